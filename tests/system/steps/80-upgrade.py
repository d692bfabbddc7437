"""A newer package: changed configuration stays, running daemons restart with the new program."""

from frames import published
from guest import CONFIG, check, is_active, main_pid, packages, run, saw, wait_until

configuration = (CONFIG / "test.toml").read_text()
profile = CONFIG / "a655sc.toml"
profile.write_text(profile.read_text() + "\n# changed by the user\n")
pid = main_pid("bolod@test")

run("dpkg", "--install", "--force-unsafe-io", "--force-confdef", "--force-confold", *packages("newer"), timeout=200)
check(run("dpkg", "--audit") == "", "dpkg --audit has something to say")
wait_until("the daemon is active", lambda: is_active("bolod@test") and is_active("bolo-fakecam"))
check(main_pid("bolod@test") != pid, "the running daemon is still the old one")
wait_until("frames", lambda: published("test") > 10)
check((CONFIG / "test.toml").read_text() == configuration, "test.toml was changed")
check("changed by the user" in profile.read_text(), "a655sc.toml lost the user's change")
check("newer package" in (CONFIG / "demo.toml").read_text(), "demo.toml, which nobody changed, is not the new one")
saw(run("dpkg-query", "-W", "-f", "${Version}", "bolo").strip() + ", daemons restarted, changes in /etc kept")

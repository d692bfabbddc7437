"""The packages install on Debian 12 with nothing but what they depend on."""

import pathlib

from guest import CONFIG, all_files, check, packages, run, saw

pathlib.Path("/var/tmp/files-before").write_text("\n".join(sorted(all_files())))
before = run("systemctl", "--failed", "--no-legend", "--plain")
run("dpkg", "--install", "--force-unsafe-io", *packages(), timeout=200)
check(run("dpkg", "--audit") == "", "dpkg --audit has something to say")
for name in ("bolo", "bolod"):
    run(name, "--version")
for file in ("a655sc.toml", "bolod.toml", "demo.toml"):
    check((CONFIG / file).is_file(), f"{CONFIG / file} is missing")
check("bolo" in run("id", "bolo"), "no user bolo")
check(pathlib.Path("/proc/sys/net/core/rmem_max").read_text().strip() == "8388608", "net.core.rmem_max is not set")
check(run("systemctl", "--failed", "--no-legend", "--plain") == before, "units failed")
installed = run("dpkg-query", "-W", "-f", "${db:Status-Status} ${Package} ${Version}\\n", "*bolo*")
saw(", ".join(line.removeprefix("installed ") for line in installed.splitlines() if line.startswith("installed ")))

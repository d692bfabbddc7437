"""Removal ends the daemons and keeps the configuration; purging leaves nothing behind."""

import pathlib
import subprocess

from guest import CONFIG, all_files, check, is_active, packages, run, saw

USERS = {"/etc/" + name for name in ("passwd-", "group-", "shadow-", "gshadow-", ".pwd.lock", "subuid-", "subgid-")}

names = [run("dpkg-deb", "-f", file, "Package").strip() for file in packages()]
drop_in = pathlib.Path("/etc/systemd/system/bolod@test.service.d/override.conf")
drop_in.parent.mkdir(exist_ok=True)
drop_in.write_text("[Service]\nNice=0\n")
run("dpkg", "--remove", *names, timeout=200)
check(not is_active("bolod@test") and not is_active("bolo-fakecam"), "daemons run on without their package")
check(subprocess.run(["pgrep", "-x", "bolod|bolo"], check=False).returncode == 1, "processes are left")
check((CONFIG / "test.toml").exists() and (CONFIG / "a655sc.toml").exists(), "removal took the configuration")
run("dpkg", "--purge", *names, timeout=200)
left = all_files() - set(pathlib.Path("/var/tmp/files-before").read_text().splitlines()) - USERS
check(not left, f"purging left {sorted(left)}")
check("no such user" in run("id", "bolo", expect=None), "purging left the user bolo")
check(run("systemctl", "--failed", "--no-legend", "--plain") == "", "units failed")
saw("removed and purged, nothing left")

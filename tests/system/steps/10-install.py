"""The packages install on Debian 12 with only their dependencies."""

import pathlib
import shutil

from guest import CONFIG, all_files, check, packages, run, saw

pathlib.Path("/var/tmp/files-before").write_text("\n".join(sorted(all_files())))
receive_buffer = pathlib.Path("/proc/sys/net/core/rmem_max")
receive_buffer.write_text("16777216")  # an administrator's larger value
before = run("systemctl", "--failed", "--no-legend", "--plain")
run("dpkg", "--install", "--force-unsafe-io", *packages(), timeout=200)
check(run("dpkg", "--audit") == "", "dpkg --audit has something to say")
for name in ("bolo", "bolod"):
    run(name, "--version")
for file in ("a655sc.toml", "bolod.toml", "demo.toml"):
    check((CONFIG / file).is_file(), f"{CONFIG / file} is missing")
check("bolo" in run("id", "bolo"), "no user bolo")
check(receive_buffer.read_text().strip() == "16777216", "net.core.rmem_max was lowered")
administrators = pathlib.Path("/etc/sysctl.d/10-network.conf")
administrators.write_text("net.core.rmem_max = 12582912\n")
run("systemctl", "restart", "systemd-sysctl")
check(receive_buffer.read_text().strip() == "12582912", "net.core.rmem_max is not what the administrator wants")
administrators.unlink()
receive_buffer.write_text("212992")
run("/var/lib/dpkg/info/bolo.postinst", "configure")
check(receive_buffer.read_text().strip() == "8388608", "net.core.rmem_max is not raised")
check(not list(pathlib.Path("/etc/modprobe.d").glob("*bolo*")), "v4l2loopback is set for all its users")
shutil.copy("/usr/share/bolo/bolo-v4l2loopback.conf", "/etc/modprobe.d")  # as in README, for later steps
check(run("systemctl", "--failed", "--no-legend", "--plain") == before, "units failed")
installed = run("dpkg-query", "-W", "-f", "${db:Status-Status} ${Package} ${Version}\\n", "*bolo*")
saw(", ".join(line.removeprefix("installed ") for line in installed.splitlines() if line.startswith("installed ")))

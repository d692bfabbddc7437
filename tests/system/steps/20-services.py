"""A fake camera and a daemon come up as units, as they would in the vehicle, and frames flow.

Everything is small here, since the machine is slow: 64x24 pixels, 12.5 frames a second, the camera's least. Automatic
lambda makes its tables with floating-point arithmetic, which QEMU emulates in software: a quarter of a second is a minute.
"""

import pathlib
import time

from frames import published
from guest import CONFIG, check, is_active, restarts, run, saw, show, stat, wait_until

# Commands of the shipped unit, with a smaller and slower camera.
SMALLER = {"--frames 800": "--width 64 --height 24 --rate 12.5 --tau 0.06 --frames 150", "--rate 200": "--rate 12.5"}
CONFIGURATION = """name = "test"

[source]
address = "127.0.0.1"
width = 64
height = 24
rate_hz = 12.5

[deblur]
tau_s = 0.06
window = 9
lambda = 0.001
workers = 1

[shm]
slots = 1024
group = "readers"

[v4l2]
enable = true

[metrics]
enable = true

[ros2]
enable = true
"""

settings = pathlib.Path("/etc/systemd/system/bolo-fakecam.service.d/small.conf")
settings.parent.mkdir(parents=True)
camera = "[Service]\nExecStartPre=\nExecStart=\n"
for line in pathlib.Path("/usr/lib/systemd/system/bolo-fakecam.service").read_text().splitlines():
    if line.startswith("ExecStart"):
        large, small = next(pair for pair in SMALLER.items() if pair[0] in line)
        camera += line.replace(large, small) + "\n"
settings.write_text(camera)
(CONFIG / "test.toml").write_text(CONFIGURATION)
run("groupadd", "--system", "readers")
run("usermod", "--append", "--groups", "readers", "bolo")
run("systemctl", "daemon-reload")
run("bolod", "--check-config", "--config", str(CONFIG / "test.toml"))

# The check refuses what a start refuses, and systemd does not retry it.
(CONFIG / "wrong.toml").write_text('name = "wrong"\n[shm]\nmode = 0o666\n')
run("bolod", "--check-config", "--config", str(CONFIG / "wrong.toml"), expect=2)
run("systemctl", "start", "bolod@wrong", expect=1)
time.sleep(3.0)  # longer than RestartSec
check(show("bolod@wrong", "ActiveState")["ActiveState"] == "failed", "a wrong file is tried again")
check(restarts("bolod@wrong") == 0, f"a wrong file was tried {restarts('bolod@wrong')} times more")
run("systemctl", "reset-failed", "bolod@wrong")
(CONFIG / "wrong.toml").unlink()

start = time.monotonic()
run("systemctl", "start", "bolo-fakecam")
run("systemctl", "enable", "--now", "bolod@test")
check(is_active("bolo-fakecam") and is_active("bolod@test"), "the units are not active")
wait_until("30 frames published", lambda: published("test") >= 30)
saw(f"30 frames {time.monotonic() - start:.1f} s after the start of both units")
now = stat("test")
check(now["lost_total"] == 0, f"frames were lost: {now['lost']}")
check(now["camera"]["state"] == "streaming", f"the camera is {now['camera']['state']}")
saw(f"{now['published_hz']:.1f} frames/s, none lost, {now['solver']}")

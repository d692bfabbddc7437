"""The same process reconnects to a camera that returns; a daemon may start long before its camera."""

import time

from frames import published
from guest import check, is_active, main_pid, restarts, run, saw, stat, wait_until

UNIT = "bolod@test"
pid = main_pid(UNIT)
run("systemctl", "stop", "bolo-fakecam")
wait_until("the camera is lost", lambda: stat("test")["camera"]["state"] == "lost")
time.sleep(12.0)  # longer than the watchdog's timeout
check(is_active(UNIT) and main_pid(UNIT) == pid, "the daemon did not stay up without its camera")
before = published("test")
start = time.monotonic()
run("systemctl", "start", "bolo-fakecam")
wait_until("frames", lambda: published("test") > before)
saw(f"frames {time.monotonic() - start:.1f} s after the camera's start, same process")
check(main_pid(UNIT) == pid, "the daemon was restarted")
wait_until("full windows", lambda: published("test") > before + 10)

run("systemctl", "stop", UNIT, "bolo-fakecam")
run("systemctl", "start", "--no-block", UNIT)
count = restarts(UNIT)
wait_until("several attempts without a camera", lambda: restarts(UNIT) >= count + 3, limit_s=90.0)
run("systemctl", "start", "bolo-fakecam")
wait_until("the daemon is active", lambda: is_active(UNIT), limit_s=60.0)
wait_until("full windows", lambda: published("test") > 10)
saw("a daemon started before its camera finds it")

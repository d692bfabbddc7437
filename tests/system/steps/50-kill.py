"""A killed or hung daemon is back within seconds; its readers and its video device follow."""

import os
import signal
import threading
import time

import bolo
from frames import open_ring, published
from guest import check, is_active, main_pid, restarts, run, saw, show, wait_until

UNIT = "bolod@test"
# Promises for a real computer; QEMU's emulation is 12 to 30 times slower, mostly at starting programs.
PROMISED_S = 2.0
LIMIT_S = PROMISED_S * (1 if run("systemd-detect-virt", expect=None).strip() == "kvm" else 5)


def frames_after(what: str, ring, start_ns: int) -> float:
    """Waits for another writer's first frame and full windows; returns the time to the frame, s."""
    other = open_ring("test", limit_s=60.0, other_than=ring.inode)
    first = other.frame(0)
    seconds = (first["publish_ns"] if first else time.monotonic_ns()) - start_ns
    saw(f"{what}: first frame again after {seconds / 1e9:.1f} s")
    wait_until("the unit is active again", lambda: is_active(UNIT))
    wait_until("full windows", lambda: published("test") > 10)
    return seconds / 1e9


def follow() -> None:
    """A reader that is never restarted."""
    with bolo.Camera("test", timeout=5) as camera:
        for frame in camera:
            seen.append(frame.number)
            if enough.is_set():
                return


seen: list[int] = []
enough = threading.Event()
reader = threading.Thread(target=follow, daemon=True)
reader.start()
wait_until("the reader reads", lambda: seen)
video_format = run("v4l2-ctl", "-d", "/dev/video10", "--get-fmt-video")

count = restarts(UNIT)
ring = open_ring("test")
pid = main_pid(UNIT)
start_ns = time.monotonic_ns()
os.kill(pid, signal.SIGKILL)
took_s = frames_after("SIGKILL", ring, start_ns)
check(took_s <= LIMIT_S, f"frames {took_s:.1f} s after SIGKILL; {LIMIT_S:g} s are allowed here")
check(restarts(UNIT) == count + 1 and main_pid(UNIT) != pid, "not restarted once")

watchdog_s = float(show(UNIT, "WatchdogUSec")["WatchdogUSec"].removesuffix("s"))
ring = open_ring("test")
pid = main_pid(UNIT)
start_ns = time.monotonic_ns()
os.kill(pid, signal.SIGSTOP)
frames_after(f"SIGSTOP, watchdog {watchdog_s:g} s", ring, start_ns)
check(restarts(UNIT) == count + 2 and main_pid(UNIT) != pid, "not restarted by the watchdog")

enough.set()
reader.join()
beginnings = sum(after < before for before, after in zip(seen, seen[1:]))
check(beginnings == 2, f"the reader followed {beginnings} of two new writers")
check(run("v4l2-ctl", "-d", "/dev/video10", "--get-fmt-video") == video_format, "the video device's format changed")
run("systemctl", "status", "--no-pager", UNIT)
saw("a reader followed both times without being restarted")

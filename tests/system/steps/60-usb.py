"""A camera on USB: listed, reported, open to its group, streamed byte for byte, unplugged and plugged in again."""

import json
import pathlib
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import usb_camera
from frames import digest, open_ring, published
from guest import CONFIG, check, is_active, main_pid, run, saw, stat, wait_until

CONFIGURATION = f"""name = "usb"

[source]
type = "usb"
width = {usb_camera.WIDTH}
height = {usb_camera.HEIGHT}
rate_hz = 10

[usb]
device = "09cb:1007"
interface = 0
alternate_setting = 1
endpoint = 0x81
start = "41 01 0000 0000"
stop = "41 02 0000 0000"
header_bytes = {usb_camera.HEADER_BYTES}
magic = "424f4c4f"
counter_offset = 4
counter_bytes = 4

[deblur]
tau_s = 0.06
window = 9
workers = 1

[shm]
slots = 512
"""
CAMERA = "usb-camera.service"


def plug(serial: str, first: int) -> None:
    program = str(pathlib.Path(__file__).parent / "usb_camera.py")
    run("systemd-run", "--quiet", f"--unit={CAMERA}", "python3", program, "--serial", serial, "--first", str(first))
    wait_until("the kernel knows the camera", lambda: listed() and listed()[0]["serial"] == serial)


def listed() -> list[dict]:
    return json.loads(run("bolo", "usb", "--json"))["devices"]


def check_frames(least: int, before: int, first: int) -> int:
    """Frames published after `before` are those that the camera sent from `first` on. Returns how many."""
    wait_until(f"{least} frames", lambda: published("usb") >= before + least)
    ring = open_ring("usb")
    seen = [frame["raw"] for number in range(before, ring.published()) if (frame := ring.frame(number))]
    sent = {digest(usb_camera.pixels(number)): number for number in range(first, first + 10 * len(seen))}
    numbers = [sent.get(digest(raw)) for raw in seen]
    check(None not in numbers, f"frames that the camera did not send, among {numbers}")
    check(numbers == sorted(set(numbers)), f"frames not in their order: {numbers}")
    return len(numbers)


run("modprobe", "vhci_hcd")
plug("V-1", first=0)
check("09cb:1007" in run("lsusb"), "lsusb does not list the camera")
device = listed()[0]
report = run("bolo", "usb", "--report")
check("0x81" in report and "Virtual A655sc" in report, "the report lacks the endpoint or the strings")
node = pathlib.Path(device["node"])
check(node.group() == "video" and node.stat().st_mode & 0o777 == 0o660, f"{node} is not for the group video")
saw(f"{device['port']} {device['speed']}, {node} for the group video")

(CONFIG / "usb.toml").write_text(CONFIGURATION)
run("systemctl", "start", "bolod@usb")
compared = check_frames(40, before=0, first=0)
now = stat("usb")
saw(f"{compared} frames byte for byte as sent, lost {now['lost_total']}")

pid = main_pid("bolod@usb")
run("systemctl", "stop", CAMERA)
wait_until("the daemon sees that the camera is gone", lambda: stat("usb")["camera"]["state"] == "lost")
before = published("usb")
start = time.monotonic()
plug("V-1", first=100_000)
wait_until("frames after plugging in", lambda: published("usb") > before)
back_s = time.monotonic() - start
compared = check_frames(20, before=before, first=100_000)
check(is_active("bolod@usb") and main_pid("bolod@usb") == pid, "the daemon was restarted")
saw(f"unplugged and plugged in: frames after {back_s:.1f} s, {compared} compared, same process")
run("systemctl", "stop", "bolod@usb", CAMERA)

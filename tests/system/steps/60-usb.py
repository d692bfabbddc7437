"""A USB camera: listing, report, group access, unplugging and plugging in."""

import json
import pathlib
import signal
import subprocess

from guest import check, run, saw, wait_until

CAMERA = "usb-camera.service"


def plug(serial: str) -> None:
    program = str(pathlib.Path(__file__).parent / "usb_camera.py")
    run("systemd-run", "--quiet", f"--unit={CAMERA}", "python3", program, "--serial", serial)
    wait_until("the kernel knows the camera", lambda: listed() and listed()[0]["serial"] == serial)


def listed() -> list[dict]:
    return json.loads(run("bolo", "usb", "--json"))["devices"]


def next_event(watch: subprocess.Popen) -> str:
    return json.loads(watch.stdout.readline())["event"]


run("modprobe", "vhci_hcd")
plug("V-1")
check("09cb:1007" in run("lsusb"), "lsusb does not list the camera")
device = listed()[0]
report = run("bolo", "usb", "--report")
check("0x81" in report and "Virtual A655sc" in report, "the report lacks the endpoint or the strings")
node = pathlib.Path(device["node"])
check(node.group() == "video" and node.stat().st_mode & 0o777 == 0o660, f"{node} is not for the group video")
saw(f"{device['port']} {device['speed']}, {node} for the group video")

with subprocess.Popen(["bolo", "usb", "--watch", "--json"], stdout=subprocess.PIPE, text=True) as watch:
    events = [next_event(watch)]
    run("systemctl", "stop", CAMERA)
    events.append(next_event(watch))
    plug("V-2")
    events.append(next_event(watch))
    watch.send_signal(signal.SIGINT)
check(events == ["arrived", "left", "arrived"], f"bolo usb --watch printed {events}")
saw("unplugged and plugged in: seen by bolo usb --watch")
run("systemctl", "stop", CAMERA)

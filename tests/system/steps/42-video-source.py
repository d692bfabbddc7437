"""A daemon uses a video device as its camera: receives the first daemon's output through v4l2loopback byte by byte,
with the kernel's time stamps, and recovers when the device's writer returns.
"""

import pathlib
import signal
import subprocess
import time

from frames import Recorder, digest, open_ring, published
from guest import check, run, saw, stat, wait_until

CONFIGURATION = """name = "second"

[source]
type = "v4l2"
device = "/dev/video10"

[deblur]
tau_s = 0.06
window = 9
lambda = 0.001
workers = 1

[shm]
slots = 256

[control]
enable = false
"""

config = pathlib.Path("/tmp/second.toml")
config.write_text(CONFIGURATION)
run("bolod", "--check-config", "--config", str(config))
first = Recorder("test")
time.sleep(1.0)  # the device may still hold older frames
log = open("/tmp/second.log", "w")
daemon = subprocess.Popen(["bolod", "--config", str(config)], stdout=log, stderr=log)
try:
    wait_until("frames of the video device", lambda: published("second") >= 20)
    ring = open_ring("second")
    frames = [frame for number in range(5, 20) if (frame := ring.frame(number)) is not None]
    wait_until("the last of them in the first one's recording", lambda: digest(frames[-1]["raw"]) in first.deblurred)
    first.stop()
    numbers = [first.deblurred.get(digest(frame["raw"])) for frame in frames]
    print(numbers)
    check(len(frames) == 15 and None not in numbers, f"it reads frames that were not written: {numbers}")
    check(numbers == sorted(numbers), f"they come out of order: {numbers}")
    state = stat("second")
    check(state["camera"]["state"] == "streaming", f"the camera is {state['camera']['state']}")
    saw(f"15 frames byte for byte, of {numbers[-1] - numbers[0] + 1} written; {state['camera_model']}, lost {state['lost_total']}")

    # The writer stops and returns: no frames in between.
    run("systemctl", "stop", "bolod@test")
    wait_until("a camera that stalls", lambda: stat("second")["camera"]["state"] in ("stalled", "lost"))
    run("systemctl", "start", "bolod@test")
    wait_until("the writer", lambda: published("test") >= 5)
    before = published("second")
    took = wait_until("frames again", lambda: published("second") >= before + 10)
    state = stat("second")["camera"]
    saw(f"a writer that went: lost {sum(state['lost'].values())}, opened again {state['reopened']} times; frames {took:.1f} s after it was back")
finally:
    daemon.send_signal(signal.SIGTERM)
    ended = daemon.wait(20)
    print(pathlib.Path("/tmp/second.log").read_text())
check(ended == 0, f"it ended with {ended}")

# Unsupported formats.
config.write_text(CONFIGURATION.replace("[deblur]", 'rows = [20, 8]\n[deblur]'))
text = run("bolod", "--config", str(config), expect=2)
check("its frames have 24 rows" in text, "the refusal does not say why")
for left in (config, pathlib.Path("/tmp/second.log")):
    left.unlink()

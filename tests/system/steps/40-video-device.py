"""Three programs that know nothing of Bolo read /dev/video10 and see the planes of the shared memory.

One after the other: v4l2loopback 0.12.7 has one set of buffers, and concurrent readers disturb each other (ffmpeg ends
with "ioctl(VIDIOC_DQBUF): Invalid argument").
"""

import pathlib
import signal
import subprocess
import time

from frames import Recorder, digest, published
from guest import check, run, saw, wait_until

DEVICE = "/dev/video10"
FRAMES = 25
BYTES = 64 * 24 * 2


def readers(frames: int) -> dict[str, list[str]]:
    """Each writes the pixels of this many frames to /tmp/NAME.raw."""
    count = str(frames)
    return {
        "v4l2-ctl": ["v4l2-ctl", "-d", DEVICE, "--stream-mmap", f"--stream-count={count}", "--stream-to=/tmp/v4l2-ctl.raw"],
        "ffmpeg": [
            *("ffmpeg", "-nostdin", "-hide_banner", "-loglevel", "warning", "-y"),
            *("-f", "v4l2", "-input_format", "gray16le", "-i", DEVICE, "-frames:v", count, "-fps_mode", "passthrough"),
            *("-f", "rawvideo", "-pix_fmt", "gray16le", "/tmp/ffmpeg.raw"),
        ],
        "gstreamer": [
            *("gst-launch-1.0", "-q", "v4l2src", f"device={DEVICE}", f"num-buffers={count}"),
            *("!", "video/x-raw,format=GRAY16_LE", "!", "filesink", "location=/tmp/gstreamer.raw"),
        ],
    }


def check_frames(name: str, recorder: Recorder) -> None:
    """The file's frames are consecutive deblurred planes of the shared memory."""
    file = pathlib.Path(f"/tmp/{name}.raw")
    content = file.read_bytes()
    file.unlink()
    check(len(content) == FRAMES * BYTES, f"{name} wrote {len(content)} bytes, not {FRAMES} frames of {BYTES}")
    frames = [content[start : start + BYTES] for start in range(0, len(content), BYTES)]
    numbers = [recorder.deblurred.get(digest(frame)) for frame in frames]
    print(name, numbers)
    check(None not in numbers, f"{name} saw frames that are not in shared memory: {numbers}")
    # The capture is looped: a frame that the recorder missed is matched to the previous loop.
    turn = next((i for i in range(1, FRAMES) if numbers[i] < numbers[i - 1]), 0)
    in_order = numbers[turn:] + numbers[:turn]
    check(in_order == sorted(in_order), f"{name} saw frames out of order: {numbers}")
    saw(f"{name}: {len(set(numbers))} frames byte for byte")


info = run("v4l2-ctl", "-d", DEVICE, "--info")
check("v4l2 loopback" in info, f"{DEVICE} is no loopback device")
pixel_format = run("v4l2-ctl", "-d", DEVICE, "--get-fmt-video")
check("'Y16 '" in pixel_format and "64/24" in pixel_format, "the device has not the daemon's format")

recorder = Recorder("test")
time.sleep(1.0)  # the device may still hold older frames
for command in readers(FRAMES).values():
    run(*command)
recorder.stop()
for name in readers(FRAMES):
    check_frames(name, recorder)

# A reader that stops reading blocks nothing.
stuck = subprocess.Popen(readers(10_000)["v4l2-ctl"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
time.sleep(2.0)
stuck.send_signal(signal.SIGSTOP)
before = published("test")
wait_until("20 frames beside a stuck reader of the device", lambda: published("test") >= before + 20)
stuck.kill()
run(*readers(FRAMES)["gstreamer"])
for file in pathlib.Path("/tmp").glob("*.raw"):
    file.unlink()
saw("a reader that stops reading holds up neither the daemon nor the next reader")

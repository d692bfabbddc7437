"""Frames in shared memory are readable by the configured group only."""

import pathlib
import stat
import subprocess
import time

import bolo
import numpy as np
from frames import open_ring
from guest import check, run, saw

ring = open_ring("test")
first = ring.published()
time.sleep(4.0)
last = ring.published()
frames = [ring.frame(number) for number in range(first, last)]
check(all(frames), "frames within the ring are not whole")
ids = [frame["frame_id"] for frame in frames]
check(ids == list(range(ids[0], ids[0] + len(ids))), f"frame ids are not consecutive: {ids}")
check(all((frame["raw"] != frame["deblurred"]).any() for frame in frames), "deblurred planes equal the raw ones")
saw(f"{len(ids)} consecutive frames in 4 s, {ring.width}x{ring.height}")

# libbolo-client, through python3-bolo, agrees with the independent reader.
with bolo.Camera("test", timeout=5) as camera:
    for frame, _ in zip(camera, range(20)):
        own = ring.frame(frame.number)
        check(np.array_equal(frame.raw.ravel(), own["raw"]), f"python3-bolo reads another raw frame {frame.number}")
        check(np.array_equal(frame.deblurred.ravel(), own["deblurred"]), f"and another deblurred frame {frame.number}")
        check(frame.valid(), f"frame {frame.number} is gone at once")
saw("python3-bolo reads the same 20 frames")

place = pathlib.Path("/dev/shm/bolo.test")
is_for = (place.owner(), place.group(), stat.filemode(place.stat().st_mode))
check(is_for == ("bolo", "readers", "-rw-r-----"), f"shared memory is {is_for}")
lock = pathlib.Path("/dev/shm/bolo-lock.test")
check(stat.filemode(lock.stat().st_mode) == "-rw-------", "readers can open what the daemon locks")

run("useradd", "--system", "--groups", "readers", "viewer")
run("useradd", "--system", "stranger")
for user, expected in (("viewer", 0), ("stranger", None)):
    as_user = ["setpriv", f"--reuid={user}", f"--regid={user}", "--init-groups"]
    done = subprocess.run([*as_user, "bolo", "stat", "test", "--once"], capture_output=True, text=True, check=False)
    print(user, done)
    check((done.returncode == 0) == (expected == 0), f"bolo stat as {user} ended with {done.returncode}")
    if expected is None:
        check(done.stderr.count("\n") == 1, "a stranger is not told in one line why")
        saw(f"a stranger is told: {done.stderr.strip()}")

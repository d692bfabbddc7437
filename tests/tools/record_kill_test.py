"""Recordings that are killed open, in Bolo and in h5py, and lost at most a second.

usage: record_kill_test.py BOLO [KILLS]. `bolo replay` is the daemon. Exit code 77: h5py isn't there.
"""

import json
import os
import random
import signal
import struct
import subprocess
import sys
import tempfile
import time

try:
    import h5py
    import numpy as np
except ImportError:
    print("skipped: python3-h5py is not installed")
    sys.exit(77)

WIDTH, HEIGHT, RATE = (int(v) for v in os.environ.get("BOLO_KILL_FORMAT", "64,24,200").split(","))


def write_capture(path):
    count = 50
    with h5py.File(path, "w") as f:
        f.attrs.update({"format": "bolo-capture", "version": 1, "unit": "kelvin", "scale": 0.01, "offset": 0.0,
                        "frame_period_s": 1 / RATE, "camera_model": "m", "camera_serial": "s", "row_step": 1})
        frames = np.full((count, HEIGHT, WIDTH), 29800, dtype=np.uint16)
        frames += np.arange(count, dtype=np.uint16)[:, None, None]
        f.create_dataset("frames", data=frames, chunks=(1, HEIGHT, WIDTH))
        f["t"] = np.arange(count) / RATE
        f["frame_id"] = np.arange(count, dtype=np.uint64)


def newest(name):
    """The newest frame's id in the shared memory, and how many frames were lost before it; shm_layout.h has the bytes."""
    with open(f"/dev/shm/bolo.{name}", "rb") as f:
        header = f.read(2048).ljust(2048, b"\0")
        slot_count, = struct.unpack_from("<I", header, 24)
        slots_offset, slot_stride = struct.unpack_from("<QQ", header, 32)
        published, = struct.unpack_from("<Q", header, 320)
        if slot_count == 0 or published == 0:
            return 0, 0
        f.seek(slots_offset + (published - 1) % slot_count * slot_stride + 8)
        return int.from_bytes(f.read(8), "little"), sum(struct.unpack_from("<16Q", header, 384))


def wait_for(condition, what):
    end = time.monotonic() + 60
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"{what} did not come")
        time.sleep(0.01)


def kill_one(bolo, name, folder, dice):
    """Seconds of frames lost by killing a recording at a random moment."""
    out = os.path.join(folder, "a.h5")
    part = out + ".part"
    recorder = subprocess.Popen([bolo, "record", name, "-o", out])
    wait_for(lambda: os.path.exists(part), "the recording's file")
    time.sleep(dice.uniform(0.7, 2.0))
    newest_id, lost_before = newest(name)
    recorder.send_signal(signal.SIGKILL)
    recorder.wait()
    with h5py.File(part, "r") as f:
        count = min(len(f["t"]), len(f["frame_id"]), len(f["frames"]))
        assert count > 0
        ids = f["frame_id"][:count]
        first = f["frames"][0, 0, 0]
        last = f["frames"][count - 1]
    assert lost_before > 0 or (np.diff(ids.astype(np.int64)) == 1).all(), "frames are missing in between"
    assert (last == 29800 + ids[-1] % 50).all() and first == 29800 + ids[0] % 50
    told = json.loads(subprocess.run([bolo, "info", part, "--json"], capture_output=True, check=True, text=True).stdout)
    assert told["frames"] == count and not told["warnings"], told
    done = subprocess.run([bolo, "recover", part, "--json"], capture_output=True, check=True, text=True)
    assert json.loads(done.stdout)["frames"] == count, done.stdout
    for name_ in (out, part, part + ".journal"):
        os.remove(name_)
    return (newest_id - int(ids[-1])) / RATE


def main(bolo, kills):
    dice = random.Random(kills)
    name = f"test-kill-{os.getpid()}"
    with tempfile.TemporaryDirectory() as folder:
        capture = os.path.join(folder, "in.h5")
        write_capture(capture)
        daemon = subprocess.Popen([bolo, "replay", capture, "--name", name, "--loop"], stderr=subprocess.DEVNULL)
        try:
            wait_for(lambda: os.path.exists(f"/dev/shm/bolo.{name}") and newest(name)[0] > 0, "the daemon")
            lost = [kill_one(bolo, name, folder, dice) for _ in range(kills)]
        finally:
            daemon.terminate()
            daemon.wait()
    print(f"{kills} kills: every file opened; lost at most {max(lost):.3f} s, {sum(lost) / kills:.3f} s on average")
    assert max(lost) <= 1.0, lost


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 3)

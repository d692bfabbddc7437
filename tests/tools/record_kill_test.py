"""Recordings killed while open in Bolo and in h5py lose at most a second, however long syncs take.

usage: record_kill_test.py BOLO SLOW_SYNC [KILLS]. `bolo replay` is the daemon; SLOW_SYNC is the library of
slow_sync.cpp. Exit code 77: h5py isn't there.
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

from programs import Programs, needed, run, wait_for

h5py, np = needed("h5py", "numpy")
WIDTH, HEIGHT, RATE = (int(v) for v in os.environ.get("BOLO_KILL_FORMAT", "64,24,200").split(","))


def newest(name):
    """Newest frame id in shared memory, and frames lost before it; offsets from shm_layout.h."""
    with open(f"/dev/shm/bolo.{name}", "rb") as f:
        header = f.read(2048).ljust(2048, b"\0")
        slot_count, = struct.unpack_from("<I", header, 24)
        slots_offset, slot_stride = struct.unpack_from("<QQ", header, 32)
        published, = struct.unpack_from("<Q", header, 320)
        if slot_count == 0 or published == 0:
            return 0, 0
        f.seek(slots_offset + (published - 1) % slot_count * slot_stride + 8)
        return int.from_bytes(f.read(8), "little"), sum(struct.unpack_from("<16Q", header, 384))


def expect_last_applied(part, told):
    """h5py reads the last durable commit, or, if killed during one, the previous."""
    with h5py.File(part, "r") as f:
        seen = len(f["frames"])
    assert told["frames"] - RATE <= seen, ("h5py opens an old state", seen, told["frames"])


def expect_whole(out, told, lost_before, capture):
    """Last frame id of the recovered capture."""
    with h5py.File(out, "r") as f, h5py.File(capture, "r") as played:
        planes = played["frames"][:]
        lengths = {len(f[name]) for name in ("frames", "t", "frame_id")}
        assert lengths == {told["frames"]}, (lengths, told["frames"])
        ids = f["frame_id"][:].astype(np.int64)
        first, last = f["frames"][0], f["frames"][len(ids) - 1]
    steps = np.diff(ids)
    assert lost_before > 0 or (steps == 1).all(), ("frames are missing in between", steps[steps != 1])
    for number, frame in ((ids[0], first), (ids[-1], last)):
        assert (frame == planes[number % len(planes)]).all(), ("wrong pixels", number)
    return int(ids[-1])


def size_of(file):
    return os.path.getsize(file) if os.path.exists(file) else 0


def kill_one(bolo, name, folder, capture, dice, disk):
    """Seconds of frames lost by killing a recording at a random moment."""
    out = os.path.join(folder, "a.h5")
    part = out + ".part"
    recorder = subprocess.Popen([bolo, "record", name, "-o", out], env=dict(os.environ, **disk))
    # A busy machine may take long until the first commit, from which the promise holds.
    wait_for(lambda: os.path.exists(part) and size_of(part + ".live") > 0, "the recording's first commit")
    time.sleep(dice.uniform(0.7, 2.0) + (dice.uniform(0, 3.0) if disk else 0))
    newest_id, lost_before = newest(name)
    recorder.send_signal(signal.SIGKILL)
    recorder.wait()
    told = json.loads(run(bolo, "info", part, "--json"))
    assert told["frames"] > 0 and not told["warnings"], told
    if not disk:
        expect_last_applied(part, told)
    saved = json.loads(run(bolo, "recover", part, "--json"))["frames"]
    assert saved == told["frames"], ("recovered another number of frames", saved, told["frames"])
    last_id = expect_whole(out, told, lost_before, capture)
    for name_ in os.listdir(folder):
        if name_.startswith("a.h5"):
            os.remove(os.path.join(folder, name_))
    return (newest_id - last_id) / RATE


def kill_many(kills, disk_text, *how):
    lost = [kill_one(*how) for _ in range(kills)]
    text = (f"{kills} kills, {disk_text}: every file opened; "
            f"lost at most {max(lost):.3f} s, {sum(lost) / kills:.3f} s on average")
    print(text)
    assert max(lost) <= 1.0, text


def main(bolo, slow_sync, kills):
    dice = random.Random(kills)
    name = f"test-kill-{os.getpid()}"
    low, high = (int(v) for v in os.environ.get("BOLO_SLOW_SYNC_MS", "700,1500").split(","))
    slow = {"LD_PRELOAD": slow_sync, "BOLO_SLOW_SYNC_MS": f"{low},{high}",
            "ASAN_OPTIONS": "verify_asan_link_order=0"}
    with tempfile.TemporaryDirectory() as folder, Programs(bolo, None, folder, name, (WIDTH, HEIGHT)) as programs:
        capture = programs.simulate("--rate", RATE, "--frames", 50)
        programs.start_replay(capture)
        wait_for(lambda: os.path.exists(f"/dev/shm/bolo.{name}") and newest(name)[0] > 0, "the daemon")
        kill_many(kills, "this disk", bolo, name, folder, capture, dice, {})
        kill_many(kills, f"syncs of {low} to {high} ms", bolo, name, folder, capture, dice, slow)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]) if len(sys.argv) > 3 else 3)

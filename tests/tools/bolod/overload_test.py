"""Overload by stolen processor time: quality is reduced before a frame is lost, every loss is counted, and each frame's
flags state its quality level.

usage: overload_test.py BOLO MODULE_FOLDER LIBRARY [SECONDS]. A daemon of 640x120 pixels at 200 Hz shares one processor
with more and more competing programs, for SECONDS each. Prints a table. Exit code 77: numpy or a second processor is
not there.
"""

import collections
import json
import multiprocessing
import os
import pathlib
import subprocess
import sys
import tempfile
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
from programs import needed, run  # noqa: E402

needed("numpy")  # of the module
BOLO, MODULE_FOLDER, LIBRARY = sys.argv[1:4]
SECONDS = float(sys.argv[4]) if len(sys.argv) > 4 else 3.0
os.environ["BOLO_CLIENT_LIBRARY"] = LIBRARY
sys.path.insert(0, MODULE_FOLDER)

import bolo  # noqa: E402

QUEUE_FRAMES = 64  # the default
MOST_LOST = 0.05
# Among 40 competing programs a thread has 5 ms / 41 = 0.12 ms per frame: hardly enough to pass on a raw frame, on some
# machines too little. More losses are then allowed, as long as most other frames are passed on raw.
HOPELESS = 40
COMPETITORS = (0, 1, 3, 8, 20, HOPELESS, 0)
EFFORTS = {bolo.Flag.REDUCED: "reduced", bolo.Flag.INVERSE: "inverse", bolo.Flag.RAW: "raw"}
ANY_EFFORT = bolo.Flag.REDUCED | bolo.Flag.INVERSE | bolo.Flag.RAW


def burn(processor, seconds):
    os.sched_setaffinity(0, {processor})
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        pass


def follow(name, seen, stop):
    """Counts frames by quality level until the stream ends."""
    with bolo.Camera(name, timeout=30) as camera:
        while not stop.is_set():
            frame = camera.next(1.0)
            if frame is None:
                continue
            seen["missed"] += frame.missed
            assert bin(frame.flags & ANY_EFFORT).count("1") <= 1, frame.flags
            if not frame.flags & bolo.Flag.WARM_UP:
                seen[EFFORTS.get(frame.flags & ANY_EFFORT, "full")] += 1


def stat(name):
    return json.loads(run(BOLO, "stat", name, "--once", "--json", "--interval", "0.1"))


def judge(rows):
    """Each row: number of competitors, frames lost, frames by quality level.

    A frame may be lost only if raw frames are passed on in the same row or a neighbouring one, for which a queue must
    be half full. Quality falls with the available time: raw frames come only after reduced ones.
    """
    for i, (competitors, lost, _) in enumerate(rows):
        raw = sum(rise["raw"] for _, _, rise in rows[max(0, i - 1) : i + 2])
        assert lost == 0 or raw > 0, f"{competitors} competitors: {lost} lost, and no frame was passed on as it came"
    spared_first = next((i for i, (_, _, rise) in enumerate(rows) if rise["reduced"] + rise["inverse"] > 0), len(rows))
    raw_first = next((i for i, (_, _, rise) in enumerate(rows) if rise["raw"] > 0), len(rows))
    assert spared_first <= raw_first, "frames were passed on as they came before less was spent on one"
    hopeless = next((lost, rise) for competitors, lost, rise in rows if competitors == HOPELESS)
    others = [(lost, rise) for competitors, lost, rise in rows if competitors != HOPELESS]
    lost, done = sum(lost for lost, _ in others), sum(sum(rise.values()) for _, rise in others)
    assert lost <= done * MOST_LOST, f"{lost} frames lost of {done + lost}: sparing does not keep up"
    lost, rise = hopeless
    done = sum(rise.values())
    most_spared = rise["full"] + rise["reduced"] <= done * MOST_LOST and rise["raw"] >= done / 2
    assert lost <= done * MOST_LOST or most_spared, f"{lost} frames lost of {done + lost}, with sparing left to do: {rise}"


def main():
    processors = sorted(os.sched_getaffinity(0))
    if len(processors) < 2:
        print("skipped: one processor only")
        return 77
    os.sched_setaffinity(0, set(processors[:-1]))
    name = f"test-overload-{os.getpid()}"
    seen, stop = collections.Counter(), threading.Event()
    with tempfile.TemporaryDirectory() as folder:
        capture = os.path.join(folder, "in.h5")
        run(BOLO, "simulate", "-o", capture, "--frames", 60)
        os.environ["RUNTIME_DIRECTORY"] = folder  # for the daemon's control socket
        config = os.path.join(folder, "overload.toml")
        with open(config, "w") as f:
            f.write(f"name = '{name}'\n")
        daemon = subprocess.Popen(["taskset", "-c", str(processors[-1]), BOLO, "replay", capture, "--config", config, "--loop"],
                                  stderr=subprocess.DEVNULL)
        try:
            reader = threading.Thread(target=follow, args=(name, seen, stop))
            reader.start()
            time.sleep(2.0)
            print(f"{'competitors':>11} {'in /s':>7} {'out /s':>7} {'lost':>6} {'full':>6} {'reduced':>8} {'inverse':>8} {'raw':>6}")
            rows = []
            for competitors in COMPETITORS:
                rivals = [multiprocessing.Process(target=burn, args=(processors[-1], SECONDS + 1))
                          for _ in range(competitors)]
                for rival in rivals:
                    rival.start()
                before, begin = stat(name), time.monotonic()
                time.sleep(SECONDS)
                after, took = stat(name), time.monotonic() - begin
                for rival in rivals:
                    rival.join()
                rise = {e: after["effort"]["frames"][e] - before["effort"]["frames"][e] for e in after["effort"]["frames"]}
                rows.append((competitors, after["lost_total"] - before["lost_total"], rise))
                print(f"{competitors:11} {(after['received'] - before['received']) / took:7.1f} "
                      f"{(after['published'] - before['published']) / took:7.1f} {after['lost_total'] - before['lost_total']:6} "
                      f"{rise['full']:6} {rise['reduced']:8} {rise['inverse']:8} {rise['raw']:6}", flush=True)
            limit = time.monotonic() + 60  # time for a machine in shared use
            while stat(name)["effort"]["now"] != "full":
                assert time.monotonic() < limit, "all is not spent again"
            while_read = stat(name)["effort"]["frames"]
            stop.set()
            reader.join()
            last = stat(name)
        finally:
            daemon.terminate()
            daemon.wait()
    told, lost = last["effort"]["frames"], {cause: n for cause, n in last["lost"].items() if n}
    print(f"flags seen: {dict(seen)}; counted by the daemon: {told}; lost: {lost or 'none'}")
    assert told["reduced"] + told["inverse"] + told["raw"] > 0, "nothing was spared"
    judge(rows)
    for effort in EFFORTS.values():
        # The reader saw what the daemon counted during the reading, and nothing that it did not count by the end.
        assert while_read[effort] - seen["missed"] <= seen[effort] <= told[effort], effort
    assert lost.keys() <= {"pool_exhausted", "queue_full"}, lost
    assert last["published"] <= last["received"] <= last["published"] + QUEUE_FRAMES, last
    return 0


if __name__ == "__main__":
    sys.exit(main())

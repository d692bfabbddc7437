"""Checks all interleavings of the lock-free protocols with the model checker spin: no error in what is built, and an
error in each deliberately broken variant, which shows that the models detect it.

usage: check_models.py [MODEL...]. Exit code 77: spin or gcc isn't there.
"""

import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).parent

# By model: definitions under which it must hold, and those under which it must fail.
MODELS = {
    "ring": (
        ["", "FRAMES=4", "FRAMES=4 SLOTS=2", "BORROW", "BORROW FRAMES=4 SLOTS=2", "W3=RELAXED", "R1=RELAXED", "W4=RELAXED"],
        ["W2=RELAXED", "W3=RELAXED W4=RELAXED", "R1=RELAXED W4=RELAXED", "R2=RELAXED", "NO_W1", "BORROW NO_BARRIER", "BORROW W2=RELAXED",
         "NEVER_READS", "BORROW NEVER_READS"],
    ),
    "queue": (
        ["", "ITEMS=7"],
        ["P1=RELAXED", "P3=RELAXED", "C1=RELAXED", "C3=RELAXED", "ONE_TOO_MANY", "NEVER_READS"],
    ),
    "sleep": (
        ["", "ITEMS=6"],
        ["ASKS_FIRST", "LOOKS_FIRST", "IGNORES_WAKE"],
    ),
    "futex": (
        ["", "THIEF"],
        ["PUBLISHED_FIRST", "WAKE_FIRST", "FORGETS_THE_REST", "THIEF SLEEPS_ON"],
    ),
    "team": (
        [""],
        ["NEVER_CLOSES", "OPENS=RELAXED", "READS=RELAXED", "FINISHES=RELAXED", "NEVER_HELPS"],
    ),
}


def explore(model, definitions):
    """Number of errors, and of states."""
    with tempfile.TemporaryDirectory() as folder:
        flags = ["-D" + word for word in definitions.split()]
        subprocess.run(["spin", *flags, "-a", HERE / f"{model}.pml"], cwd=folder, check=True, capture_output=True)
        subprocess.run(["gcc", "-O0", "-w", "-DSAFETY", "-DVECTORSZ=4096", "-o", "pan", "pan.c"], cwd=folder, check=True)
        out = subprocess.run(["./pan", "-m1000000"], cwd=folder, capture_output=True, text=True).stdout
    if "max search depth too small" in out or "out of memory" in out:
        raise AssertionError(f"{model} {definitions}: not all states were seen\n{out}")
    return int(re.search(r"errors: (\d+)", out)[1]), int(re.search(r"(\d+) states, stored", out)[1])


def main(names):
    if not (shutil.which("spin") and shutil.which("gcc")):
        print("skipped: spin or gcc is not installed")
        return 77
    wrong = []
    for name in names or MODELS:
        holds, broken = MODELS[name]
        for definitions in holds:
            errors, states = explore(name, definitions)
            print(f"{name:6} {definitions or 'as built':26} {states:9,} states: {'holds' if errors == 0 else 'FAILS'}")
            wrong += [(name, definitions)] if errors else []
        for definitions in broken:
            errors, states = explore(name, definitions)
            print(f"{name:6} {definitions:26} {states:9,} states: {'error found' if errors else 'NO ERROR FOUND'}")
            wrong += [] if errors else [(name, definitions)]
    assert not wrong, wrong
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

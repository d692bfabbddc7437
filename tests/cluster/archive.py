"""A small archive of captures, the reference outputs of one process, and the progress of others."""

import filecmp
import os
import pathlib
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "tools"))
from programs import run, wait_for  # noqa: E402

TOTAL, FRAMES = 8, 60
# Slow enough to interrupt a run.
SOLVER = ["--solver", "exact"]


def set_up(*command):
    """Runs the cluster's script; skips the test if it cannot run here."""
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=60)
    if done.returncode == 77:
        print(f"skipped: {done.stderr.strip()}")
        sys.exit(77)
    if done.returncode != 0:
        raise SystemExit(f"{command[0]}: exit code {done.returncode}: {done.stderr.strip()}")
    return done.stdout.split()


class Archive:
    """captures/*.h5, and in expected/ the outputs of a single process."""

    def __init__(self, bolo):
        self.temporary = tempfile.TemporaryDirectory(prefix="bolo-cluster-")
        self.folder = pathlib.Path(self.temporary.name)
        self.captures = [self.folder / "captures" / f"{i}.h5" for i in range(TOTAL)]
        self.expected = self.folder / "expected"
        self.bolo = pathlib.Path(bolo)
        for folder in (self.folder / "captures", self.expected):
            folder.mkdir()
        for seed, capture in enumerate(self.captures):
            run(self.bolo, "simulate", "-o", capture, "--frames", FRAMES, "--width", 64, "--height", 48, "--no-truth",
                "--seed", seed)
        run(self.bolo, "deblur", *self.captures, "-o", self.expected, *SOLVER, "--threads", 1)

    def close(self):
        self.temporary.cleanup()


class Work:
    def __init__(self, archive, name):
        self.archive = archive
        self.out = archive.folder / name / "sharp"
        self.out.mkdir(parents=True)

    def done(self):
        """Finished outputs: file, and a value that changes when it is rewritten."""
        return {path: (path.stat().st_ino, path.stat().st_mtime_ns) for path in self.out.glob("*.h5")}

    def wait_for_the_middle(self, ended=lambda: False):
        """Waits until some captures are finished, but not all. `ended` tells whether the run has ended."""
        wait_for(lambda: self.done() or ended(), f"a finished capture in {self.out}")
        done = len(self.done())
        assert done >= 1, "it ended without any capture"
        assert done < TOTAL, f"all {done} captures were finished before anything could be killed: make them slower"
        return done

    def differences(self):
        """Files that differ from a single process's, are extra or missing."""
        names = sorted(p.name for p in self.archive.expected.glob("*.h5"))
        there = sorted(p.name for p in self.out.iterdir())
        if names != there:
            return f"{there} instead of {names}"
        return [n for n in names if not filecmp.cmp(self.archive.expected / n, self.out / n, shallow=False)]

    def processes(self, variable):
        """Processes working on the run, by the value of one of their environment variables."""
        found = {}
        for process in pathlib.Path("/proc").glob("[0-9]*"):
            try:
                words = (process / "cmdline").read_bytes().split(b"\0")
                variables = dict(v.split(b"=", 1) for v in (process / "environ").read_bytes().split(b"\0") if b"=" in v)
            except OSError:
                continue  # ended, or another user's
            # Only the program itself, not a launcher with it among the arguments.
            program = os.path.basename(self.archive.bolo).encode()
            if program in [os.path.basename(w) for w in words[:2]] and str(self.out).encode() in words:
                found[variables.get(variable.encode(), b"").decode()] = int(process.name)
        return found

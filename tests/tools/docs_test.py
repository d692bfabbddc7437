"""The command blocks of README and the guides, run in order as by a newcomer, without hardware.

usage: docs_test.py SOURCE BUILD [PAGE...]. Each page gets a private folder, a fake camera where `$EDITOR` would
configure one, and the PATH and Python settings printed by tools/quickstart. Blocks that need more (root, a kernel
module, a reader's own files) are in LEFT_OUT, with their needs. Exit code 77: ffmpeg or numpy isn't there.
"""

import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time

from programs import own_address, run, wait_for

SOURCE, BUILD = (pathlib.Path(argument).resolve() for argument in sys.argv[1:3])
PAGES = sys.argv[3:] or ["README.md", "docs/guide.md", "docs/diagnosis.md"]
PATIENCE_S = 120  # a guard against hanging, not an expectation
LEFT_OUT = {
    "tools/": "the tree's own scripts", "sudo ": "root", "journalctl ": "the service", "cp ": "root", "modprobe ": "root",
    "ffplay ": "a video device", "gst-launch-1.0 ": "a video device", "curl ": "metrics", "mpirun ": "MPI",
    "bolo recover ": "a crash", "bolod --check-config --config /etc": "the package", "# In front.toml": "a video device",
    "#                ": "a video device", "bolo view front --listen": "a network",
}
# Commands that run until Ctrl-C, and how to see from their output that they run.
ENDLESS = {"bolo view ": lambda said, folder: "http://" in said, "bolo stat ": lambda said, folder: "heartbeat" in said,
           "bolo record ": lambda said, folder: any(folder.glob("*.part")), "bolo demo": lambda said, folder: "Ctrl-C" in said,
           "bolo replay ": lambda said, folder: os.path.exists(f"/dev/shm/bolo.{stream()}-bench")}


def environment(folder):
    """The caller's environment with quickstart's settings."""
    told = re.search(r"printf 'export PATH=.*\\\n.*", (SOURCE / "tools/quickstart").read_text())[0]
    lines = run("bash", "-c", f"root={SOURCE}\n{told}").replace(f"{SOURCE}/build/release", str(BUILD))
    assert lines.count("export ") == 2, lines
    told = run("bash", "-c", f"{lines}env -0")
    found = dict(entry.split("=", 1) for entry in told.split("\0") if entry)
    editor = folder / "editor"
    address = own_address()
    editor.write_text(f'#!/bin/sh\nsed -i \'s/^name = .*/name = "{stream()}"/; s/^address = .*/address = "{address}"/\' "$1"\n')
    editor.chmod(0o755)
    return {**found, "EDITOR": str(editor), "XDG_RUNTIME_DIR": str(folder)}, address


def stream():
    return f"docs-{os.getpid()}"


def own(text):
    """`text` with stream names that no other program has."""
    return re.sub(r"\bfront\b(?!\.toml)", stream(), text).replace("--name bench", f"--name {stream()}-bench")


def blocks(page):
    """(language, text) of each fenced block."""
    return re.findall(r"^```(\w*)\n(.*?)^```", (SOURCE / page).read_text(), re.M | re.S)


class Reader:
    def __init__(self, folder, environ):
        self.folder, self.environ, self.running, self.ran = folder, environ, [], []

    def start(self, words, log="output"):
        output = open(self.folder / log, "w", encoding="utf-8")
        return subprocess.Popen(words, cwd=self.folder, env=self.environ, stdout=output, stderr=output,
                                start_new_session=True), output

    def end(self, program, output, runs, codes):
        """Waits for the end; for an endless command, until it runs, then sends Ctrl-C."""
        deadline = time.monotonic() + PATIENCE_S
        said = lambda: (self.folder / "output").read_text(encoding="utf-8")
        if runs is not None:
            while program.poll() is None and not runs(said(), self.folder):
                assert time.monotonic() < deadline, said()[-2000:]
                time.sleep(0.1)
            time.sleep(1.5)
            assert program.poll() is None, said()[-2000:]
            os.killpg(program.pid, signal.SIGINT)
        code = program.wait(PATIENCE_S)
        output.close()
        assert code in codes, (code, said()[-2000:])

    def shell(self, line, prelude):
        if line.endswith("&"):
            words = ["bash", "-c", prelude + "exec " + line.rstrip("& ")]
            self.running.append(self.start(words, "daemon.log")[0])
            wait_for_stream()
            return
        runs = next((seen for start, seen in ENDLESS.items() if line.startswith(start)), None)
        program, output = self.start(["bash", "-c", prelude + ("exec " if runs is not None else "set -e; ") + line])
        self.end(program, output, runs, (0, 1) if line.startswith("bolo doctor") else (0,))

    def commands(self, text):
        prelude = ""
        for line in text.splitlines():
            command = own(re.sub(r"\s+# .*", "", line)).strip()
            if not command or line.startswith("    ") or any(line.startswith(start) for start in LEFT_OUT):
                continue
            if re.match(r"\w+=", command):
                prelude += command + "\n"
                continue
            print(f"  {command}", flush=True)
            # Shorter, and on a free port.
            briefly = command.replace("bolo demo", "bolo demo --seconds 1").replace("bolo view", "bolo view --port 0")
            self.shell(briefly, prelude)
            self.ran.append(command)

    def python(self, text):
        """Runs until it prints, or for a while; then Ctrl-C."""
        print("  python: " + text.splitlines()[0], flush=True)
        program, output = self.start([sys.executable, "-u", "-c", "import numpy as np, bolo\nprint()\n" + own(text)])
        lines = 1 if "continue" in text else 2  # frames that it skips print nothing
        self.end(program, output, lambda said, folder: said.count("\n") >= lines, (-signal.SIGINT, 1))
        said = (self.folder / "output").read_text(encoding="utf-8")
        assert said.rstrip().endswith("KeyboardInterrupt"), said

    def close(self):
        pathlib.Path("/dev/shm/bolo-gyro.imu").unlink(missing_ok=True)  # the guide's gyro
        for program in self.running:
            os.killpg(program.pid, signal.SIGTERM)
            assert program.wait(PATIENCE_S) == 0, "a daemon of the page did not end in good order"


def wait_for_stream():
    wait_for(lambda: os.path.exists(f"/dev/shm/bolo.{stream()}"), "the daemon's first frame", PATIENCE_S)
    time.sleep(1)


def is_commands(text):
    return re.match(r"(bolod?|tools/|cp|camera=)", text) is not None


def follow(page, folder, environ):
    reader = Reader(folder, environ)
    (folder / "archive").mkdir()
    small = ("--width", 64, "--height", 24, "--frames", 40)
    run("bolo", "simulate", "-o", "archive/a.h5", *small, cwd=folder, env=environ)
    try:
        for language, text in blocks(page):
            if language == "python":
                reader.python(text)
            elif language == "" and is_commands(text):
                reader.commands(text)
    finally:
        reader.close()
    return len(reader.ran)


def main():
    if shutil.which("ffmpeg") is None:
        print("skipped: ffmpeg is not installed")
        return 77
    with tempfile.TemporaryDirectory() as top:
        top = pathlib.Path(top)
        environ, address = environment(top)
        run("bolo", "simulate", "-o", "street.h5", "--no-truth", "--frames", 200, cwd=top, env=environ)
        camera = subprocess.Popen(["bolo", "fakecam", "street.h5", "--loop", "--interface", address], cwd=top, env=environ,
                                  stdout=subprocess.DEVNULL)
        try:
            for page in PAGES:
                print(page)
                folder = top / page.replace("/", "-")
                folder.mkdir()
                assert follow(page, folder, environ) > 2, f"{page} has no commands"
        finally:
            camera.terminate()
            camera.wait()
    return 0


if __name__ == "__main__":
    sys.exit(main())

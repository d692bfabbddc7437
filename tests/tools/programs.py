"""Shared by tests of running programs: waiting, private addresses, camera and daemon."""

import atexit
import importlib
import os
import pathlib
import signal
import socket
import subprocess
import sys
import time


def needed(*names):
    """Imports these modules; if one is missing, skips the test: exit code 77."""
    try:
        return [importlib.import_module(name) for name in names]
    except ImportError as missing:
        print(f"skipped: {missing}")
        sys.exit(77)


def own_address(number=0):
    """A loopback address of this process alone: it contains all 22 bits of the process id. `number`: 0 or 1."""
    pid = os.getpid()
    return f"127.{64 + 65 * number + pid // 65024}.{pid // 254 % 256}.{1 + pid % 254}"


def free_port():
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        return server.getsockname()[1]


def wait_for(find, what, hang_guard_s=120.0):
    """Polls until find() returns something, and returns that."""
    end = time.monotonic() + hang_guard_s
    while not (found := find()):
        assert time.monotonic() < end, f"{what} did not come"
        time.sleep(0.01)
    return found


def run(*command, **how):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=300, **how)
    assert done.returncode == 0, f"{command} ended with {done.returncode}: {done.stdout[-2000:]}{done.stderr[-2000:]}"
    return done.stdout


class Programs:
    """Camera, daemon and other programs of a test, in `folder`. `keys`: the daemon's, beginning in [source]."""

    def __init__(self, bolo, bolod, folder, name, size=(160, 48), keys="", number=0):
        self.bolo, self.bolod, self.folder, self.name, self.size = bolo, bolod, pathlib.Path(folder), name, size
        self.address = own_address(number)
        self.config = self.folder / f"{name}.toml"
        self.config.write_text(f'name = "{name}"\n[control]\nsocket = "{folder}/{name}.sock"\n[source]\n'
                               f'address = "{self.address}"\nwidth = {size[0]}\nheight = {size[1]}\n{keys}')
        self.running = {}
        atexit.register(self.end)  # however the test ends

    def simulate(self, *options):
        capture = self.folder / f"{self.name}.h5"
        width, height = self.size
        run(self.bolo, "simulate", "-o", capture, "--no-truth", "--width", width, "--height", height, *options)
        return capture

    def start(self, what, *command, **how):
        """Starts a program; its log is named `what`."""
        with open(self.folder / f"{self.name}-{what}.log", "w", encoding="utf-8") as log:
            self.running[what] = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, **how)
        return self.running[what]

    def start_camera(self, capture, *options):
        self.start("camera", self.bolo, "fakecam", capture, "--loop", "--interface", self.address, *options)
        wait_for(lambda: "serving" in self.log("camera"), "the fake camera")

    def start_daemon(self, **how):
        return self.start("daemon", self.bolod, "--config", self.config, **how)

    def start_replay(self, capture):
        """A daemon without a camera, of a capture that is looped."""
        return self.start("daemon", self.bolo, "replay", capture, "--name", self.name, "--loop")

    def kill(self, what, how=signal.SIGKILL):
        self.running[what].send_signal(how)
        self.running[what].wait()

    def log(self, what):
        return (self.folder / f"{self.name}-{what}.log").read_text(encoding="utf-8")

    def logs(self):
        return "".join(self.log(what)[-2000:] for what in self.running)

    def __enter__(self):
        return self

    def __exit__(self, failure, *_):
        if failure:
            sys.stderr.write(self.logs())
        self.end()

    def end(self):
        for process in reversed(self.running.values()):
            process.terminate()
            process.wait()
        pathlib.Path(f"/dev/shm/bolo.{self.name}").unlink(missing_ok=True)

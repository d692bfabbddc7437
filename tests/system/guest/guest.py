"""Shared by the steps: programs, waiting, systemd units, reports."""

import json
import pathlib
import subprocess
import sys
import time
from collections.abc import Callable

PAYLOAD = pathlib.Path("/payload")
CONFIG = pathlib.Path("/etc/bolo")


def saw(text: str) -> None:
    """Adds a figure or finding to the report."""
    print(f"saw: {text}", flush=True)


def check(condition: object, what: str) -> None:
    """Ends the step as failed unless the condition holds; what: the failure, with values."""
    if not condition:
        print(f"FAILED: {what}", flush=True)
        sys.exit(1)


def run(*command: str, expect: int | None = 0, timeout: float = 60.0) -> str:
    """Runs a program and returns its output and errors; ends the step on an unexpected exit code (None: any)."""
    print("$ " + " ".join(command), flush=True)
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
                          timeout=timeout, check=False)
    if done.stdout:
        print(done.stdout.rstrip(), flush=True)
    check(expect is None or done.returncode == expect, f"{command[0]} ended with {done.returncode}, not {expect}")
    return done.stdout


def wait_until(what: str, condition: Callable[[], object], limit_s: float = 30.0) -> float:
    """Waits for the condition and returns the time taken, s; ends the step after the limit."""
    start = time.monotonic()
    while not condition():
        check(time.monotonic() - start < limit_s, f"not within {limit_s:g} s: {what}")
        time.sleep(0.05)
    return time.monotonic() - start


def show(unit: str, *properties: str) -> dict[str, str]:
    command = ["systemctl", "show", unit, "-p", ",".join(properties)]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return dict(line.split("=", 1) for line in text.splitlines())


def is_active(unit: str) -> bool:
    return show(unit, "ActiveState")["ActiveState"] == "active"


def main_pid(unit: str) -> int:
    """0: none."""
    return int(show(unit, "MainPID")["MainPID"])


def restarts(unit: str) -> int:
    return int(show(unit, "NRestarts")["NRestarts"])


def journal(*matches: str, since: float = 0.0) -> list[dict]:
    """Journal entries of this boot; matches as for journalctl."""
    command = ["journalctl", "--no-pager", "-b", "-o", "json", f"--since=@{since:.6f}", *matches]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return [json.loads(line) for line in text.splitlines()]


def stat(name: str) -> dict:
    """`bolo stat` of a running daemon."""
    return json.loads(run("bolo", "stat", name, "--once", "--json", "--interval", "0.5"))


def packages(folder: str = "packages") -> list[str]:
    """The Debian packages that the host put into the shared folder."""
    return sorted(str(path) for path in (PAYLOAD / folder).glob("*.deb"))


def all_files() -> set[str]:
    """Files in the folders that packages and daemons write to, except those that change by themselves."""
    folders = ("/dev/shm", "/etc", "/opt", "/run", "/srv", "/tmp", "/usr", "/var")
    changing = r"/run/\(udev\|log\|systemd\)/.*\|/var/\(cache\|log\|tmp\|lib/systemd\|lib/dpkg\)/.*"
    changing += r"\|/tmp/systemd-private.*\|/run/agetty.reload"
    command = ["find", *folders, "-not", "-regex", changing]
    return set(subprocess.run(command, capture_output=True, text=True, check=False).stdout.splitlines())

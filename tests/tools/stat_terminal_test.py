"""`bolo stat` in a real terminal (tmux): latency bars, resizing, restart of the daemon.

usage: stat_terminal_test.py BOLO. `bolo replay` is the daemon. Exit code 77: tmux isn't there.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile

from programs import Programs, run, wait_for

if shutil.which("tmux") is None:
    print("skipped: tmux is not installed")
    sys.exit(77)

BLOCKS = "▁▂▃▄▅▆▇█"


class Terminal:
    """A terminal that runs a command, shows its exit code and stays. `name`: of its private tmux server."""

    def __init__(self, folder, name, width, height, command):
        self.tmux = ["tmux", "-u", "-S", f"{folder}/{name}", "-f", "/dev/null"]
        command = f"trap : INT; {command}; code=$?; echo; echo ended $code; exec sleep 1000"
        subprocess.run([*self.tmux, "new-session", "-d", "-x", str(width), "-y", str(height), command], check=True)

    def run(self, *command):
        return subprocess.run([*self.tmux, *command], check=True, capture_output=True, text=True).stdout

    def lines(self, *options):
        return self.run("capture-pane", "-p", *options).split("\n")[:-1]

    def close(self):
        subprocess.run([*self.tmux, "kill-server"], check=False, capture_output=True)


def bars(lines, row):
    """Text behind `row`: last line of the bars."""
    return next((line[9:] for line in lines if line.startswith(f"  {row} ")), "")


def columns(terminal, row="p50"):
    return sum(bars(terminal.lines(), row).count(block) for block in BLOCKS)


def state(terminal):
    found = re.match(r"\S+  (\w+), process (\d+)", terminal.lines()[0])
    return found.groups() if found else ("", "")


def main(bolo):
    name = f"stat-terminal-{os.getpid()}"
    with tempfile.TemporaryDirectory() as folder:
        programs = Programs(bolo, None, folder, name, (64, 24))
        capture = programs.simulate("--frames=100")
        programs.start_replay(capture)
        wait_for(lambda: os.path.exists(f"/dev/shm/bolo.{name}"), "the daemon")
        terminal = Terminal(folder, "first", 100, 40, f"{bolo} stat {name} --interval 0.1")
        try:
            wait_for(lambda: state(terminal)[0] == "running" and columns(terminal) >= 8, "bars")
            shown = terminal.lines()
            assert sum(line.startswith("history ") for line in shown) == 1, "drawn over, not below\n" + "\n".join(shown)
            assert re.search(r"bars from 0 to [\d.]+ ms", "\n".join(shown))
            assert "\x1b[34m" in "".join(terminal.lines("-e")), "colour on a terminal"

            terminal.run("resize-window", "-x", "40", "-y", "12")
            small = wait_for(lambda: (now := terminal.lines()) and columns(terminal) == 31 and now, "the smaller picture")
            assert len(small) == 12 and all(len(line) <= 40 for line in small), "\n".join(small)
            assert state(terminal)[0] == "running", "the first line stays"
            terminal.run("resize-window", "-x", "100", "-y", "40")
            wait_for(lambda: columns(terminal) > 31, "the larger picture")

            programs.kill("daemon")
            wait_for(lambda: state(terminal)[0] == "stopped", "the end of the daemon")
            daemon = programs.start_replay(capture)
            wait_for(lambda: state(terminal) == ("running", str(daemon.pid)), "the second daemon")
            wait_for(lambda: re.search(f"[{BLOCKS}] +[{BLOCKS}]+$", bars(terminal.lines(), "p50")), "bars after the gap")

            terminal.run("send-keys", "C-c")
            wait_for(lambda: any(line.startswith("ended") for line in terminal.lines()), "the end")
            assert "ended 0" in terminal.lines(), "\n".join(terminal.lines())
            terminal.close()
            terminal = Terminal(folder, "second", 80, 40, f"NO_COLOR=1 {bolo} stat {name} --interval 0.1")
            wait_for(lambda: columns(terminal) >= 2, "bars without colour")
            assert "\x1b[3" not in "".join(terminal.lines("-e"))
            for output in ([], ["--json"]):
                plain = run(bolo, "stat", name, "--interval", "0.1", "--once", *output)
                assert "\x1b" not in plain and not any(block in plain for block in BLOCKS)
        finally:
            terminal.close()
            programs.end()
    print("bolo stat drew its bars, followed the terminal's size and the daemon")


if __name__ == "__main__":
    main(sys.argv[1])

"""Runs the steps within the virtual machine, in order of their names, and reports each.

usage: runner.py PAYLOAD [STEP...]

A step is a program: exit code 0 means passed, anything else failed; lines `saw: ...` go into the report. A failed step
is followed by its output and its part of the journal; later steps still run. PAYLOAD/report.tsv has one line per step:
name, result, seconds, what was seen.
"""

import pathlib
import subprocess
import sys
import time

STEP_LIMIT_S = 240
JOURNAL_LINES = 60


def journal(since: float) -> str:
    command = ["journalctl", "--no-pager", "-o", "short-precise", f"--since=@{since:.3f}", "-n", str(JOURNAL_LINES)]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


def run_step(step: pathlib.Path, payload: pathlib.Path) -> tuple[str, float, str]:
    """Result, duration in s, and what the step saw."""
    since = time.time()
    try:
        done = subprocess.run(["/usr/bin/python3", str(step)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              text=True, errors="replace", timeout=STEP_LIMIT_S, check=False)
        output, result = done.stdout, "passed" if done.returncode == 0 else "FAILED"
    except subprocess.TimeoutExpired as expired:
        output = (expired.stdout or b"").decode(errors="replace") + f"\nnot done within {STEP_LIMIT_S} s"
        result = "FAILED"
    seconds = time.time() - since
    (payload / "logs" / f"{step.stem}.log").write_text(output)
    if result != "passed":
        print(f"--- {step.stem}: output\n{output}\n--- {step.stem}: journal\n{journal(since)}---")
    seen = [line.removeprefix("saw: ") for line in output.splitlines() if line.startswith("saw: ")]
    return result, seconds, "; ".join(seen)


def main(payload: pathlib.Path, chosen: list[str]) -> int:
    (payload / "logs").mkdir(exist_ok=True)
    failed = 0
    with open(payload / "report.tsv", "w", encoding="utf-8") as report:
        for step in sorted((payload / "steps").glob("[0-9]*.py")):
            if chosen and not any(step.stem.startswith(name) for name in chosen):
                continue
            result, seconds, seen = run_step(step, payload)
            failed += result != "passed"
            report.write(f"{step.stem}\t{result}\t{seconds:.1f}\t{seen}\n")
            report.flush()
            print(f"{step.stem:24} {result}  {seconds:6.1f} s  {seen}", flush=True)
    with open(payload / "logs" / "journal.log", "w", encoding="utf-8") as log:
        subprocess.run(["journalctl", "--no-pager", "-o", "short-precise", "-b"], stdout=log, check=False)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1]), sys.argv[2:]))

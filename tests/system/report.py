"""Prints the steps' table, and writes it as JSON.

usage: report.py PAYLOAD [--json FILE]
"""

import argparse
import csv
import json
import pathlib
import sys


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("payload", type=pathlib.Path)
    parser.add_argument("--json", type=pathlib.Path)
    arguments = parser.parse_args()
    table = arguments.payload / "report.tsv"
    if not table.exists():
        sys.exit("no step ran")
    with open(table, encoding="utf-8") as file:
        steps = [{"step": name, "passed": result == "passed", "seconds": float(seconds), "seen": seen}
                 for name, result, seconds, seen in csv.reader(file, delimiter="\t", quoting=csv.QUOTE_NONE)]
    for step in steps:
        print(f"{step['step']:24} {'passed' if step['passed'] else 'FAILED'} {step['seconds']:6.1f} s  {step['seen']}")
    passed = sum(step["passed"] for step in steps)
    print(f"{passed} of {len(steps)} steps passed, {sum(step['seconds'] for step in steps):.0f} s")
    if arguments.json:
        arguments.json.write_text(json.dumps({"steps": steps}, indent=1) + "\n")
    return 0 if passed == len(steps) else 1


if __name__ == "__main__":
    sys.exit(main())

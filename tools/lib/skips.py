"""Runs ctest and lists skipped tests with their reasons; fails unless each lacks only data that may be absent.

usage: skips.py [--allow WORDS]... BUILD [CTEST OPTION...]

A test that fails runs once more, since other tests load the machine beside it; second runs are listed, and more than a few
are a failure. The ends of failed tests' outputs are repeated at the end.
A skip is one of a whole test (gtest's GTEST_SKIP, ctest's SKIP_RETURN_CODE) or of a part: a TEST of a program that is one
test of ctest's, or what Python's unittest leaves out.
Its reason must have "BOLO_TEST_DATA" in it, or the words of an --allow. The last lines are ctest's own summary.
Exit code: ctest's, or 1 for a skip that is not allowed or too many tests that needed a second run.
"""

import argparse
import pathlib
import re
import subprocess
import sys
import tempfile
import xml.etree.ElementTree

ALLOWED = "BOLO_TEST_DATA"
MOST_BYTES = str(1 << 20)  # of a test's output; ctest's default is one KiB
MOST_AGAIN = 3000  # shown of a failed test's output
MOST_REPEATED = 3  # tests that pass only on a second run
FAILED = re.compile(r"Test +#\d+: (\S+) \.*\*\*\*(?!Skipped)")
SUMMARY = re.compile(r"^\d+% tests passed")
# gtest prints "file:line: Skipped" before the reason; Python prints "test_x (...) ... skipped 'reason'".
GTEST = re.compile(r"^.*: Skipped\n(.*)\n(?:.*\n)*?(?:\[  SKIPPED \] (\S+)|\Z)", re.MULTILINE)
UNITTEST = re.compile(r"^(\w+) \(.*\.\.\. skipped (['\"])(.*)\2$", re.MULTILINE)
PROGRAM = re.compile(r"^skipped:? *(.*)$", re.MULTILINE | re.IGNORECASE)


def reason_of(output: str, told: str) -> str:
    """Reason of a test that was skipped as a whole."""
    found = GTEST.search(output) or PROGRAM.search(output)
    return (found.group(1).strip() if found else "") or told or "no reason is told"


def skips_of(cases: list[xml.etree.ElementTree.Element]) -> list[tuple[str, str]]:
    """Names and reasons, from the test cases of ctest's JUnit file."""
    skips = []
    for case in cases:
        name, output = case.get("name", "?"), case.findtext("system-out") or ""
        skipped = case.find("skipped")
        if skipped is not None:
            skips.append((name, reason_of(output, skipped.get("message", ""))))
        else:
            skips += [(f"{name}: {part}", reason.strip()) for reason, part in GTEST.findall(output)]
        skips += [(f"{name}: {part}", reason) for part, _, reason in UNITTEST.findall(output)]
    return skips


def failures_of(cases: list[xml.etree.ElementTree.Element]) -> list[tuple[str, str]]:
    """Names of failed tests and the ends of their output."""
    return [(case.get("name", "?"), (case.findtext("system-out") or "").strip()[-MOST_AGAIN:])
            for case in cases if case.get("status") == "fail"]


def run_ctest(build: str, options: list[str]) -> tuple[int, str, list[tuple[str, str]], list[tuple[str, str]], list[str]]:
    """Shows ctest's output but for its summary, which comes last.
    Returns exit code, summary, skips, failures and the names of those that passed in their second run."""
    with tempfile.TemporaryDirectory(prefix="bolo-skips-") as folder:
        junit = pathlib.Path(folder) / "junit.xml"
        command = ["ctest", "--test-dir", build, "--output-junit", str(junit), "--repeat", "until-pass:2", *options]
        for outcome in ("passed", "failed"):
            command += [f"--test-output-size-{outcome}", MOST_BYTES]
        summary, failed_once = "", []
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, errors="replace") as ctest:
            for line in ctest.stdout:
                if summary or SUMMARY.match(line):
                    summary += line
                else:
                    failed_once += FAILED.findall(line)
                    print(line, end="", flush=True)
        cases = list(xml.etree.ElementTree.parse(junit).getroot().iter("testcase")) if junit.exists() else []
        failures = failures_of(cases)
        failed = {name for name, _ in failures}
        repeated = sorted(name for name in set(failed_once) if name not in failed)
        return ctest.returncode, summary, skips_of(cases), failures, repeated


def main() -> int:
    parser = argparse.ArgumentParser(usage=__doc__.split("usage: ")[1].splitlines()[0], description=__doc__.splitlines()[0])
    parser.add_argument("--allow", action="append", default=[ALLOWED])
    parser.add_argument("build")
    arguments, options = parser.parse_known_args()
    code, summary, skips, failures, repeated = run_ctest(arguments.build, options)
    bad = [skip for skip in skips if not any(words in skip[1] for words in arguments.allow)]
    print(f"{len(skips)} skipped" + (":" if skips else ""))
    for name, reason in skips:
        print(f"  {name}: {reason}" + (" (NOT ALLOWED)" if (name, reason) in bad else ""))
    for name in repeated:
        print(f"passed only in its second run: {name}")
    for name, end in failures:
        print(f"failed: {name}\n{end}")
    print(summary, end="", flush=True)
    if bad:
        print(f"skips.py: {len(bad)} of these skips must not be: install or allow what they need", file=sys.stderr)
    if len(repeated) > MOST_REPEATED:
        print(f"skips.py: {len(repeated)} tests passed only in their second run", file=sys.stderr)
    return code or (1 if bad or len(repeated) > MOST_REPEATED else 0)


if __name__ == "__main__":
    sys.exit(main())

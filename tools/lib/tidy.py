#!/usr/bin/python3
"""Runs clang-tidy on C++ files, several at a time, and passes over those whose preprocessed text was found clean before.

usage: tidy.py BUILD_FOLDER FILE...
What was found clean is remembered under $BOLO_CACHE (default: ~/.cache/bolo) by a hash of the preprocessed file with
its comments, the checks and the version of clang-tidy. Exit code 1 when anything is found.
"""
import concurrent.futures
import hashlib
import json
import os
import pathlib
import re
import shlex
import subprocess
import sys

# The static analyzer follows so many states of a function and no more: three quarters of the time went beyond them.
ANALYZER = [f"--extra-arg={word}" for word in ("-Xclang", "-analyzer-config", "-Xclang", "max-nodes=20000")]
NOISE = re.compile(r"warnings? generated|Suppressed|Use -header-filter")


def cache_folder():
    default = pathlib.Path(os.environ.get("XDG_CACHE_HOME", pathlib.Path.home() / ".cache")) / "bolo"
    folder = pathlib.Path(os.environ.get("BOLO_CACHE", default)) / "tidy"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def preprocessing_commands(build):
    """Absolute file -> (folder, command that prints the file as clang-tidy reads it)."""
    commands = {}
    for entry in json.loads((build / "compile_commands.json").read_text()):
        words = [word for word in shlex.split(entry["command"]) if word not in ("-c", "-MD")]
        for option in ("-o", "-MT", "-MF"):
            if option in words:
                at = words.index(option)
                del words[at : at + 2]
        compiler = next(i for i, word in enumerate(words) if os.path.basename(word) != "ccache")
        options = ["-E", "-P", "-CC", "-w", "-Wno-unknown-warning-option"]
        commands[entry["file"]] = (entry["directory"], ["clang++", *words[compiler + 1 :], *options])
    return commands


def key_of(command, checks):
    folder, words = command
    done = subprocess.run(words, cwd=folder, capture_output=True)
    return hashlib.sha256(checks + done.stdout).hexdigest() if done.returncode == 0 else None


def main():
    root = pathlib.Path(__file__).resolve().parents[2]
    build = pathlib.Path(sys.argv[1]).resolve()
    version = subprocess.run(["clang-tidy", "--version"], capture_output=True, check=True).stdout
    checks = version + " ".join(ANALYZER).encode() + (root / ".clang-tidy").read_bytes()
    commands = preprocessing_commands(build)
    cache = cache_folder()

    def examine(file):
        command = commands.get(str(pathlib.Path(file).resolve()))
        key = key_of(command, checks) if command else None
        if key and (cache / key).exists():
            return "known", ""
        done = subprocess.run(
            ["clang-tidy", "--quiet", "-p", build, "--extra-arg=-Wno-unknown-warning-option", *ANALYZER, file],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        if done.returncode != 0:
            return "bad", "\n".join(line for line in done.stdout.splitlines() if not NOISE.search(line))
        if key:
            (cache / key).touch()
        return "clean", ""

    counts = {"known": 0, "clean": 0, "bad": 0}
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for outcome, text in pool.map(examine, sys.argv[2:]):
            counts[outcome] += 1
            if text:
                print(text, flush=True)
    print(f"{len(sys.argv) - 2} files: {counts['clean']} clean, {counts['known']} clean before, {counts['bad']} not")
    return 1 if counts["bad"] else 0


if __name__ == "__main__":
    sys.exit(main())

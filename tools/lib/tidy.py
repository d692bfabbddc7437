#!/usr/bin/python3
"""Runs clang-tidy on C++ files, several at a time, and passes over those whose preprocessed text was found clean before.

usage: tidy.py BUILD_FOLDER FILE...
Files that a unity build compiles together are looked at together first, as one text, for most of the time goes into what
they include; one by one where anything is found in it. What was found clean is remembered under $BOLO_CACHE (default: ~/.cache/bolo) by a hash of the preprocessed file with
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
import tempfile

# The static analyzer follows so many states of a function and no more: three quarters of the time went beyond them.
ANALYZER = [f"--extra-arg={word}" for word in ("-Xclang", "-analyzer-config", "-Xclang", "max-nodes=20000")]
NOISE = re.compile(r"warnings? generated|Suppressed|Use -header-filter")


def cache_folder():
    default = pathlib.Path(os.environ.get("XDG_CACHE_HOME", pathlib.Path.home() / ".cache")) / "bolo"
    folder = pathlib.Path(os.environ.get("BOLO_CACHE", default)) / "tidy"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def joined(entries, folder, wanted):
    """Entries of compile_commands.json for texts of several files each, written to `folder`, and their files."""
    for number, entry in enumerate(entries):
        files = re.findall(r'^#include "(.+\.cpp)"$', pathlib.Path(entry["file"]).read_text(), re.M)
        if not files or not wanted.issuperset(files):
            continue
        text = folder / f"{number}.cpp"
        text.write_text("".join(pathlib.Path(file).read_text() + "\n" for file in files))
        yield {**entry, "command": entry["command"].replace(entry["file"], str(text)), "file": str(text)}, files


def preprocessing_commands(entries):
    """Absolute file -> (folder, command that prints the file as clang-tidy reads it)."""
    commands = {}
    for entry in entries:
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
    files = [str(pathlib.Path(file).resolve()) for file in sys.argv[2:]]
    version = subprocess.run(["clang-tidy", "--version"], capture_output=True, check=True).stdout
    checks = version + " ".join(ANALYZER).encode() + (root / ".clang-tidy").read_bytes()
    cache = cache_folder()
    database = tempfile.TemporaryDirectory(dir=build)  # below the project, whose .clang-tidy holds there, too

    single = json.loads((build / "compile_commands.json").read_text())
    unity = json.loads((build / "unity" / "compile_commands.json").read_text())
    groups = list(joined(unity, pathlib.Path(database.name), set(files)))
    groups.sort(key=lambda group: -pathlib.Path(group[0]["file"]).stat().st_size)  # no long one alone at the end
    entries = [*single, *(entry for entry, _ in groups)]
    (pathlib.Path(database.name) / "compile_commands.json").write_text(json.dumps(entries))
    commands = preprocessing_commands(entries)

    def examine(file):
        command = commands.get(file)
        key = key_of(command, checks) if command else None
        if key and (cache / key).exists():
            return "known", ""
        done = subprocess.run(
            ["clang-tidy", "--quiet", "-p", database.name, "--extra-arg=-Wno-unknown-warning-option", *ANALYZER, file],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        if done.returncode != 0:
            return "bad", "\n".join(line for line in done.stdout.splitlines() if not NOISE.search(line))
        if key:
            (cache / key).touch()
        return "clean", ""

    counts = {"known": 0, "clean": 0, "bad": 0}
    alone = set(files)
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for (entry, together), (outcome, _) in zip(groups, pool.map(examine, [entry["file"] for entry, _ in groups])):
            if outcome != "bad":
                alone.difference_update(together)
                counts[outcome] += len(together)
        for outcome, text in pool.map(examine, sorted(alone)):
            counts[outcome] += 1
            if text:
                print(text, flush=True)
    print(f"{len(files)} files: {counts['clean']} clean, {counts['known']} clean before, {counts['bad']} not")
    return 1 if counts["bad"] else 0


if __name__ == "__main__":
    sys.exit(main())

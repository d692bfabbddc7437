#!/usr/bin/python3
"""Runs clang-tidy on C++ files, several at a time, and passes over those whose preprocessed text was found clean before.

usage: tidy.py BUILD_FOLDER FILE...
Files that are compiled with the same options are looked at together first, as one text, for most of the time goes into
what they include; one by one where anything is found in it. What was found clean is remembered under $BOLO_CACHE (default:
~/.cache/bolo) by a hash of the preprocessed text with its comments, the checks and the version of clang-tidy. What is
found is printed, and then the exit code is 1.
"""
import collections
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
TOGETHER = 24  # files at most: what a change of one of them makes look at again
ALONE = re.compile(r"foreach_target\.h|elements\.hpp")  # includes itself, for each set of instructions; GStreamer's own names


def cache_folder():
    default = pathlib.Path(os.environ.get("XDG_CACHE_HOME", pathlib.Path.home() / ".cache")) / "bolo"
    folder = pathlib.Path(os.environ.get("BOLO_CACHE", default)) / "tidy"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def options_of(entry):
    """The words of an entry of compile_commands.json without those that name files."""
    words = [word for word in shlex.split(entry["command"]) if word not in ("-c", "-MD", entry["file"])]
    for option in ("-o", "-MT", "-MF"):
        if option in words:
            at = words.index(option)
            del words[at : at + 2]
    compiler = next(i for i, word in enumerate(words) if os.path.basename(word) != "ccache")
    return words[compiler:]


def joined(entries, folder):
    """Entries for texts of several files each, written to `folder`, and their files."""
    alike = collections.defaultdict(list)
    for entry in entries:
        text = pathlib.Path(entry["file"]).read_text()
        if not ALONE.search(text):
            alike[tuple(options_of(entry))].append((entry, text))
    for number, (options, members) in enumerate(alike.items()):
        parts = -(-len(members) // TOGETHER)
        for part in range(parts):
            some = members[part::parts]
            file = folder / f"{number}-{part}.cpp"
            file.write_text("\n".join(text for _, text in some))
            command = shlex.join([*options, "-c", str(file)])
            yield {**some[0][0], "command": command, "file": str(file)}, [entry["file"] for entry, _ in some]


def key_of(entry, checks):
    options = ["-E", "-P", "-CC", "-w", "-Wno-unknown-warning-option"]
    words = ["clang++", *options_of(entry)[1:], *options, entry["file"]]
    done = subprocess.run(words, cwd=entry["directory"], capture_output=True)
    text = done.stdout.replace(os.path.dirname(entry["file"]).encode(), b"")  # __FILE__
    return hashlib.sha256(checks + text).hexdigest() if done.returncode == 0 else None


def main():
    root = pathlib.Path(__file__).resolve().parents[2]
    build = pathlib.Path(sys.argv[1]).resolve()
    files = {str(pathlib.Path(file).resolve()) for file in sys.argv[2:]}
    version = subprocess.run(["clang-tidy", "--version"], capture_output=True, check=True).stdout
    checks = version + " ".join(ANALYZER).encode() + (root / ".clang-tidy").read_bytes()
    cache = cache_folder()
    database = tempfile.TemporaryDirectory(dir=build)  # below the project, whose .clang-tidy holds there, too

    single = [e for e in json.loads((build / "compile_commands.json").read_text()) if e["file"] in files]
    groups = list(joined(single, pathlib.Path(database.name)))
    groups.sort(key=lambda group: -pathlib.Path(group[0]["file"]).stat().st_size)  # no long one alone at the end
    entries = {entry["file"]: entry for entry in [*single, *(entry for entry, _ in groups)]}
    (pathlib.Path(database.name) / "compile_commands.json").write_text(json.dumps(list(entries.values())))

    def examine(file):
        """Whether it is clean, and what was found."""
        key = key_of(entries[file], checks) if file in entries else None
        if key and (cache / key).exists():
            return True, ""
        done = subprocess.run(
            ["clang-tidy", "--quiet", "-p", database.name, "--extra-arg=-Wno-unknown-warning-option", *ANALYZER, file],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        if done.returncode != 0:
            return False, "\n".join(line for line in done.stdout.splitlines() if not NOISE.search(line))
        if key:
            (cache / key).touch()
        return True, ""

    alone, outcomes = files.copy(), []
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for (_, together), (clean, _) in zip(groups, pool.map(examine, [entry["file"] for entry, _ in groups])):
            if clean:
                alone.difference_update(together)
        for clean, text in pool.map(examine, sorted(alone)):
            outcomes.append(clean)
            if text:
                print(text, flush=True)
    return 0 if all(outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())

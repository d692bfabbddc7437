#!/usr/bin/python3
"""Runs clang-tidy on C++ files, in parallel, except those whose preprocessed text was found clean before.

usage: tidy.py BUILD_FOLDER FILE...
Some twenty files are analysed as one unit, because most of the time goes into their includes. A unit with findings, or in
which names collide, is split in halves; a note tells of the collision, because it costs a minute or more. Clean files are
remembered under $BOLO_CACHE (default: ~/.cache/bolo) by a hash of the preprocessed text with its comments, the checks and
the version of clang-tidy. Findings are printed; the exit code is then 1.
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

# Limits the states that the static analyzer follows in a function: three quarters of the time were spent beyond.
ANALYZER = [f"--extra-arg={word}" for word in ("-Xclang", "-analyzer-config", "-Xclang", "max-nodes=20000")]
NOISE = re.compile(r"warnings? generated|Suppressed|Use -header-filter")
COLLISION = re.compile(r"error: (.*) \[clang-diagnostic-error")
TOGETHER = 24  # files at most: a change in one of them rechecks all
ALONE = re.compile(r"foreach_target\.h|elements\.hpp|int main\(")  # files that include themselves per instruction set; names of GStreamer
WITH_VALUE = ("-o", "-MT", "-MF", "-isystem", "-include")
ROOT = pathlib.Path(__file__).resolve().parents[2]


def cache_folder():
    default = pathlib.Path(os.environ.get("XDG_CACHE_HOME", pathlib.Path.home() / ".cache")) / "bolo"
    folder = pathlib.Path(os.environ.get("BOLO_CACHE", default)) / "tidy"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def options_of(entry):
    """Options of an entry of compile_commands.json, with values, except those that name files or only GCC knows."""
    words = shlex.split(entry["command"])
    compiler = next(i for i, word in enumerate(words) if os.path.basename(word) != "ccache")
    options = []
    for word in words[compiler + 1 :]:
        if options and options[-1][-1] in WITH_VALUE:
            options[-1] += (word,)
        elif word not in ("-c", "-MD", entry["file"]) and not word.startswith("--param"):
            options.append((word,))
    return [option for option in options if option[0] not in ("-o", "-MT", "-MF")]


class Examination:
    def __init__(self, entries, folder):
        self.entries, self.folder = entries, pathlib.Path(folder)
        version = subprocess.run(["clang-tidy", "--version"], capture_output=True, check=True).stdout
        self.checks = version + " ".join(ANALYZER).encode() + (ROOT / ".clang-tidy").read_bytes()
        self.cache = cache_folder()

    def findings(self, files):
        """clang-tidy's output for these files; empty if they are clean."""
        options = dict.fromkeys(option for file in files for option in options_of(self.entries[file]))
        words = ["clang++", *(word for option in options for word in option)]
        file = files[0]
        if len(files) > 1:
            file = str(self.folder / (hashlib.sha256("".join(files).encode()).hexdigest() + ".cpp"))
            pathlib.Path(file).write_text("\n".join(pathlib.Path(one).read_text() for one in files))
        key = self.key_of(words, file)
        if key and (self.cache / key).exists():
            return ""
        done = subprocess.run(
            ["clang-tidy", "--quiet", *ANALYZER, file, "--", *words[1:], "-Wno-unknown-warning-option"],
            cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        if done.returncode == 0:
            if key:
                (self.cache / key).touch()
            return ""
        if len(files) > 1:
            if collision := COLLISION.search(done.stdout):
                print(f"takes twice as long, since names collide: {collision[1]}", file=sys.stderr, flush=True)
            half = len(files) // 2
            return self.findings(files[:half]) + self.findings(files[half:])
        return "\n".join(line for line in done.stdout.splitlines() if not NOISE.search(line)) + "\n"

    def key_of(self, words, file):
        options = ["-E", "-P", "-CC", "-w", "-Wno-unknown-warning-option"]
        done = subprocess.run([*words, *options, file], cwd=self.folder, capture_output=True)
        text = done.stdout.replace(os.path.dirname(file).encode(), b"")  # __FILE__
        return hashlib.sha256(self.checks + text).hexdigest() if done.returncode == 0 else None


def main():
    build = pathlib.Path(sys.argv[1]).resolve()
    wanted = {str(pathlib.Path(file).resolve()) for file in sys.argv[2:]}
    entries = {entry["file"]: entry for entry in json.loads((build / "compile_commands.json").read_text())}
    files = [file for file in entries if file in wanted]
    alone = [file for file in files if ALONE.search(pathlib.Path(file).read_text())]
    together = [file for file in files if file not in alone]
    size = max(1, -(-len(together) // -(-len(together) // TOGETHER))) if together else 1
    groups = [together[at : at + size] for at in range(0, len(together), size)] + [[file] for file in alone]
    with tempfile.TemporaryDirectory(dir=build) as folder:  # inside the project, so that its .clang-tidy applies
        examination = Examination(entries, folder)
        with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
            found = "".join(pool.map(examination.findings, groups))
    print(found, end="", flush=True)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())

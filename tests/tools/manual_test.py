"""Manual pages and completion agree with --help: manual_test.py BOLO BOLOD MANUAL SOURCE (pages; tools/manual)."""

import os
import pathlib
import pty
import re
import select
import shutil
import subprocess
import sys
import time
import unittest

BOLO, BOLOD, MANUAL, SOURCE = (pathlib.Path(path) for path in sys.argv[1:5])
COMPLETION = SOURCE / "bolo.bash"
PATH = f"{BOLO.parent}:{os.environ['PATH']}"


def help_of(*command):
    return subprocess.run([*map(str, command), "--help"], capture_output=True, text=True, check=True).stdout


def verbs_in(text):
    return re.findall(r"^  (\w+) +\S", text, re.MULTILINE)


def options_in(text):
    return re.findall(r"^ +(?:-\w, )?--([\w-]+)", text, re.MULTILINE)


VERBS = verbs_in(help_of(BOLO))
# Command lines, and their --help.
COMMANDS = {("bolo", verb): help_of(BOLO, verb) for verb in VERBS}
COMMANDS[("bolod",)] = help_of(BOLOD)


def page_of(command):
    if command == ("bolod",):
        return (MANUAL / "man8/bolod.8").read_text()
    return (MANUAL / "man1" / ("-".join(command[:2]) + ".1")).read_text()


def complete(*words):
    script = 'source "$1"; shift; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _bolo; printf "%s\\n" "${COMPREPLY[@]}"'
    run = ["bash", "--norc", "-uc", script, "bash", str(COMPLETION), *words]
    done = subprocess.run(run, capture_output=True, text=True, env={**os.environ, "PATH": PATH})
    if done.returncode != 0 or done.stderr:
        raise AssertionError(f"{words}: {done.stderr}")
    return done.stdout.split()


class Pages(unittest.TestCase):
    def test_every_verb_and_option_is_in_its_page(self):
        self.assertGreater(len(VERBS), 10)
        overview = (MANUAL / "man1/bolo.1").read_text()
        for verb in VERBS:
            self.assertIn(f"bolo\\-{verb}", overview)
        for command, text in COMMANDS.items():
            options = options_in(text)
            self.assertIn("help", options, command)
            page = page_of(command)
            for option in options:
                escaped = option.replace("-", "\\-")
                self.assertIn(f"\\-\\-{escaped}\\fR", page, (command, option))

    def test_every_key_of_the_configuration_is_in_its_page(self):
        document = subprocess.run([BOLOD, "--print-config"], capture_output=True, text=True, check=True).stdout
        page = (MANUAL / "man5/bolod.toml.5").read_text()
        keys = re.findall(r"^#?(\w+) = ", document, re.MULTILINE)
        self.assertGreater(len(keys), 50)
        for key in keys:
            self.assertIn(f".TP\n\\fB{key}\\fR\n", page)
        for section in re.findall(r"^\[(\w+)\]", document, re.MULTILINE):
            self.assertIn(f".SS [{section}]\n", page)

    @unittest.skipUnless(shutil.which("mandoc"), "mandoc is not installed")
    def test_mandoc_finds_nothing(self):
        for page in sorted(MANUAL.glob("man?/*.[158]")):
            lint = subprocess.run(["mandoc", "-T", "lint", "-W", "warning", page], capture_output=True, text=True)
            self.assertEqual(lint.stdout + lint.stderr, "")


class Completion(unittest.TestCase):
    def test_offers_every_verb_and_option(self):
        self.assertEqual(set(complete("bolo", "")), {*VERBS, "--help"})
        self.assertEqual(complete("bolo", "diag"), ["diagnose"])
        for command, text in COMMANDS.items():
            self.assertEqual(set(complete(*command, "--")), {f"--{option}" for option in options_in(text)}, command)

    def test_offers_the_words_that_a_value_may_be(self):
        self.assertEqual(complete("bolo", "deblur", "--solver", ""), ["admm", "dual", "exact", "inverse", "mmae", "motion"])
        self.assertEqual(complete("bolo", "deblur", "--solver", "=", "ex"), ["exact"])
        self.assertEqual(complete("bolo", "deblur", "--tau", ""), [])

    def test_offers_files_and_folders(self):
        folder = str(MANUAL) + "/"
        self.assertEqual(set(complete("bolo", "info", folder)), {folder + "man1", folder + "man5", folder + "man8"})
        self.assertEqual(complete("bolod", "--config", folder + "man8/bolod.8."), [folder + "man8/bolod.8.gz"])
        self.assertEqual(complete("bolo", "diagnose", "-o", str(COMPLETION)), [])

    def test_offers_daemons_that_run(self):
        name = f"manual-test-{os.getpid()}"
        segment = pathlib.Path("/dev/shm") / f"bolo.{name}"
        segment.touch()
        try:
            self.assertEqual(complete("bolo", "stat", "manual-test-"), [name])
        finally:
            segment.unlink()

    def test_works_in_an_interactive_bash(self):
        child, terminal = pty.fork()
        if child == 0:
            os.execvpe("bash", ["bash", "--norc", "--noprofile", "-i"], {**os.environ, "PATH": PATH, "PS1": "$ ", "TERM": "dumb"})
        os.write(terminal, f"bind 'set bell-style none'; source '{COMPLETION}'\n".encode())
        os.write(terminal, b"bolo diagn\t--withh\tX\n")
        seen, end = b"", time.monotonic() + 30
        while b"bolo diagnose --withhold X" not in seen and time.monotonic() < end:
            if select.select([terminal], [], [], 1.0)[0]:
                seen += os.read(terminal, 4096)
        os.write(terminal, b"exit\n")
        os.close(terminal)
        os.waitpid(child, 0)
        self.assertIn(b"bolo diagnose --withhold X", seen)

    @unittest.skipUnless(shutil.which("fish"), "fish is not installed")
    def test_fish_offers_the_same(self):
        def offers(line):
            script = f"source {SOURCE}/bolo.fish; complete -C '{line}'"
            done = subprocess.run(["fish", "--no-config", "-c", script], capture_output=True, text=True, check=True,
                                  env={**os.environ, "PATH": PATH})
            return {entry.split("\t")[0] for entry in done.stdout.splitlines()}

        self.assertEqual(offers("bolo "), set(VERBS))
        for command, text in COMMANDS.items():
            if command[0] == "bolo":
                self.assertEqual(offers(" ".join(command) + " --"), {f"--{option}" for option in options_in(text)})

    @unittest.skipUnless(shutil.which("zsh"), "zsh is not installed")
    def test_zsh_reads_it(self):
        done = subprocess.run(["zsh", "-n", SOURCE / "_bolo"], capture_output=True, text=True)
        self.assertEqual((done.returncode, done.stderr), (0, ""))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)

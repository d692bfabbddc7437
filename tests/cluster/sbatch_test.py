"""bolo's command lines in tools/slurm/bolo-deblur.sbatch, without Slurm: sbatch_test.py SCRIPT.

A program that prints its arguments replaces bolo.
"""

import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

SCRIPT = pathlib.Path(sys.argv[1]).resolve()
PRINTS = "#!/bin/sh\nprintf '%s\\n' \"$@\"\n"


class Script(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        for name in ("b.h5", "a b.h5"):
            (self.folder / name).touch()
        self.program("bolo", PRINTS)

    def program(self, name, text):
        path = self.folder / name
        path.write_text(text)
        path.chmod(0o755)
        return path

    def run_script(self, **variables):
        environment = {k: v for k, v in os.environ.items() if not k.startswith(("SLURM_", "OMPI_"))}
        environment.update(BOLO=str(self.folder / "bolo"), CAPTURES=str(self.folder), OUT="sharp")
        environment.update({k: str(v) for k, v in variables.items()})
        done = subprocess.run([SCRIPT], capture_output=True, text=True, cwd=self.folder,
                              env={k: v for k, v in environment.items() if v != "None"})
        said = [line for line in done.stdout.splitlines() if not line.startswith("bolo-deblur.sbatch:")]
        return done.returncode, said, done.stderr

    def test_the_part_is_left_to_bolo(self):
        _, arguments, _ = self.run_script(SLURM_ARRAY_TASK_ID=3, SLURM_ARRAY_TASK_MIN=0, SLURM_ARRAY_TASK_MAX=3,
                                          SLURM_ARRAY_TASK_COUNT=4)
        self.assertEqual(arguments, ["deblur", str(self.folder), "-o", "sharp", "--threads", "1"])

    def test_captures_are_a_folder_a_list_or_one(self):
        (self.folder / "list.txt").write_text("a b.h5\n\nb.h5\n")
        (self.folder / "odd.txt").write_text("b.h5\n--overwrite\n")
        for given, captures in ((".", ["."]), ("list.txt", ["a b.h5", "b.h5"]), ("odd.txt", ["b.h5", "./--overwrite"]), ("a b.h5", ["a b.h5"])):
            _, arguments, _ = self.run_script(CAPTURES=given)
            self.assertEqual(arguments[:len(captures) + 3], ["deblur", *captures, "-o", "sharp"])

    def test_options_and_threads(self):
        _, arguments, _ = self.run_script(OPTIONS="--solver exact", SLURM_CPUS_PER_TASK=3)
        text = "|".join(arguments)
        for part in ("--threads|3", "--solver|exact"):
            self.assertIn(part, text)

    def test_tasks_of_a_job_are_started_by_srun(self):
        self.program("srun", PRINTS)
        _, arguments, _ = self.run_script(SLURM_NTASKS=4, PATH=f"{self.folder}:{os.environ['PATH']}", SLURM_CPUS_PER_TASK=2)
        self.assertEqual(arguments[:3], ["--cpus-per-task=2", str(self.folder / "bolo"), "deblur"])

    def test_bad_input_is_one_line_and_exit_code_2(self):
        for variables, word in (({"CAPTURES": None}, "CAPTURES"), ({"OUT": None}, "OUT"), ({"CAPTURES": "none.txt"}, "none.txt"),
                                ({"CAPTURES": "none.h5"}, "none.h5")):
            with self.subTest(word=word):
                code, arguments, said = self.run_script(**variables)
                self.assertEqual((code, arguments), (2, []))
                self.assertEqual(said.count("\n"), 1)
                self.assertIn(word, said)

    def test_exit_codes_are_bolos(self):
        for code in (1, 2):
            self.program("bolo", f"#!/bin/sh\necho once\nexit {code}\n")
            self.assertEqual(self.run_script()[:2], (code, ["once"]))

    def test_a_killed_program_is_started_again(self):
        self.program("bolo", "#!/bin/sh\necho started\n[ -e again ] || { touch again; kill -9 $$; }\n")
        self.assertEqual(self.run_script()[:2], (0, ["started", "started"]))
        self.program("bolo", "#!/bin/sh\necho started\nkill -9 $$\n")
        self.assertEqual(self.run_script(TRIES=2)[:2], (137, ["started", "started"]))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)

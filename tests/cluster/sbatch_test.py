"""What tools/slurm/bolo-deblur.sbatch asks bolo to do, without Slurm: sbatch_test.py SCRIPT.

A program that prints its arguments stands for bolo.
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
        folder = tempfile.TemporaryDirectory(prefix="bolo-sbatch-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
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

    def shard(self, task, numbers, step=1):
        """The part of a task of an array, as Slurm describes it: it says step 1 of an array with gaps."""
        code, arguments, _ = self.run_script(SLURM_ARRAY_TASK_ID=task, SLURM_ARRAY_TASK_MIN=min(numbers),
                                             SLURM_ARRAY_TASK_MAX=max(numbers), SLURM_ARRAY_TASK_STEP=step,
                                             SLURM_ARRAY_TASK_COUNT=len(numbers))
        self.assertEqual(code, 0)
        return arguments[arguments.index("--shard") + 1]

    def test_every_part_has_a_task(self):
        for numbers, step in ((range(0, 4), 1), (range(1, 4), 1), (range(7, 14, 3), 3), (range(5, 6), 1)):
            with self.subTest(numbers=numbers):
                shards = [self.shard(task, numbers, step) for task in numbers]
                self.assertEqual(shards, [f"{i}/{len(numbers)}" for i in range(len(numbers))])

    def test_tasks_of_an_array_with_gaps_have_parts_of_their_own(self):
        self.assertEqual([self.shard(task, (1, 3, 7)) for task in (1, 3, 7)], ["0/7", "2/7", "6/7"])

    def test_a_job_without_array_does_everything(self):
        _, arguments, _ = self.run_script()
        self.assertEqual(arguments[arguments.index("--shard") + 1], "0/1")

    def test_captures_are_a_folder_a_list_or_one(self):
        (self.folder / "list.txt").write_text("a b.h5\n\nb.h5\n")
        for given, captures in ((".", ["."]), ("list.txt", ["a b.h5", "b.h5"]), ("a b.h5", ["a b.h5"])):
            _, arguments, _ = self.run_script(CAPTURES=given)
            self.assertEqual(arguments[:len(captures) + 3], ["deblur", *captures, "-o", "sharp"])

    def test_options_threads_and_job_folder(self):
        _, arguments, _ = self.run_script(JOB="a job", OPTIONS="--solver exact", SLURM_CPUS_PER_TASK=3)
        text = "|".join(arguments)
        for part in ("--threads|3", "--job|a job", "--solver|exact"):
            self.assertIn(part, text)

    def test_ranks_are_launched_and_have_no_part(self):
        self.program("mpirun", PRINTS)
        self.program("srun", PRINTS)
        path = f"{self.folder}:{os.environ['PATH']}"
        _, arguments, _ = self.run_script(SLURM_NTASKS=4, PATH=path)
        self.assertEqual(arguments[:3], ["--bind-to", "none", str(self.folder / "bolo")])
        self.assertNotIn("--shard", arguments)
        _, arguments, _ = self.run_script(SLURM_NTASKS=4, PATH=path, LAUNCH="srun --mpi=pmix", SLURM_CPUS_PER_TASK=2)
        self.assertEqual(arguments[:3], ["--mpi=pmix", "--cpus-per-task=2", str(self.folder / "bolo")])

    def test_bad_input_is_one_line_and_exit_code_2(self):
        gap = {"SLURM_NTASKS": 4, "SLURM_ARRAY_TASK_COUNT": 2, "SLURM_ARRAY_TASK_MAX": 1}
        for variables, word in (({"CAPTURES": None}, "CAPTURES"), ({"OUT": None}, "OUT"), ({"CAPTURES": "none.txt"}, "none.txt"),
                                ({"CAPTURES": "none.h5"}, "none.h5"), (gap, "--array=0")):
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

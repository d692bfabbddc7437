"""The Slurm script on a real one-node Slurm whose tasks are killed: slurm_test.py BOLO SLURM SCRIPT.

Whatever is killed, the last job's outputs equal a single process's byte by byte. Exit code 77: Slurm is not installed.
"""

import os
import signal
import subprocess
import sys
import unittest

from archive import SOLVER, TOTAL, Archive, Work, run, set_up, wait_for

BOLO, SLURM, SCRIPT = (os.path.abspath(path) for path in sys.argv[1:4])


class Slurm(unittest.TestCase):
    def setUp(self):
        self.work = Work(ARCHIVE, self.id().rsplit(".")[-1])
        self.logs = self.work.out.parent
        self.environment = {k: v for k, v in os.environ.items() if not k.startswith("SLURM_")}
        self.environment.update(SLURM_CONF=f"{ARCHIVE.folder}/slurm/slurm.conf", BOLO=str(ARCHIVE.bolo),
                                CAPTURES=str(ARCHIVE.captures[0].parent), OUT=str(self.work.out), OPTIONS=" ".join(SOLVER))
        self.addCleanup(self.slurm, "scancel", "--user", str(os.getuid()))

    def slurm(self, *command):
        return run(*command, env=self.environment, cwd=self.logs).strip()

    def submit(self, *options):
        return self.slurm("sbatch", "--parsable", "--cpus-per-task=1", *options, SCRIPT)

    def jobs(self):
        return self.slurm("squeue", "--noheader", "--array", "--format=%i %T").splitlines()

    def log(self):
        return "\n".join(f"{path.name}:\n{path.read_text()[-1500:]}" for path in sorted(self.logs.glob("*.log")))

    def wait_for_the_middle(self):
        try:
            self.work.wait_for_the_middle(lambda: not self.jobs())
        except AssertionError as error:
            self.fail(f"{error}\n{self.log()}")

    def expect_done(self):
        wait_for(lambda: not self.jobs(), f"the end of {self.jobs()}")
        self.assertFalse(self.work.differences(), self.log())

    def test_the_last_job_does_what_killed_tasks_left(self):
        array = self.submit("--array=0-2")
        last = self.submit("--array=0", f"--dependency=afterany:{array}")
        self.wait_for_the_middle()
        self.slurm("scancel", f"{array}_1")
        wait_for(lambda: [job for job in self.jobs() if job.startswith(array)] == [], f"the end of array {array}")
        left = TOTAL - len(self.work.done())
        self.assertGreater(left, 0, "nothing is left for the last job")
        before = self.work.done()
        self.expect_done()
        self.assertEqual({path: self.work.done()[path] for path in before}, before)
        self.assertIn("done before", (self.logs / f"bolo-deblur-{last}_0.log").read_text())

    def test_a_killed_program_is_started_again_within_its_task(self):
        job = self.submit("--array=0")
        self.wait_for_the_middle()
        os.kill(self.work.processes("SLURM_JOB_ID")[job], signal.SIGKILL)
        self.expect_done()
        self.assertIn("start 0.2", self.log())

    def test_out_of_time_a_task_queues_again(self):
        job = self.submit("--array=0")
        self.wait_for_the_middle()
        self.slurm("scancel", "--batch", "--signal=USR1", job)
        wait_for(lambda: self.jobs() == [f"{job}_0 PENDING"], "the job back in the queue")
        before = self.work.done()
        self.assertLess(len(before), TOTAL)
        # Slurm would wait two minutes, and would take a restart within the same second for the first start.
        self.slurm("scontrol", "update", f"JobId={job}", "StartTime=now+2")
        wait_for(lambda: "start 1.1" in self.log(), "the task's second start")
        self.expect_done()
        self.assertEqual({path: self.work.done()[path] for path in before}, before)

    def test_tasks_of_which_one_is_killed_are_started_again(self):
        self.submit("--array=0", "--ntasks=2")
        self.wait_for_the_middle()
        os.kill(self.work.processes("SLURM_PROCID")["1"], signal.SIGKILL)
        self.expect_done()
        self.assertIn("2 at once, start 0.2", self.log())

    def test_tasks_and_array_share_the_captures(self):
        job = self.submit("--array=1-2", "--ntasks=2")
        self.expect_done()
        parts = [line.split("part ")[1].split(" (")[0] for line in self.log().splitlines() if "; part " in line]
        self.assertEqual(sorted(parts), [f"{i} of 4" for i in range(4)], f"job {job}\n{self.log()}")


if __name__ == "__main__":
    ARCHIVE = Archive(BOLO)
    try:
        set_up(SLURM, "up", ARCHIVE.folder / "slurm")
        unittest.main(argv=sys.argv[:1], verbosity=2)
    finally:
        subprocess.run([SLURM, "down", ARCHIVE.folder / "slurm"], check=False)
        ARCHIVE.close()

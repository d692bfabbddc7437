"""bolo deblur by MPI on several hosts, some of which are lost: hosts_test.py BOLO HOSTS.

Every way must give, byte for byte, what one process makes. Exit code 77: no root, no network namespaces, no mpirun.
"""

import os
import shutil
import signal
import subprocess
import sys
import unittest

from archive import TOTAL, Archive, Work, run, set_up, skip, wait_for

BOLO, HOSTS = (os.path.abspath(path) for path in sys.argv[1:3])


class Hosts(unittest.TestCase):
    def setUp(self):
        self.work = Work(ARCHIVE, self.id().rsplit(".")[-1])
        self.running = None

    def tearDown(self):
        if self.running is not None and self.running.poll() is None:
            self.running.kill()
            self.running.wait()
        self.wait_until_no_rank_is_left()

    def start(self, ranks, *flags):
        log = open(self.work.job.parent / "log", "a+")
        self.addCleanup(log.close)
        command = [HOSTS, "mpirun", *flags, "-np", ranks, *self.work.command, "--rank-timeout", 3]
        self.running = subprocess.Popen([str(c) for c in command], stdout=log, stderr=subprocess.STDOUT)

    def end(self, seconds=60):
        return self.running.wait(timeout=seconds)

    def log(self):
        return (self.work.job.parent / "log").read_text()[-3000:]

    def ranks(self):
        return self.work.processes("OMPI_COMM_WORLD_RANK")

    def wait_for_the_middle(self):
        try:
            self.work.wait_for_the_middle(lambda: self.running.poll() is not None)
        except AssertionError as error:
            self.fail(f"{error}\n{self.log()}")

    def kill_rank(self, rank):
        """Kills it while blocks are missing."""
        self.wait_for_the_middle()
        os.kill(self.ranks()[str(rank)], signal.SIGKILL)

    def wait_until_no_rank_is_left(self):
        wait_for(lambda: not self.ranks(), "the end of all ranks", 20)

    def expect_done(self):
        self.assertEqual(self.end(), 0, self.log())
        self.assertFalse(self.work.differences())

    def expect_the_rest_is_done_once(self, ranks):
        """The same command again: it keeps the blocks that there are."""
        self.wait_until_no_rank_is_left()
        before = self.work.records()
        self.assertLess(len(before), TOTAL)
        self.start(ranks)
        self.expect_done()
        after = self.work.records()
        self.assertEqual(len(after), TOTAL)
        self.assertEqual({path: after[path] for path in before}, before)

    def test_two_hosts(self):
        self.start(2)
        self.expect_done()
        self.assertIn("2 ranks on 2 hosts", self.log())

    def test_four_hosts_that_share_nothing_but_a_folder(self):
        self.start(4)
        self.wait_for_the_middle()
        ranks = self.ranks()
        self.assertEqual(len(ranks), 4)
        for kind in ("net", "mnt", "uts", "ipc", "pid"):
            self.assertEqual(len({os.readlink(f"/proc/{pid}/ns/{kind}") for pid in ranks.values()}), 4, kind)
        self.expect_done()
        self.assertIn("4 ranks on 4 hosts", self.log())

    def test_others_go_on_when_a_rank_is_killed(self):
        self.start(4, "--enable-recovery")
        self.kill_rank(2)
        self.expect_done()

    def test_a_host_that_loses_its_power_costs_only_time(self):
        self.start(4, "--enable-recovery")
        self.wait_for_the_middle()
        self.addCleanup(lambda: (run(HOSTS, "down"), run(HOSTS, "up", 4, ARCHIVE.folder)))
        run(HOSTS, "kill", NAMES[3])
        # mpirun itself waits for ever for the host's daemon, and is ended by hand (or by a queue's time limit).
        wait_for(lambda: not self.ranks(), "the end of the other ranks")
        self.running.kill()
        self.assertFalse(self.work.differences(), self.log())

    def test_without_recovery_the_same_command_goes_on(self):
        self.start(2)
        self.kill_rank(0)
        self.assertNotEqual(self.end(), 0)
        self.expect_the_rest_is_done_once(2)

    def test_mpirun_is_killed(self):
        self.start(4)
        self.wait_for_the_middle()
        # Ranks outlive mpirun by a second or two, until their host's daemon misses it; they must not finish by then.
        for rank in self.ranks().values():
            os.kill(rank, signal.SIGSTOP)
        self.running.kill()
        self.end()
        self.expect_the_rest_is_done_once(4)


if __name__ == "__main__":
    if shutil.which("mpirun") is None:
        skip("mpirun is not installed")
    if not os.path.exists(os.path.join(os.path.dirname(BOLO), "bolo-mpi.so")):
        skip("bolo was built without MPI")
    ARCHIVE = Archive(BOLO)
    try:
        NAMES = set_up(HOSTS, "up", 4, ARCHIVE.folder)
        unittest.main(argv=sys.argv[:1], verbosity=2)
    finally:
        run(HOSTS, "down")
        ARCHIVE.close()

"""Which skipped tests fail a check: skips_test.py SKIPS_PY."""

import pathlib
import subprocess
import sys
import tempfile
import unittest

SKIPS_PY = sys.argv[1]
TESTS = r"""
add_test(good /bin/echo fine)
add_test(data sh -c "echo 'a.cpp:12: Skipped'; echo 'BOLO_TEST_DATA is not set: no captures'; echo; echo '[  SKIPPED ] A.B'")
set_tests_properties(data PROPERTIES SKIP_REGULAR_EXPRESSION "SKIPPED")
add_test(root sh -c "echo 'a.cpp:3: Skipped'; echo 'needs root'; echo; echo '[  SKIPPED ] A.C'")
set_tests_properties(root PROPERTIES SKIP_REGULAR_EXPRESSION "SKIPPED")
add_test(numpy sh -c "echo 'skipped: python3-numpy is not installed'; exit 77")
set_tests_properties(numpy PROPERTIES SKIP_RETURN_CODE 77)
add_test(part sh -c "echo 'test_fish (m.T.test_fish) ... skipped \"fish is not installed\"' >&2")
add_test(program sh -c "echo 'a.cpp:3: Skipped'; echo 'needs root'; echo; echo '[  SKIPPED ] A.C (0 ms)'; echo '[ OK ] A.D'")
foreach(n 1 2 3 4)
  add_test(busy${n} sh -c "test -e ran${n} || { touch ran${n}; exit 1; }")
endforeach()
add_test(bad sh -c "echo why it is so; exit 1")
"""


class Skips(unittest.TestCase):
    def check(self, *tests):
        with tempfile.TemporaryDirectory() as folder:
            (pathlib.Path(folder) / "CTestTestfile.cmake").write_text(TESTS)
            run = [sys.executable, SKIPS_PY, folder, "-j", "2", "-R", f"^({'|'.join(tests)})$"]
            return subprocess.run(run, capture_output=True, text=True)

    def test_missing_data_are_no_failure_and_the_summary_is_last(self):
        done = self.check("good", "data")
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        told, summary = done.stdout.split("100% tests passed")
        self.assertIn("data: BOLO_TEST_DATA is not set: no captures", told)
        self.assertIn("0 tests failed out of 2", summary)
        self.assertNotIn("BOLO_TEST_DATA", summary)

    def test_every_other_reason_is(self):
        for test, reason in (("root", "needs root"), ("numpy", "python3-numpy is not installed"), ("part", "fish is not"),
                             ("program", "program: A.C: needs root")):
            done = self.check("good", "data", test)
            self.assertEqual(done.returncode, 1, done.stdout)
            self.assertIn(reason, done.stdout)
            self.assertIn("1 of these skips must not be", done.stderr)

    def test_a_failure_stays_one(self):
        done = self.check("good", "bad", "data")
        self.assertEqual(done.returncode, 8)
        self.assertIn("failed: bad\nwhy it is so\n", done.stdout)
        self.assertIn("bad", done.stdout.split("tests passed")[1])
        self.assertNotIn("second run", done.stdout)

    def test_a_few_may_pass_in_their_second_run(self):
        done = self.check("good", "busy1", "busy2")
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        self.assertIn("passed only in its second run: busy1\npassed only in its second run: busy2\n100% tests", done.stdout)
        done = self.check("good", "busy1", "busy2", "busy3", "busy4")
        self.assertEqual(done.returncode, 1)
        self.assertIn("4 tests passed only in their second run", done.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)

"""What is installed fits together: package_test.py BUILD SOURCE."""

import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

BUILD, SOURCE = (pathlib.Path(path) for path in sys.argv[1:3])


class Installed(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="bolo-installed-")
        cls.root = pathlib.Path(cls.folder.name)
        run = ["cmake", "--install", BUILD, "--component", "bolo", "--prefix", "/usr"]
        done = subprocess.run(run, capture_output=True, text=True, env={**os.environ, "DESTDIR": str(cls.root)})
        if done.returncode != 0:
            raise AssertionError(done.stderr)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def test_dpkg_knows_every_configuration_file(self):
        listed = (SOURCE / "cmake/packaging/bolo/conffiles").read_text().split()
        found = ["/" + str(f.relative_to(self.root)) for f in (self.root / "etc").rglob("*") if f.is_file()]
        self.assertEqual(sorted(listed), sorted(found))

    def test_the_configurations_are_right(self):
        for name in ("bolod.toml", "demo.toml"):
            run = [self.root / "usr/bin/bolod", "--check-config", "--config", self.root / "etc/bolo" / name]
            self.assertEqual(subprocess.run(run, capture_output=True).returncode, 0, name)

    def test_units_run_what_is_installed_and_document_it(self):
        units = sorted((self.root / "usr/lib/systemd/system").glob("*.service"))
        self.assertEqual(len(units), 2)
        for unit in units:
            text = unit.read_text()
            for program in re.findall(r"/usr/bin/\w+", text):
                self.assertTrue((self.root / program[1:]).is_file(), program)
            for page, chapter in re.findall(r"man:([\w.-]+)\((\d)\)", text):
                self.assertTrue((self.root / f"usr/share/man/man{chapter}/{page}.{chapter}.gz").is_file(), page)

    @unittest.skipUnless(shutil.which("systemd-analyze"), "systemd-analyze is not installed")
    def test_units_are_confined(self):
        for unit in sorted((self.root / "usr/lib/systemd/system").glob("*.service")):
            run = ["systemd-analyze", "security", "--offline=true", "--threshold=15", "--no-pager", unit]
            done = subprocess.run(run, capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stdout[-500:] + done.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)

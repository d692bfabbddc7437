"""Contents of the built packages are consistent: package_test.py BUILD SOURCE."""

import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time
import unittest

BUILD, SOURCE = (pathlib.Path(path) for path in sys.argv[1:3])


class Installed(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.root = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory()))
        run = ["cmake", "--install", BUILD, "--component", "bolo", "--prefix", "/usr"]
        done = subprocess.run(run, capture_output=True, text=True, env={**os.environ, "DESTDIR": str(cls.root)})
        if done.returncode != 0:
            raise AssertionError(done.stderr)

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

    def test_the_documentation_links_to_nothing_that_is_not_there(self):
        for page in (self.root / "usr/share/doc/bolo").rglob("*.md"):
            text = re.sub(r"^ *```.*?^ *```", "", page.read_text(), flags=re.M | re.S)
            for link in re.findall(r"\]\(([^)#:]+)[#)]", text):
                self.assertTrue((page.parent / link).exists(), f"{page.name}: {link}")

    def test_a_fake_camera_whose_first_start_was_cut_off_starts_again(self):
        folder = self.root / "fakecam"
        folder.mkdir()
        unit = (self.root / "usr/lib/systemd/system/bolo-fakecam.service").read_text()
        line = re.search(r"^ExecStartPre=/bin/sh -c '(.*)'$", unit, re.M)[1].replace("/usr/bin", f"{self.root}/usr/bin")
        line = line.replace("%S/bolo-fakecam", str(folder)).replace("--frames 800", "--frames 3")
        endless = [self.root / "usr/bin/bolo", "simulate", "-o", folder / "street.h5", "--frames", "5000"]
        cut_off = subprocess.Popen(endless)
        while not (folder / "street.h5.part").exists() or (folder / "street.h5.part").stat().st_size < 60_000_000:
            self.assertIsNone(cut_off.poll())
            time.sleep(0.01)
        cut_off.kill()
        cut_off.wait()
        self.assertEqual(subprocess.run(["sh", "-c", line], stdout=subprocess.DEVNULL).returncode, 0)
        self.assertTrue((folder / "street.h5").is_file())

    def test_no_setting_of_the_kernel_is_anybodys_but_ours(self):
        self.assertFalse(list(self.root.rglob("modprobe.d")), "v4l2loopback's options are those of all its users")
        self.assertTrue((self.root / "usr/share/bolo/bolo-v4l2loopback.conf").is_file())
        settings = [f.name for f in (self.root / "usr/lib/sysctl.d").iterdir()]
        self.assertEqual(settings, ["00-bolo.conf"], "an administrator's file is read later, and holds")

    @unittest.skipUnless(shutil.which("systemd-analyze"), "systemd-analyze is not installed")
    def test_units_are_confined(self):
        for unit in sorted((self.root / "usr/lib/systemd/system").glob("*.service")):
            run = ["systemd-analyze", "security", "--offline=true", "--threshold=20", "--no-pager", unit]
            done = subprocess.run(run, capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stdout[-500:] + done.stderr)


class Scripts(unittest.TestCase):
    """Maintainer scripts in a private root, with stand-ins for programs that change the system."""

    def setUp(self):
        self.root = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        for name in ("usr", "dev/shm", "etc/systemd/system", "proc/sys/net/core", "run/systemd/system", "stand-ins"):
            (self.root / name).mkdir(parents=True)
        for name in ("bin", "lib", "lib64", "sbin"):
            (self.root / name).symlink_to(f"usr/{name}")
        for name in ("getent", "systemctl", "systemd-sysusers", "deb-systemd-invoke", "userdel", "groupdel"):
            self.stand_in(name, f'echo "{name} $*" >>/called')
        self.stand_in("getent", "echo bolo:x:998:998:Bolo camera daemon:/var/lib/bolo:/usr/sbin/nologin")

    def stand_in(self, name, text):
        script = self.root / "stand-ins" / name
        script.write_text(f"#!/bin/sh\n{text}\n")
        script.chmod(0o755)

    def write(self, name, text=""):
        file = self.root / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        return file

    def run_script(self, name, *arguments, before=""):
        """The system's programs are readable; /usr/lib/sysctl.d contains only our file."""
        shutil.copy(SOURCE / "cmake/packaging/bolo" / name, self.root / "script")
        shutil.copy(SOURCE / "systemd/sysctl.conf", self.root / "00-bolo.conf")
        into_it = f"""set -e
            mount --rbind /usr "$0/usr"
            mount -t tmpfs none "$0/usr/lib/sysctl.d"
            cp "$0/00-bolo.conf" "$0/usr/lib/sysctl.d"
            {before}
            chroot "$0" /usr/bin/env PATH=/stand-ins:/usr/sbin:/usr/bin sh /script "$@\""""
        run = ["unshare", "--mount", *([] if os.geteuid() == 0 else ["--map-root-user"]), "sh", "-c", into_it]
        return subprocess.run([*run, self.root, *arguments], capture_output=True, text=True)

    def purged(self, **how):
        """What is said on standard error."""
        done = self.run_script("postrm", "purge", **how)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stderr

    def test_the_receive_buffer_is_raised_and_never_lowered(self):
        for before, after in ((212992, 8388608), (16777216, 16777216)):
            limit = self.write("proc/sys/net/core/rmem_max", f"{before}\n")
            done = self.run_script("postinst", "configure")
            self.assertEqual((done.returncode, int(limit.read_text())), (0, after), done.stderr)

    def test_purging_leaves_nothing_that_the_manual_tells_to_make(self):
        system = "etc/systemd/system"
        ours = [self.write(name) for name in (
            "etc/bolo/front.toml", "etc/modprobe.d/bolo-v4l2loopback.conf",
            f"{system}/bolod@front.service.d/override.conf", f"{system}/bolod@.service.d/override.conf",
            f"{system}/bolo-fakecam.service.d/override.conf", f"{system}/multi-user.target.wants/bolod@front.service")]
        others = [self.write(f"{system}/other.service.d/override.conf"), self.write("etc/modprobe.d/other.conf")]
        self.assertEqual(self.run_script("postrm", "remove").returncode, 0)
        self.assertTrue(all(file.exists() for file in ours), "removing is not purging")
        self.purged()
        self.assertEqual([str(file) for file in ours if file.exists()], [])
        self.assertFalse((self.root / system / "bolod@front.service.d").exists())
        self.assertTrue(all(file.exists() for file in others))

    def test_a_user_that_stays_does_not_break_purging(self):
        self.stand_in("userdel", "echo 'user bolo is used by process 1' >&2; exit 8")
        self.stand_in("groupdel", "exit 8")
        self.assertIn("userdel bolo failed: user bolo is used by process 1", self.purged())
        self.assertIn("systemctl daemon-reload", (self.root / "called").read_text())

    def test_purging_leaves_disks_that_are_mounted_in_its_folders(self):
        for place in ("var/lib/bolo", "var/lib/bolo/drives"):
            with self.subTest(place):
                state = self.write("var/lib/bolo/state")
                (self.root / place).mkdir(exist_ok=True)
                mount = f"""mount -t tmpfs none "$0/{place}"; echo mine >"$0/{place}/drive.h5"
                    trap 'cp "$0/{place}/drive.h5" "$0/saved"' EXIT"""
                said = self.purged(before=mount)
                self.assertTrue((self.root / "saved").exists(), said)
                self.assertTrue(state.exists())
                (self.root / "saved").unlink()

    def test_purging_leaves_files_of_others_in_its_folders(self):
        ours = [self.write(name) for name in ("etc/bolo/front.toml", "run/bolo/front.sock")]
        others = [self.write(name) for name in ("var/lib/bolo/drive.h5", "var/lib/bolo/a/b.h5", "etc/bolo/maps.h5",
                                                "run/bolo/x")]
        elsewhere = self.write("data/kept.toml")
        for again in (True, False):
            said = self.purged()
            self.assertEqual([str(file) for file in ours if file.exists()], [])
            self.assertTrue(elsewhere.exists())
            if again:
                self.assertTrue(all(file.exists() for file in others))
                self.assertIn("/var/lib/bolo stays", said)
                for folder in ("var/lib/bolo", "etc/bolo", "run/bolo"):
                    shutil.rmtree(self.root / folder)
                (self.root / "etc/bolo").symlink_to("/data")
                (self.root / "run/bolo").mkdir()
        self.assertEqual([name for name in ("etc/bolo", "run/bolo") if os.path.lexists(self.root / name)], [])

    def test_purging_leaves_somebody_of_its_users_name(self):
        self.stand_in("getent", "echo bolo:x:1000:1000:Bolo:/home/bolo:/bin/bash")
        self.purged()
        called = (self.root / "called").read_text()
        self.assertNotIn("userdel", called)
        self.assertNotIn("groupdel", called)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)

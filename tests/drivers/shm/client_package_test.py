"""The installed libbolo-client: its files, then the examples, built against it and run on a live stream.

usage: client_package_test.py CMAKE BUILD_FOLDER BOLO EXAMPLES
"""

import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[2] / "tools"))
from programs import Programs, run  # noqa: E402

CMAKE, BUILD, BOLO, EXAMPLES = sys.argv[1:5]
COMPONENTS = ("libbolo-client", "libbolo-client-dev", "python3-bolo")
STRICT = ["-Wall", "-Wextra", "-Wpedantic", "-Werror"]


class Installed(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory()))
        cls.prefix = cls.folder / "prefix"
        for component in COMPONENTS:
            run(CMAKE, "--install", BUILD, "--prefix", cls.prefix, "--component", component)
        library = next(cls.prefix.rglob("libbolo-client.so.0"))
        cls.environment = dict(os.environ, LD_LIBRARY_PATH=str(library.parent), PYTHONDONTWRITEBYTECODE="1",
                               PKG_CONFIG_PATH=str(library.parent / "pkgconfig"),
                               PYTHONPATH=str(next(cls.prefix.rglob("bolo.py")).parent))
        cls.environment.pop("BOLO_CLIENT_LIBRARY", None)
        cls.name = f"test-package-{os.getpid()}"
        programs = cls.enterClassContext(Programs(BOLO, None, cls.folder, cls.name, (64, 24)))
        programs.start_replay(programs.simulate("--frames", 200))

    def run_here(self, *words):
        return run(*words, env=self.environment)

    def check_viewer(self, program):
        lines = self.run_here(program, self.name, 3).splitlines()
        self.assertRegex(lines[0], r"64x24 at 200 Hz: ")
        self.assertEqual(len(lines), 4)
        for line in lines[1:]:
            self.assertRegex(line, r"^frame \d+: -?\d+\.\d\d C at \(\d+, \d+\), \d+ missed$")

    def check_points(self, program):
        lines = self.run_here(program, self.name, 5, "0,0", "63,23").splitlines()
        self.assertEqual(len(lines), 5)
        for line in lines:
            self.assertRegex(line, r"^frame \d+: \d{3}\.\d{3} \d{3}\.\d{3}$")
        outside = subprocess.run([program, self.name, "5", "64,0"], env=self.environment, capture_output=True, text=True, timeout=60)
        self.assertEqual((outside.returncode, outside.stdout), (1, ""))
        self.assertIn("(64, 0) is not inside the frame", outside.stderr)

    def test_files_are_where_they_are_looked_for(self):
        files = {str(path.relative_to(self.prefix)) for path in self.prefix.rglob("*") if not path.is_dir()}
        for ending in ("include/bolo/client.h", "include/bolo/shm_layout.h", "/libbolo-client.so",
                       "/libbolo-client.so.0", "/pkgconfig/bolo-client.pc", "/bolo-client/bolo-clientConfig.cmake",
                       "/bolo-client/bolo-clientConfigVersion.cmake", "lib/python3/dist-packages/bolo.py",
                       "/examples/viewer.c"):
            self.assertTrue(any(file.endswith(ending) for file in files), f"{ending} in {sorted(files)}")

    def test_soname_has_the_abis_number(self):
        library = next(self.prefix.rglob("libbolo-client.so.0"))
        self.assertIn("Library soname: [libbolo-client.so.0]", run("readelf", "-d", library))

    def test_examples_build_and_run_by_pkg_config(self):
        flags = self.run_here("pkg-config", "--cflags", "--libs", "bolo-client").split()
        viewer, points = self.folder / "viewer", self.folder / "points"
        run("cc", "-std=c11", *STRICT, pathlib.Path(EXAMPLES, "viewer.c"), "-o", viewer, *flags)
        run("c++", "-std=c++17", *STRICT, pathlib.Path(EXAMPLES, "points.cpp"), "-o", points, *flags)
        self.check_viewer(viewer)
        self.check_points(points)

    def test_examples_build_and_run_by_find_package(self):
        build = self.folder / "build"
        run(CMAKE, "-S", EXAMPLES, "-B", build, f"-DCMAKE_PREFIX_PATH={self.prefix}")
        run(CMAKE, "--build", build)
        self.check_viewer(build / "viewer")
        self.check_points(build / "points")

    def test_the_python_example_runs_without_opencv(self):
        hidden = self.folder / "no-opencv"
        hidden.mkdir()
        (hidden / "cv2.py").write_text("raise ImportError\n")
        environment = dict(self.environment, PYTHONPATH=f"{hidden}:{self.environment['PYTHONPATH']}")
        example = pathlib.Path(EXAMPLES, "opencv_view.py")
        lines = run("/usr/bin/python3", example, self.name, 60, env=environment).splitlines()
        self.assertGreater(len(lines), 0)
        for line in lines:
            self.assertRegex(line, r"^frame \d+: \d+\.\d\d to \d+\.\d\d K$")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)

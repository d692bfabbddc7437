"""The Python module against a daemon in another process.

usage: python_module_test.py BOLO MODULE_FOLDER LIBRARY. Exit code 77: numpy isn't there.
"""

import copy
import ctypes
import dataclasses
import gc
import math
import os
import pathlib
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[2] / "tools"))
from programs import needed, run  # noqa: E402

[np] = needed("numpy")
BOLO, MODULE_FOLDER, LIBRARY = sys.argv[1:4]
os.environ["BOLO_CLIENT_LIBRARY"] = LIBRARY
sys.path.insert(0, MODULE_FOLDER)

import bolo  # noqa: E402

HANG_S = 60


def mapped_ranges(name):
    """Address ranges where this process maps the stream."""
    ranges = []
    with open("/proc/self/maps") as maps:
        for line in maps:
            if line.split()[-1:] == [f"/dev/shm/bolo.{name}"]:
                ranges.append(tuple(int(end, 16) for end in line.split()[0].split("-")))
    return ranges


def address(array):
    return array.__array_interface__["data"][0]


class WithDaemon(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = cls.enterClassContext(tempfile.TemporaryDirectory())
        cls.capture = os.path.join(cls.folder, "in.h5")
        run(BOLO, "simulate", "-o", cls.capture, "--width", 64, "--height", 24, "--frames", 200)

    def setUp(self):
        self.name = f"test-python-{os.getpid()}-{self._testMethodName[:40]}"
        self.daemons = []
        self.start()

    def tearDown(self):
        self.end(signal.SIGTERM)
        for file in (f"/dev/shm/bolo.{self.name}", f"/dev/shm/bolo-lock.{self.name}"):
            pathlib.Path(file).unlink(missing_ok=True)

    def start(self, capture=None, *words):
        command = [BOLO, "replay", capture or self.capture, "--name", self.name, "--loop", *words]
        self.daemons.append(subprocess.Popen(command, stderr=subprocess.DEVNULL))

    def end(self, how):
        for daemon in self.daemons:
            daemon.send_signal(how)
            daemon.wait()

    def open(self, **options):
        return bolo.Camera(self.name, timeout=HANG_S, **options)

    def whole_frame(self, camera):
        """A copy of a frame with a full window; a busy machine may need several attempts."""
        while True:
            copy = camera.next(HANG_S).copy()
            if copy is not None and bolo.Flag.WARM_UP not in copy.flags:
                return copy

    def newest_points(self, camera, points):
        while True:
            try:
                return camera.points(points)
            except bolo.Unavailable:
                time.sleep(0.01)

    def test_the_period_is_that_of_the_newest_frame(self):
        with self.open() as camera:
            true = camera.info.frame_period_s
            camera.info = dataclasses.replace(camera.info, frame_period_s=1.0)  # not measured yet
            self.assertEqual(camera.next(HANG_S).info.frame_period_s, true)

    def test_frames_come_in_order_with_their_metadata(self):
        with self.open() as camera:
            self.assertEqual((camera.info.width, camera.info.height), (64, 24))
            self.assertTrue(camera.info.kelvin)
            before = None
            for frame in camera:
                self.assertEqual(frame.raw.shape, (24, 64))
                self.assertEqual(frame.deblurred.dtype, np.uint16)
                self.assertGreaterEqual(frame.publish_time, frame.receive_time)
                self.assertLess(abs(frame.utc - time.time()), HANG_S)
                self.assertEqual(frame.utc, frame.utc_ns * 1e-9)
                self.assertGreater(frame.utc_uncertainty, camera.info.frame_period_s / 2)
                self.assertLess(abs(time.monotonic() - frame.publish_time), HANG_S)
                if before is not None:
                    self.assertEqual(frame.number, before.number + 1 + frame.missed)
                    self.assertGreater(frame.camera_time, before.camera_time)
                before = frame
                if frame.number > 40:
                    break
            self.assertIsInstance(frame.flags, bolo.Flag)

    def test_motion_is_that_of_the_scene(self):
        self.end(signal.SIGTERM)
        config = os.path.join(self.folder, "motion.toml")
        with open(config, "w", encoding="utf-8") as f:
            f.write('name = "any"\n[deblur]\nsolver = "motion"\n')
        capture = os.path.join(self.folder, "street.h5")
        size = ("--width", 160, "--height", 48, "--frames", 400, "--speed", 300)
        run(BOLO, "simulate", "-o", capture, "--no-truth", *size)
        self.start(capture, "--config", config)
        with self.open() as camera:
            while True:
                frame = camera.next(HANG_S)
                if frame.motion is None:
                    continue
                copy = frame.copy()
                if copy is None or np.median(copy.motion[..., 2]) < 0.5:
                    continue
                self.assertEqual(frame.motion.shape, (6, 20, 3))
                self.assertEqual(frame.motion.dtype, np.float32)
                self.assertFalse(frame.motion.flags.writeable)
                self.assertTrue(any(begin <= address(frame.motion) < end for begin, end in mapped_ranges(self.name)))
                if frame.valid():
                    np.testing.assert_array_equal(frame.motion, copy.motion)
                    np.testing.assert_array_equal(frame.affine, copy.affine)
                # The scene moves right at 300 px/s.
                speed = np.median(copy.motion[..., 0])
                self.assertAlmostEqual(speed, 1.5, delta=0.3)
                self.assertAlmostEqual(copy.affine[0, 0], speed, delta=0.3)
                self.assertLess(abs(np.median(copy.motion[..., 1])), 0.2)
                twice = copy.copy()
                np.testing.assert_array_equal(twice.motion, copy.motion)
                break

    def test_planes_are_the_shared_memory_itself(self):
        with self.open() as camera:
            frame = camera.next()
            for plane in (frame.raw, frame.deblurred):
                begin = address(plane)
                self.assertTrue(any(a <= begin and begin + plane.nbytes <= b for a, b in mapped_ranges(self.name)))
                self.assertFalse(plane.flags.owndata)
                self.assertFalse(plane.flags.writeable)
                with self.assertRaises(ValueError):
                    plane[0, 0] = 1
                with self.assertRaises(ValueError):
                    plane.flags.writeable = True
            self.assertTrue(np.shares_memory(frame.raw, frame.raw))
            self.assertFalse(np.shares_memory(frame.raw, frame.deblurred))
            again = frame.raw
            deadline = time.monotonic() + HANG_S
            while frame.valid() and time.monotonic() < deadline:
                time.sleep(0.01)
            self.assertFalse(frame.valid(), "the ring comes round")
            self.assertTrue(np.shares_memory(again, frame.raw))
            copies = [copy for copy in (camera.next().copy() for _ in range(20)) if copy is not None]
            self.assertGreater(len(copies), 0)
            for copy in copies:
                self.assertTrue(copy.raw.flags.owndata)
                self.assertTrue(copy.valid())
                np.testing.assert_array_equal(copy.copy().deblurred, copy.deblurred)

    def test_kelvin_is_scale_and_offset_and_only_one_solver_carries_motion(self):
        with self.open() as camera:
            frame = self.whole_frame(camera)
            self.assertIsNone(frame.motion)
            self.assertIsNone(frame.affine)
            self.assertEqual(frame.kelvin().dtype, np.float32)
            np.testing.assert_allclose(
                frame.kelvin(), frame.deblurred * camera.info.scale + camera.info.offset, rtol=1e-6)
            np.testing.assert_allclose(frame.kelvin(frame.raw), frame.raw * camera.info.scale + camera.info.offset,
                                       rtol=1e-6)

    def test_points_are_the_deblurred_planes_values(self):
        points = [(0, 0), (63, 23), (17, 5)]
        compared = 0
        with self.open() as camera:
            while compared < 10:
                frame = self.whole_frame(camera)
                if frame.flags & (bolo.Flag.REDUCED | bolo.Flag.INVERSE | bolo.Flag.RAW):
                    continue  # degraded on a busy machine: points are not
                try:
                    camera.next(HANG_S)  # its look-ahead frame
                    values = camera.points(points, frame)
                except bolo.Unavailable:
                    continue
                expected = [frame.deblurred[y, x] * camera.info.scale + camera.info.offset for x, y in points]
                np.testing.assert_allclose(values, expected, rtol=1e-6)
                compared += 1
            with self.assertRaisesRegex(bolo.Unavailable, "left the ring"):
                first = self.whole_frame(camera)
                while first.number + camera.info.slot_count > camera.state().published:
                    camera.next(HANG_S)
                camera.points(points, first)
            self.assertEqual(len(self.newest_points(camera, points)), 3)
            self.assertEqual(len(camera.points([])), 0)
            for wrong in ([(64, 0)], [(0, 24)]):
                with self.assertRaisesRegex(bolo.Error, "not inside the frame of 64x24"):
                    camera.points(wrong)
            for wrong in ([(-1, 0)], [1, 2], [(1, 2, 3)], [(math.nan, 0)], [(0.5, 1)]):
                with self.assertRaises(ValueError):
                    camera.points(wrong)

    def test_a_killed_daemons_successor_is_followed(self):
        with self.open() as camera:
            old = camera.next()
            old_plane = old.raw
            self.end(signal.SIGKILL)
            kept = old_plane.copy()
            killed = time.monotonic()
            self.start()
            for frame in camera:
                if frame.restarted:
                    break
            print(f"{time.monotonic() - killed:.2f} s from kill to frame", file=sys.stderr)
            self.assertEqual(camera.restarts, 1)
            self.assertEqual(camera.info.writer_pid, self.daemons[1].pid)
            self.assertGreater(camera.next(HANG_S).number, frame.number)
            np.testing.assert_array_equal(old_plane, kept, "arrays keep the ring they lie in")
            self.assertEqual(len(mapped_ranges(self.name)), 1)
            del old, old_plane
            gc.collect()

    def test_arrays_outlive_their_camera(self):
        camera = self.open()
        plane = camera.next().raw
        camera.close()
        self.assertEqual(plane.shape, (24, 64))
        self.assertGreater(int(plane.max()), 0)
        self.assertEqual(len(mapped_ranges(self.name)), 1)
        with self.assertRaisesRegex(ValueError, "is closed"):
            camera.next()
        camera.close()
        del plane, camera
        gc.collect()
        self.assertEqual(mapped_ranges(self.name), [], "and nothing stays when they are gone")

    def test_a_camera_has_no_copies(self):
        camera = self.open()
        for made in (copy.copy, copy.deepcopy, pickle.dumps):
            with self.assertRaisesRegex(TypeError, "cannot be copied or pickled"):
                made(camera)
        self.assertIsNotNone(camera.next())

    def test_closing_ends_another_threads_wait(self):
        self.end(signal.SIGTERM)
        ends = []

        def wait(camera, wait_on):
            try:
                ends.append(wait_on(camera))
            except ValueError as error:
                ends.append(str(error))

        for wait_on in (bolo.Camera.next, bolo.Camera.latest, list):
            self.start()
            camera = self.open()
            self.end(signal.SIGKILL)
            while camera.next(0.2) is not None:
                pass  # frames left in the ring
            waiting = threading.Thread(target=wait, args=(camera, wait_on), daemon=True)
            waiting.start()
            time.sleep(0.05)
            camera.close()
            waiting.join(HANG_S)
            self.assertFalse(waiting.is_alive())
            with self.assertRaisesRegex(ValueError, "is closed"):
                camera.state()
        self.assertEqual(ends, [f"the camera '{self.name}' is closed"] * 3)

    def test_a_signals_handler_may_close(self):
        camera = self.open()
        self.end(signal.SIGKILL)
        before = signal.signal(signal.SIGALRM, lambda *_: (camera.state(), camera.close()))
        try:
            signal.setitimer(signal.ITIMER_REAL, 0.15)
            with self.assertRaisesRegex(ValueError, "is closed"):
                for _ in camera:
                    pass
        finally:
            signal.signal(signal.SIGALRM, before)

    def test_a_program_may_end_while_a_thread_waits(self):
        program = ("import bolo, sys, threading, time\n"
                   "camera = bolo.Camera(sys.argv[1], timeout=60)\n"
                   "threading.Thread(target=list, args=(camera,), daemon=True).start()\n"
                   "time.sleep(0.3)\n")
        ended = subprocess.run([sys.executable, "-c", program, self.name], capture_output=True, text=True,
                               env=dict(os.environ, PYTHONPATH=MODULE_FOLDER), timeout=HANG_S)
        self.assertEqual((ended.returncode, ended.stderr), (0, ""))

    def test_iteration_ends_with_the_daemon_when_asked_to(self):
        with self.open(follow=False) as camera:
            frames = 0
            for _ in camera:
                frames += 1
                if frames == 5:
                    self.daemons[0].terminate()
            self.assertGreaterEqual(frames, 5)
            self.assertFalse(camera.state().alive)

    def test_state_and_timeouts(self):
        with self.open() as camera:
            camera.next()
            state = camera.state()
            self.assertTrue(state.alive)
            self.assertGreater(state.published, 0)
            self.assertEqual(state.lost["out_of_order"], 0)
            self.daemons[0].send_signal(signal.SIGSTOP)
            try:
                while camera.next(timeout=0.2) is not None:
                    pass
                self.assertIsNone(camera.latest(timeout=0.01))
            finally:
                self.daemons[0].send_signal(signal.SIGCONT)
            self.assertIsNotNone(camera.latest(timeout=HANG_S))


class Alone(unittest.TestCase):
    def test_an_absent_stream_is_one_clear_line(self):
        with self.assertRaisesRegex(bolo.NotFound, "no shared memory named 'no-such-camera'"):
            bolo.Camera("no-such-camera")
        for name in ("a/b", "a\0b"):
            with self.assertRaisesRegex(bolo.Error, "is no name"):
                bolo.Camera(name, timeout=None)

    def test_structures_are_as_long_as_the_librarys(self):
        # client.cpp asserts the same sizes.
        sizes = [ctypes.sizeof(s) for s in (bolo._Info, bolo._Frame, bolo._State, bolo._Settings, bolo._Camera)]
        self.assertEqual(sizes, [128, 136, 216, 64, 320])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)

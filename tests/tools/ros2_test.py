#!/usr/bin/env python3
"""[ros2] of bolod: topics read by a subscriber of another vendor (Fast DDS) in a separate process equal the replayed
capture; foreign packets, and the end of either program, do no harm to the other.

usage: ros2_test.py BOLO BOLOD SUBSCRIBER. Exit code 77 where h5py is missing.
"""

import mmap
import os
import pathlib
import random
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import unittest
import zlib

from programs import needed, run, wait_for

h5py, np = needed("h5py", "numpy")
BOLO, BOLOD, SUBSCRIBER = sys.argv[1:4]
BRIDGE = pathlib.Path(BOLOD).with_name("bolo-ros2")
del sys.argv[1:4]
DOMAIN = 1 + os.getpid() % 100
FRAMES = 600
SECONDS = 8  # for the subscriber's discovery, and for receiving
PORTS = [7400 + 250 * DOMAIN + offset for offset in (0, 1, 10, 11, 12, 13)]  # DDSI-RTPS 9.6.1


def running(parent):
    found = subprocess.run(["pgrep", "-P", str(parent), "bolo-ros2"], capture_output=True, text=True, check=False)
    return [int(line) for line in found.stdout.split()]


class Ros2(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory()))
        cls.capture = cls.folder / "drive.h5"
        run(BOLO, "simulate", "-o", cls.capture, "--no-truth", "--frames", FRAMES)

    def setUp(self):
        self.name = f"-ros2-{os.getpid()}"  # starts like an option
        self.running = []

    def tearDown(self):
        for process in self.running:
            process.kill()
            process.communicate()

    def config(self, ros2="", rest=""):
        file = self.folder / "bolod.toml"
        file.write_text(f"""name = "{self.name}"
[source]
type = "replay"
file = "{self.capture}"
[ros2]
enable = true
domain = {DOMAIN}
{ros2}
{rest}""")
        return file

    def daemon(self, ros2=""):
        with open(self.folder / "bolod.log", "w") as log:
            self.running.append(subprocess.Popen([BOLOD, "--config", self.config(ros2)], stderr=log))
        return self.running[-1]

    def child_of(self, daemon, other_than=()):
        return wait_for(lambda: set(running(daemon.pid)) - set(other_than), "bolo-ros2").pop()

    def assert_good_end(self, daemon):
        self.assertEqual(daemon.wait(timeout=30), 0)

    def log(self):
        return (self.folder / "bolod.log").read_text()

    def subscribe(self, plane):
        self.running.append(subprocess.Popen([SUBSCRIBER, self.name.replace("-", "_"), plane, str(SECONDS)], stdout=subprocess.PIPE, text=True,
                                             env={**os.environ, "ROS_DOMAIN_ID": str(DOMAIN)}))
        time.sleep(0.5)
        return self.running[-1]

    def read(self, subscriber):
        """([(stamp in ns, encoding, width, height, step, frame_id, crc)], [(stamp, width, height, frame_id)])."""
        out, _ = subscriber.communicate(timeout=60)
        lines = [line.split() for line in out.splitlines()]
        images = [(int(w[0]), w[1], int(w[2]), int(w[3]), int(w[4]), w[5], int(w[6])) for w in lines if w[0] != "info"]
        return images, [(int(w[1]), int(w[2]), int(w[3]), w[4]) for w in lines if w[0] == "info"]

    def check_images(self, images, planes, encoding, frame_id):
        self.assertGreater(len(images), FRAMES // 2)
        height, width = planes[0].shape
        form = {(encoding, width, height, width * planes[0].itemsize, frame_id)}
        self.assertEqual({image[1:6] for image in images}, form)
        expected = [zlib.crc32(plane.tobytes()) for plane in planes]
        places = [expected.index(image[6]) for image in images]  # each is a frame of the capture, bit for bit; some may
        # be lost on a busy machine: sensor data is not sent again
        self.assertEqual(places, sorted(places))
        steps = np.diff([image[0] for image in images]) / np.diff(places) / 1e6
        self.assertAlmostEqual(float(np.median(steps)), 5.0, delta=0.2)
        self.assertLess(abs(images[-1][0] / 1e9 - time.time()), 60)

    def planes(self):
        with h5py.File(self.capture) as file:
            frames = file["frames"]
            return frames[:], float(file.attrs["scale"]), float(file.attrs["offset"])

    def test_a_subscriber_has_frames_bit_for_bit_with_their_times(self):
        subscriber = self.subscribe("image_raw")
        self.daemon()
        images, infos = self.read(subscriber)
        frames, _, _ = self.planes()
        self.check_images(images, list(frames), "mono16", self.name)
        self.assertEqual({info[1:] for info in infos}, {(frames.shape[2], frames.shape[1], self.name)})
        self.assertTrue({info[0] for info in infos} & {image[0] for image in images})

    def test_kelvin_and_a_frame_of_coordinates_of_its_own(self):
        subscriber = self.subscribe("image_raw")
        self.daemon('kelvin = true\nframe_id = "thermal_optical"')
        images, _ = self.read(subscriber)
        frames, scale, offset = self.planes()
        kelvin = [(scale * frame + offset).astype("<f4") for frame in frames]
        self.check_images(images, kelvin, "32FC1", "thermal_optical")

    def test_strangers_packets_end_nothing(self):
        draw = random.Random(7)
        subscriber = self.subscribe("image_deblurred")
        daemon = self.daemon()
        self.child_of(daemon)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for i in range(6000):
                junk = draw.randbytes(draw.randrange(1, 1400))
                if i % 2:  # plausible: DATA, complete or truncated
                    junk = b"RTPS\x02\x01\x01\x10" + draw.randbytes(12) + b"\x15\x05" + junk
                sender.sendto(junk, ("127.0.0.1", PORTS[i % len(PORTS)]))
        images, _ = self.read(subscriber)
        self.assertGreater(len(images), FRAMES // 2)
        self.assert_good_end(daemon)
        self.assertNotIn("bolo-ros2 ended", self.log())
        self.assertIn("bolo-ros2: DDS: more is not shown", self.log())
        self.assertLess(len(self.log()), 10_000)

    def test_it_is_started_again_and_the_daemon_goes_on(self):
        daemon = self.daemon()
        first = self.child_of(daemon)
        os.kill(first, signal.SIGKILL)
        self.child_of(daemon, other_than=[first])
        self.assert_good_end(daemon)
        self.assertIn("bolo-ros2 ended by signal 9; it is started again", self.log())
        self.assertIn(f"ended: {FRAMES} frames in, {FRAMES} out", self.log())

    def test_it_ends_with_the_daemon(self):
        for end in (signal.SIGTERM, signal.SIGKILL):
            daemon = self.daemon()
            child = self.child_of(daemon)
            time.sleep(0.3)  # a starting process has not requested its parent-death signal yet
            daemon.send_signal(end)
            daemon.wait(timeout=10)
            wait_for(lambda: not os.path.exists(f"/proc/{child}"), f"its end after {end}")

    def publish(self, times, subscriber):
        """Publishes frames with these UTC times (ns) in turn, in shared memory made here, until the subscriber ends."""
        slots, first, stride = 8, 4096, 512
        shared = pathlib.Path(f"/dev/shm/bolo.{self.name}")
        header = struct.pack("<QIIIIIIQQQQdddd", 0x4D48534F4C4F42, 3, 2112, 8, 8, slots, 0, first, stride, 128, 256, 0.01, 0, 0.02, 0.01)
        shared.write_bytes(header.ljust(first + slots * stride, b"\0"))
        self.addCleanup(shared.unlink)
        with open(shared, "r+b") as file, mmap.mmap(file.fileno(), 0) as memory:
            number = 0
            while subscriber.poll() is None:
                slot = (2 * number + 2, number, 0, 1, 1, 0, 0, 0.0, 1, times[number % len(times)])
                struct.pack_into("<QQqqqIIdqq", memory, first + number % slots * stride, *slot)
                struct.pack_into("<QIIQ", memory, 320, number + 1, number + 1, 1, time.monotonic_ns())
                number += 1
                time.sleep(0.02)

    def test_a_time_without_a_stamp_has_the_nearest_and_one_line(self):
        """A stamp has 31 bits of seconds: before 1970 it is empty, from 2038 on it is the largest."""
        now = time.time_ns()
        subscriber = self.subscribe("image_raw")
        with open(self.folder / "bridge.log", "w") as log:
            self.running.append(subprocess.Popen([BRIDGE, f"--name={self.name}", "--domain", str(DOMAIN)], stderr=log))
        self.publish((now, -1, 2**31 * 10**9, -(2**62), 2**62), subscriber)
        images, _ = self.read(subscriber)
        booted = time.clock_gettime_ns(time.CLOCK_REALTIME) - time.monotonic_ns()  # implied by the frames' other times
        stamps = sorted({image[0] if abs(image[0] - booted) > 10**9 else booted for image in images})
        self.assertEqual(stamps, [booted, now, 2**31 * 10**9 - 1])
        said = (self.folder / "bridge.log").read_text()
        self.assertEqual(said.count("\n"), 1, said)
        self.assertIn("2038", said)

    def refusal(self, config, program=BOLOD):
        done = subprocess.run([program, "--check-config", "--config", config], capture_output=True, text=True, check=False)
        self.assertEqual((done.returncode, done.stderr.count("\n")), (2, 1), done.stderr)
        return done.stderr

    def test_what_it_lacks_is_said_in_one_line(self):
        self.assertIn("bolod.toml:6:10: ros2.enable needs shm.enable = true",
                      self.refusal(self.config(rest="[shm]\nenable = false")))
        alone = self.folder / "alone"
        alone.mkdir()
        shutil.copy(BOLOD, alone / "bolod")
        self.assertIn("install the package bolo-ros2", self.refusal(self.config(), alone / "bolod"))

    def test_its_errors_name_it_once(self):
        for words in (["--x"], ["--domain", "a"], ["a", "b"], ["--kelvin=1", "a"], ["--domain", "999", "a"], []):
            done = subprocess.run([BRIDGE, *words], capture_output=True, text=True, timeout=60)
            self.assertEqual((done.returncode, done.stderr.count("\n")), (2, 1), done.stderr)
            self.assertTrue(done.stderr.startswith("bolo-ros2: "), done.stderr)
            self.assertNotIn(str(BRIDGE), done.stderr)

    def test_a_name_that_is_none_is_bad_input(self):
        done = subprocess.run([BRIDGE, "--domain", str(DOMAIN), "--", "it's"], capture_output=True, text=True, check=False)
        self.assertEqual((done.returncode, done.stderr.count("\n")), (2, 1), done.stderr)
        self.assertIn("is no name for shared memory", done.stderr)


if __name__ == "__main__":
    unittest.main()

#!/usr/bin/env python3
"""`bolo convert` to MCAP and back, verified by another reader (mcap_file.py).

usage: mcap_test.py BOLO. Exit code 77 where h5py is missing.
"""

import os
import pathlib
import random
import resource
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest

from mcap_file import MAGIC, File, pack
from programs import needed

h5py, np = needed("h5py", "numpy")
BOLO = os.path.abspath(sys.argv.pop(1))
SANITIZED = b"__asan_init" in pathlib.Path(BOLO).read_bytes()  # reserves terabytes of address space


class Mcap(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = cls.enterClassContext(tempfile.TemporaryDirectory())
        cls.capture("counts.h5", np.random.default_rng(1).integers(0, 65536, (90, 120, 160), np.uint16),
                    {"unit": "count", "scale": 1.0, "offset": 0.0}, events=[(5.0, "nuc"), (5.113, "gap")])
        ramp = 300.0 + np.linspace(0, 5, 20 * 6 * 10, dtype=np.float32).reshape(20, 6, 10)
        cls.capture("kelvin.h5", ramp, {"unit": "kelvin", "scale": 1.0, "offset": 0.0})
        cls.capture("linear.h5", (ramp * 100).astype(np.uint16), {"unit": "kelvin", "scale": 0.01, "offset": -0.25,
                                                                   "recorded_at": "2026-11-23T12:34:56.789Z"})
        cls.capture("utc.h5", (ramp * 100).astype(np.uint16), {"unit": "kelvin", "scale": 0.01, "offset": -0.25,
                                                                "recorded_at": "2001-01-01T00:00:00Z"},
                    events=[(5.05, "nuc")], utc=True)
        cls.capture("sharp.h5", (ramp[4:] * 100).astype(np.uint16), {
            "unit": "kelvin", "scale": 0.01, "offset": -0.25, "solver": "admm", "tau_s": 0.011}, first=4)

    @classmethod
    def path(cls, name):
        return os.path.join(cls.folder, name)

    @classmethod
    def capture(cls, name, frames, attributes, events=(), first=0, utc=False, stopped=False):
        with h5py.File(cls.path(name), "w") as f:
            n = len(frames)
            f.create_dataset("frames", data=frames, chunks=(1, *frames.shape[1:]))
            index = first + np.arange(n)
            f["t"] = 5.0 + index * 0.00512345 + 1e-7 * np.sin(index)
            f["frame_id"] = (np.uint64(2**32 - 40) + 3 * index.astype(np.uint64)).astype(np.uint64)
            f.attrs.update({"format": "bolo-capture", "version": 1, "frame_period_s": 0.00512345, "row_step": 2,
                            "camera_model": "FLIR A655sc é", "camera_serial": "55001234", **attributes})
            if utc:
                f["t_utc"] = 1_790_000_000.123456 + f["t"][:] * 1.00001  # the camera's clock drifts
                f["t_host"] = 77.7 + f["t"][:]
            if stopped:
                f["t_utc"][:] = f["t_utc"][0]
            if events:
                kind = np.dtype([("t", "f8"), ("kind", h5py.string_dtype())])
                f.create_dataset("events", data=np.array(list(events), dtype=kind))

    def bolo(self, *words, code=0, says="", memory=None):
        limit = (lambda: resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))) if memory and not SANITIZED else None
        done = subprocess.run([BOLO, "convert", *words], capture_output=True, text=True, timeout=300, preexec_fn=limit)
        self.assertEqual(done.returncode, code, (words, done.stderr))
        if code != 0:
            self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
        self.assertIn(says, done.stderr + done.stdout)
        return done

    def convert(self, name, out, *more):
        self.bolo(self.path(name), "-o", self.path(out), "--overwrite", *more)

    def assert_images(self, mcap, topic, capture):
        with h5py.File(self.path(capture)) as f:
            images = File(self.path(mcap)).topic(topic)
            self.assertEqual(len(images), len(f["t"]))
            frames = f["frames"]
            is_float = frames.dtype == np.float32
            for i, (sequence, log, image) in enumerate(images):
                self.assertEqual((image["width"], image["height"]), (frames.shape[2], frames.shape[1]))
                self.assertEqual(image["encoding"], "32FC1" if is_float else "mono16")
                self.assertEqual((image["step"], image["is_bigendian"]), (frames.shape[2] * (4 if is_float else 2), 0))
                self.assertEqual(image["data"], frames[i].tobytes())
                self.assertEqual(sequence, int(f["frame_id"][i]) & 0xffffffff)
                stamp = image["header"]["stamp"]
                self.assertEqual(log, stamp["sec"] * 10**9 + stamp["nanosec"])
            return [log for _, log, _ in images]

    def assert_same_capture(self, name, other):
        with h5py.File(self.path(name)) as a, h5py.File(self.path(other)) as b:
            for item in a:
                self.assertEqual(a[item].dtype.kind, b[item].dtype.kind)
                self.assertTrue((a[item][()] == b[item][()]).all(), item)
            for key, value in a.attrs.items():
                other = b.attrs[key]
                self.assertEqual(value, other.decode() if isinstance(other, bytes) else other, key)

    def test_counts_are_mono16_with_numbers_infos_and_events(self):
        self.convert("counts.h5", "a.mcap", "--name", "front")
        times = self.assert_images("a.mcap", "/front/image_raw", "counts.h5")
        mcap = File(self.path("a.mcap"))
        with h5py.File(self.path("counts.h5")) as f:
            self.assertEqual(times, [round(t * 1e9) for t in f["t"]], "the camera's clock, for nothing else is known")
            frames = mcap.topic("/front/frame")
            self.assertEqual([m["frame_number"] for _, _, m in frames], [int(i) for i in f["frame_id"]])
            self.assertEqual([m["t"] for _, _, m in frames], list(f["t"]))
        infos = mcap.topic("/front/camera_info")
        self.assertEqual([log for _, log, _ in infos], times)
        self.assertEqual((infos[0][2]["width"], infos[0][2]["height"], infos[0][2]["k"]), (160, 120, [0.0] * 9))
        events = mcap.topic("/diagnostics")
        self.assertEqual([e["status"][0]["message"] for _, _, e in events], ["nuc", "gap"])
        self.assertEqual([log for _, log, _ in events], [5_000_000_000, 5_113_000_000])
        self.assertEqual(events[0][2]["status"][0]["hardware_id"], "55001234")
        self.assertGreater(len(mcap.indexes), 0)

    def test_a_capture_survives_the_way_there_and_back(self):
        for name in ("counts.h5", "kelvin.h5", "linear.h5", "utc.h5", "sharp.h5"):
            self.convert(name, "b.mcap")
            self.assert_images("b.mcap", "/thermal/image_" + ("deblurred" if name == "sharp.h5" else "raw"), name)
            self.convert("b.mcap", "b.h5")
            self.assert_same_capture(name, "b.h5")

    def test_captures_of_hosts_whose_clock_was_wrong_survive_it(self):
        ramp = np.arange(20 * 6 * 10, dtype=np.uint16).reshape(20, 6, 10)
        for name, at in (("old.h5", "1969-12-30T23:59:59.000Z"), ("late.h5", "9999-12-31T23:59:59.000Z"),
                         ("stopped.h5", "2001-01-01T00:00:00Z")):
            stopped = name == "stopped.h5"
            self.capture(name, ramp, {"unit": "count", "scale": 1.0, "offset": 0.0, "recorded_at": at}, utc=stopped,
                         stopped=stopped)
            self.convert(name, "w.mcap")
            times = self.assert_images("w.mcap", "/thermal/image_raw", name)
            if not stopped:
                self.assertEqual(len(set(times)), len(times), "a player would show them all at once")
            self.convert("w.mcap", "w.h5")
            self.assert_same_capture(name, "w.h5")

    def test_stamps_begin_when_the_recording_did(self):
        self.convert("linear.h5", "l.mcap")
        times = np.array(self.assert_images("l.mcap", "/thermal/image_raw", "linear.h5"))
        self.assertAlmostEqual(times[0] * 1e-9, 1795437296.789, places=5)
        with h5py.File(self.path("linear.h5")) as f:
            np.testing.assert_allclose(times - times[0], (f["t"][:] - f["t"][0]) * 1e9, rtol=0, atol=1.0)

    def test_stamps_are_utc_where_the_capture_has_it(self):
        self.convert("utc.h5", "u.mcap")
        times = self.assert_images("u.mcap", "/thermal/image_raw", "utc.h5")
        mcap = File(self.path("u.mcap"))
        with h5py.File(self.path("utc.h5")) as f:
            self.assertEqual(times, [round(t * 1e9) for t in f["t_utc"]])
            frames = [m for _, _, m in mcap.topic("/thermal/frame")]
            self.assertEqual([m["t_utc"] for m in frames], list(f["t_utc"]))
            self.assertEqual([m["t_host"] for m in frames], list(f["t_host"]))
            event = mcap.topic("/diagnostics")[0][1]
            self.assertAlmostEqual(event * 1e-9, float(f["t_utc"][0]) + 0.05, places=5)

    def test_raw_and_sharp_captures_share_a_file(self):
        self.bolo(self.path("linear.h5"), self.path("sharp.h5"), "-o", self.path("both.mcap"), "--name", "car/left")
        raw = self.assert_images("both.mcap", "/car/left/image_raw", "linear.h5")
        sharp = self.assert_images("both.mcap", "/car/left/image_deblurred", "sharp.h5")
        self.assertEqual(raw[4:], sharp)
        mcap = File(self.path("both.mcap"))
        self.assertEqual([log for _, log, _ in mcap.topic("/car/left/camera_info")], raw)
        log = [m[2] for m in mcap.messages]
        self.assertEqual(log, sorted(log))
        self.bolo(self.path("both.mcap"), "-o", self.path("one.h5"), code=2, says="choose one by --topic: /car/left/im")
        self.bolo(self.path("both.mcap"), "-o", self.path("one.h5"), "--topic", "/car/left/image_deblurred")
        self.assert_same_capture("sharp.h5", "one.h5")
        self.bolo(self.path("linear.h5"), self.path("linear.h5"), "-o", self.path("two.mcap"), code=2,
                  says="two captures would be")
        self.bolo(self.path("linear.h5"), self.path("sharp.h5"), "-o", self.path("two.tiff"), code=2)
        self.bolo(self.path("linear.h5"), self.path("sharp.h5"), "-o", self.path("two.mcap"), "--frame", "1", code=2,
                  says="--frame is of one capture")
        self.assertFalse(os.path.exists(self.path("two.mcap")))

    def test_names_that_are_no_topics_are_refused(self):
        for bad in ("", "9", "a//b", "a/", "é", "a b"):
            self.bolo(self.path("kelvin.h5"), "-o", self.path("n.mcap"), "--name", bad, code=2, says="--name")

    def write(self, name, data):
        pathlib.Path(self.path(name)).write_bytes(data)

    def hostile(self, data, says="", memory=None):
        self.write("hostile.mcap", data)
        done = self.bolo(self.path("hostile.mcap"), "-o", self.path("hostile.h5"), "--overwrite", code=2, says=says,
                         memory=memory)
        self.assertIn("hostile.mcap: ", done.stderr)

    def test_damaged_files_are_refused_in_one_line(self):
        self.convert("kelvin.h5", "d.mcap")
        good = pathlib.Path(self.path("d.mcap")).read_bytes()
        data_end = struct.unpack("<Q", good[-28:-20])[0]  # start of the summary
        self.hostile(b"", "is not an MCAP file")
        self.hostile(b"\x89HDF\r\n\x1a\n" + good[8:], "is not an MCAP file")
        for cut in (9, 20, data_end // 2, data_end - 1):
            self.hostile(good[:cut], "ends in the middle")
        random.seed(1)
        for _ in range(60):
            bad = bytearray(good)
            bad[random.randrange(8, data_end)] ^= 1 << random.randrange(8)
            self.hostile(bytes(bad))  # detected by a checksum at the latest

    @staticmethod
    def text(t):
        return struct.pack("<I", len(t)) + t

    @staticmethod
    def record(code, *fields):
        data = b"".join(fields)
        return struct.pack("<BQ", code, len(data)) + data

    def topic(self, number, name, kind):
        return (self.record(3, struct.pack("<H", number + 1), self.text(kind), self.text(b"ros2msg"), self.text(b""))
                + self.record(4, struct.pack("<HH", number, number + 1), self.text(name), self.text(b"cdr"), self.text(b"")))

    def chunk(self, chunk, compression=b"zstd", size=None, crc=0):
        packed = pack(chunk) if compression == b"zstd" else chunk
        return self.record(6, struct.pack("<QQQI", 0, 0, len(chunk) if size is None else size, crc),
                           self.text(compression), struct.pack("<Q", len(packed)), packed)

    def recording(self, *records):
        return b"".join((MAGIC, self.record(1, self.text(b"ros2"), self.text(b"x")),
                         self.topic(0, b"/a/image_raw", b"sensor_msgs/msg/Image"), *records,
                         self.record(15, struct.pack("<I", 0))))

    def chunked(self, chunk, **how):
        return self.recording(self.chunk(chunk, **how))

    @staticmethod
    def message(data, log=0, sequence=0, channel=0):
        return struct.pack("<BQHIQQ", 5, 22 + len(data), channel, sequence, log, log) + data

    @staticmethod
    def image(width, height, step, data, encoding=b"mono16\0", big=0, sec=3, nanosec=5):
        head = struct.pack("<iII", sec, nanosec, 2) + b"c\0"
        head += b"\0" * (-len(head) % 4) + struct.pack("<III", height, width, len(encoding)) + encoding
        head += struct.pack("<B", big)
        head += b"\0" * (-len(head) % 4) + struct.pack("<II", step, len(data))
        return b"\0\1\0\0" + head + data

    def pictures(self):
        return b"".join(self.message(self.image(1, 1, 2, bytes(2), sec=i), i, i) for i in range(4))

    def test_files_that_lie_are_refused(self):
        image = self.image(2, 2, 4, bytes(8))
        message = self.message(image)
        for chunk, says in (
                (bytes(300 << 20), "a chunk of"),  # 300 MiB in 30 kB
                (struct.pack("<BQ", 5, 2**63) + bytes(50), "damaged"),
                (self.message(image, channel=7), "no topic"),
                (self.message(self.image(2, 2, 4, bytes(7))), "cannot be"),
                (self.message(self.image(0, 2, 4, bytes(8))), "cannot be"),
                (self.message(self.image(2**31, 2**31, 4, bytes(8))), "cannot be"),
                (self.message(self.image(2, 2, 4, bytes(8), b"bgr8\0")), "bgr8"),
                (self.message(b"\0\0\0\0" + image[4:]), "little-endian"),
                (self.message(image[:20]), "shorter"),
                (2 * message, "no time of its own"),
                (message + self.message(self.image(1, 2, 2, bytes(4)), 9), "one size"),
                (b"", "has no images")):
            self.hostile(self.chunked(chunk), says)
        self.hostile(self.chunked(message, size=2**62), "a chunk of")
        self.hostile(self.chunked(message, size=4), "a chunk")
        self.hostile(self.chunked(message, crc=7), "checksum")
        self.hostile(self.chunked(message, compression=b"lz4"), "packed by 'lz4'")
        self.hostile(MAGIC + struct.pack("<BQ", 6, 2**40), "a record of")

    def test_small_files_take_little_memory_and_can_be_interrupted(self):
        names = [b"".join(self.record(3, struct.pack("<H", 30 * part + i), self.text(b"n" * 2**20), bytes(8))
                          for i in range(30)) for part in range(10)]
        self.hostile(self.recording(*(self.chunk(part) for part in names)), "has no images", memory=200 << 20)
        message = self.message(self.image(1, 1, 2, bytes(2)))
        self.hostile(self.chunked(message * 10**5), "more frames than its size can hold")
        # Empty records: 128 MiB in 4 kB, repeated.
        nothing = self.chunk(bytes((128 << 20) // 9 * 9))
        self.write("long.mcap", self.recording(*[nothing] * 2000))
        with subprocess.Popen([BOLO, "convert", self.path("long.mcap"), "-o", self.path("long.h5")]) as convert:
            time.sleep(1)
            convert.send_signal(signal.SIGINT)
            try:
                self.assertNotEqual(convert.wait(timeout=20), 0)
            finally:
                convert.kill()
        self.assertEqual([name for name in os.listdir(self.folder) if name.startswith("long.h5")], [])

    def test_times_and_scales_that_cannot_be_are_refused(self):
        pictures = self.pictures()
        for key, value in ((b"scale", b"0"), (b"scale", b"1e300"), (b"frame_period_s", b"0"), (b"frame_period_s", b"-1")):
            texts = b"".join(map(self.text, (b"topic", b"/a/image_raw", b"unit", b"kelvin", key, value)))
            self.hostile(self.recording(self.record(12, self.text(b"bolo-capture"), self.text(texts)), pictures), key.decode())
        for times in ((1e300, 1.0, 1.0), (1.0, float("inf"), 1.0), (1.0, 1e300, 1.0), (1.0, 1.0, float("nan"))):
            head = b"\0\1\0\0" + struct.pack("<iII", 0, 0, 2) + b"c\0" + bytes(2)
            frame = self.message(head + struct.pack("<Qddd", 0, *times), channel=1)
            self.hostile(self.recording(self.topic(1, b"/a/frame", b"bolo_msgs/msg/Frame"), frame, pictures), "no clock shows")

    def test_texts_that_no_capture_has_room_for_do_not_stop_the_pictures(self):
        texts = {b"topic": b"/a/image_raw", b"text.long": b"v" * 200_000, b"text.twice": b"v", b"number.twice": b"1"}
        texts.update((b"text.%d" % i, b"v") for i in range(3000))
        map_of_texts = b"".join(self.text(key) + self.text(value) for key, value in texts.items())
        self.write("texts.mcap",
                   self.recording(self.record(12, self.text(b"bolo-capture"), self.text(map_of_texts)), self.pictures()))
        self.bolo(self.path("texts.mcap"), "-o", self.path("texts.h5"))
        with h5py.File(self.path("texts.h5")) as f:
            self.assertLessEqual(len(f.attrs), 1010)

    def test_other_programs_files_are_read(self):
        # Padded rows, big-endian, uncompressed, stamps out of order, no counter.
        rows = np.arange(6, dtype=np.uint16).reshape(2, 3)
        data = b"".join(row.astype(">u2").tobytes() + b"xx" for row in rows)
        chunk = b"".join(self.message(self.image(3, 2, 8, data, b"16UC1\0", 1, 1700000000, ns), ns)
                         for ns in (20_000_000, 0, 40_000_000))
        self.write("other.mcap", self.chunked(chunk, compression=b""))
        self.bolo(self.path("other.mcap"), "-o", self.path("other.h5"), "--scale", "0.04")
        with h5py.File(self.path("other.h5")) as f:
            self.assertTrue((f["frames"][:] == rows).all())
            self.assertEqual(list(f["frame_id"]), [0, 1, 2])
            np.testing.assert_allclose(f["t"][:] - f["t"][0], [0, 0.02, 0.04], atol=1e-6)
            self.assertAlmostEqual(f.attrs["frame_period_s"], 0.02, places=6)
            self.assertEqual((f.attrs["unit"], f.attrs["scale"]), (b"kelvin", 0.04))


if __name__ == "__main__":
    unittest.main()

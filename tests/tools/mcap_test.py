#!/usr/bin/env python3
"""`bolo convert` to MCAP and back, seen by another reader: one written here from https://mcap.dev/spec, the ros2msg
definitions that the file itself carries, and the rules of CDR.

usage: mcap_test.py BOLO. Exit code 77 where h5py is missing.
"""

import ctypes
import os
import random
import re
import struct
import subprocess
import sys
import tempfile
import unittest
import zlib

try:
    import h5py
    import numpy as np
except ImportError:
    sys.exit(77)

BOLO = os.path.abspath(sys.argv.pop(1))
MAGIC = b"\x89MCAP0\r\n"
zstd = ctypes.CDLL("libzstd.so.1")
for function in (zstd.ZSTD_decompress, zstd.ZSTD_compress, zstd.ZSTD_compressBound):
    function.restype = ctypes.c_size_t


def unpack(data, size):
    out = ctypes.create_string_buffer(size)
    done = zstd.ZSTD_decompress(out, ctypes.c_size_t(size), data, ctypes.c_size_t(len(data)))
    assert done == size, done
    return out.raw


def pack(data):
    out = ctypes.create_string_buffer(len(data) // 100 + 1000 + len(data))
    done = zstd.ZSTD_compress(out, ctypes.c_size_t(len(out)), data, ctypes.c_size_t(len(data)), 3)
    return out.raw[:done]


class Fields:
    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, code):
        values = struct.unpack_from("<" + code, self.data, self.at)
        self.at += struct.calcsize("<" + code)
        return values[0] if len(values) == 1 else values

    def bytes(self):
        size = self.take("I")
        self.at += size
        assert self.at <= len(self.data)
        return self.data[self.at - size:self.at]

    def text(self):
        return self.bytes().decode()

    def pairs(self, key, value):
        inside, out = Fields(self.bytes()), {}
        while inside.at < len(inside.data):
            k = inside.text() if key == "s" else inside.take(key)
            out[k] = inside.text() if value == "s" else inside.take(value)
        return out


def records(data, at, end):
    """(code, fields, offset) of what lies there."""
    while at < end:
        code, size = struct.unpack_from("<BQ", data, at)
        yield code, data[at + 9:at + 9 + size], at
        at += 9 + size
    assert at == end


class Cdr:
    """Messages by the definitions in a ros2msg schema."""

    SIZES = {"bool": "B", "byte": "B", "uint8": "B", "int32": "i", "uint32": "I", "uint64": "Q", "float64": "d"}

    def __init__(self, name, text):
        parts = re.split(r"={80}\nMSG: (\S+)\n", text)
        self.types = {name.replace("/msg/", "/"): parts[0]}
        self.types.update(zip(parts[1::2], parts[2::2]))
        self.top = name.replace("/msg/", "/")

    def read(self, data):
        assert data[:4] == b"\0\1\0\0"
        self.data, self.at = data[4:], 0
        value = self.message(self.top)
        assert self.at == len(self.data), "bytes left over"
        return value

    def number(self, code):
        size = struct.calcsize(code)
        self.at += -self.at % size
        self.at += size
        return struct.unpack_from("<" + code, self.data, self.at - size)[0]

    def one(self, kind, package):
        if kind in self.SIZES:
            return self.number(self.SIZES[kind])
        if kind == "string":
            size = self.number("I")
            self.at += size
            assert self.data[self.at - 1] == 0
            return self.data[self.at - size:self.at - 1].decode()
        return self.message(kind if "/" in kind else package + "/" + kind)

    def message(self, kind):
        out = {}
        for line in self.types[kind].splitlines():
            line = line.split("#")[0].strip()
            if not line or "=" in line:
                continue
            field, name = line.split()
            base, _, length = field.partition("[")
            if not length:
                out[name] = self.one(base, kind.split("/")[0])
                continue
            count = self.number("I") if length == "]" else int(length[:-1])
            if base == "uint8":
                self.at += count
                out[name] = self.data[self.at - count:self.at]
            else:
                out[name] = [self.one(base, kind.split("/")[0]) for _ in range(count)]
        return out


class File:
    """A whole file, by its index; everything that the specification lets a reader rely on is looked at."""

    def __init__(self, name):
        with open(name, "rb") as f:
            self.data = data = f.read()
        assert data[:8] == MAGIC and data[-8:] == MAGIC
        code, size, start, offsets, crc = struct.unpack("<BQQQI", data[-37:-8])
        assert (code, size) == (2, 20)
        assert zlib.crc32(data[start:-12]) == crc
        self.schemas, self.channels, self.metadata, self.messages = {}, {}, {}, []
        self.indexes, groups, self.statistics = [], {}, None
        for code, fields, at in records(data, start, offsets):
            groups.setdefault(code, [at, at])[1] = at + 9 + len(fields)
            self.summary_record(code, Fields(fields))
        for code, fields, _ in records(data, offsets, len(data) - 37):
            assert code == 14
            group, begin, length = struct.unpack("<BQQ", fields)
            assert groups.pop(group) == [begin, begin + length]
        assert not groups, "a group without its offset"
        self.walk(start)
        for index in self.indexes:
            self.read_chunk(index)
        assert self.statistics["messages"] == len(self.messages)
        assert self.statistics["chunks"] == len(self.indexes)
        assert self.statistics["counts"] == {c: sum(m[0] == c for m in self.messages) for c in self.channels}
        assert self.statistics["times"] == (min(m[2] for m in self.messages), max(m[2] for m in self.messages))

    def summary_record(self, code, f):
        if code == 3:
            number = f.take("H")
            self.schemas[number] = name, encoding, text = f.text(), f.text(), f.text()
            assert encoding == "ros2msg", (name, text)
        elif code == 4:
            number, schema = f.take("HH")
            self.channels[number] = f.text(), self.schemas[schema]
            assert f.text() == "cdr" and f.pairs("s", "s").keys() == {"offered_qos_profiles"}
        elif code == 8:
            self.indexes.append((f.take("QQQQ"), f.pairs("H", "Q"), f.take("Q"), f.text(), f.take("QQ")))
        elif code == 11:
            messages, schemas, channels, attachments, metadata, chunks, first, last = f.take("QHIIIIQQ")
            assert (schemas, channels, attachments) == (len(self.schemas), len(self.channels), 0)
            self.statistics = {"messages": messages, "chunks": chunks, "times": (first, last),
                               "metadata": metadata, "counts": f.pairs("H", "Q")}
        elif code == 13:
            at, _ = f.take("QQ")
            f_code, size = struct.unpack_from("<BQ", self.data, at)
            inside = Fields(self.data[at + 9:at + 9 + size])
            assert f_code == 12 and inside.text() == f.text()
            pairs = inside.pairs("s", "s")
            self.metadata[pairs["topic"]] = pairs
        else:
            raise AssertionError(code)

    def walk(self, end):
        """The records before the summary, in order."""
        seen = []
        for code, fields, at in records(self.data, 8, end):
            seen.append(code)
            if code == 1:
                f = Fields(fields)
                assert f.text() == "ros2" and f.text().startswith("bolo ")
            if code == 15:
                assert struct.unpack("<I", fields)[0] == zlib.crc32(self.data[:at])
        assert seen[0] == 1 and seen[-1] == 15 and seen.count(6) == len(self.indexes)

    def read_chunk(self, index):
        (first, last, at, length), places, index_bytes, compression, (packed, size) = index
        code, inside = struct.unpack_from("<BQ", self.data, at)
        assert code == 6 and inside + 9 == length
        f = Fields(self.data[at + 9:at + length])
        assert f.take("QQQ") == (first, last, size)
        crc, name, bytes_ = f.take("I"), f.text(), f.take("Q")
        assert (name, compression, bytes_) == ("zstd", "zstd", packed)
        chunk = unpack(f.data[f.at:], size)
        assert zlib.crc32(chunk) == crc
        found = {}
        for code, fields, offset in records(chunk, 0, len(chunk)):
            assert code == 5
            channel, sequence, log, publish = struct.unpack_from("<HIQQ", fields)
            assert log == publish and first <= log <= last
            found.setdefault(channel, []).append((log, offset))
            self.messages.append((channel, sequence, log, fields[22:]))
        assert places.keys() == found.keys()
        for channel, place in places.items():
            assert at + length <= place < at + length + index_bytes
            code, _ = struct.unpack_from("<BQ", self.data, place)
            f = Fields(self.data[place + 9:])
            assert code == 7 and f.take("H") == channel
            entries = f.bytes()
            assert [struct.unpack_from("<QQ", entries, i) for i in range(0, len(entries), 16)] == found[channel]

    def topic(self, topic):
        """[(sequence, log time, message)]"""
        out = []
        for channel, sequence, log, data in self.messages:
            name, (kind, _, text) = self.channels[channel]
            if name == topic:
                out.append((sequence, log, Cdr(kind, text).read(data)))
        return out


class Mcap(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.folder = cls.scratch.name
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
    def tearDownClass(cls):
        cls.scratch.cleanup()

    @classmethod
    def path(cls, name):
        return os.path.join(cls.folder, name)

    @classmethod
    def capture(cls, name, frames, attributes, events=(), first=0, utc=False):
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
            if events:
                kind = np.dtype([("t", "f8"), ("kind", h5py.string_dtype())])
                f.create_dataset("events", data=np.array(list(events), dtype=kind))

    def bolo(self, *words, code=0, says=""):
        done = subprocess.run([BOLO, "convert", *words], capture_output=True, text=True, timeout=300)
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
                self.assertEqual(a[item][()].tobytes() if item != "events" else list(a[item]["kind"]),
                                 b[item][()].tobytes() if item != "events" else list(b[item]["kind"]), item)
                self.assertEqual(a[item].dtype.kind, b[item].dtype.kind)
            if "events" in a:
                self.assertEqual(list(a["events"]["t"]), list(b["events"]["t"]))
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
            self.convert("b.mcap", "b.h5")
            self.assert_same_capture(name, "b.h5")

    def test_kelvin_is_32fc1(self):
        self.convert("kelvin.h5", "k.mcap")
        self.assert_images("k.mcap", "/thermal/image_raw", "kelvin.h5")

    def test_stamps_begin_when_the_recording_did(self):
        self.convert("linear.h5", "l.mcap")
        times = self.assert_images("l.mcap", "/thermal/image_raw", "linear.h5")
        self.assertAlmostEqual(times[0] * 1e-9, 1795437296.789, places=5)
        with h5py.File(self.path("linear.h5")) as f:
            for i, time in enumerate(times):
                self.assertLessEqual(abs(time - times[0] - (f["t"][i] - f["t"][0]) * 1e9), 1.0)

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
        self.assertFalse(os.path.exists(self.path("two.mcap")))

    def test_what_is_there_is_kept(self):
        with open(self.path("kept.mcap"), "w", encoding="utf-8") as f:
            f.write("mine")
        self.bolo(self.path("kelvin.h5"), "-o", self.path("kept.mcap"), code=2, says="is there already")
        with open(self.path("kept.mcap"), encoding="utf-8") as f:
            self.assertEqual(f.read(), "mine")
        for bad in ("", "9", "a//b", "a/", "é", "a b"):
            self.bolo(self.path("kelvin.h5"), "-o", self.path("n.mcap"), "--name", bad, code=2, says="--name")

    def hostile(self, data, says="", code=2):
        with open(self.path("hostile.mcap"), "wb") as f:
            f.write(data)
        done = self.bolo(self.path("hostile.mcap"), "-o", self.path("hostile.h5"), "--overwrite", code=code, says=says)
        self.assertIn("hostile.mcap: ", done.stderr)

    def test_damaged_files_are_refused_in_one_line(self):
        self.convert("kelvin.h5", "d.mcap")
        with open(self.path("d.mcap"), "rb") as f:
            good = f.read()
        data_end = struct.unpack("<Q", good[-28:-20])[0]  # where the summary begins
        self.hostile(b"", "is not an MCAP file")
        self.hostile(b"\x89HDF\r\n\x1a\n" + good[8:], "is not an MCAP file")
        for cut in (9, 20, data_end // 2, data_end - 1):
            self.hostile(good[:cut], "ends in the middle")
        random.seed(1)
        for _ in range(60):
            bad = bytearray(good)
            bad[random.randrange(8, data_end)] ^= 1 << random.randrange(8)
            self.hostile(bytes(bad))  # a checksum at the latest

    def chunked(self, chunk, compression=b"zstd", size=None, crc=0):
        def record(code, data):
            return struct.pack("<BQ", code, len(data)) + data

        def text(t):
            return struct.pack("<I", len(t)) + t

        packed = pack(chunk) if compression == b"zstd" else chunk
        head = record(1, text(b"ros2") + text(b"x"))
        schema = record(3, struct.pack("<H", 1) + text(b"sensor_msgs/msg/Image") + text(b"ros2msg") + text(b""))
        channel = record(4, struct.pack("<HH", 0, 1) + text(b"/a/image_raw") + text(b"cdr") + text(b""))
        body = struct.pack("<QQQI", 0, 0, len(chunk) if size is None else size, crc) + text(compression)
        body += struct.pack("<Q", len(packed)) + packed
        return MAGIC + head + schema + channel + record(6, body) + record(15, struct.pack("<I", 0))

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

    def test_files_that_lie_are_refused(self):
        image = self.image(2, 2, 4, bytes(8))
        self.hostile(self.chunked(self.message(image), size=2**62), "a chunk of")
        self.hostile(self.chunked(self.message(image), size=4), "a chunk")
        self.hostile(self.chunked(self.message(image), crc=7), "checksum")
        self.hostile(self.chunked(self.message(image), compression=b"lz4"), "packed by 'lz4'")
        self.hostile(self.chunked(bytes(300 << 20)), "a chunk of")  # 300 MiB in 30 kB
        self.hostile(self.chunked(struct.pack("<BQ", 5, 2**63) + bytes(50)), "damaged")
        self.hostile(self.chunked(self.message(image, channel=7)), "no topic")
        self.hostile(self.chunked(self.message(self.image(2, 2, 4, bytes(7)))), "cannot be")
        self.hostile(self.chunked(self.message(self.image(0, 2, 4, bytes(8)))), "cannot be")
        self.hostile(self.chunked(self.message(self.image(2**31, 2**31, 4, bytes(8)))), "cannot be")
        self.hostile(self.chunked(self.message(self.image(2, 2, 4, bytes(8), b"bgr8\0"))), "bgr8")
        self.hostile(self.chunked(self.message(b"\0\0\0\0" + image[4:])), "little-endian")
        self.hostile(self.chunked(self.message(image[:20])), "shorter")
        self.hostile(self.chunked(2 * self.message(image)), "no time of its own")
        self.hostile(self.chunked(self.message(image) + self.message(self.image(1, 2, 2, bytes(4)), 9)), "one size")
        self.hostile(self.chunked(b""), "has no images")
        self.hostile(MAGIC + struct.pack("<BQ", 6, 2**40), "a record of")

    def test_other_programs_files_are_read(self):
        # Rows with padding, big-endian, uncompressed, stamps out of order, no counter.
        rows = np.arange(6, dtype=np.uint16).reshape(2, 3)
        data = b"".join(row.astype(">u2").tobytes() + b"xx" for row in rows)
        chunk = b"".join(self.message(self.image(3, 2, 8, data, b"16UC1\0", 1, 1700000000, ns), ns)
                         for ns in (20_000_000, 0, 40_000_000))
        with open(self.path("other.mcap"), "wb") as f:
            f.write(self.chunked(chunk, compression=b""))
        self.bolo(self.path("other.mcap"), "-o", self.path("other.h5"), "--scale", "0.04")
        with h5py.File(self.path("other.h5")) as f:
            self.assertTrue((f["frames"][:] == rows).all())
            self.assertEqual(list(f["frame_id"]), [0, 1, 2])
            np.testing.assert_allclose(f["t"][:] - f["t"][0], [0, 0.02, 0.04], atol=1e-6)
            self.assertAlmostEqual(f.attrs["frame_period_s"], 0.02, places=6)
            self.assertEqual((f.attrs["unit"], f.attrs["scale"]), (b"kelvin", 0.04))


if __name__ == "__main__":
    unittest.main()

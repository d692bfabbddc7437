"""`bolo convert` of CPTV films, encoded here according to go-cptv's SPECv2.md.

usage: cptv_test.py BOLO. Exit code 77: numpy or h5py isn't there.
"""

import gzip
import pathlib
import struct
import subprocess
import sys
import tempfile
import unittest

from programs import needed

h5py, np = needed("h5py", "numpy")
BOLO = sys.argv.pop(1)
WIDTH, HEIGHT = 7, 5
ZERO = np.zeros((HEIGHT, WIDTH), np.uint16)


def field(code, data):
    return bytes([len(data)]) + code + data


def header(width=WIDTH, height=HEIGHT, compression=1, version=2):
    fields = [field(b"T", struct.pack("<Q", 1_563_926_262_123_000)), field(b"X", struct.pack("<I", width)),
              field(b"Y", struct.pack("<I", height)), field(b"C", bytes([compression])), field(b"D", b"nz42"),
              field(b"E", b"lepton3.5"), field(b"N", struct.pack("<I", 1234)), field(b"?", b"of the future"), field(b"Z", b"\x09")]
    return b"CPTV" + bytes([version]) + b"H" + bytes([len(fields)]) + b"".join(fields)


def snake(plane):
    rows = plane.astype(np.int64).copy()
    rows[1::2] = rows[1::2, ::-1]
    return rows.ravel()


def packed(values, bits):
    text = "".join(format(int(v) & ((1 << bits) - 1), f"0{bits}b") for v in values)
    text += "0" * (-len(text) % 8)
    return bytes(int(text[i:i + 8], 2) for i in range(0, len(text), 8))


def frame(plane, before, time_ms, ffc_ms=100, background=False, bits=None):
    walk = snake(plane.astype(np.int64) - before.astype(np.int64))
    steps = np.diff(walk)
    least = max(int(np.abs(steps).max()).bit_length() + 1, 1) if steps.size else 1
    bits = bits or least
    data = struct.pack("<i", int(walk[0])) + packed(steps, bits)
    fields = [field(b"t", struct.pack("<I", time_ms)), field(b"w", bytes([bits])),
              field(b"f", struct.pack("<I", len(data))), field(b"c", struct.pack("<I", ffc_ms))]
    if background:
        fields.append(field(b"g", b"\x01"))
    return b"F" + bytes([len(fields)]) + b"".join(fields) + data


class Cptv(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        random = np.random.default_rng(5)
        self.planes = [random.integers(low, high, (HEIGHT, WIDTH), dtype=np.uint16)
                       for low, high in ((3000, 3010), (2990, 3050), (0, 65535), (65535 - 9, 65535), (30000, 30001), (7, 9))]

    def film(self, **keys):
        text, before = header(**keys), ZERO
        for n, plane in enumerate(self.planes):
            text += frame(plane, before, 5000 + 115 * n, ffc_ms=100 if n < 3 else 5300)
            before = plane
        return text

    def convert(self, text, *options, packs=gzip.compress):
        (self.folder / "a.cptv").write_bytes(packs(text))
        run = [BOLO, "convert", self.folder / "a.cptv", "-o", self.folder / "a.h5", "--overwrite", *options]
        return subprocess.run(run, capture_output=True, text=True, timeout=60)

    def converted(self, text, *options):
        done = self.convert(text, *options)
        self.assertEqual(done.returncode, 0, done.stderr)
        return h5py.File(self.folder / "a.h5")

    def refused(self, text, part, **how):
        done = self.convert(text, **how)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertIn(part, done.stderr)
        self.assertIn("a.cptv", done.stderr)
        self.assertEqual(done.stderr.count("\n"), 1, done.stderr)

    def test_every_value_and_time_comes_back(self):
        with self.converted(self.film()) as capture:
            self.assertTrue((capture["frames"][:] == np.stack(self.planes)).all())
            np.testing.assert_allclose(capture["t"][:], 5.0 + 0.115 * np.arange(6), atol=1e-9)
            self.assertAlmostEqual(capture.attrs["frame_period_s"], 0.115, 9)
            for key, value in (("unit", "count"), ("camera_model", "lepton3.5"), ("camera_serial", "1234"),
                               ("recorded_at", "2019-07-23T23:57:42.123Z")):
                self.assertEqual(capture.attrs[key].decode(), value)
            self.assertEqual([(round(e["t"], 3), e["kind"].decode()) for e in capture["events"][:]], [(5.345, "nuc")])
        with self.converted(self.film(), "--scale", "0.01") as capture:
            self.assertEqual((capture.attrs["unit"].decode(), capture.attrs["scale"]), ("kelvin", 0.01))

    def test_a_correction_long_ago_is_no_event(self):
        text = header() + b"".join(frame(ZERO, ZERO, 60_000 + 115 * n, ffc_ms=30_000 + 115 * n) for n in range(4))
        with self.converted(text) as capture:
            self.assertNotIn("events", capture)

    def test_a_background_frame_is_no_frame_but_counts_for_the_next(self):
        text = header() + frame(self.planes[0], ZERO, 0, background=True) + frame(self.planes[1], self.planes[0], 5000)
        with self.converted(text + frame(self.planes[2], self.planes[1], 5115)) as capture:
            self.assertTrue((capture["frames"][:] == np.stack(self.planes[1:3])).all())

    def test_times_that_do_not_rise_give_way_to_the_rate(self):
        with self.converted(header() + frame(ZERO, ZERO, 7) + frame(ZERO, ZERO, 7)) as capture:
            np.testing.assert_allclose(capture["t"][:], [0, 1 / 9])

    def test_what_is_wrong_is_said_in_one_line(self):
        film = self.film()
        self.refused(b"", "it is no CPTV file")
        self.refused(b"CPTX" + film[4:], "it is no CPTV file")
        self.refused(self.film(version=1), "it is CPTV version 1; 2 is read")
        self.refused(self.film(compression=0), "compressed by scheme 0; 1 is read")
        self.refused(header(width=0), "its frames are 0x5")
        self.refused(header(width=1 << 20), "its frames are 1048576x5")
        self.refused(header(), "it has no frame")
        self.refused(film + b"G\x00", "something other than a frame")
        self.refused(film + frame(ZERO, ZERO, 9000, bits=40), "has 40 bits a pixel")
        self.refused(header() + frame(ZERO[:2], ZERO[:2], 1), "a frame of 7x5 with 1 bits a pixel has 6 bytes")
        self.refused(header() + 17 * frame(ZERO, ZERO, 1, background=True), "has more than 16 background frames")
        over = frame(np.full((HEIGHT, WIDTH), 65535), np.full((HEIGHT, WIDTH), -1), 9000)
        self.refused(film + over, "frame 6 has a value beyond 16 bits")
        self.refused(film, "it is cut off", packs=lambda text: gzip.compress(text)[:-40])
        for end in range(60, len(film), 37):
            self.assertIn(self.convert(film[:end]).returncode, (0, 2), end)

    def test_damage_ends_no_program(self):
        random = np.random.default_rng(6)
        film = self.film()
        for _ in range(60):
            bad = bytearray(film)
            for at in random.integers(5, len(bad), 3):
                bad[at] = random.integers(256)
            self.assertIn(self.convert(bytes(bad)).returncode, (0, 2))


if __name__ == "__main__":
    unittest.main(verbosity=2)

#!/usr/bin/env python3
"""The GStreamer plugin through GStreamer's own tools, appsrc and appsink: bolosrc against the frames of a daemon in
another process, bolodeblur against `bolo deblur` on the same capture.

usage: gstreamer_test.py BOLO PLUGIN_FOLDER MODULE_FOLDER LIBRARY. Exit code 77: GStreamer's Python or h5py isn't there.
"""

import os
import resource
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
import unittest

BOLO, PLUGINS, MODULE, LIBRARY = sys.argv[1:5]
del sys.argv[1:5]
os.environ["GST_PLUGIN_PATH"] = PLUGINS
os.environ["BOLO_CLIENT_LIBRARY"] = LIBRARY
registry = tempfile.TemporaryDirectory()
os.environ["GST_REGISTRY"] = os.path.join(registry.name, "registry.bin")
sys.path.insert(0, MODULE)

try:
    import gi
    import h5py
    import numpy as np

    gi.require_version("Gst", "1.0")
    gi.require_version("GstApp", "1.0")
    gi.require_version("GstVideo", "1.0")
    gi.require_version("GstRtspServer", "1.0")
    from gi.repository import GLib, Gst, GstApp, GstRtspServer, GstVideo  # noqa: F401
except (ImportError, ValueError) as error:
    print("skipped:", error)
    sys.exit(77)

import bolo  # noqa: E402
from programs import Programs  # noqa: E402

Gst.init(None)
HANG_S = 60
NS = 10**9
GREY16_60HZ = "video/x-raw,format=GRAY16_LE,framerate=60/1"


def pixels(buffer, caps):
    """The plane of a buffer, whatever its row stride."""
    info = GstVideo.VideoInfo.new_from_caps(caps)
    kind = np.uint8 if info.finfo.format == GstVideo.VideoFormat.GRAY8 else np.dtype("<u2")
    good, memory = buffer.map(Gst.MapFlags.READ)
    assert good
    rows = np.frombuffer(memory.data, np.uint8).reshape(info.height, info.stride[0])
    plane = rows[:, :info.width * np.dtype(kind).itemsize].copy().view(kind)
    buffer.unmap(memory)
    return plane


def simulate(file, *more):
    subprocess.run([BOLO, "simulate", "-o", file, "--no-truth", *more], check=True, capture_output=True)


class Pipeline:
    def __init__(self, text):
        self.pipeline = Gst.parse_launch(text + " ! appsink name=sink sync=false max-buffers=400")
        self.sink = self.pipeline.get_by_name("sink")

    def __enter__(self):
        self.pipeline.set_state(Gst.State.PLAYING)
        return self

    def __exit__(self, *_):
        self.pipeline.set_state(Gst.State.NULL)

    def pull(self, seconds=HANG_S):
        """(buffer, caps), or None at the end of the stream or after an error."""
        sample = self.sink.try_pull_sample(int(seconds * NS))
        return sample and (sample.get_buffer(), sample.get_caps())

    def message(self, kind, seconds=HANG_S):
        return self.pipeline.get_bus().timed_pop_filtered(int(seconds * NS), kind)

    def error(self, seconds=HANG_S):
        message = self.message(Gst.MessageType.ERROR, seconds)
        return message.parse_error()[0].message if message else ""


def launch(line, **how):
    return subprocess.run(["gst-launch-1.0", *line.split()], capture_output=True, text=True, timeout=HANG_S, **how)


class WithTools(unittest.TestCase):
    def assert_runs(self, line):
        done = launch(line)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        self.assertNotIn("CRITICAL", done.stderr)


class Tools(WithTools):
    def test_gst_launch_runs_the_filter_on_any_source(self):
        for size in ("width=64,height=48", "width=63,height=5"):  # rows with and without padding
            self.assert_runs(f"videotestsrc num-buffers=40 ! {GREY16_60HZ},{size} ! bolodeblur lookahead=1 tau=0.01 "
                             "! videoconvert ! fakesink")

    def test_frames_that_downstream_does_not_take_are_dropped(self):
        for look_ahead in (0, 3):
            self.assert_runs(f"videotestsrc num-buffers=60 ! {GREY16_60HZ},width=64,height=48 ! tee name=t "
                             f"t. ! bolodeblur window=9 lookahead={look_ahead} t. ! fakesink")

    def test_what_cannot_be_is_an_error_in_words(self):
        for wrong, says in (("bolodeblur solver=fast", "fast"), ("bolodeblur window=16", "window"),
                            ("bolodeblur lookahead=200", "lookahead")):
            with Pipeline(f"videotestsrc ! {GREY16_60HZ} ! {wrong}") as wrong_one:
                self.assertIn(says, wrong_one.error())
        with Pipeline("appsrc name=in is-live=true format=time "
                      "caps=video/x-raw,format=GRAY16_LE,width=8,height=8,framerate=0/1 ! bolodeblur") as rateless:
            rateless.pipeline.get_by_name("in").push_buffer(Gst.Buffer.new_wrapped(bytes(128)))
            self.assertIn("frame rate", rateless.error())
        with Pipeline("bolosrc camera=nobody-here") as none:
            self.assertIn("nobody-here", none.error())

    def test_frames_that_memory_has_no_room_for_are_an_error_in_words(self):
        done = launch(f"videotestsrc num-buffers=1 ! {GREY16_60HZ},width=16000,height=16000 ! bolodeblur ! fakesink",
                      preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30)))
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertIn("16000x16000 cannot be deblurred", done.stderr)


class Filter(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = cls.enterClassContext(tempfile.TemporaryDirectory())
        cls.capture = os.path.join(cls.folder, "in.h5")
        simulate(cls.capture, "--width", "70", "--height", "33", "--frames", "60", "--rate", "60", "--speed", "120")
        cls.lossy = os.path.join(cls.folder, "lossy.h5")
        with h5py.File(cls.capture) as whole, h5py.File(cls.lossy, "w") as lossy:
            kept = [i for i in range(60) if i not in (25, 26, 40)]
            for name in ("frames", "t", "frame_id"):
                lossy[name] = whole[name][kept]
            lossy.attrs.update(dict(whole.attrs))

    def deblurred(self, capture, *options):
        out = os.path.join(self.folder, "out.h5")
        subprocess.run([BOLO, "deblur", capture, "-o", out, "--overwrite", "--type", "uint16", *options], check=True,
                       capture_output=True)
        with h5py.File(out) as f:
            return dict(zip(map(int, f["frame_id"]), f["frames"][:]))

    def filtered(self, capture, options, flag_lost=False):
        """{frame id: plane} and flags of the output, and the input frames."""
        with h5py.File(capture) as f:
            frames, times, ids = f["frames"][:], f["t"][:], f["frame_id"][:]
            scale = float(f.attrs["scale"])
        height, width = frames.shape[1:]
        caps = f"{GREY16_60HZ},width={width},height={height}"
        stride = (2 * width + 3) // 4 * 4
        out = {}
        with Pipeline(f"appsrc name=in format=time caps={caps} ! bolodeblur scale={scale} {options}") as filter_:
            source = filter_.pipeline.get_by_name("in")
            for n, (frame, t, id_) in enumerate(zip(frames, times, ids)):
                rows = np.zeros((height, stride), np.uint8)
                rows[:, :2 * width] = frame.view(np.uint8)
                buffer = Gst.Buffer.new_wrapped(rows.tobytes())
                buffer.pts = int(round((t - times[0]) * NS))
                buffer.offset = int(id_)
                if flag_lost and n > 0 and id_ != ids[n - 1] + 1:
                    gap = Gst.Buffer.new_wrapped(bytes(rows.nbytes))
                    gap.pts = int(round((times[n - 1] + 1 / 60 - times[0]) * NS))
                    gap.set_flags(Gst.BufferFlags.GAP)
                    self.assertEqual(source.push_buffer(gap), Gst.FlowReturn.OK)
                    buffer.set_flags(Gst.BufferFlags.DISCONT)
                self.assertEqual(source.push_buffer(buffer), Gst.FlowReturn.OK)
            source.end_of_stream()
            for buffer, got_caps in iter(filter_.pull, None):
                out[buffer.offset] = pixels(buffer, got_caps)
                self.assertEqual(buffer.pts, int(round((times[list(ids).index(buffer.offset)] - times[0]) * NS)))
            self.assertIsNotNone(filter_.message(Gst.MessageType.EOS))
        self.assertEqual(list(out), list(ids), "one for each, in order")
        return out, dict(zip(map(int, ids), frames))

    def assert_same(self, capture, command, element, **how):
        sharp = self.deblurred(capture, *command)
        out, came = self.filtered(capture, element, **how)
        self.assertGreater(len(sharp), 20)
        for number, plane in out.items():
            np.testing.assert_array_equal(plane, sharp.get(number, came[number]), str(number))
        changed = sum((out[n] != came[n]).any() for n in sharp)
        self.assertEqual(changed, len(sharp), "nothing was deblurred")

    def test_pixels_are_those_of_bolo_deblur(self):
        self.assert_same(self.capture, ["--tau", "0.009", "--lambda", "0.002"], "tau=0.009 lambda=0.002")
        self.assert_same(self.capture, ["--lookahead", "2"], "lookahead=2 workers=3")
        for solver in ("dual", "inverse", "mmae", "motion"):
            self.assert_same(self.capture, ["--solver", solver], f"solver={solver}")

    def test_lost_frames_are_gaps(self):
        self.assert_same(self.lossy, ["--lookahead", "1"], "lookahead=1")
        self.assert_same(self.lossy, ["--lambda", "0.002"], "lambda=0.002", flag_lost=True)

    def laid_out(self, pipeline, width, height, stride, offset, size):
        """Pushes a buffer of `size` bytes, 0, 1, 2 ..., that claims this layout."""
        buffer = Gst.Buffer.new_wrapped(np.arange(size, dtype=np.uint32).astype(np.uint8).tobytes())
        buffer.pts = 0
        GstVideo.buffer_add_video_meta_full(buffer, GstVideo.VideoFrameFlags.NONE, GstVideo.VideoFormat.GRAY16_LE, width,
                                            height, 1, [offset, 0, 0, 0], [stride, 0, 0, 0])
        pipeline.pipeline.get_by_name("in").push_buffer(buffer)

    def test_a_buffers_own_layout_is_believed_within_the_buffer(self):
        filter_ = f"appsrc name=in format=time caps={GREY16_60HZ},width=64,height=48 ! bolodeblur"
        for layout in ((64, 48, 100000, 0), (64, 48, 128, 600), (64, 480, 1280, 0), (64, 48, -128, 0), (64, 48, 0, 0)):
            with self.subTest(layout=layout), Pipeline(filter_) as refusing:
                self.laid_out(refusing, *layout, size=128 * 48)
                self.assertIn("no frame of its caps", refusing.error())
        for layout in ((64, 48, 256, 64), (90, 60, 256, 64)):  # the corner of the larger layout
            with self.subTest(layout=layout), Pipeline(filter_) as taking:
                self.laid_out(taking, *layout, size=64 + 256 * 60)
                rows = np.arange(64 + 256 * 60, dtype=np.uint32).astype(np.uint8)[64:].reshape(60, 256)
                taking.pipeline.get_by_name("in").end_of_stream()
                np.testing.assert_array_equal(pixels(*taking.pull()), rows[:48, :128].copy().view("<u2"))

    def test_latency_has_the_look_ahead(self):
        caps = "video/x-raw,format=GRAY16_LE,framerate=50/1"
        with Pipeline(f"videotestsrc is-live=true ! {caps} ! bolodeblur name=deblur lookahead=3") as live:
            self.assertIsNotNone(live.pull())
            query = Gst.Query.new_latency()
            self.assertTrue(live.pipeline.get_by_name("deblur").get_static_pad("src").query(query))
            is_live, least, _ = query.parse_latency()
            self.assertTrue(is_live)
            self.assertGreaterEqual(least, 4 * NS // 50)


class Source(WithTools):
    def setUp(self):
        self.folder = self.enterContext(tempfile.TemporaryDirectory())
        self.capture = os.path.join(self.folder, "in.h5")
        simulate(self.capture, "--width", "66", "--height", "24", "--frames", "150", "--rate", "50")
        self.name = f"test-gst-{os.getpid()}-{self._testMethodName}"[:40]
        self.programs = self.enterContext(Programs(BOLO, None, self.folder, self.name))
        self.start()

    def start(self, capture=None):
        self.programs.start_replay(capture or self.capture)
        with bolo.Camera(self.name, timeout=HANG_S) as camera:
            while not camera.state().alive:
                time.sleep(0.05)

    def seen_in_shared_memory(self, plane, seconds):
        seen = {}

        def read():
            end = time.monotonic() + seconds
            with bolo.Camera(self.name, timeout=HANG_S) as camera:
                while time.monotonic() < end:
                    frame = camera.next(1.0)
                    copy = frame and frame.copy()
                    if copy:
                        seen[copy.frame_id] = (getattr(copy, plane), copy)

        thread = threading.Thread(target=read)
        thread.start()
        return seen, thread

    def streamed(self, pipeline, plane):
        """All output, and {frame id: plane} of shared memory at the same time."""
        seen, thread = self.seen_in_shared_memory(plane, 3.0)
        with Pipeline(pipeline) as live:
            got = list(iter(live.pull, None))
        thread.join()
        return got, seen

    def test_pixels_numbers_and_times_are_those_of_shared_memory(self):
        for plane in ("deblurred", "raw"):
            got, seen = self.streamed(f"bolosrc name={self.name} plane={plane} num-buffers=100", plane)
            caps = got[0][1].get_structure(0)
            self.assertEqual(caps.get_string("format"), "GRAY16_LE")
            self.assertEqual(caps.get_fraction("framerate")[1:], (50, 1))
            common = [(b, c) for b, c in got if b.offset in seen]
            self.assertGreater(len(common), 30)
            for buffer, buffer_caps in common:
                expected, frame = seen[buffer.offset]
                np.testing.assert_array_equal(pixels(buffer, buffer_caps), expected)
                meta = buffer.get_reference_timestamp_meta(Gst.Caps.from_string("timestamp/x-bolo-camera"))
                self.assertAlmostEqual(meta.timestamp / NS, frame.camera_time, places=6)
                utc = buffer.get_reference_timestamp_meta(Gst.Caps.from_string("timestamp/x-unix"))
                self.assertAlmostEqual(utc.timestamp / NS, frame.utc, places=5)
            steps = np.diff([b.pts for b, _ in got])
            self.assertTrue((steps >= 0).all())
            self.assertAlmostEqual(float(np.median(steps)) / NS, 0.02, delta=0.005)
            numbers = [b.offset for b, _ in got]
            breaks = [b.has_flags(Gst.BufferFlags.DISCONT) for b, _ in got]
            self.assertEqual(breaks, [True] + [b != a + 1 for a, b in zip(numbers, numbers[1:])])
            if plane == "raw":  # equals the capture's
                with h5py.File(self.capture) as f:
                    first = int(f["frame_id"][0])
                    for buffer, buffer_caps in got:
                        recorded = f["frames"][(buffer.offset - first) % 150]
                        np.testing.assert_array_equal(pixels(buffer, buffer_caps), recorded)

    def test_gray8_is_the_agc_of_the_same_plane(self):
        got, seen = self.streamed(f"bolosrc camera={self.name} num-buffers=60 ! video/x-raw,format=GRAY8", "deblurred")
        common = [(b, c) for b, c in got if b.offset in seen]
        self.assertGreater(len(common), 10)
        for buffer, caps in common:
            counts, greys = seen[buffer.offset][0].ravel(), pixels(buffer, caps).ravel().astype(int)
            order = np.argsort(counts, kind="stable")
            self.assertTrue((np.diff(greys[order]) >= 0).all(), "a hotter pixel is never darker")
            self.assertGreater(greys.max() - greys.min(), 100)

    def test_caps_are_asked_for_while_it_starts_and_stops(self):
        source = Gst.parse_launch(f"bolosrc camera={self.name} ! fakesink name=sink sync=false")
        pad = source.get_by_name("sink").get_static_pad("sink").get_peer()
        ended, answers = threading.Event(), set()

        def ask():
            while not ended.is_set():
                caps = pad.query_caps(None).get_structure(0)
                if caps.get_int("width")[0]:  # the camera is open
                    answers.add((caps.get_int("width").value, caps.get_int("height").value, caps.get_fraction("framerate")[1:]))

        asking = [threading.Thread(target=ask) for _ in range(2)]
        for thread in asking:
            thread.start()
        for _ in range(200):
            source.set_state(Gst.State.PLAYING)
            source.set_state(Gst.State.NULL)
        ended.set()
        for thread in asking:
            thread.join()
        self.assertEqual(answers, {(66, 24, (50, 1))})

    def test_it_goes_on_after_a_restart_with_another_size(self):
        other = os.path.join(self.folder, "other.h5")
        simulate(other, "--width", "40", "--height", "32", "--frames", "100", "--rate", "100")
        with Pipeline(f"bolosrc camera={self.name} restart-timeout=60000") as live:
            self.assertIsNotNone(live.pull())
            self.programs.kill("daemon")
            self.start(other)
            end = time.monotonic() + HANG_S
            while time.monotonic() < end:
                pulled = live.pull()
                self.assertIsNotNone(pulled, live.error(0))
                buffer, caps = pulled
                if caps.get_structure(0).get_int("width")[1] == 40:
                    break
            self.assertEqual(caps.get_structure(0).get_fraction("framerate")[1:], (100, 1))
            self.assertTrue(buffer.has_flags(Gst.BufferFlags.DISCONT))
            self.assertEqual(pixels(buffer, caps).shape, (32, 40))

    def test_it_ends_when_the_daemon_does_not_come_back(self):
        with Pipeline(f"bolosrc camera={self.name} restart-timeout=300") as live:
            self.assertIsNotNone(live.pull())
            self.programs.kill("daemon", signal.SIGTERM)
            while live.pull():
                continue
            self.assertIsNotNone(live.message(Gst.MessageType.EOS))

    def see_a_forged_frame(self, camera_ns=0, utc_ns=0, period_s=0.02, look_ahead=0):
        """Plays a copy of the ring with forged values and future frames, until a sink with sync has shown one."""
        with bolo.Camera(self.name) as camera:
            while camera.state().published < camera.info.slot_count:
                time.sleep(0.05)
        with open(f"/dev/shm/bolo.{self.name}", "rb") as shared:
            ring = bytearray(shared.read())
        forged = f"/dev/shm/bolo.{self.name}-forged"
        (slots,), (first, stride) = struct.unpack_from("<I", ring, 24), struct.unpack_from("<QQ", ring, 32)
        struct.pack_into("<d", ring, 80, period_s)
        struct.pack_into("<I", ring, 100, look_ahead)
        for place in range(first, first + slots * stride, stride):
            struct.pack_into("<q", ring, place + 16, camera_ns)
            struct.pack_into("<qq", ring, place + 56, time.monotonic_ns() + 10**18, utc_ns)  # host_ns, utc_ns
        with open(forged, "wb") as file:
            file.write(ring)
        try:
            self.assert_runs(f"bolosrc camera={self.name}-forged num-buffers=1 ! fakesink sync=true")
        finally:
            os.unlink(forged)

    def test_times_periods_and_look_aheads_that_cannot_be_hold_up_no_sink(self):
        for forged in ({"camera_ns": -1, "utc_ns": -1}, {"period_s": 3600.0}, {"look_ahead": 2**31}):
            with self.subTest(forged):
                self.see_a_forged_frame(**forged)

    def test_a_daemon_that_takes_longer_is_told_to_the_pipeline(self):
        """Otherwise sinks drop its frames as late."""
        with Pipeline(f"bolosrc camera={self.name} restart-timeout=60000") as live:
            self.assertIsNotNone(live.pull())
            while live.message(Gst.MessageType.LATENCY, 0.1):
                pass
            self.programs.kill("daemon", signal.SIGTERM)
            self.start()
            self.assertIsNotNone(live.message(Gst.MessageType.LATENCY))

    def test_rtsp_clients_see_the_picture(self):
        """Two clients of gst-rtsp-server in turn, as JPEG."""
        server = GstRtspServer.RTSPServer(address="127.0.0.1", service="0")
        factory = GstRtspServer.RTSPMediaFactory(shared=True)
        factory.set_launch(f"( bolosrc camera={self.name} ! video/x-raw,format=GRAY8 ! videoconvert ! video/x-raw,format=I420 ! jpegenc quality=95 "
                           "! rtpjpegpay name=pay0 pt=26 )")
        server.get_mount_points().add_factory("/front", factory)
        server.attach(None)
        loop = GLib.MainLoop()
        serving = threading.Thread(target=loop.run)
        serving.start()
        self.addCleanup(serving.join)
        self.addCleanup(loop.quit)
        for transport in ("tcp", "udp"):
            seen, thread = self.seen_in_shared_memory("deblurred", 6.0)
            with Pipeline(f"rtspsrc location=rtsp://127.0.0.1:{server.get_bound_port()}/front protocols={transport} latency=0 "
                          "! rtpjpegdepay ! jpegdec ! videoconvert ! video/x-raw,format=GRAY8") as client:
                shown = [pulled for pulled in (client.pull(10) for _ in range(20)) if pulled]
            thread.join()
            self.assertEqual(len(shown), 20, transport)
            picture = pixels(*shown[-1])[:24, :66].ravel().astype(float)  # JPEG pads to whole blocks
            likeness = max(np.corrcoef(picture, plane.ravel())[0, 1] for plane, _ in seen.values())
            self.assertGreater(likeness, 0.95)


if __name__ == "__main__":
    unittest.main()

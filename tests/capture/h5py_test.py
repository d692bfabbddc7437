"""Captures that h5py writes are read: argument 1 is the bolo program. Exit code 77: h5py isn't there."""

import json
import os
import pathlib
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "tools"))
from programs import needed, run  # noqa: E402

h5py, np = needed("h5py", "numpy")

ATTRIBUTES = {"format": "bolo-capture", "version": 1, "unit": "kelvin", "scale": 0.01, "offset": 0.0,
              "frame_period_s": 0.005, "camera_model": "FLIR A655sc", "camera_serial": "1", "row_step": 1}


def write_capture(path, frames, t, frame_id, **how):
    with h5py.File(path, "w", **how) as f:
        f.attrs.update(ATTRIBUTES)
        f.create_dataset("frames", data=frames, chunks=(1, *frames.shape[1:]), compression="gzip", shuffle=True)
        f["t"] = t
        f["frame_id"] = frame_id
        events = np.array([(0.001, "nuc")], dtype=[("t", "f8"), ("kind", h5py.string_dtype())])
        f["events"] = events
        stimulus = f.create_group("stimulus")
        stimulus.attrs.update({"kind": "chopper", "cold_k": 293})
        for name, value in (("on_s", 0.1), ("off_s", 0.2), ("level_k", 303)):
            stimulus[name] = [value]


def info(bolo, path):
    return json.loads(run(bolo, "info", path, "--json"))


def main(bolo):
    random = np.random.default_rng(3)
    frames = random.integers(29000, 31000, (6, 3, 7), dtype=np.uint16)
    t = np.array([0, 1, 2, 5, 6, 7]) * 0.005
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "a.h5")
        write_capture(path, frames, t, np.array([9, 10, 11, 14, 15, 16]))
        told = info(bolo, path)
        assert (told["width"], told["height"], told["frames"]) == (7, 3, 6), told
        assert told["lost_frames"]["count"] == 2 and told["lost_frames"]["first"][0]["before_frame"] == 3, told
        assert abs(told["rate"]["measured_hz"] - 200) < 1e-6, told
        assert told["events"] == [{"kind": "nuc", "t_s": 0.001}], told
        assert told["stimulus"]["kind"] == "chopper" and told["stimulus"]["level_k"] == [303.0], told
        last = frames[5] * 0.01
        values = told["values"]["last"]
        assert abs(values["min"] - last.min()) < 1e-9 and abs(values["median"] - np.median(last)) < 1e-9, told

        # Unsupported contents are left out or truncated.
        path = os.path.join(folder, "foreign.h5")
        write_capture(path, frames, t, np.arange(6), libver="latest")
        with h5py.File(path, "a", libver="latest") as f:
            f.attrs["long"] = np.bytes_(b"v" * 200_000)
            for i in range(1500):
                f.attrs[f"k{i}"] = "v"
            del f["events"]
            f["events"] = np.array([(0.001, "n" * 100), (0.002, "")], dtype=[("t", "f8"), ("kind", h5py.string_dtype())])
        for verb in ("convert", "recover"):
            out = os.path.join(folder, verb + ".h5")
            run(bolo, verb, path, "-o", out)
            assert [event["kind"] for event in info(bolo, out)["events"]] == ["n" * 63]
        with h5py.File(path, "a") as f:
            f["t_host"] = f["t"]
            f["t_utc"] = np.full(6, 1e300)
        done = subprocess.run([bolo, "convert", path, "-o", os.path.join(folder, "far.mcap")], capture_output=True, text=True)
        assert done.returncode == 2 and "/t_utc has a time that is not" in done.stderr, done

        path = os.path.join(folder, "bad.h5")
        write_capture(path, frames, t[::-1], np.arange(6))
        done = subprocess.run([bolo, "info", path], capture_output=True, text=True, check=False)
        assert done.returncode == 2 and done.stderr.count("\n") == 1 and "/t: value 1" in done.stderr, done


if __name__ == "__main__":
    main(sys.argv[1])

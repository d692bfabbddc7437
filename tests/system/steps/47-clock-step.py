"""The clock is set during a recording: monotonic times do not move, UTC does, and the recording reports it."""

import json
import pathlib
import signal
import subprocess
import time

from guest import check, journal, run, saw, stat, wait_until

HOUR_S = 3600
file = pathlib.Path("/tmp/stepped.h5")
since = time.time()
record = subprocess.Popen(["bolo", "record", "test", "-o", str(file)], stdout=subprocess.DEVNULL)
wait_until("a recording", lambda: pathlib.Path(f"{file}.part").exists())
time.sleep(2.0)
steps = stat("test")["clock"]["steps"]
run("date", "--set", "+1 hour")
try:
    time.sleep(2.0)
    record.send_signal(signal.SIGINT)
    check(record.wait(30) == 0, "bolo record failed")
    clock = stat("test")["clock"]
finally:
    run("date", "--set", "-1 hour")
check(clock["steps"] == steps + 1, f"the daemon counts {clock['steps']} steps, not {steps + 1}")

info = json.loads(run("bolo", "info", str(file), "--json"))
file.unlink()
kinds = [event["kind"] for event in info["events"]]
check(kinds == ["clock_step"], f"the recording's events are {kinds}")
check(info["irregular_times"]["count"] <= 2, f"camera times moved: {info['irregular_times']}")
print(info["utc"], info["events"], info["attributes"])
seconds = [time.mktime(time.strptime(info["utc"][end][:19], "%Y-%m-%dT%H:%M:%S")) for end in ("first", "last")]
moved = seconds[1] - seconds[0] - info["duration_s"]
check(abs(moved - HOUR_S) < 2.0, f"UTC moved by {moved} s beyond the recording's {info['duration_s']}")
check(abs(seconds[0] - since) < 60, f"the recording begins {seconds[0] - since} s after now")
said = journal("BOLO_EVENT=clock_step", "-u", "bolod@test")
check(said, "the journal does not tell of it")
saw(f"set by an hour: event clock_step, UTC {moved:+.0f} s over {info['duration_s']:.1f} s of the camera; "
    f"uncertainty {info['attributes']['utc_uncertainty_s']:.3g} s, synchronised {clock['synchronised']}")

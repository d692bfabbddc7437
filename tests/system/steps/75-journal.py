"""The journal of all previous steps: structured fields, few lines, and no denied access."""

import collections
import re
import time

from frames import published
from guest import check, journal, run, saw, wait_until

entries = journal("-t", "bolod", "BOLO_NAME=test")
check(entries, "no entries with BOLO_NAME=test")
check(all({"PRIORITY", "BOLO_NAME", "_SYSTEMD_UNIT"} <= entry.keys() for entry in entries), "entries lack fields")
events = collections.Counter(entry["BOLO_EVENT"] for entry in entries if "BOLO_EVENT" in entry)
check({"start", "camera_lost", "camera_back", "reload"} <= events.keys(), f"events are missing: {dict(events)}")
saw(", ".join(f"{event} {count}" for event, count in sorted(events.items())))

since = time.time()
before = published("test")
wait_until("50 frames", lambda: published("test") >= before + 50)
lines = len(journal("-t", "bolod", "BOLO_NAME=test", since=since))
check(lines < 10, f"{lines} lines in the journal within 50 frames")
denial = re.compile(r"denied|not permitted|bad system call", re.IGNORECASE)
noise = [entry["MESSAGE"] for entry in journal() if denial.search(str(entry.get("MESSAGE")))]
check(not noise, f"something was denied: {noise}")
run("journalctl", "-b", "--no-pager", "-p", "warning", "-n", "40")
saw(f"{len(entries)} lines of the daemon, nothing denied")

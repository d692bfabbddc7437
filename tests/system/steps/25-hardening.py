"""systemd's rating of the units."""

import re

from guest import check, run, saw

UNITS = ("bolod@test.service", "bolo-fakecam.service")
MOST_EXPOSED = 2.0  # 0.2 each: other users exist, and fchown is allowed, for [shm] group; 0.3: the clock may be read

check(run("systemd-analyze", "verify", "--man=no", *UNITS) == "", "systemd-analyze verify has something to say")
for unit in UNITS:
    text = run("systemd-analyze", "security", "--no-pager", unit)
    level = re.search(r"Overall exposure level for \S+: ([\d.]+)", text)
    check(level and float(level[1]) <= MOST_EXPOSED, f"{unit} is more exposed than {MOST_EXPOSED}")
    saw(f"{unit} {level[1]}")

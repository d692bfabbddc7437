"""v4l2-compliance reports only failures of v4l2loopback itself."""

import re

from guest import check, run, saw

# Failures of v4l2loopback 0.12.7 with any writer.
DRIVERS_OWN = {
    "VIDIOC_ENUM_FMT/FRAMESIZES/FRAMEINTERVALS",
    "VIDIOC_G/S_PARM",
    "VIDIOC_G_FMT",
    "VIDIOC_REQBUFS/CREATE_BUFS/QUERYBUF",
    "for unlimited opens",
}

text = run("v4l2-compliance", "-d", "/dev/video10", expect=None, timeout=120)
failed = {line.strip().removeprefix("test ").split(": FAIL")[0] for line in text.splitlines() if ": FAIL" in line}
summary = re.search(r"Total for .*: (\d+), Succeeded: (\d+), Failed: (\d+), Warnings: (\d+)", text)
check(summary, "v4l2-compliance did not come to its end")
check(failed <= DRIVERS_OWN, f"these fail beyond the driver's own: {sorted(failed - DRIVERS_OWN)}")
saw(f"{summary[2]} of {summary[1]} succeed; the driver's own {len(failed)} fail")

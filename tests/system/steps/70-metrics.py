"""The metrics page agrees with `bolo stat`. promtool checks it on the host."""

import re
import urllib.request

from guest import PAYLOAD, check, saw, stat


def value(name: str, labels: str = "") -> float:
    match = re.search(rf"^{name}(\{{[^}}]*{labels}[^}}]*\}})? (\S+)$", text, re.MULTILINE)
    check(match, f"{name} with {labels!r} is not on the page")
    return float(match[2])


before = stat("test")
with urllib.request.urlopen("http://127.0.0.1:9464/metrics", timeout=20) as answer:
    text = answer.read().decode()
after = stat("test")
(PAYLOAD / "metrics.txt").write_text(text)
published = value("bolo_frames_published_total")
between = before["published"] <= published <= after["published"]
check(between, f"{published:.0f} frames published: not what bolo stat says")
check(value("bolo_flowing") == 1.0, "frames do not flow, the page says")
check(value("bolo_video_frames_written_total") > 0, "no frame was written to the video device, the page says")
saw(f"{text.count('# TYPE ')} metrics, {len(text.splitlines())} lines")

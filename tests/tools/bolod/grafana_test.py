"""The Grafana dashboard: a real Prometheus that scrapes a real daemon has data for every panel.

usage: grafana_test.py BOLO BOLOD DASHBOARD. Exit code 77: prometheus is not there.
"""

import json
import os
import pathlib
import re
import shutil
import sys
import tempfile
import time
import urllib.error
import urllib.parse
import urllib.request

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
from programs import Programs, free_port  # noqa: E402

BOLO, BOLOD, DASHBOARD = sys.argv[1:4]
HANG_GUARD_S = 90.0
if shutil.which("prometheus") is None:
    print("skipped: prometheus is not installed")
    sys.exit(77)


def query(port, expression):
    url = f"http://127.0.0.1:{port}/api/v1/query?" + urllib.parse.urlencode({"query": expression})
    try:
        with urllib.request.urlopen(url, timeout=20) as answer:
            return json.load(answer)["data"]["result"]
    except urllib.error.HTTPError as error:
        raise AssertionError(f"{expression}: {error.read().decode()}") from error
    except urllib.error.URLError:
        return []  # not started yet


def expressions():
    """(expression, labels in its legend) of every panel."""
    dashboard = json.loads(pathlib.Path(DASHBOARD).read_text(encoding="utf-8"))
    for panel in dashboard["panels"]:
        for target in panel["targets"]:
            expression = target["expr"].replace("$camera", ".+").replace("$__rate_interval", "10s")
            assert "$" not in expression, expression
            yield expression, re.findall(r"{{(\w+)}}", target["legendFormat"])


def main(folder):
    metrics, prometheus = free_port(), free_port()
    scrapes = pathlib.Path(folder, "prometheus.yml")
    scrapes.write_text("global: {scrape_interval: 500ms, scrape_timeout: 500ms}\nscrape_configs:\n- job_name: bolo\n"
                       f"  static_configs: [{{targets: ['127.0.0.1:{metrics}']}}]\n")
    with Programs(BOLO, BOLOD, folder, f"test-grafana-{os.getpid()}", keys="[deblur]\nlambda = 0.001\n"
                  f'[metrics]\nenable = true\nlisten = "127.0.0.1:{metrics}"\n') as programs:
        programs.start("prometheus", "prometheus", f"--config.file={scrapes}", f"--storage.tsdb.path={folder}/data",
                       f"--web.listen-address=127.0.0.1:{prometheus}")
        end = time.monotonic() + HANG_GUARD_S
        programs.start_camera(programs.simulate("--frames=200"))
        programs.start_daemon()
        silent = dict(expressions())
        assert len(silent) >= 8, silent
        while silent and time.monotonic() < end:
            time.sleep(0.5)
            for expression, labels in list(silent.items()):
                results = query(prometheus, expression)
                if results and all(label in result["metric"] for result in results for label in labels):
                    del silent[expression]
        assert not silent, f"Prometheus has nothing, or not these labels: {silent}"


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        main(scratch)

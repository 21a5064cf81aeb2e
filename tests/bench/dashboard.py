#!/usr/bin/python3
"""Asks a real Prometheus, which scrapes a real daemon, everything that the dashboard for Grafana asks for.

    tests/bench/dashboard.py BUILD_DIR

Needs Debian's package prometheus. The daemon replays the example; after 20 s each expression of
examples/grafana/servotwin.json is asked once. A line for each: how many series it gives, and the value of the first.
Fails where Prometheus refuses an expression or finds nothing, but for those of CAN buses, which a replay has not. NaN
is an answer: no model is in force yet.
promtool looks at /metrics itself.
"""

import json
import os
import pathlib
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import urllib.parse
import urllib.request

TREE = pathlib.Path(__file__).resolve().parents[2]
SCRAPED_FOR_S = 20


def free_address():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{one.getsockname()[1]}"


PROMETHEUS = free_address()


def get(url):
    with urllib.request.urlopen(url, timeout=10) as answer:
        return answer.read().decode()


def asked(expression):
    answer = json.loads(get(f"http://{PROMETHEUS}/api/v1/query?" + urllib.parse.urlencode({"query": expression})))
    assert answer["status"] == "success", f"{expression}: {answer}"
    return answer["data"]["result"]


def begin_daemon(build, work):
    lines = open(work / "daemon", "w+")
    daemon = subprocess.Popen([build / "servotwind", "--store", work / "store", "--machine", f"dashboard-{os.getpid()}", "--domain", "97", "--http", "127.0.0.1:0", "--replay",
                               TREE / "examples/axis_production.csv"], stderr=lines, stdout=lines)
    for _ in range(100):
        time.sleep(0.1)
        found = re.search(r"page at http://(\S+)/", (work / "daemon").read_text())
        if found:
            return daemon, found[1]
    sys.exit("the daemon has not said where its page is:\n" + (work / "daemon").read_text())


def main():
    build = pathlib.Path(sys.argv[1]).resolve()
    for program in ("prometheus", "promtool"):
        if shutil.which(program) is None:
            sys.exit(f"{program} is missing: apt install prometheus")
    dashboard = json.loads((TREE / "examples/grafana/servotwin.json").read_text())
    running = []
    with tempfile.TemporaryDirectory() as place:
        work = pathlib.Path(place)
        try:
            daemon, address = begin_daemon(build, work)
            running.append(daemon)
            (work / "prometheus.yml").write_text(
                "global: {scrape_interval: 1s}\n"
                f"scrape_configs: [{{job_name: servotwin, static_configs: [{{targets: ['{address}']}}]}}]\n")
            running.append(subprocess.Popen(
                ["prometheus", f"--config.file={work}/prometheus.yml", f"--storage.tsdb.path={work}/data", f"--web.listen-address={PROMETHEUS}"],
                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
            time.sleep(SCRAPED_FOR_S)
            checked = subprocess.run(["promtool", "check", "metrics"], input=get(f"http://{address}/metrics"), capture_output=True, check=False,
                                     text=True)
            print("promtool:", (checked.stdout + checked.stderr).strip() or "no remark")
            failed = checked.returncode
            for panel in dashboard["panels"]:
                for target in panel.get("targets", []):
                    expression = target["expr"].replace("$instance", address).replace("$axis", ".*")
                    series = asked(expression)
                    print(f"{len(series):3d}  {series[0]['value'][1] if series else '-':>24}  {panel['title']}: {target['legendFormat']}")
                    if not series and "servotwin_bus_" not in expression:
                        failed = 1
            sys.exit(failed)
        finally:
            for program in running:
                program.terminate()
            for program in running:
                program.wait()


main()

#!/usr/bin/python3
"""Frame in to prediction out, through the real daemon over DDS, for large and fast machines.

    tests/bench/dds.py [BUILD_DIR] [SECONDS] [--part large|core|ahead] [--json FILE]

large: 32 axes at 1 kHz and 8 axes at 4 kHz, each beside ddsperf's ping-pong of the same size at the
same rate. core: the daemon alone on one core, by axes and rate: where p99.9 exceeds a cycle.
ahead: the same with commands of cycles ahead. Of each of these runs: what a cycle costs, by thread.
Every run measures for that many seconds (20). Nothing here passes or fails.
"""

import argparse
import json
import os
import pathlib
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import typing

sys.dont_write_bytecode = True
from common import CORE, introduce, output_of, table  # noqa: E402

HERE = pathlib.Path(__file__).resolve().parent
SECONDS = 20
CELLS = ("{:.1f}", "{:.1f}", "{:.2f}", "{:.1f}", "{:.2f}")


class Load(typing.NamedTuple):
    """What the machine is like: also in bench_dds.cpp."""

    axes: int = 8
    hz: int = 1000
    ahead: int = 0

    def __str__(self):
        return f"{self.axes} axes at {self.hz / 1000:g} kHz"


LARGE = (Load(32, 1000), Load(8, 4000))
SWEEP_AXES = (1, 4, 8, 16, 32)
SWEEP_HZ = (1000, 2000, 4000, 8000)
AHEAD = (Load(8, 1000, 0), Load(8, 1000, 8), Load(8, 1000, 32), Load(32, 1000, 32))
LATE_SHARE = 0.01  # of the frames, above which it is the sender that cannot keep the rate

# What the daemon sets for itself (drivers/dds/dds.cpp), for ddsperf.
LOOPBACK = """<CycloneDDS><Domain id="any">
<General>
  <Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>
  <AllowMulticast>false</AllowMulticast>
</General>
<Discovery>
  <ParticipantIndex>auto</ParticipantIndex>
  <MaxAutoParticipantIndex>63</MaxAutoParticipantIndex>
  <Peers><Peer address="127.0.0.1"/></Peers>
</Discovery>
</Domain></CycloneDDS>"""

# The daemon's threads by name. What is at idle priority takes what the others leave, and is no cost
# of a cycle.
IDLE = ("identification", "diagnosis")
THREADS = {"real-time loop": "loop", "publisher": "publisher", "recorder": "recorder"}


def costs(pid, cycles):
    """CPU time of a cycle in us, by thread."""
    out = dict.fromkeys((*THREADS.values(), "DDS", "other"), 0.0)
    for thread in pathlib.Path(f"/proc/{pid}/task").iterdir():
        name = (thread / "comm").read_text(encoding="utf-8").strip()
        if name in IDLE:
            continue
        nanoseconds = int((thread / "schedstat").read_text(encoding="utf-8").split()[0])
        of = THREADS.get(name) or ("DDS" if re.match(r"recv|tev|dq\.|xmit|gc", name) else "other")
        out[of] += 1e-3 * nanoseconds / cycles
    return out


def through_the_daemon(build, scratch, domain, load, seconds, core=None, cpus=None):
    """The figures of bench_dds; with `core`, the daemon alone there and the machine elsewhere; with
    `cpus`, what a frame wakes in the daemon is kept to them (real_time.cpus)."""
    store, log = scratch / "store", scratch / "servotwind.log"
    shutil.rmtree(store, ignore_errors=True)
    output_of(build / "bench_dds", "prepare", store, load.axes, load.hz)
    environment = {key: value for key, value in os.environ.items() if key != "CYCLONEDDS_URI"}
    here = there = ()
    if core is not None:
        others = os.sched_getaffinity(0) - {core} or {core}
        here = ("taskset", "-c", str(core))
        there = ("taskset", "-c", ",".join(map(str, sorted(others))))
    config = ()
    if cpus is not None:
        file = scratch / "bench.toml"
        file.write_text(f"[real_time]\ncpus = {list(cpus)}\n", encoding="utf-8")
        config = ("--config", file)
    with open(log, "w", encoding="utf-8") as errors:
        daemon = subprocess.Popen(
            [*here, build / "servotwind", *config, "--store", store, "--machine", "bench"]
            + ["--domain", str(domain), "--http", "127.0.0.1:0"],
            stderr=errors,
            env=environment,
        )
    try:
        text = output_of(
            *there, build / "bench_dds", "measure", domain, seconds, *load, env=environment
        )
        result = json.loads(text)
        result["cost_us"] = costs(daemon.pid, result["cycles"])
        return result
    except SystemExit:
        sys.stderr.write(log.read_text(encoding="utf-8"))
        raise
    finally:
        daemon.terminate()
        daemon.wait()


def ddsperf(domain, size, trigger, hz, run_s):
    """Round trips of a ping-pong by the second, the first second left out, and pings without pong.

    ddsperf prints half of what it measures, as the way there alone (process_pong in its source);
    here it is doubled again.
    """
    environment = {**os.environ, "CYCLONEDDS_URI": LOOPBACK}
    base = ["ddsperf", "-i", str(domain), "-D"]
    pong = subprocess.Popen(
        [*base, str(run_s + 10), "pong", trigger], stdout=subprocess.DEVNULL, env=environment
    )
    try:
        text = output_of(
            *base, run_s + 1, "-Qminmatch:1", "-Qinitwait:10",
            "ping", f"{hz}Hz", "size", size, trigger, env=environment,
        )  # fmt: skip
    finally:
        pong.terminate()
        pong.wait()
    line = re.compile(r" size .* 50% ([\d.]+)us .* 99% ([\d.]+)us max ([\d.]+)us cnt (\d+)")
    matches = list(line.finditer(text))[1:]
    seconds = [[2 * float(us) for us in match.groups()[:3]] for match in matches]
    if not seconds:
        sys.exit(f"ddsperf said nothing about round trips:\n{text}")
    figures = per_second([dict(zip(("p50_us", "p99_us", "max_us"), second)) for second in seconds])
    timeouts = re.findall(r"ping timed out \(total (\d+) times\)", text)
    pongs = statistics.median(int(match.group(4)) for match in matches)
    return {**figures, "timeouts": int(timeouts[-1]) if timeouts else 0, "pongs_per_s": pongs}


def per_second(seconds):
    """ddsperf gives figures of one second, so ours are taken alike: the median of all seconds."""
    return {
        "p50_us": statistics.median(s["p50_us"] for s in seconds),
        "p99_us": statistics.median(s["p99_us"] for s in seconds),
        "worst_us": statistics.median(s["max_us"] for s in seconds),
        "max_us": max(s["max_us"] for s in seconds),
    }


def require_ddsperf():
    if shutil.which("ddsperf") is None:
        sys.exit("ddsperf is missing; it is in the Debian package cyclonedds-tools")


def domain_of_this_run():
    return 100 + os.getpid() % 100


def beside_ddsperf(build, scratch, load=Load(), seconds=SECONDS):
    """One machine through the daemon, and ddsperf with messages of the mean size at that rate."""
    require_ddsperf()
    domain = domain_of_this_run()
    whole = through_the_daemon(build, scratch, domain, load, seconds)
    size = (whole["frame_bytes"] + whole["prediction_bytes"]) // 2
    ours = per_second(whole["seconds"])
    direct = ddsperf(domain, size, "listener", load.hz, seconds)
    threaded = ddsperf(domain, size, "waitset", load.hz, seconds)

    print(f"\nDDS: frame in to prediction out, {load}, {seconds} s, loopback")
    labels = {
        "p50_us": "p50 [us]",
        "p99_us": "p99 [us]",
        "worst_us": f"worst of a second, 1 in {load.hz} [us]",
        "max_us": "max [us]",
    }
    rows = [("", "servotwin", "ddsperf", "ratio", "its waitset", "ratio")]
    for key, label in labels.items():
        here, direct_us, threaded_us = ours[key], direct[key], threaded[key]
        cells = (here, direct_us, here / direct_us, threaded_us, here / threaded_us)
        rows.append((label, *(form.format(x) for form, x in zip(CELLS, cells))))
    table(rows, (34, 11, 10, 8, 13, 8))
    print("  Medians over all seconds, max of all; round trips, twice what ddsperf prints. ddsperf")
    print("  answers in the receiving thread; with waitsets in a thread of its own, on both sides:")
    print("  as many changes of thread as ours (aim: 1.5).")
    loop = whole["daemon"]
    kept = through_the_daemon(build, scratch, domain, load, seconds, cpus=[CORE])
    its = per_second(kept["seconds"])
    print(
        f"  With real_time.cpus = [{CORE}]: p50 {its['p50_us']:.1f}, p99 {its['p99_us']:.1f} us;"
        f" {its['p50_us'] / direct['p50_us']:.2f}, {its['p99_us'] / direct['p99_us']:.2f} times"
        f" ddsperf, {its['p50_us'] / threaded['p50_us']:.2f},"
        f" {its['p99_us'] / threaded['p99_us']:.2f} times with waitsets; p99.9"
        f" {kept['p999_us']:.1f}, max {kept['max_us']:.1f} us; lost {kept['lost']}."
    )
    print(
        f"  servotwin, all {whole['sent']} round trips: p50 {whole['p50_us']:.1f},"
        f" p99 {whole['p99_us']:.1f}, p99.9 {whole['p999_us']:.1f}, max {whole['max_us']:.1f} us;"
        f" lost {whole['lost']}.\n"
        f"  Frames that never reached the daemon: {loop['frames_lost']}; written more than a cycle"
        f" late by the sender: {whole['late']}.\n"
        f"  ddsperf: {direct['timeouts']} and {threaded['timeouts']} pings not answered in time,"
        f" {direct['pongs_per_s']:.0f} and {threaded['pongs_per_s']:.0f} answered per second.\n"
        f"  Until the daemon's loop has the frame: p50 {loop['wake_p50_us']:.1f} us;"
        f" in the loop: p50 {loop['work_p50_us']:.1f}, p99 {loop['work_p99_us']:.1f} us.\n"
        f"  Frame {whole['frame_bytes']} bytes, prediction {whole['prediction_bytes']};"
        f" ddsperf {size} each way.\n"
        f"  A settled model of every axis in {100 * whole['predicted_share']:.1f} % of the cycles."
    )
    return {
        "load": load._asdict(),
        "servotwin": {**whole, "per_second": ours},
        "servotwin_kept": {**kept, "per_second": its},
        "ddsperf": direct,
        "ddsperf_waitset": threaded,
    }


def on_one_core(build, scratch, loads, seconds):
    """Every load with the daemon on a core of its own."""
    domain = domain_of_this_run()
    runs = {}
    for load in loads:
        if sys.stderr.isatty():
            print(f"\r  {len(runs) + 1} of {len(loads)}: {load}   ", end="", file=sys.stderr)
        runs[load] = through_the_daemon(build, scratch, domain, load, seconds, CORE)
    if sys.stderr.isatty():
        print("\r" + " " * 40, end="\r", file=sys.stderr)
    return runs


def cycle_us(load):
    return 1e6 / load.hz


def within_a_cycle(load, run):
    return run["lost"] == 0 and run["p999_us"] <= cycle_us(load)


def print_sweep(runs):
    print("\nOne core for the daemon: p99.9 of frame to prediction [us], by axes and rate")
    rows = [("", *(f"{axes} axes" for axes in SWEEP_AXES))]
    for hz in SWEEP_HZ:
        cells = []
        for axes in SWEEP_AXES:
            run = runs[Load(axes, hz)]
            mark = "L" if run["lost"] else "" if within_a_cycle(Load(axes, hz), run) else "!"
            if run["late"] > LATE_SHARE * run["sent"]:
                mark += "s"
            cells.append(f"{run['p999_us']:.0f}{mark:<2}")
        rows.append((f"{hz / 1000:g} kHz, cycle {1e6 / hz:.0f} us", *cells))
    table(rows, (24, 11, 11, 11, 11, 11))
    print("  !: beyond a cycle. L: predictions lost. s: more than 1 % of the frames were written")
    print("  more than a cycle late, so that the sender, too, is at its end.")
    good = [load for load, run in runs.items() if within_a_cycle(load, run)]
    if not good:
        print("  p99.9 is within a cycle nowhere.")
        return
    best = max(good, key=lambda load: load.axes * load.hz)
    print(f"  Most with p99.9 within a cycle: {best.axes * best.hz / 1000:g} axis-kHz, {best}.")
    for hz in SWEEP_HZ:
        most = max((load.axes for load in good if load.hz == hz), default=0)
        print(f"  At {hz / 1000:g} kHz: {most * hz / 1000:g} axis-kHz.")


def print_costs(runs):
    print("\nWhat a cycle costs the daemon: CPU time [us] by thread")
    rows = [("axes, rate, look-ahead", "loop", "DDS", "publisher", "recorder", "other", "all",
             "of a core")]  # fmt: skip
    for load, run in runs.items():
        cost = run["cost_us"]
        whole = sum(cost.values())
        parts = (*(cost[part] for part in ("loop", "DDS", "publisher", "recorder", "other")), whole)
        label = f"{load.axes:>2}, {load.hz / 1000:g} kHz, {load.ahead}"
        share = f"{100 * whole / cycle_us(load):.1f} %"
        rows.append((label, *(f"{part:.1f}" for part in parts), share))
    table(rows, (24, 8, 8, 11, 10, 8, 8, 11))
    print("  The loop waits for DDS, decodes the frame and predicts; DDS is Cyclone's receiving and")
    print("  timing; other is the page. Identification and diagnosis, at idle priority, are not in it.")


def plain(runs):
    return [{"load": load._asdict(), **run} for load, run in runs.items()]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("build", type=pathlib.Path, nargs="?", default=HERE.parents[1] / "build")
    parser.add_argument("seconds", type=int, nargs="?", default=SECONDS)
    parser.add_argument("--part", action="append", choices=("large", "core", "ahead"))
    parser.add_argument("--json", help="write all figures here")
    arguments = parser.parse_args()
    build, seconds = arguments.build.resolve(), arguments.seconds
    parts = arguments.part or ("large", "core", "ahead")
    if not (build / "bench_dds").exists():
        sys.exit(f"bench: there are no benchmarks in {build}; ./dev build makes them in build")
    if seconds < 1:
        sys.exit(f"bench: for how many seconds? {seconds} is too short")

    result = {"schema": "servotwin.bench_dds/1"}
    introduce(result)
    sys.stdout.reconfigure(line_buffering=True)
    with tempfile.TemporaryDirectory(prefix="servotwin-bench-") as directory:
        scratch = pathlib.Path(directory)
        if "large" in parts:
            result["large"] = [beside_ddsperf(build, scratch, load, seconds) for load in LARGE]
        if "core" in parts:
            sweep = [Load(axes, hz) for hz in SWEEP_HZ for axes in SWEEP_AXES]
            runs = on_one_core(build, scratch, sweep, seconds)
            print_sweep(runs)
            print_costs(runs)
            result["core"] = plain(runs)
        if "ahead" in parts:
            runs = on_one_core(build, scratch, AHEAD, seconds)
            print_costs(runs)
            result["ahead"] = plain(runs)
    if arguments.json:
        text = json.dumps(result, indent=1) + "\n"
        pathlib.Path(arguments.json).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()

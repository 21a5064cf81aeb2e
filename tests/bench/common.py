"""What the benchmarks share: to run a program, to say on what machine, to print a table."""

import datetime
import os
import subprocess
import sys

CORE = max(os.sched_getaffinity(0))


def output_of(*command, **options):
    """Standard output of a program; if it fails, its last words and the end of this run."""
    command = [str(part) for part in command]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    except FileNotFoundError:
        sys.exit(f"bench: {command[0]} is missing")
    if done.returncode != 0:
        sys.exit(f"bench: {' '.join(command)} failed: {done.stderr.strip() or done.returncode}")
    return done.stdout


def on_one_core(*command):
    return output_of("taskset", "-c", CORE, *command)


def machine():
    cpu = next(
        (
            line.split(":")[1].strip()
            for line in open("/proc/cpuinfo", encoding="utf-8")
            if line.startswith("model name")
        ),
        "unknown processor",
    )
    return {
        "date": datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
        "cpu": cpu,
        "cores": os.cpu_count(),
        "kernel": os.uname().release,
        "load": os.getloadavg()[0],
    }


def table(rows, widths):
    for row in rows:
        cells = [f"{cell:>{width}}" for cell, width in zip(row[1:], widths[1:])]
        print(f"  {row[0]:<{widths[0]}}" + "".join(cells))


def introduce(result):
    """The head of a run."""
    here = result["machine"] = machine()
    print(f"servotwin bench, {here['date']}")
    print(f"{here['cpu']}, {here['cores']} cores, Linux {here['kernel']}")
    if here["load"] > 0.5:
        print(f"The machine has other work (load {here['load']:.1f}): latencies are worse for it.")

#!/usr/bin/python3
"""Frequency response and coherence by SciPy: the peer of identification/response/frequency_response.h.

    frequency_response_peer.py RESPONSE.json RECORD.csv INPUT OUTPUT [--instrument NAME] [--differenced]

RESPONSE.json is what `servotwin frequency-response RECORD.csv --json` wrote; INPUT, OUTPUT and NAME
are columns of the same file, which must have no gaps. G = csd / welch and coherence with the same
windows (with an instrument G = S_ry / S_ru, and no coherence is compared). Prints one JSON object
with the largest differences over all frequencies, relative to |G|, and the CPU time of SciPy's
reading and estimate; runs on one thread.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"  # before numpy is loaded

import argparse
import json
import time

import numpy as np
import scipy
from scipy import signal


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("response")
    parser.add_argument("record")
    parser.add_argument("input")
    parser.add_argument("output")
    parser.add_argument("--instrument")
    parser.add_argument("--differenced", action="store_true")
    arguments = parser.parse_args()

    start = time.process_time()
    with open(arguments.record, encoding="utf-8") as file:
        names = file.readline().strip().split(",")
    wanted = [arguments.input, arguments.output]
    if arguments.instrument:
        wanted.append(arguments.instrument)
    columns = [names.index(name) for name in wanted]
    data = np.loadtxt(arguments.record, delimiter=",", skiprows=1, usecols=columns, unpack=True)
    if arguments.differenced:
        data = np.diff(data)
    read_s = time.process_time() - start

    with open(arguments.response, encoding="utf-8") as file:
        ours = json.load(file)
    h = ours["sample_time_s"]
    samples = round(ours["window_s"] / h)
    how = {"fs": 1 / h, "window": "hann", "nperseg": samples, "noverlap": samples // 2}

    start = time.process_time()
    u, y, r = data[0], data[1], data[-1] if arguments.instrument else data[0]
    frequency, with_output = signal.csd(r, y, **how)
    response = with_output / signal.csd(r, u, **how)[1]
    coherence = signal.coherence(u, y, **how)[1]
    estimate_s = time.process_time() - start

    one = ours["responses"][0]
    there = np.array([value is not None for value in one["real"]])
    found = np.array([complex(re or 0.0, im or 0.0) for re, im in zip(one["real"], one["imag"])])
    lines = slice(1, 1 + len(found))
    known = response[lines]
    result = {
        "scipy": scipy.__version__,
        "windows": (len(u) - samples) // (samples // 2) + 1,
        "windows_of_servotwin": ours["windows"],
        "frequencies": int(there.sum()),
        "frequency_hz": float(np.max(np.abs(frequency[lines] - ours["frequency_hz"]))),
        "response": float(np.max((np.abs(found - known) / np.abs(known))[there])),
        "read_cpu_s": read_s,
        "estimate_cpu_s": estimate_s,
    }
    if not arguments.instrument:
        gamma2 = np.array([value or 0.0 for value in one["coherence"]])
        result["coherence"] = float(np.max(np.abs(gamma2 - coherence[lines])[there]))
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()

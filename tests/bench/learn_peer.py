#!/usr/bin/python3
"""Learning as one would write it in SciPy: the peer of ilc/learn.h and ilc/norm_optimal.h.

    learn_peer.py PATH.csv BANDWIDTH_HZ

The same two drives and commands as bench_learn.cpp: per trial the loop by exact steps with the
Maxwell elements solved in them sample by sample, then u <- Q (u + e / T) by numpy's FFT. And one
step of the norm-optimal law over all samples of the first axis: conjugate gradients of SciPy on a
LinearOperator, products by FFT. Prints one JSON object; runs on one thread.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"  # before numpy is loaded

import json
import sys
import time

import numpy as np
from scipy import fft, interpolate, linalg, optimize, signal
from scipy.sparse import linalg as sparse

STEP_S = 1e-3
TRIALS = 10
WEIGHT = 1e-2  # also in bench_learn.cpp
BREAKAWAY, TRAVEL, SHAPE, ELEMENTS = 0.286, 20e-6, 0.7, 10


def loop_of(slower):
    real, omega, zeta = 2 * np.pi * 9.87 * slower, 2 * np.pi * 31.31 * slower, 0.44
    a = np.polymul((1.0, real), (1.0, 2 * zeta * omega, omega**2))
    return a, np.array((1.0, a[1], a[3] / (75.0 * slower)))


def elements():
    """Stiffness and level of the Maxwell elements on the quartic virgin curve."""
    length = 8.0 * SHAPE - 3.0
    t = np.arange(ELEMENTS + 1) / ELEMENTS

    def x(s):
        return s**2 * (
            (3 + length - 8 * SHAPE)
            + (16 * SHAPE - 3 * length - 2) * s
            + (2 * length - 8 * SHAPE) * s**2
        )

    place, force = x(t), 1.0 - x(1.0 - t)
    slope = np.append(np.diff(force) / np.diff(place), 0.0)
    stiffness = slope[:-1] - slope[1:]
    return stiffness / TRAVEL, stiffness * place[1:]


def held(a, order):
    """Exact steps of 1/P whose input is a polynomial of this order within a step."""
    n = 3 + order + 1
    m = np.zeros((n, n))
    m[0, 1] = m[1, 2] = 1.0
    m[2, :3] = -a[:0:-1]
    m[2, 3] = 1.0
    for k in range(order):
        m[3 + k, 4 + k] = 1.0
    e = linalg.expm(m * STEP_S)
    return e[:3, :3], e[:3, 3:]


class Drive:
    def __init__(self, slower):
        self.a, self.c = loop_of(slower)
        self.phi, self.g = held(self.a, 2)
        _, force = held(self.a, 1)
        self.end = force[:, 1] / STEP_S
        self.begin = force[:, 0] - self.end
        self.stiffness, self.level = elements()

    def error(self, command):
        """Tracking error against this command, from rest."""
        spline = interpolate.CubicSpline(
            STEP_S * np.arange(len(command)), command, bc_type="clamped"
        )
        grid = spline.x
        inputs = np.stack([spline(grid, d) for d in (1, 2, 3)])
        y, z, f, force, position = np.zeros(3), np.zeros(3), np.zeros(ELEMENTS), 0.0, command[0]
        out = np.zeros(len(command))
        for k in range(1, len(command)):
            y = self.phi @ y + self.g @ inputs[:, k - 1]
            z = self.phi @ z + self.begin * force
            error = self.c[::-1] @ y
            free = command[k] - error - z[1]

            def slipped(trial):
                way = free - self.end[1] * trial - position
                return np.clip(f + self.stiffness * way, -self.level, self.level)

            def miss(trial):
                return trial - BREAKAWAY * slipped(trial).sum()

            if miss(force) != 0.0:
                force = optimize.brentq(miss, -1.01 * BREAKAWAY, 1.01 * BREAKAWAY, xtol=1e-15)
            f = slipped(force)
            z = z + self.end * force
            position = free - self.end[1] * force
            out[k] = error + z[1]
        return out


def learned(drive, command, bandwidth_hz):
    n = len(command)
    padded = 1 << int(np.ceil(np.log2(2 * n)))
    s = 2j * np.pi * fft.rfftfreq(padded, STEP_S)
    transfer = 1.0 - s * np.polyval(drive.c, s) / np.polyval(drive.a, s)
    q = 1.0 / (1.0 + (np.abs(s) / (2 * np.pi * bandwidth_hz)) ** 4)

    def filtered(x, response):
        before = (padded - n) // 2
        wide = np.pad(x, (before, padded - n - before), mode="edge")
        return fft.irfft(fft.rfft(wide) * response, padded)[before : before + n]

    u, rms = np.zeros(n), []
    for _ in range(TRIALS + 1):
        error = drive.error(command + u) - u
        rms.append(1e6 * np.sqrt(np.mean(error**2)))
        u = filtered(u, q) + filtered(error, q / transfer)
    return rms


def norm_optimal(drive, error):
    n = len(error)
    # The command of one sample alone, straight lines between samples.
    system = signal.tf2ss(np.polysub(drive.a, np.append(drive.c, 0.0)), drive.a)
    b, a = signal.ss2tf(*signal.cont2discrete(system, STEP_S, "foh")[:4])
    impulse = signal.lfilter(b[0], a, np.eye(1, n)[0])
    size = fft.next_fast_len(2 * n, real=True)
    spectrum = fft.rfft(impulse, size)

    def times(x, response):
        return fft.irfft(fft.rfft(x, size) * response, size)[:n]

    def system_of(x):
        return times(times(x, spectrum), spectrum.conj()) + WEIGHT * x

    begin = time.process_time()
    u, _ = sparse.cg(
        sparse.LinearOperator((n, n), system_of), times(error, spectrum.conj()), tol=1e-10
    )
    seconds = time.process_time() - begin
    cost = np.sum((error - times(u, spectrum)) ** 2) + WEIGHT * np.sum(u**2)
    return seconds, cost


def main():
    commands = np.loadtxt(sys.argv[1], delimiter=",").T
    drives = [Drive(1.0), Drive(0.9)]
    begin = time.process_time()
    rms = [learned(d, c, float(sys.argv[2])) for d, c in zip(drives, commands)]
    learning_s = time.process_time() - begin
    lifted_s, cost = norm_optimal(drives[0], drives[0].error(commands[0]))
    print(
        json.dumps(
            {
                "learning_s": learning_s,
                "rms_um": [r[0] for r in rms],
                "best_um": [min(r) for r in rms],
                "lifted_s": lifted_s,
                "lifted_cost": cost,
            }
        )
    )


main()

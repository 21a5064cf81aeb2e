#!/usr/bin/python3
"""The pole search as one would write it in SciPy: the peer of identification/loop/pole_search.h.

    pole_search_peer.py RECORD.csv [--tolerance T] [--at REAL_HZ OMEGA_HZ ZETA]

The same problem on the same samples: min over three poles of |e - R theta|, theta by least squares,

    e ~ c0 s^3/P x_r + c1 s^2/P x_r + c2 s/P x_r + d s/P sat(v / v_lim),    d >= 0,

within the box of thesis table 3.8, by differential evolution over the logarithms of the poles.
SciPy's own tolerance, 0.01, stops before the optimum; 1e-8 finds it to six digits. The filters are
the first-order hold of cont2discrete, run by lfilter: the command's velocity is that of its cubic
spline, linear within a sample, where ours is the spline itself. --at gives this objective at other
poles too, so that two optima are compared by one measure. Prints one JSON object; runs on one
thread.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"  # before numpy is loaded

import argparse
import json
import time

import numpy as np
import scipy
from scipy import interpolate, ndimage, optimize, signal

SAMPLE_TIME_S = 1e-3
VELOCITY_LIMIT = 1e-3  # [m/s], also in bench_identification.cpp
NYQUIST_HZ = 0.5 / SAMPLE_TIME_S
BOUNDS = [(1.0, min(833.0, NYQUIST_HZ)), (1.0, 210.0), (0.2, 2.0)]  # real [Hz], omega [Hz], zeta
SEED = 1


class Objective:
    """RMS of e - R theta [um] over log(real, omega, zeta)."""

    def __init__(self, command, actual):
        grid = SAMPLE_TIME_S * np.arange(len(command))
        self.error = command - actual
        self.command_velocity = interpolate.CubicSpline(grid, command, bc_type="clamped")(grid, 1)
        velocity = ndimage.uniform_filter1d(np.gradient(actual, SAMPLE_TIME_S), 11, mode="nearest")
        self.friction = np.clip(velocity / VELOCITY_LIMIT, -1.0, 1.0)
        self.evaluations = 0

    def __call__(self, log_poles):
        self.evaluations += 1
        real, omega, zeta = np.exp(log_poles) * (2 * np.pi, 2 * np.pi, 1.0)
        denominator = np.polymul((1.0, real), (1.0, 2 * zeta * omega, omega**2))
        # 1/P, s/P and s^2/P are the three states of one system.
        companion = signal.tf2ss((1.0, 0.0, 0.0), denominator)
        system = (companion[0], companion[1], np.eye(3), np.zeros((3, 1)))
        numerators, poles = signal.ss2tf(*signal.cont2discrete(system, SAMPLE_TIME_S, "foh")[:4])
        columns = [signal.lfilter(b, poles, self.command_velocity) for b in numerators]
        columns.append(signal.lfilter(numerators[1], poles, self.friction))
        regressors = np.column_stack(columns)
        scale = 1.0 / np.linalg.norm(regressors, axis=0)
        theta, *_ = np.linalg.lstsq(regressors * scale, self.error, rcond=None)
        rms = 1e6 * np.sqrt(np.mean((self.error - regressors @ (theta * scale)) ** 2))
        # A candidate that needs negative friction is no candidate.
        return rms if theta[3] >= 0.0 else 1e3 * rms


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("record")
    parser.add_argument("--at", nargs=3, type=float, metavar=("REAL_HZ", "OMEGA_HZ", "ZETA"))
    parser.add_argument("--tolerance", type=float, default=0.01)
    arguments = parser.parse_args()

    command, actual = np.loadtxt(arguments.record, delimiter=",", skiprows=1, unpack=True)
    start_cpu, start = time.process_time(), time.perf_counter()
    objective = Objective(command, actual)
    found = optimize.differential_evolution(
        objective, np.log(BOUNDS), seed=SEED, tol=arguments.tolerance
    )
    result = {
        "scipy": scipy.__version__,
        "cpu_s": time.process_time() - start_cpu,
        "wall_s": time.perf_counter() - start,
        "evaluations": objective.evaluations,
        "rms_um": found.fun,
        "poles": list(np.exp(found.x)),
    }
    if arguments.at:
        result["rms_at_um"] = objective(np.log(arguments.at))
    print(json.dumps(result))


if __name__ == "__main__":
    main()

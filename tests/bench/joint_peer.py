#!/usr/bin/python3
"""The joint identification as one would write it in SciPy: the peer of identification/loop/joint.h.

    joint_peer.py RECORD.csv

The same problem on the same samples, the first half of them fast motion, the second half slow
reversals: poles, breakaway displacement and shape factor are searched, what is linear is projected
out,

    e ~ c0 s^3/P x_r + c1 s^2/P x_r + c2 s/P x_r + F s/P phi(x; x_br, shape) + free response

1. On the fast half the poles, with Coulomb friction in place of phi, by differential evolution with
   SciPy's own tolerance.
2. On the slow half phi on a grid, with these poles.
3. All five on all samples by least_squares, from the best of the grid for every displacement.

phi is the reduced GMS with ten elements along the measured position: its recursion over the samples
is a loop, over the elements and the points of the grid an array. The filters are those of
pole_search_peer.py. Prints one JSON object; runs on one thread.
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
VELOCITY_LIMIT = 1e-3  # [m/s]
NYQUIST_HZ = 0.5 / SAMPLE_TIME_S
BOUNDS = [(1.0, min(833.0, NYQUIST_HZ)), (1.0, 210.0), (0.2, 2.0)]  # real [Hz], omega [Hz], zeta
ELEMENTS = 10
SHAPE_BOUNDS = (0.02, 0.938)
DISPLACEMENT_BOUNDS = (2e-7, 2e-3)  # [m]
GRID_DISPLACEMENTS = (3e-6, 10e-6, 30e-6, 100e-6)  # [m]
GRID_SHAPES = (0.2, 0.5, 0.8)
SEED = 1


def spline_length(shape):
    """S of the quartic virgin curve, concave for every shape factor."""
    if shape <= 0.3875:
        return min(0.1, 8.0 * shape)
    if shape <= 0.875:
        return 8.0 * shape - 3.0
    return 4.0 + 14.19 * (shape - 0.875)


def elements(displacement, shape):
    """Stiffness and level of the elements of one unit of breakaway force."""
    s = spline_length(shape)

    def x(tau):
        linear, square = 16.0 * shape - 3.0 * s - 2.0, 2.0 * s - 8.0 * shape
        return tau**2 * ((3.0 + s - 8.0 * shape) + linear * tau + square * tau**2)

    tau = np.linspace(0.0, 1.0, ELEMENTS + 1)
    node, force = x(tau), 1.0 - x(1.0 - tau)
    slope = np.append(np.diff(force) / np.diff(node), 0.0)
    stiffness = slope[:-1] - slope[1:]
    return stiffness / displacement, stiffness * node[1:]


def friction(position, points):
    """phi along a position, one column for every (displacement, shape)."""
    pairs = [elements(*point) for point in points]
    stiffness = np.concatenate([pair[0] for pair in pairs])
    level = np.concatenate([pair[1] for pair in pairs])
    state, lowest = np.zeros_like(level), -level
    out = np.empty((len(position), len(points)))
    travel = np.diff(position, prepend=position[0])
    for k, dx in enumerate(travel):
        state += stiffness * dx
        np.minimum(state, level, out=state)
        np.maximum(state, lowest, out=state)
        out[k] = state.reshape(len(points), ELEMENTS).sum(axis=1)
    return out


def denominator_of(real_hz, omega_hz, zeta):
    real, omega = 2 * np.pi * real_hz, 2 * np.pi * omega_hz
    return np.polymul((1.0, real), (1.0, 2 * zeta * omega, omega**2))


def poles_of(denominator):
    """Real pole and pair in Hz; of three real poles the fastest is the real one."""
    roots = np.roots(denominator)
    is_real = np.abs(roots.imag) < 1e-9 * np.abs(roots)
    real = roots[is_real][np.argmax(np.abs(roots[is_real]))]
    a, b = np.delete(roots, np.argmin(np.abs(roots - real)))
    omega = np.sqrt((a * b).real)
    return [-real.real / (2 * np.pi), omega / (2 * np.pi), -(a + b).real / (2 * omega)]


class Data:
    """Regressors of a record, and the error they leave."""

    def __init__(self, command, actual):
        grid = SAMPLE_TIME_S * np.arange(len(command))
        self.actual = actual
        self.error = command - actual
        self.command_velocity = interpolate.CubicSpline(grid, command, bc_type="clamped")(grid, 1)
        velocity = ndimage.uniform_filter1d(np.gradient(actual, SAMPLE_TIME_S), 11, mode="nearest")
        self.coulomb = np.clip(velocity / VELOCITY_LIMIT, -1.0, 1.0)
        self.impulses = np.eye(3, len(command))
        self.evaluations = 0

    def residual(self, denominator, force):
        """What is left, and the linear parameters."""
        self.evaluations += 1
        # 1/P, s/P and s^2/P are the three states of one system.
        companion = signal.tf2ss((1.0, 0.0, 0.0), denominator)
        system = (companion[0], companion[1], np.eye(3), np.zeros((3, 1)))
        numerators, poles = signal.ss2tf(*signal.cont2discrete(system, SAMPLE_TIME_S, "foh")[:4])
        columns = [signal.lfilter(b, poles, self.command_velocity) for b in numerators]
        columns.append(signal.lfilter(numerators[1], poles, force))
        columns.extend(signal.lfilter([1.0], poles, impulse) for impulse in self.impulses)
        regressors = np.column_stack(columns)
        scale = 1.0 / np.linalg.norm(regressors, axis=0)
        theta, *_ = np.linalg.lstsq(regressors * scale, self.error, rcond=None)
        theta *= scale
        return self.error - regressors @ theta, theta


def rms_um(residual):
    return 1e6 * np.sqrt(np.mean(residual**2))


def pole_search(data):
    def objective(log_poles):
        residual, theta = data.residual(denominator_of(*np.exp(log_poles)), data.coulomb)
        # A candidate that needs negative friction is no candidate.
        return rms_um(residual) * (1.0 if theta[3] >= 0.0 else 1e3)

    found = optimize.differential_evolution(objective, np.log(BOUNDS), seed=SEED)
    return denominator_of(*np.exp(found.x))


def friction_starts(data, denominator):
    """The best shape factor for every displacement of the grid."""
    points = [(d, s) for d in GRID_DISPLACEMENTS for s in GRID_SHAPES]
    forces = friction(data.actual, points)
    left = [rms_um(data.residual(denominator, force)[0]) for force in forces.T]
    return [
        min((rms, point) for rms, point in zip(left, points) if point[0] == displacement)[1]
        for displacement in GRID_DISPLACEMENTS
    ]


def refine(data, denominator, point):
    last = {}  # a step of the poles leaves the friction as it is

    def residual(q):
        at = (np.exp(q[3]), q[4])
        if last.get("at") != at:
            last.update(at=at, force=friction(data.actual, [at])[:, 0])
        return 1e6 * data.residual(np.append(1.0, np.exp(q[:3])), last["force"])[0]

    start = [*np.log(denominator[1:]), np.log(point[0]), point[1]]
    low = [-np.inf] * 3 + [np.log(DISPLACEMENT_BOUNDS[0]), SHAPE_BOUNDS[0]]
    high = [np.inf] * 3 + [np.log(DISPLACEMENT_BOUNDS[1]), SHAPE_BOUNDS[1]]
    return optimize.least_squares(residual, start, bounds=(low, high), x_scale="jac")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("record")
    arguments = parser.parse_args()

    command, actual = np.loadtxt(arguments.record, delimiter=",", skiprows=1, unpack=True)
    half = len(command) // 2
    clock = [time.process_time()]
    fast, slow = Data(command[:half], actual[:half]), Data(command[half:], actual[half:])
    whole = Data(command, actual)
    rough = pole_search(fast)
    clock.append(time.process_time())
    starts = friction_starts(slow, rough)
    clock.append(time.process_time())
    found = min((refine(whole, rough, start) for start in starts), key=lambda fit: fit.cost)
    clock.append(time.process_time())

    denominator = np.append(1.0, np.exp(found.x[:3]))
    displacement, shape = np.exp(found.x[3]), found.x[4]
    force = friction(actual, [(displacement, shape)])[:, 0]
    residual, theta = whole.residual(denominator, force)
    result = {
        "scipy": scipy.__version__,
        "cpu_s": clock[3] - clock[0],
        "step_cpu_s": list(np.diff(clock)),
        "evaluations": fast.evaluations + slow.evaluations + whole.evaluations,
        "rms_um": rms_um(residual),
        "step_1_poles": poles_of(rough),
        "poles": poles_of(denominator),
        "breakaway_mm_s2": 1e3 * theta[3],
        "breakaway_um": 1e6 * displacement,
        "shape_factor": shape,
    }
    print(json.dumps(result))


if __name__ == "__main__":
    main()

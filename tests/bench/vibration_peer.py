#!/usr/bin/python3
"""A vibrating axis by standard means and by servotwin, on the same recordings, in one run.

    vibration_peer.py BUILD

The recordings are those of vibration_study. Standard: a subspace estimate (MOESP, Verhaegen and
Dewilde 1992, what n4sid does at its heart) from command velocity to tracking error, orders 2 to 16,
and the same with the sign of the measured velocity as a second input, which is Coulomb friction.
The order is chosen on the last third of the training data; all are judged by free simulation of the
last 40 % from the state that their first 0.25 s tell. For the second input free simulation is
spared: it is given the sign of the velocity that was measured there.

Two axes that push each other: the same from both commands, and both frictions, to both errors, A of
both outputs together, B and D of each; beside it `servotwin multivariable`.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"  # before numpy is loaded

import argparse
import json
import subprocess
import tempfile
import time

import numpy as np
from scipy import linalg, ndimage

STEP_S = 1e-3
ROWS = 30  # of the block Hankel matrices
START = 250  # samples that tell the state


def hankel(signal, rows):
    columns = len(signal) - rows + 1
    return np.vstack([signal[i : i + columns].T for i in range(rows)])


def moesp(u, y, orders):
    """A and C of the given orders, from the row space of y that u does not explain."""
    y = y / np.std(y, axis=0)
    r = linalg.qr(np.vstack([hankel(u, ROWS), hankel(y, ROWS)]).T, mode="r")[0].T
    m, p = ROWS * u.shape[1], y.shape[1]
    left, _, _ = linalg.svd(r[m : m + p * ROWS, m : m + p * ROWS])
    out = {}
    for n in orders:
        observability = left[:, :n]
        a = linalg.lstsq(observability[:-p], observability[p:])[0]
        out[n] = (a, observability[:p])
    return out


def responses(a, c, u):
    """Columns of y = C x, linear in B, D and the first state."""
    n, samples = len(a), len(u)
    columns = []
    # In modal coordinates every state is one recursion.
    poles, vectors = np.linalg.eig(a)
    seen = c @ vectors
    for k in range(n):
        one = seen[k] * poles[k] ** np.arange(samples)
        columns.append(one)
        for i in range(u.shape[1]):
            driven = np.concatenate([[0], np.convolve(u[:, i], one)[: samples - 1]])
            columns.append(driven)
    real = [f(x) for x in columns for f in (np.real, np.imag)]
    real += [u[:, i] for i in range(u.shape[1])]
    return np.array(real).T


def fit(a, c, u, y):
    """B and D on these samples; returns a function that predicts others from their own start."""
    n, inputs = len(a), u.shape[1]
    columns = responses(a, c, u)
    scale = np.linalg.norm(columns, axis=0) + 1e-300
    theta = linalg.lstsq(columns / scale, y, cond=1e-10)[0] / scale
    state = np.array([2 * (1 + inputs) * k + j for k in range(n) for j in (0, 1)])

    def predict(u, y):
        columns = responses(a, c, u)
        rest = np.setdiff1d(np.arange(columns.shape[1]), state)
        forced = columns[:, rest] @ theta[rest]
        free = columns[:, state]
        start = linalg.lstsq(free[:START], (y - forced)[:START], cond=1e-10)[0]
        return forced + free @ start

    return predict


def rms(x):
    return float(np.sqrt(np.mean(x[START:] ** 2)))


def modes_of(a):
    """Frequency and damping ratio of the pairs that are neither the loop's nor beyond 200 Hz."""
    poles = np.log(np.linalg.eigvals(a).astype(complex)) / STEP_S
    pairs = [(abs(p) / 2 / np.pi, -p.real / abs(p)) for p in poles if p.imag > 1.0]
    return sorted((hz, zeta) for hz, zeta in pairs if zeta < 0.5 and hz < 200.0)


def text_of(modes):
    return "".join(f"  {hz:7.3f} Hz {zeta:.4f}" for hz, zeta in modes)


def standard(u, e, training):
    start = time.process_time()
    fitted = training * 2 // 3
    tried = {}
    for n, (a, c) in moesp(u[:fitted], e[:fitted], range(2, 17)).items():
        if max(abs(np.linalg.eigvals(a))) < 1.0:
            left = []
            for row, error in zip(c, e.T):
                predict = fit(a, row, u[:fitted], error[:fitted])
                unseen = error[fitted:training]
                left.append(rms(unseen - predict(u[fitted:training], unseen)) / rms(unseen))
            tried[n] = np.prod(left)
    n = min(tried, key=tried.get)
    a, c = moesp(u[:training], e[:training], [n])[n]
    predicts = [fit(a, row, u[:training], error[:training]) for row, error in zip(c, e.T)]
    seconds = time.process_time() - start
    left = [
        rms(error[training:] - predict(u[training:], error[training:]))
        for predict, error in zip(predicts, e.T)
    ]
    return n, modes_of(a), left, seconds


def smooth_sign(actual):
    moving = ndimage.uniform_filter1d(np.gradient(actual, STEP_S, axis=0), 11, axis=0)
    return np.tanh(moving / 1e-3)


def run_tool(arguments):
    """Seconds of a processor."""
    before = os.times()
    subprocess.run(arguments, check=True, capture_output=True)
    return os.times().children_user - before.children_user


def coupled(build, folder):
    for name in ("coupled_linear", "coupled"):
        path = f"{folder}/{name}.csv"
        data = np.loadtxt(path, delimiter=",", skiprows=1)
        command, actual = data[:, [1, 3]], data[:, [2, 4]]
        velocity = np.gradient(command, STEP_S, axis=0)
        e = command - actual
        training = int(len(e) * 0.7)
        print(name)

        def say(label, left, seconds, order, modes):
            print(
                f"  {label:26s} held out X {1e6 * left[0]:8.4f} Y {1e6 * left[1]:8.4f} um RMS"
                f"  {seconds:6.2f} s  order {order:2d}{text_of(modes)}"
            )

        for label, u in (
            ("subspace", velocity),
            ("subspace, friction given", np.hstack([velocity, smooth_sign(actual)])),
        ):
            n, modes, left, seconds = standard(u, e, training)
            say(label, left, seconds, n, modes)
        commands, friction = "X.command,Y.command", ",X.friction,Y.friction"
        for label, options in (
            ("servotwin, commands", ["--input", commands]),
            ("servotwin, signs", ["--input", commands + friction, "--break-distance", "0.1"]),
            ("servotwin, Maxwell slip", ["--input", commands + friction]),
        ):
            seconds = run_tool(
                [f"{build}/servotwin", "multivariable", path, "--json", f"{folder}/found.json"]
                + options
            )
            with open(f"{folder}/found.json", encoding="utf-8") as file:
                found = json.load(file)
            modes = [
                (p["frequency_hz"], p["damping"])
                for p in found["poles"]
                if p.get("damping", 1.0) < 0.5 and p["frequency_hz"] < 200.0
            ]
            left = [one["holdout_rms"] for one in found["outputs"]]
            say(label, left, seconds, found["order"], modes)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("build")
    build = parser.parse_args().build
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([f"{build}/vibration_study", "--write", folder], check=True)
        coupled(build, folder)
        joint = ["--method", "joint"]
        for name, rigid, flexible in (
            ("Coulomb_p", joint, joint + ["--modes", "2"]),
            ("GMS_p", joint, joint + ["--modes", "2"]),
            ("five_masses", ["--order", "2"], ["--order", "2", "--modes", "6"]),
        ):
            path = f"{folder}/{name}.csv"
            data = np.loadtxt(path, delimiter=",", skiprows=1)
            command, actual = data[:, 1], data[:, 2]
            velocity = np.gradient(command, STEP_S)[:, None]
            friction = smooth_sign(actual)[:, None]
            e = (command - actual)[:, None]
            training = len(e) * 6 // 10
            print(name)
            for label, u in (
                ("subspace", velocity),
                ("subspace, friction given", np.hstack([velocity, friction])),
            ):
                n, modes, left, seconds = standard(u, e, training)
                print(
                    f"  {label:26s} held out {1e6 * left[0]:9.4f} um RMS  {seconds:6.2f} s"
                    f"  order {n:2d}{text_of(modes)}"
                )
            for label, options in (
                ("servotwin, rigid", rigid),
                ("servotwin, with modes", flexible),
            ):
                seconds = run_tool(
                    [f"{build}/servotwin", "identify", path, "--axis", "X", "--method", "pole-search"]
                    + ["--json", f"{folder}/found.json"]
                    + options
                )
                with open(f"{folder}/found.json", encoding="utf-8") as file:
                    found = json.load(file)
                modes = found["loop"].get("modes", [])
                text = text_of(
                    sorted((m["natural_frequency_hz"], m["damping_ratio"]) for m in modes)
                )
                left = found["fit"]["holdout"]["rms_m"]
                print(f"  {label:26s} held out {1e6 * left:9.4f} um RMS  {seconds:6.2f} s{text}")


if __name__ == "__main__":
    main()

#!/usr/bin/python3
"""The rig of paper 002 as other code sees it: recordings and a frequency response to fit.

    tests/bench/feed_axis_peer.py FOLDER

Writes bare.csv, covered.csv (command, motor encoder, torque at 1 kHz) and response.csv (closed
velocity loop) of an axis whose coupling, nut and bearing are not what the data sheet says. 48
elements, friction integrated with the motion eight times per control cycle, noise of 0.01 Nm on
the torque and of 2 % on the response. SciPy; no code of the twin.
"""

import pathlib
import sys

import numpy as np
from scipy.linalg import expm

RATE, SUBSTEPS, ELEMENTS = 16000.0, 8, 48
LEAD, LENGTH, END, D, D_END = 0.032, 0.850, 0.112, 0.032, 0.025
RHO, E, G = 7850.0, 2.1e11, 8.1e10
R = LEAD / (2 * np.pi)
# As built: what the fit is to find.
K_COUPLING, K_BEARING, K_NUT = 14000.0, 1.9e9, 2.4e8
C_COUPLING, C_BEARING, C_NUT = 0.50, 3.8e4, 9e3
TABLE, ROTOR, COUPLING = 106.0, 593e-6, 114e-6
KP, KV, TN, LAG_HZ = 60.0, 1.5747, 0.010, 1000.0
DRIVE = dict(fs=200.0, fc=163.0, vs=2.53e-3, s0=9.37e6, s1=4.45e4, s2=530.0)
COVER = dict(fs=49.6, fc=106.0, vs=5.30e-4, s0=1.92e6, s1=5.78e3, s2=86.2)
NUT_AT_ZERO, GRID = 0.220, np.arange(0.2, 0.401, 0.01)


def mechanics():
    n, l = ELEMENTS, LENGTH / ELEMENTS
    size = 2 + 2 * (n + 1) + 1
    m, c, k = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size))

    def link(i, j, stiff, damp=0.0):
        for a, b, s in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
            k[a, b] += s * stiff
            c[a, b] += s * damp

    def element(i, j, mass, stiff):
        for a, b, s in ((i, i, 1 / 3), (j, j, 1 / 3), (i, j, 1 / 6), (j, i, 1 / 6)):
            m[a, b] += s * mass
            c[a, b] += s * mass  # 1 / s
        link(i, j, stiff, 5e-6 * stiff)

    m[0, 0] += ROTOR + COUPLING / 2
    m[1, 1] += COUPLING / 2
    link(0, 1, K_COUPLING, C_COUPLING)
    polar, polar_end = np.pi * D**4 / 32, np.pi * D_END**4 / 32
    area = np.pi * D**2 / 4
    element(1, 2, RHO * polar_end * END, G * polar_end / END)
    for e in range(n):
        element(2 + e, 3 + e, RHO * polar * l, G * polar / l)
        element(3 + n + e, 4 + n + e, RHO * area * l, E * area / l)
    k[3 + n, 3 + n] += K_BEARING
    c[3 + n, 3 + n] += C_BEARING
    m[-1, -1] += TABLE
    return m, c, k


def nut_vector(size, x):
    e = min(int(x / LENGTH * ELEMENTS), ELEMENTS - 1)
    a = x / LENGTH * ELEMENTS - e
    h = np.zeros(size)
    h[-1] = 1
    for node, share in ((e, 1 - a), (e + 1, a)):
        h[2 + node] -= R * share
        h[3 + ELEMENTS + node] -= share
    return h


def continuous(x):
    m, c, k = mechanics()
    h = nut_vector(len(m), x)
    inverse = np.linalg.inv(m)
    size = len(m)
    a = np.zeros((2 * size, 2 * size))
    a[:size, size:] = np.eye(size)
    a[size:, :size] = -inverse @ (k + K_NUT * np.outer(h, h))
    a[size:, size:] = -inverse @ (c + C_NUT * np.outer(h, h))
    b = np.zeros((2 * size, 2))
    b[size:, 0] = inverse[:, 0]
    b[size:, 1] = -inverse[:, -1]
    return a, b


def held(x, step):
    a, b = continuous(x)
    size = len(a)
    both = np.zeros((size + 2, size + 2))
    both[:size, :size], both[:size, size:] = a, b
    # Positions in micrometres or so: the exponential keeps its digits.
    scale = np.r_[np.full(size // 2, 1e6), np.ones(size // 2 + 2)]
    out = expm((scale[:, None] * both / scale) * step)
    out = out / scale[:, None] * scale
    return out[:size, :size], out[:size, size:]


def motion():
    acc, rest = 10.0, 0.2
    parts = []
    for speed, travel in ((0.30, 0.10), (0.05, 0.02), (0.005, 0.002)):
        half = 0.06
        cruise = (travel - speed**2 / acc - speed * half) / speed
        ramp = speed / 2 / acc
        for sign in (1, -1):
            for seconds, level in ((ramp, acc), (half, 0), (ramp, acc), (cruise, 0), (ramp, -acc), (half, 0), (ramp, -acc), (rest, 0)):
                parts.append((seconds, sign * level))
    times = np.cumsum([0.0] + [p[0] for p in parts])
    grid = np.arange(int(times[-1] * RATE)) / RATE
    x, v, out = 0.0, 0.0, np.zeros(len(grid))
    for (seconds, level), start in zip(parts, times):
        inside = (grid >= start) & (grid < start + seconds)
        t = grid[inside] - start
        out[inside] = x + t * (v + t * level / 2)
        x, v = x + seconds * (v + seconds * level / 2), v + seconds * level
    return out


def simulate(frictions, table, random):
    command = motion()
    size = len(table[0][0])
    n = size // 2
    q = np.zeros(size)
    z = [0.0] * len(frictions)
    integral = torque = 0.0
    keep = 1 - np.exp(-2 * np.pi * LAG_HZ / RATE)
    dt = 1 / RATE / SUBSTEPS
    rows = []
    for k, wanted in enumerate(command):
        position, velocity = q[0] * R, q[n] * R
        error = (KP * (wanted - position) - velocity) / R
        integral += KV / TN * error / RATE
        torque += keep * (KV * error + integral - torque)
        if k % 16 == 0:
            rows.append((k / RATE, wanted, position, torque + 0.01 * random.standard_normal()))
        place = (NUT_AT_ZERO + q[n - 1] - GRID[0]) / (GRID[1] - GRID[0])
        i = min(int(place), len(GRID) - 2)
        w = place - i
        phi = (1 - w) * table[i][0] + w * table[i + 1][0]
        gain = (1 - w) * table[i][1] + w * table[i + 1][1]
        for _ in range(SUBSTEPS):
            v, force = q[-1], 0.0
            for j, f in enumerate(frictions):
                g = (f["fc"] + (f["fs"] - f["fc"]) * np.exp(-abs(v) / f["vs"])) / f["s0"]
                # dz/dt = v - |v| z / g, by the trapezoidal rule.
                slip = abs(v) / g * dt / 2
                new = ((1 - slip) * z[j] + v * dt) / (1 + slip)
                force += f["s0"] * (new + z[j]) / 2 + f["s1"] * (new - z[j]) / dt + f["s2"] * v
                z[j] = new
            q = phi @ q + gain @ np.array([torque, force])
    return rows


def response(nut, random):
    """Continuous, with the hold's half cycle of delay and the sampled control."""
    a, b = continuous(nut)
    n = len(a) // 2
    phi, gain = held(nut, 1 / RATE)
    keep = 1 - np.exp(-2 * np.pi * LAG_HZ / RATE)
    rows = []
    for f in np.geomspace(5, 2000, 250):
        z = np.exp(2j * np.pi * f / RATE)
        plant = R * np.linalg.solve(z * np.eye(2 * n) - phi, gain[:, 0])[n]
        control = (KV + KV / TN / RATE * z / (z - 1)) / R * keep * z / (z - 1 + keep)
        closed = control * plant / (1 + control * plant)
        closed *= 1 + 0.02 * (random.standard_normal() + 1j * random.standard_normal())
        rows.append((f, 20 * np.log10(abs(closed)), np.degrees(np.angle(closed))))
    return rows


def write(file, head, rows):
    file.write_text(head + "\n" + "".join(",".join("%.9g" % v for v in row) + "\n" for row in rows))


def main():
    if len(sys.argv) != 2:
        sys.exit("feed_axis_peer.py: usage: feed_axis_peer.py FOLDER")
    folder = pathlib.Path(sys.argv[1])
    random = np.random.default_rng(2)
    write(folder / "response.csv", "frequency[Hz],gain[dB],phase[deg]", response(0.425, random))
    table = [held(x, 1 / RATE / SUBSTEPS) for x in GRID]
    head = "time[s],X.command[m],X.actual[m],X.torque[Nm]"
    write(folder / "bare.csv", head, simulate([DRIVE], table, random))
    write(folder / "covered.csv", head, simulate([DRIVE, COVER], table, random))


main()

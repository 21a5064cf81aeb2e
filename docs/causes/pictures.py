#!/usr/bin/python3
"""Draws docs/causes/pictures/*.svg: the tracking error of one axis with and without each cause that a diagnosis can name.

    docs/causes/pictures.py            # all of them; needs python3-numpy, python3-matplotlib and build/servotwin
    docs/causes/pictures.py cogging    # or some; SERVOTWIN=... is another program

The axis is a model file that is written here; `servotwin simulate` runs it twice over the same commands, as it is and
with the effect of the cause added (twin/effects/). Three causes the model file cannot hold: the force of the cut comes with a
recording, so it is put through the equation of the loop here; lost samples are made by repeating rows of the
simulated encoder; a gap inside the loop is drawn as the one between two encoders.
"""
import csv
import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

HERE = Path(__file__).resolve().parent
SERVOTWIN = os.environ.get("SERVOTWIN", HERE.parents[1] / "build/servotwin")
STEP = 1e-3  # s, of the commands and of the model
WITHOUT, WITH, ALSO = "#5b6b7b", "#c8401c", "#1f6fb5"

# A drive with a proportional velocity loop, its velocity fed forward: a constant force F leaves the error F / a2.
OMEGA, ZETA = 2 * math.pi * 20, 0.7
A1, A2 = 2 * ZETA * OMEGA, OMEGA**2
PROPORTIONAL = {"denominator": [A1, A2], "numerator": [0.05, 0.0]}
LAGGING = {"denominator": [A1, A2], "numerator": [0.05, 4.0]}  # some of the velocity is not fed forward
# A drive with integral action: a constant force leaves no error.
REAL = 2 * math.pi * 8
INTEGRAL = {"denominator": [A1 + REAL, A2 + A1 * REAL, A2 * REAL], "numerator": [0.05, 0.0, 0.0]}
COULOMB = ("coulomb_friction", {"coulomb": 0.15, "velocity_limit": 3e-4, "viscous": 0.0})


def moves(legs, start=0.0, smooth=0.04, rest=0.3):
    """Positions [m] every STEP: trapezoids of velocity to places [mm], averaged over `smooth` [s]. A leg is
    (to [mm], speed [mm/s], acceleration [m/s^2], rest after it [s])."""
    x, parts = start * 1e-3, [np.full(int(rest / STEP), start * 1e-3)]
    for to, speed, acceleration, pause in legs:
        to, speed = to * 1e-3, speed * 1e-3
        way = abs(to - x)
        speed = min(speed, math.sqrt(way * acceleration))
        ramp, total = speed / acceleration, way / speed + speed / acceleration
        t = np.arange(0, total, STEP)
        s = np.where(t < ramp, acceleration * t**2 / 2,
                     np.where(t < total - ramp, speed * (t - ramp / 2), way - acceleration * (total - t) ** 2 / 2))
        parts += [x + math.copysign(1, to - x) * s, np.full(int(pause / STEP), to)]
        x = to
    path = np.concatenate(parts)
    count = int(smooth / STEP)
    padded = np.concatenate([np.full(count - 1, path[0]), path, np.full(count, path[-1])])
    return np.convolve(padded, np.full(count, 1 / count), "valid")


def model(axis, loop, effects):
    return {"schema": "servotwin.model/1", "axis": axis, "kind": "linear", "sample_time_s": STEP, "version": 1,
            "loop": {"order": len(loop["denominator"]), "denominator": loop["denominator"],
                     "tracking_error_numerator": loop["numerator"]},
            "effects": [{"id": id, "parameters": {name: {"value": value} for name, value in values.items()}}
                        for id, values in effects]}


def simulate(loop, effects, command, other=None):
    """The tracking error [um] of axis X, whose neighbour Y has the commands `other`."""
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        axes = {"X": command} | ({"Y": other} if other is not None else {})
        with open(folder / "path.csv", "w", newline="") as f:
            table = csv.writer(f)
            table.writerow(["time[s]"] + [f"{axis}.command[mm]" for axis in axes])
            for k in range(len(command)):
                table.writerow([f"{k * STEP:.3f}"] + [f"{1e3 * path[k]:.9f}" for path in axes.values()])
        (folder / "x.json").write_text(json.dumps(model("X", loop, effects)))
        done = subprocess.run([SERVOTWIN, "simulate", folder / "path.csv", "--model", folder / "x.json", "--out",
                               folder / "out.csv"], capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"servotwin simulate: {done.stderr}")
        with open(folder / "out.csv") as f:
            rows = list(csv.reader(line for line in f if not line.startswith("#")))
        at = {name: k for k, name in enumerate(rows[0])}
        values = np.array([[float(v) for v in row] for row in rows[1:]])
        return 1e6 * (values[:, at["X.command[m]"]] - values[:, at["X.actual[m]"]])


def thin(x, y, most=1200):
    """Of every few samples the least and the largest, in their order: a curve of fewer points that looks the same."""
    group = max(1, 2 * len(x) // most)
    keep = []
    for begin in range(0, len(x), group):
        part = y[begin:begin + group]
        keep += sorted({begin + int(np.argmin(part)), begin + int(np.argmax(part))})
    return x[keep], y[keep]


def figure(name, panels, x_label, title):
    """`panels`: of each (label of the y axis, curves, share of the height); a curve is (x, y, colour, label)."""
    plt.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "servotwin", "font.size": 11,
                         "font.family": "sans-serif", "path.simplify_threshold": 0.3})
    height = 3.2 if len(panels) == 1 else 4.0
    drawing, places = plt.subplots(len(panels), 1, figsize=(6.6, height), sharex=True, squeeze=False,
                                   height_ratios=[panel[2] for panel in panels])
    for place, (label, curves, _) in zip(places[:, 0], panels):
        for x, y, colour, name_of in curves:
            place.plot(*thin(np.asarray(x), np.asarray(y)), color=colour, linewidth=1.4, label=name_of)
        place.set_ylabel(label)
        place.spines[["top", "right"]].set_visible(False)
        place.grid(color="#e4e4e4", linewidth=0.7)
        place.set_axisbelow(True)
        place.margins(x=0.01)
    last = places[-1, 0]
    last.set_xlabel(x_label)
    low, high = last.get_ylim()
    last.set_ylim(low, high + 0.22 * (high - low))  # room for the legend
    last.legend(loc="upper right", frameon=False, ncols=3, handlelength=1.4, columnspacing=1.2, borderaxespad=0.1)
    drawing.suptitle(title, fontsize=11, x=0.015, ha="left")
    if any(curve[3] for curve in panels[0][1]) and len(panels) > 1:
        places[0, 0].legend(loc="upper right", frameon=False, fontsize=9, handlelength=1.4, borderaxespad=0.1)
    for _ in range(2):  # the first pass may change the ticks and so the room that they take
        drawing.tight_layout(pad=0.6)
        drawing.canvas.draw()
    out = HERE / "pictures" / f"{name}.svg"
    drawing.savefig(out, metadata={"Date": None, "Creator": None})
    plt.close(drawing)
    print(f"{out}: {out.stat().st_size / 1000:.0f} kB")


def over_time(name, title, command, loop, base, effects, show=None, context="velocity", other=None, change=None):
    """Both errors over time, below what the command does. `change` makes the error with the cause out of the simulated one."""
    without = simulate(loop, base, command, other)
    with_it = simulate(loop, effects, command, other) if change is None else change(without)
    t = STEP * np.arange(len(command))
    shown = slice(*(int(s / STEP) for s in show)) if show else slice(None)
    what = {"velocity": ("velocity\n[mm/s]", 1e3 * np.gradient(command, STEP)), "position": ("position\n[mm]", 1e3 * command)}
    if other is not None:
        what["velocity"] = ("velocity\n[mm/s]", None)
    label, line = what[context]
    above = [(t[shown], line[shown], "#444444", None)] if line is not None else []
    if other is not None:
        above = [(t[shown], 1e3 * np.gradient(command, STEP)[shown], "#444444", "this axis"),
                 (t[shown], 1e3 * np.gradient(other, STEP)[shown], ALSO, "the other axis")]
    figure(name, [("command:\n" + label, above, 1),
                  ("tracking error [µm]", [(t[shown], with_it[shown], WITH, "with"), (t[shown], without[shown], WITHOUT, "without")], 2.6)],
           "time [s]", title)


def over_position(name, title, speeds, loop, base, effects, span, there_and_back=False, begin=30):
    """Errors over the position, on the way there at each speed, or there and back at one."""
    curves = []
    for speed, colour in zip(speeds, (WITH, ALSO)):
        command = moves([(span[1] + begin, speed, 2.0, 0.3), (span[0] - begin, speed, 2.0, 0.3)], start=span[0] - begin)
        x, v = 1e3 * command, np.gradient(command, STEP)
        inside = (x > span[0]) & (x < span[1])
        error = simulate(loop, effects, command)
        ways = [("forwards", v > 0, WITH), ("backwards", v < 0, ALSO)] if there_and_back else [(f"{speed:g} mm/s", v > 0, colour)]
        for words, way, colour_of in ways:
            curves.append((x[inside & way], error[inside & way], colour_of, f"with, {words}"))
        if speed == speeds[0]:
            plain = simulate(loop, base, command)
            for k, way in enumerate((v > 0, v < 0) if there_and_back else (v > 0,)):
                curves.append((x[inside & way], plain[inside & way], WITHOUT, "without" if k == 0 else None))
    figure(name, [("tracking error [µm]", curves, 1)], "position [mm]", title)


def through_loop(force):
    """The error [um] that a force per moved mass [m/s^2] makes in PROPORTIONAL: e'' + a1 e' + a2 e = force."""
    e = rate = 0.0
    out = []
    fine = 10
    for value in force:
        for _ in range(fine):
            rate += STEP / fine * (value - A1 * rate - A2 * e)
            e += STEP / fine * rate
        out.append(1e6 * e)
    return np.array(out)


def cutting(error):
    t = STEP * np.arange(len(error))
    in_cut = ((t > 0.9) & (t < 1.9)) | ((t > 3.5) & (t < 4.5))
    return error + through_loop(in_cut * (0.2 + 0.1 * np.sin(2 * math.pi * 32 * t)))


def repeated(command):
    """Two rows in a row lost, three times: the recorder repeats the encoder's last value."""
    def change(error):
        actual = command - 1e-6 * error
        for at in (0.62, 0.95, 1.9):
            k = int(at / STEP)
            actual[k:k + 2] = actual[k - 1]
        return 1e6 * (command - actual)
    return change


def cycle(times, way=60, speed=100, acceleration=1.5, rest=0.3):
    return moves([leg for _ in range(times) for leg in ((way, speed, acceleration, rest), (0, speed, acceleration, rest))])


def waves(way, seconds, count):
    t = np.arange(0, seconds * count, STEP)
    path = way * 1e-3 * (1 - np.cos(2 * math.pi * t / seconds)) / 2
    return np.concatenate([np.zeros(300), path, np.zeros(300)])


STAIRS = [leg for v in (2, 8, 40) for leg in ((1.2 * v, v, 1.0, 0.15), (0, v, 1.0, 0.15))]
SLOW = waves(1.0, 1.0, 3)
PULSE = cycle(3)


def with_effect(id, **values):
    return [COULOMB, (id, values)]


def presliding():
    over_time("presliding", "Slow reversals: friction builds up over 60 µm of travel, not immediately", SLOW, PROPORTIONAL,
              [COULOMB], [("presliding", {"breakaway": 0.15, "breakaway_displacement": 6e-5, "shape_factor": 0.3, "viscous": 0.0})],
              (0.2, 2.4), "position")


def cross_coupling():
    this = moves([(60, 60, 1.5, 2.0)], rest=0.3)
    other = moves([(40, 150, 2.5, 0.6), (0, 150, 2.5, 0.6)], rest=1.0)
    count = max(len(this), len(other))
    this, other = (np.pad(path, (0, count - len(path)), mode="edge") for path in (this, other))
    over_time("cross_coupling", "The other axis accelerates: a force on this one, in motion and at rest", this, PROPORTIONAL, [COULOMB],
              with_effect("cross_coupling", other_frequency_hz=25, other_damping=0.8, ratio=0.06, lead=0.0, direct=0.0), None, other=other)


def dwell_stiction():
    legs = [(10, 20, 0.5, 0.3), (0, 20, 0.5, 4.0), (10, 20, 0.5, 0.3), (0, 20, 0.5, 1.0), (10, 20, 0.5, 0.3)]
    over_time("dwell_stiction", "The longer the rest, the larger the peak when the axis breaks away", moves(legs), PROPORTIONAL, [COULOMB],
              with_effect("dwell_stiction", length=4e-4, rest_time=0.02, growth=0.06))


def cutting_force():
    over_time("cutting_force", "In the cut: a mean force and one at the tooth-passing frequency", moves(
        [(60, 30, 1.0, 0.5), (0, 30, 1.0, 0.3)]), PROPORTIONAL, [COULOMB], None, change=cutting)


def dropped_samples():
    command = cycle(1)
    over_time("dropped_samples", "Rows repeated by the recorder: single peaks of speed times lost time", command, PROPORTIONAL,
              [COULOMB], None, change=repeated(command))


PICTURES = {
    "stribeck": lambda: over_time(
        "stribeck", "2, 8 and 40 mm/s: more friction at creeping speed, none at feed speed", moves(STAIRS), PROPORTIONAL, [COULOMB],
        with_effect("falling_friction", drop=0.12, stribeck_velocity=0.008, stribeck_exponent=1.0)),
    "presliding": presliding,
    "asymmetric_friction": lambda: over_time(
        "asymmetric_friction", "Friction larger forwards than backwards; at rest no difference", PULSE, PROPORTIONAL, [COULOMB],
        with_effect("asymmetric_friction", coulomb_difference=0.05, viscous_difference=0.4)),
    "position_dependent_friction": lambda: over_position(
        "position_dependent_friction", "A section with more friction: opposite sign in the two directions", [60], PROPORTIONAL, [COULOMB],
        with_effect("position_dependent_friction", wave=0.25, sine=0.06, slope=0.0, curvature=0.0, cosine=0.0), (0, 250), True),
    "added_friction": lambda: over_time(
        "added_friction", "From 3.9 s on, friction is larger at every speed", cycle(4), PROPORTIONAL, [COULOMB],
        with_effect("added_friction", time_s=3.9, coulomb=0.1, viscous=0.0)),
    "backlash": lambda: over_time(
        "backlash", "A gap of 12 µm before the recorded encoder: one step at every reversal", SLOW, INTEGRAL, [COULOMB],
        with_effect("backlash", width=1.2e-5, velocity_limit=3e-4, deceleration=5.0, share=1.0, offset=0.0), (0.2, 2.4), "position"),
    "compliance": lambda: over_time(
        "compliance", "A mode of 38 Hz: it oscillates after every change of acceleration", cycle(1, 60, 100, 2.5, 0.5), PROPORTIONAL,
        [COULOMB], with_effect("compliance", frequency_hz=38, damping_ratio=0.03, spring=40.0, damper=0.0, ringing=0.02, fading=0.0)),
    "cogging": lambda: over_position(
        "cogging", "A force with a period of 10 mm: the same size at both speeds", [20, 80], PROPORTIONAL, [COULOMB],
        with_effect("cogging", period=0.01, sine=0.08, cosine=0.0, sine_2=0.02, cosine_2=0.0), (0, 60)),
    "lead_error": lambda: over_position(
        "lead_error", "A pitch error: a slope and a wave, the same at both speeds", [20, 80], INTEGRAL, [COULOMB],
        with_effect("lead_error", period=0.01, slope=3e-5, sine=2e-6, cosine=0.0, offset=0.0), (0, 120)),
    "encoder_error": lambda: over_position(
        "encoder_error", "A periodic error (5 mm) of the loop's encoder: it grows with speed", [20, 80],
        PROPORTIONAL, [COULOMB], with_effect("encoder_error", period=0.005, sine=2e-6, cosine=0.0), (0, 60)),
    "gravity_offset": lambda: over_time(
        "gravity_offset", "A constant force: the same shift in motion and at rest", PULSE, PROPORTIONAL, [COULOMB],
        with_effect("gravity_offset", offset_mps2=0.12)),
    "inertia_change": lambda: over_time(
        "inertia_change", "From 2.8 s on, 1.4 times the mass: larger errors during acceleration", cycle(3, 60, 100, 2.0),
        PROPORTIONAL, [COULOMB], with_effect("inertia_change", time_s=2.8, ratio_less_1=0.4)),
    "viscous_drift": lambda: over_time(
        "viscous_drift", "Viscous friction that decreases as the axis warms up", cycle(22, 120, 120, 2.0, 0.2), PROPORTIONAL, [COULOMB],
        with_effect("viscous_drift", time_constant_s=15.0, cold=2.0)),
    "time_delay": lambda: over_time(
        "time_delay", "The encoder is recorded 0.6 ms late: an error proportional to speed", PULSE, PROPORTIONAL, [COULOMB],
        with_effect("time_delay", delay_s=6e-4), (0, 3)),
    "feedforward_mismatch": lambda: over_time(
        "feedforward_mismatch", "3 % of the velocity feed-forward is missing", PULSE, PROPORTIONAL, [COULOMB],
        with_effect("feedforward_mismatch", velocity_gain=-0.03 * A1, acceleration_gain=0.0), (0, 3)),
    "gain_change": lambda: over_time(
        "gain_change", "From 2.0 s on, the gain is 0.7 times as high: every error grows", cycle(2), LAGGING, [COULOMB],
        with_effect("gain_change", time_s=2.0, proportional=0.3 * A2, integral=0.0)),
    "torque_saturation": lambda: over_time(
        "torque_saturation", "Torque limit at 1.6 m/s²: errors at larger accelerations only", moves(
            [(60, 150, 2.4, 0.4), (0, 150, 2.4, 0.4), (60, 150, 0.8, 0.4), (0, 150, 0.8, 0.4)]), PROPORTIONAL, [COULOMB],
        with_effect("torque_saturation", limit_mps2=1.6, reset=60.0, viscous=1e-3, share=1.0)),
    "periodic_disturbance": lambda: over_time(
        "periodic_disturbance", "An external vibration of 11 Hz, in motion and at rest", cycle(1, 60, 60, 1.0, 0.8), PROPORTIONAL,
        [COULOMB], with_effect("periodic_disturbance", frequency_hz=11, sine=0.05, cosine=0.0)),
    "impulse_disturbance": lambda: over_time(
        "impulse_disturbance", "Two short impulses, which do not recur in the next cycle", PULSE, PROPORTIONAL, [COULOMB],
        with_effect("impulse_disturbance", time_1_s=0.83, time_2_s=4.6, time_3_s=90.0, time_4_s=91.0, width_s=0.012, push_1=1.2, push_2=-0.9,
                    push_3=0.0, push_4=0.0)),
    "cutting_force": cutting_force,
    "cross_coupling": cross_coupling,
    "dwell_stiction": dwell_stiction,
    "thermal_growth": lambda: over_time(
        "thermal_growth", "The screw grows by 80 µm per metre: the error grows with every cycle",
        moves([leg for _ in range(14) for leg in ((300, 150, 1.5, 0.8), (50, 150, 1.5, 0.8))], start=50), INTEGRAL, [COULOMB],
        with_effect("thermal_growth", time_constant_s=20.0, growth=8e-5, drift=0.0, offset=0.0), None, "position"),
    "dropped_samples": dropped_samples,
}

if __name__ == "__main__":
    (HERE / "pictures").mkdir(exist_ok=True)
    for name in sys.argv[1:] or PICTURES:
        PICTURES[name]()

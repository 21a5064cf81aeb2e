#!/usr/bin/env python3
"""What `servotwin identify` says of recordings that are wrong: BUILD [NAME..]

Each is axis X of the example, 12 s of it, with one thing wrong. Prints a table: what is wrong, the status, the
seconds, and the notes, the error or the warnings that a user reads. Whether that is the right answer only a reader
can tell; the tests of the reasons are in tests/identification/recording and tests/cli."""
import math
import pathlib
import random
import subprocess
import sys
import tempfile
import time

EXAMPLE = pathlib.Path(__file__).parents[2] / "examples/axis_production.csv"
HEADER = "time[s],X.command[mm],X.actual[mm],X.torque[Nm]"
ROWS = 12_000


def table(header, rows):
    return "\n".join([header, *(",".join(cell if isinstance(cell, str) else f"{cell:.7g}" for cell in row) for row in rows)]) + "\n"


def wrong_recordings():
    """Pairs of what is wrong and the text of the file."""
    lines = [line for line in EXAMPLE.read_text().splitlines() if not line.startswith("#")]
    rows = [[float(cell) for cell in line.split(",")] for line in lines[1 : ROWS + 1]]
    data = [row[:4] for row in rows]
    noise = random.Random(3)
    last = len(data) - 1

    def each(change, header=HEADER):
        return table(header, [change(k, *row) for k, row in enumerate(data)])

    def named(header):
        return table(header, data)

    return {
        "units: mm, called m": named("time[s],X.command[m],X.actual[m],X.torque[Nm]"),
        "units: m, called mm": each(lambda k, t, c, a, u: (t, 1e-3 * c, 1e-3 * a, u)),
        "units: um, called mm": each(lambda k, t, c, a, u: (t, 1e3 * c, 1e3 * a, u)),
        "units: encoder in um, called mm": each(lambda k, t, c, a, u: (t, c, 1e3 * a, u)),
        "units: encoder in inches, called mm": each(lambda k, t, c, a, u: (t, c, a / 25.4, u)),
        "units: command in mm, encoder in deg": named("time[s],X.command[mm],X.actual[deg],X.torque[Nm]"),
        "units: deg for a linear axis": named("time[s],X.command[deg],X.actual[deg],X.torque[Nm]"),
        "units: none": named("time,X.command,X.actual,X.torque"),
        "time: in ms": each(lambda k, t, c, a, u: (1e3 * t, c, a, u)),
        "time: in us": each(lambda k, t, c, a, u: (1e6 * t, c, a, u)),
        "time: stands still": each(lambda k, t, c, a, u: (0.0, c, a, u)),
        "time: halves exchanged": table(HEADER, data[ROWS // 2 :] + data[: ROWS // 2]),
        "rate: 10 Hz": table(HEADER, data[::100]),
        "rate: 50 Hz": table(HEADER, data[::20]),
        "rows: each twice": table(HEADER, [row for row in data for _ in (0, 1)]),
        "rows: every third lost": table(HEADER, [row for k, row in enumerate(data) if k % 3]),
        "rows: 1 s": table(HEADER, data[:1000]),
        "rows: 20": table(HEADER, data[:20]),
        "rows: none": HEADER + "\n",
        "rows: the last one is cut off": table(HEADER, data) + "12.000,5.3",
        "columns: command and encoder exchanged": each(lambda k, t, c, a, u: (t, a, c, u)),
        "columns: command missing": table("time[s],X.actual[mm],X.torque[Nm]", [(t, a, u) for t, _, a, u in data]),
        "columns: command misspelt": named("time[s],X.comand[mm],X.actual[mm],X.torque[Nm]"),
        "columns: decimal comma, divided by commas": each(lambda k, t, c, a, u: (f"{t:.3f}".replace(".", ","), c, a, u)),
        "command: a velocity": each(lambda k, t, c, a, u: (t, 1e3 * (data[min(k + 1, last)][1] - c), a, u)),
        "command: a target that jumps": table(HEADER, [(1e-3 * k, 10.0 * (k // 1000 % 2), 10.0 * (k // 1000 % 2) + (10.0 - 20.0 * (k // 1000 % 2)) * math.exp(-(k % 1000) / 30.0), 0.0) for k in range(ROWS)]),
        "command: refreshed every 8 ms": each(lambda k, t, c, a, u: (t, data[k - k % 8][1], a, u)),
        "command: constant": each(lambda k, t, c, a, u: (t, 3.0, a, u)),
        "encoder: the command": each(lambda k, t, c, a, u: (t, c, c, u)),
        "encoder: the position error": each(lambda k, t, c, a, u: (t, c, c - a, u)),
        "encoder: of another axis": table(HEADER, [(row[0], row[1], row[5], row[3]) for row in rows]),
        "encoder: constant": each(lambda k, t, c, a, u: (t, c, 3.0, u)),
        "encoder: 0.5 s late": each(lambda k, t, c, a, u: (t, c, data[max(k - 500, 0)][2], u)),
        "encoder: 5 ms early": each(lambda k, t, c, a, u: (t, c, data[min(k + 5, last)][2], u)),
        "encoder: reversed": each(lambda k, t, c, a, u: (t, c, -a, u)),
        "encoder: zero 100 mm away": each(lambda k, t, c, a, u: (t, c, a + 100.0, u)),
        "encoder: goes round at 20 mm": each(lambda k, t, c, a, u: (t, c, a % 20.0, u)),
        "encoder: refreshed every 16 ms": each(lambda k, t, c, a, u: (t, c, data[k - k % 16][2], u)),
        "encoder: six values 50 mm off": each(lambda k, t, c, a, u: (t, c, a + 50.0 * (k % 2000 == 777), u)),
        "encoder: each hundredth empty": each(lambda k, t, c, a, u: (t, c, "" if k % 100 == 5 else a, u)),
        "command and encoder: go round at 20 mm": each(lambda k, t, c, a, u: (t, c % 20.0, a % 20.0, u)),
        "command and encoder: rest": each(lambda k, t, c, a, u: (t, 3.0, 3.0, u)),
        "command and encoder: noise": each(lambda k, t, c, a, u: (t, noise.gauss(0.0, 1e-3), noise.gauss(0.0, 1e-3), u)),
    }


def said(output):
    """The lines that speak of the recording or of whether the model is good."""
    kept = ("note:", "servotwin identify:", "warning:", "excitation", "refused")
    return " / ".join(" ".join(line.split()) for line in output.splitlines() if line.startswith(kept))


def main():
    servotwin = pathlib.Path(sys.argv[1]).resolve() / "servotwin"
    print("| wrong | status | s | said |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, text in wrong_recordings().items():
            if sys.argv[2:] and name not in sys.argv[2:]:
                continue
            pathlib.Path(folder, "rec.csv").write_text(text)
            begin = time.monotonic()
            done = subprocess.run([servotwin, "identify", "rec.csv", "--model", "model.json"], cwd=folder, capture_output=True, text=True, check=False)
            print(f"| {name} | {done.returncode} | {time.monotonic() - begin:.1f} | {said(done.stdout + done.stderr)} |", flush=True)


if __name__ == "__main__":
    main()

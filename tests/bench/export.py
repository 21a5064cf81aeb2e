#!/usr/bin/python3
"""An exported unit along a recording's commands, beside `servotwin simulate` of the same model.

    tests/bench/export.py BUILD_DIR [RECORDING] [AXIS]

Identifies the axis, exports the model, and simulates the unit in the host of tests/cli/export.
"""

import csv
import pathlib
import subprocess
import sys
import tempfile

sys.dont_write_bytecode = True
HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "cli" / "export"))
from command_spline import spline  # noqa: E402
from fmi_host import Instance, Unit  # noqa: E402


def main():
    tool = pathlib.Path(sys.argv[1]).resolve() / "servotwin"
    recording = sys.argv[2] if len(sys.argv) > 2 else HERE.parents[1] / "examples/axis_production.csv"
    axis = sys.argv[3] if len(sys.argv) > 3 else "X"
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        model, table = folder / "model.json", folder / "simulated.csv"

        def run(*words):
            subprocess.run([tool, *map(str, words)], check=True, stdout=subprocess.DEVNULL)

        run("identify", recording, "--axis", axis, "--method", "joint", "--model", model)
        run("export", model, "--fmu", folder / "unit.fmu")
        run("simulate", recording, "--model", model, "--out", table)
        with table.open() as lines:
            rows = list(csv.DictReader(lines))
        commands = [float(row[f"{axis}.command[m]"]) for row in rows]
        positions = [float(row[f"{axis}.actual[m]"]) for row in rows]
        unit = Unit(folder / "unit.fmu")
        print(f"unit             {(folder / 'unit.fmu').stat().st_size} bytes, of which the shared "
              f"library {unit.library.stat().st_size} unpacked")
        largest = max(abs(c - p) for c, p in zip(commands, positions))
        print(f"commands         {len(commands)}, tracking error up to {1e6 * largest:.4g} um")

        first, second, third = spline(commands, unit.step)
        for what in ("with derivatives", "commands alone"):
            one = Instance(unit)
            one.begin(commands[0])
            worst = 0.0
            for k in range(1, len(commands)):
                if what == "with derivatives":
                    one.set(command=commands[k - 1])
                    one.set_derivatives("command", first[k - 1], second[k - 1], third[k - 1])
                else:
                    one.set(command=commands[k])
                one.do_step((k - 1) * unit.step)
                worst = max(worst, abs(one.get("position") - positions[k]))
            one.free()
            print(f"{what:16} unit less servotwin simulate up to {worst:.2g} m")
        unit.close()


main()

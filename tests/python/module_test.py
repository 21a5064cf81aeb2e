"""The module beside the command-line tool: the same digits, and errors that say what to do."""

import ast
import csv
import json
import os
import pickle
import signal
import subprocess
import tempfile
import threading
import unittest
from pathlib import Path

import numpy
import servotwin

TOOL = os.environ["SERVOTWIN"]
DAEMON = os.environ["SERVOTWIND"]
RECORDING = Path(os.environ["SERVOTWIN_EXAMPLES"]) / "axis_production.csv"
STUB = Path(os.environ["SERVOTWIN_SOURCES"]) / "servotwin" / "_core.pyi"
PART = {"to_s": 8.0}  # seconds: a diagnosis of all takes longer and shows no more


def tool(*arguments):
    """What the tool writes to standard output, where it was asked to."""
    done = subprocess.run([TOOL, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        raise AssertionError(done.stderr)
    return done.stdout


def without_clock(values):
    """Without what the clock says."""
    out = {key: value for key, value in values.items() if key != "created"}
    if "fit" in out:
        out["fit"] = {key: value for key, value in out["fit"].items() if key != "time_taken_s"}
    return out


class AnAxis(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.axis = servotwin.read(RECORDING, **PART)["X"]
        cls.found = servotwin.identify(cls.axis)

    def in_files(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        return Path(folder.name)


class SameDigits(AnAxis):
    def test_identify(self):
        of_tool = json.loads(tool("identify", RECORDING, "--axis", "X", "--to", 8, "--json", "-"))
        self.assertEqual(without_clock(self.found.to_dict()), without_clock(of_tool))
        self.assertGreater(len(of_tool["trials"]), 1)

    def test_predict(self):
        folder = self.in_files()
        self.found.model.save(folder / "m.json")
        figures = json.loads(
            tool("predict", RECORDING, "--axis", "X", "--model", folder / "m.json", "--json", "-", "--out", folder / "p.csv")
        )
        prediction = self.found.model.predict(servotwin.read(RECORDING)["X"])
        self.assertEqual(prediction.rms, figures["rms_m"])
        self.assertEqual(prediction.max, figures["max_m"])
        self.assertEqual(prediction.noise_floor_rms, figures["noise_floor_rms_m"])
        with open(folder / "p.csv") as table:
            rows = list(csv.DictReader(table))
        for column, values in (
            ("time[s]", prediction.time),
            ("X.predicted_error[m]", prediction.predicted_error),
            ("X.measured_error[m]", prediction.measured_error),
            ("X.residual[m]", prediction.residual),
        ):
            numpy.testing.assert_array_equal(values, [float(row[column]) for row in rows])

    def test_simulate(self):
        folder = self.in_files()
        self.found.model.save(folder / "m.json")
        tool("simulate", RECORDING, "--model", folder / "m.json", "--out", folder / "s.csv")
        with open(folder / "s.csv") as table:
            rows = list(csv.DictReader(table))
        command = numpy.array([float(row["X.command[m]"]) for row in rows])
        error = self.found.model.simulate(command)
        numpy.testing.assert_array_equal(command - error, [float(row["X.actual[m]"]) for row in rows])
        self.assertGreater(abs(error).max(), 1e-6)

    def test_learn(self):
        folder = self.in_files()
        self.found.model.save(folder / "m.json")
        with open(folder / "path.csv", "w") as table:
            table.write("time[s],X.command[m]\n")
            for k, command in enumerate(self.axis.command):
                table.write(f"{k * 1e-3:.3f},{float(command)!r}\n")
        for method, aim_options in (("inverse", {}), ("feedforward", {}), ("norm-optimal", {"peak": 1e-6 * 50.0})):
            tool(
                "learn", folder / "path.csv", "--model", folder / "m.json", "--method", method, "--out", folder / "c.csv",
                "--json", folder / "c.json", *(("--limits-peak", 50) if aim_options else ()),
            )
            with open(folder / "c.csv") as table:
                rows = list(csv.DictReader(table))
            correction = servotwin.learn(self.found.model, self.axis, method=method, **aim_options)
            numpy.testing.assert_array_equal(
                correction.corrected["X"], [float(row["X.command[m]"]) for row in rows], method
            )
            figures = json.loads((folder / "c.json").read_text())
            self.assertEqual(correction.bandwidth_hz["X"], figures["axes"][0]["bandwidth_hz"])
            self.assertEqual(correction.contraction["X"], figures["axes"][0]["contraction"])
            self.assertEqual(len(correction.trials), len(figures["trials"]))
            if method == "feedforward":
                compensated = servotwin.compensate(self.found.model, self.axis)
                numpy.testing.assert_array_equal(compensated["X"], correction.corrected["X"])
            if method == "inverse":
                self.assertLess(correction.trials[correction.best]["rms"]["X"], 0.05 * correction.trials[0]["rms"]["X"])

    def test_diagnose(self):
        of_tool = json.loads(tool("diagnose", RECORDING, "--axis", "X", "--to", 8, "--json", "-"))
        diagnosis = servotwin.diagnose(self.axis)
        self.assertEqual(without_clock(diagnosis.to_dict()), without_clock(of_tool))
        self.assertEqual([cause["id"] for cause in diagnosis.causes], ["presliding"])
        self.assertEqual(diagnosis.causes + diagnosis.torque_causes, of_tool["causes"])
        self.assertGreater(len(diagnosis.torque_causes), 0)
        self.assertEqual(diagnosis.suspected, of_tool["suspected"])
        self.assertIn("<html", diagnosis.report())
        self.assertLess(diagnosis.extended.predict(self.axis).rms, diagnosis.baseline.predict(self.axis).rms)

    def test_a_saved_model_is_the_model(self):
        file = self.in_files() / "m.json"
        model = self.found.model
        model.save(file)
        loaded = servotwin.Model.load(file)
        self.assertEqual(loaded.to_dict(), model.to_dict())
        self.assertEqual(servotwin.Model.from_dict(model.to_dict()).to_dict(), model.to_dict())
        self.assertEqual(loaded.predict(self.axis).rms, model.predict(self.axis).rms)


class Objects(AnAxis):
    def test_a_model_goes_to_other_processes(self):
        model = self.found.model
        self.assertEqual(pickle.loads(pickle.dumps(model)).to_dict(), model.to_dict())

    def test_a_recording_of_one_axis_is_that_axis(self):
        table = {"X.command[m]": self.axis.command, "X.actual[m]": self.axis.actual}
        recording = servotwin.recording(table, rate_hz=1000.0)
        self.assertAlmostEqual(self.found.model.predict(recording).rms, self.found.model.predict(self.axis).rms, 12)

    def test_a_prediction_knows_its_axis_and_unit(self):
        prediction = self.found.model.predict(self.axis)
        self.assertEqual((prediction.axis, prediction.rotary, prediction.unit), ("X", False, "m"))
        # Measured minus predicted, once the starting state is known.
        rows = round(self.found.model.settling_time_s / self.axis.sample_time_s)
        rms = numpy.sqrt(numpy.mean(prediction.residual[rows:] ** 2))
        self.assertAlmostEqual(prediction.rms, rms, delta=1e-3 * rms)


class Paths(AnAxis):
    def test_two_axes_have_a_contour_error(self):
        recording = servotwin.read(RECORDING, to_s=4.0)
        models = [self.found.model, servotwin.identify(servotwin.read(RECORDING, **PART)["Y"]).model]
        correction = servotwin.learn(models, recording, aim="contour", trials=3)
        self.assertEqual(correction.axes, ["X", "Y"])
        before, after = correction.contour_before, correction.contour_after
        self.assertLess(numpy.sqrt(numpy.mean(after**2)), 0.5 * numpy.sqrt(numpy.mean(before**2)))
        self.assertAlmostEqual(
            correction.trials[0]["contour_rms"], numpy.sqrt(numpy.mean(before**2)), delta=1e-12
        )
        for name in correction.axes:
            numpy.testing.assert_array_equal(
                correction.corrected[name], correction.command[name] + correction.correction[name]
            )
            # The twin is the model: what the correction leaves is what the model says of it.
            simulated = dict(zip(correction.axes, models))[name].simulate(
                correction.corrected[name], sample_time_s=correction.sample_time_s
            )
            position = correction.corrected[name] - simulated
            numpy.testing.assert_allclose(
                correction.command[name] - position, correction.error_after[name], atol=1e-12
            )


class Arrays(AnAxis):
    def columns(self):
        with open(RECORDING) as table:
            rows = list(csv.reader(line for line in table if not line.startswith("#")))
        return {name: numpy.array([float(row[i]) for row in rows[1:]]) for i, name in enumerate(rows[0])}

    def assert_same(self, recording):
        of_file, of_table = servotwin.read(RECORDING)["X"], recording["X"]
        for name in ("time", "command", "actual", "torque"):
            numpy.testing.assert_array_equal(getattr(of_table, name), getattr(of_file, name))
        self.assertEqual(of_table.torque_unit, of_file.torque_unit)

    def test_of_a_dict(self):
        self.assert_same(servotwin.recording(self.columns()))

    def test_of_a_frame(self):
        import pandas

        self.assert_same(servotwin.recording(pandas.DataFrame(self.columns())))

    def test_with_names_and_units_of_ones_own(self):
        columns = self.columns()
        mine = {"q": 1000.0 * columns["X.command[mm]"], "y": columns["X.actual[mm]"]}
        recording = servotwin.recording(mine, columns="X.command=q[um],X.actual=y[mm]", rate_hz=1000.0)
        numpy.testing.assert_allclose(recording["X"].command, servotwin.read(RECORDING)["X"].command, rtol=1e-14)

    def test_what_is_wrong_with_them_is_said(self):
        columns = self.columns()
        columns["X.actual[mm]"] = columns["X.actual[mm]"][:-1]
        with self.assertRaisesRegex(ValueError, r"differ in length: time\[s\] has 24517 rows, X\.actual\[mm\] 24516"):
            servotwin.recording(columns)
        with self.assertRaisesRegex(ValueError, "dimensions"):
            servotwin.recording({"X.command[mm]": numpy.zeros((2, 2)), "X.actual[mm]": numpy.zeros(4)}, rate_hz=1.0)
        with self.assertRaises(ValueError):
            servotwin.recording({})
        with self.assertRaisesRegex(TypeError, "a dict of arrays or a pandas frame.*ndarray"):
            servotwin.recording(numpy.zeros((3, 3)))

    def test_what_is_no_number_is_refused_where_it_is_asked_for(self):
        columns = self.columns()
        dates = numpy.datetime64("2026-01-01", "ns") + (1e9 * columns["time[s]"]).astype("timedelta64[ns]")
        with self.assertRaisesRegex(ValueError, r"time\[s\] has dates.*give seconds"):
            servotwin.recording({**columns, "time[s]": dates})
        with self.assertRaisesRegex(ValueError, r"X\.actual\[mm\] has values of the type <U"):
            servotwin.recording({**columns, "X.actual[mm]": columns["X.actual[mm]"].astype(str)})
        self.assert_same(servotwin.recording({**columns, "note": ["x"] * len(dates)}))

    def test_names_keep_their_order(self):
        z, a = numpy.sin(numpy.arange(1000.0) / 50), numpy.cos(numpy.arange(1000.0) / 50)
        table = {"Z.command[mm]": z, "Z.actual[mm]": z, "A.command[mm]": a, "A.actual[mm]": a}
        recording = servotwin.recording(table, rate_hz=1000.0)
        self.assertEqual(list(recording), ["Z", "A"])
        self.assertIn("A", recording)

    def test_are_checked_before_anything_is_fitted(self):
        time = numpy.arange(0.0, 4.0, 1e-3)
        moves = numpy.sin(time)
        good = servotwin.recording({"time[s]": time, "X.command[mm]": moves, "X.actual[mm]": 0.99 * moves})
        self.assertTrue(servotwin.check(good))
        self.assertEqual(servotwin.check(good).why_not, "")
        for command, actual, unit, said in (
            (0.0 * moves, moves, "mm", "X.command does not move"),
            (300.0 * moves, 299.0 * moves, "m", "is its unit mm"),
            (moves, moves, "mm", "not a copy of the command"),
        ):
            found = servotwin.check(
                servotwin.recording({"time[s]": time, f"X.command[{unit}]": command, f"X.actual[{unit}]": actual})
            )
            self.assertFalse(found)
            self.assertIn(said, found.why_not)
        short = servotwin.recording({"time[s]": time[:50], "X.command[mm]": moves[:50], "X.actual[mm]": 0.9 * moves[:50]})
        self.assertIn("too few", servotwin.check(short).why_not)
        alone = servotwin.recording({"time[s]": time, "X.actual[mm]": moves, "X.torque[Nm]": moves})
        self.assertIn("X.command has no values", servotwin.check(alone).why_not)

    def test_an_axis_without_a_command_has_none(self):
        columns = self.columns()
        del columns["X.command[mm]"]
        axis = servotwin.recording(columns)["X"]
        self.assertTrue(numpy.isnan(axis.command).all())
        self.assertTrue(numpy.isnan(axis.segments[0].command).all())
        self.assertIn("X.command has no values: only its torque can be diagnosed", axis.notes)
        with self.assertRaisesRegex(ValueError, "X.command has no values"):
            self.found.model.predict(axis)
        with self.assertRaisesRegex(ValueError, "X.command has no values"):
            servotwin.identify(axis)
        diagnosis = servotwin.diagnose(axis)
        self.assertIn("torque alone", diagnosis.verdict)
        self.assertEqual(diagnosis.causes, [])
        self.assertNotEqual(diagnosis.torque_causes, [])


class Errors(AnAxis):
    def test_several_axes(self):
        with self.assertRaisesRegex(RuntimeError, r"has the axes X, Y.*choose one"):
            servotwin.identify(servotwin.read(RECORDING))
        with self.assertRaisesRegex(KeyError, "has no axis 'Q'"):
            servotwin.read(RECORDING)["Q"]

    def test_no_file(self):
        with self.assertRaisesRegex(RuntimeError, "nowhere.csv"):
            servotwin.read("nowhere.csv")

    def test_a_format_by_its_name(self):
        file = self.in_files() / "run.log"
        file.write_text("Axis1\nSampling rate;1;kHz\na;b\n1;2\n2;3\n")
        columns = "X.command=a[mm],X.actual=b[mm]"
        with self.assertRaisesRegex(RuntimeError, "is named .log"):
            servotwin.read(file, columns=columns)
        self.assertIn("1000 Hz", " ".join(servotwin.read(file, columns=columns, format="csv").notes))
        with self.assertRaisesRegex(ValueError, "'excel' is no format of recordings; they are csv, matlab"):
            servotwin.read(file, format="excel")

    def test_options(self):
        for options, words in (
            ({"method": "magic"}, "'magic' is not known; choose one of full-ls, joint, pole-search"),
            ({"friction": "gms", "method": "full-ls"}, "need the method joint"),
            ({"structure": "two-mass", "modes": 1}, "takes no modes"),
            ({"order": 4}, "order 4"),
            ({"training_share": 2.0}, "training"),
            ({"modes": -1}, "modes -1 is not 0 to 6"),
            ({"delay_max_s": float("nan")}, "delay_max_s nan is not 0 to 0.05"),
        ):
            with self.assertRaisesRegex((ValueError, RuntimeError), words):
                servotwin.identify(self.axis, **options)

    def test_of_a_diagnosis(self):
        for options, words in (
            ({"leave_out": ["dhal"]}, "'dhal' is no cause; the causes are .*presliding"),
            ({"delay_max_s": 1.0}, "delay_max_s 1.0"),
            ({"training_share": 0.0}, "training_share"),
        ):
            with self.assertRaisesRegex(ValueError, words):
                servotwin.diagnose(self.axis, **options)
        with self.assertRaisesRegex(TypeError, "diagnose takes an axis.*str"):
            servotwin.diagnose("axis.csv")

    def test_of_a_compensation(self):
        axis = servotwin.read(RECORDING, **PART)["X"]
        found = servotwin.identify(axis)
        with self.assertRaisesRegex(TypeError, "learn takes models.*Identification"):
            servotwin.compensate(found, axis)
        with self.assertRaisesRegex(ValueError, "cycles of 0.001 s"):
            servotwin.compensate(found.model, axis, sample_time_s=4e-3)
        with self.assertWarnsRegex(UserWarning, "not reliable"):
            servotwin.compensate(found.model, 1.8 * axis.command)

    def test_of_a_correction(self):
        model, command = self.found.model, self.axis.command
        for arguments, options, words in (
            ((model, {"Y": command}), {}, "no command of axis X; there are Y"),
            (([model, model], command), {}, "for the axes X, X give a dict"),
            (([model, model], {"X": command}), {}, "two models are of axis X"),
            ((model, servotwin.read(RECORDING, **PART)["Y"]), {}, "command is of axis Y, the model of axis X"),
            ((model, command), {"peak": 0.0}, "peak 0 is not 1e-09 to 1"),
            ((model, command), {"method": "magic"}, "'magic' is not known; choose one of feedforward, inverse"),
            ((model, command), {"trials": 0}, "trials 0 is not 1 to 1000"),
            ((model, command), {"uncertainty": 2.0}, "uncertainty 2 is not"),
            ((model, command), {"method": "feedforward", "aim": "contour"}, "takes neither aim"),
            ((model, command), {"sample_time_s": 0.0}, "sample_time_s must be positive"),
            ((model, numpy.zeros(1000)), {}, "no axis moves"),
            ((model, numpy.full(1000, numpy.nan)), {}, "finite"),
            ((model, numpy.repeat([0.0, 0.01, 0.0], [500, 1, 500])), {}, "X.command jumps by 10 mm"),
            ((model, 1e3 * command), {}, "nothing is learned|jumps"),
        ):
            with self.assertRaisesRegex((ValueError, RuntimeError), words):
                servotwin.learn(*arguments, **options)
        with self.assertRaisesRegex(TypeError, "learn takes models"):
            servotwin.learn(["m.json"], command)

    def test_of_a_model(self):
        values = self.found.model.to_dict()
        values["loop"]["damping_ratio"] = float("nan")
        with self.assertRaisesRegex(ValueError, "loop.damping_ratio is nan"):
            servotwin.Model.from_dict(values)
        with self.assertRaisesRegex(ValueError, r"axis\[0\] is of the type set"):
            servotwin.Model.from_dict({"axis": [{1}]})
        with self.assertRaisesRegex(RuntimeError, "cannot be written: No such file or directory"):
            self.found.model.save("/nowhere/at/all.json")

    def test_a_command_that_is_none(self):
        with self.assertRaisesRegex(ValueError, "not finite"):
            self.found.model.simulate([0.0, float("nan")])
        with self.assertRaisesRegex(ValueError, "no values"):
            self.found.model.simulate([])

    def test_a_model_that_must_not_be_used(self):
        # The positions of another axis: no loop predicts them.
        other = servotwin.read(RECORDING, **PART)
        mixed = servotwin.recording(
            {"X.command[m]": other["X"].command, "X.actual[m]": other["Y"].actual[: len(other["X"].command)]},
            rate_hz=1000.0,
            as_recorded=True,
        )
        try:
            found = servotwin.identify(mixed)
        except RuntimeError:
            return  # refused before anything was fitted
        self.assertNotEqual(found.refusals, [])
        with self.assertRaisesRegex(RuntimeError, "must not be used"):
            found.model


class Threads(AnAxis):
    def test_others_go_on_while_it_calculates(self):
        count, done = 0, threading.Event()

        def work():
            servotwin.identify(self.axis)
            done.set()

        thread = threading.Thread(target=work)
        thread.start()
        while not done.wait(0.001):
            count += 1
        thread.join()
        self.assertGreater(count, 10)

    def test_an_interrupt_ends_a_diagnosis(self):
        timer = threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT))
        timer.start()
        with self.assertRaises(KeyboardInterrupt):
            servotwin.diagnose(servotwin.read(RECORDING)["X"])
        timer.join()


class Live(unittest.TestCase):
    def test_predictions_of_a_daemon(self):
        with tempfile.TemporaryDirectory() as store:
            machine = f"python-{os.getpid()}"
            daemon = subprocess.Popen(
                [DAEMON, "--store", store, "--machine", machine, "--domain", "96", "--replay", *[RECORDING] * 20],
                stderr=subprocess.DEVNULL,
            )
            try:
                listener = servotwin.Listener(machine, domain=96)
                got = []
                while len(got) < 20:
                    one = listener.next(timeout_s=5.0)
                    if one is not None and "X" in one["axes"]:
                        got.append(one)
                self.assertLess(got[0]["sequence"], got[-1]["sequence"])
                self.assertEqual(sorted(got[-1]["axes"]), ["X", "Y"])
                self.assertTrue(numpy.isfinite(got[-1]["axes"]["X"]["measured_error"]))
            finally:
                daemon.kill()
                daemon.wait()

    def test_nobody_there(self):
        listener = servotwin.Listener("nobody", domain=96)
        self.assertIsNone(listener.next(timeout_s=0.1))
        for wrong in (float("nan"), -1.0, float("inf")):
            with self.assertRaisesRegex(ValueError, "timeout_s"):
                listener.next(timeout_s=wrong)


class Stub(unittest.TestCase):
    def test_has_what_the_module_has(self):
        said = {}
        for node in ast.parse(STUB.read_text()).body:
            if isinstance(node, ast.ClassDef):
                said[node.name] = {
                    item.target.id if isinstance(item, ast.AnnAssign) else item.name
                    for item in node.body
                    if isinstance(item, (ast.AnnAssign, ast.FunctionDef))
                }
            elif isinstance(node, ast.FunctionDef):
                said[node.name] = None
        core = servotwin._core
        public = {name for name in dir(core) if not name.startswith("_")}
        self.assertEqual(public, set(said))
        for name, members in said.items():
            if members is None:
                continue
            there = {m for m in dir(getattr(core, name)) if not m.startswith("_")}
            self.assertEqual(there, {m for m in members if not m.startswith("_")}, name)


if __name__ == "__main__":
    unittest.main()

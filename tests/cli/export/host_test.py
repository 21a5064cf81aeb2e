#!/usr/bin/env python3
"""An exported unit in an independent host, compared with `servotwin simulate`.

    host_test.py SERVOTWIN
"""

import copy
import csv
import ctypes
import json
import math
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from command_spline import spline  # noqa: E402
from fmi_host import DISCARD, REAL, REF, Instance, Refused, Unit  # noqa: E402

SERVOTWIN = sys.argv.pop(1)
SAME = 1e-12  # [m]


def parameter(value, unit):
    return {"value": value, "unit": unit, "sd": None}


PRESLIDING = {"id": "presliding", "parameters": {
    "breakaway": parameter(0.53, "m/s^2"), "viscous": parameter(0.0, "1/s"),
    "breakaway_displacement": parameter(1.1e-5, "m"), "shape_factor": parameter(0.22, "1")}}
COULOMB = {"id": "coulomb_friction", "parameters": {
    "coulomb": parameter(0.25, "m/s^2"), "viscous": parameter(0.0, "1/s"),
    "velocity_limit": parameter(1e-3, "m/s")}}
TWO_MASSES = {"id": "two_mass_play_load_encoder", "parameters": {
    "frequency_hz": parameter(60.0, "Hz"), "damping_ratio": parameter(0.05, "1"),
    "load_share": parameter(0.4, "1"), "friction_share": parameter(0.7, "1"),
    "reset": parameter(20.0, "1/s"), "width": parameter(2e-5, "m")}}
LEAD_ERROR = {"id": "lead_error", "parameters": {
    "slope": parameter(1e-5, "1"), "sine": parameter(2e-6, "m"), "cosine": parameter(1e-6, "m"),
    "offset": parameter(0.0, "m"), "period": parameter(5e-3, "m")}}
DELAY = {"id": "time_delay", "parameters": {"delay_s": parameter(2.3e-3, "s")}}
CUT = {"id": "cutting_force", "parameters": {
    "mean": parameter(0.2, "m/s^2"), "sine": parameter(0.1, "m/s^2"),
    "cosine": parameter(0.0, "m/s^2"), "tooth_frequency_hz": parameter(50.0, "Hz")}}
NEIGHBOUR = {"id": "cross_coupling", "parameters": {
    "ratio": parameter(0.05, "1"), "lead": parameter(0.01, "1"), "direct": parameter(0.0, "1"),
    "other_frequency_hz": parameter(20.0, "Hz"), "other_damping": parameter(0.9, "1")}}


# Over a part of `path` below, beside one that stands.
MOVING = [
    {"natural_frequency_rad_s": 280.0, "damping_ratio": 0.04, "alpha": -0.05, "beta_per_s": 20.0,
     "gamma_s": 2e-4, "delta": 0.6, "log_frequency_slope": 0.3, "log_frequency_curve": -0.12,
     "log_damping_slope": 0.4},
    {"natural_frequency_rad_s": 420.0, "damping_ratio": 0.08, "alpha": 0.01, "beta_per_s": -3.0,
     "gamma_s": 0.0, "delta": 0.05}]
TRAVEL = {"from_m": 0.088, "to_m": 0.109}


def model(*effects, order=3, sample_time_s=1e-3, rotary=False, axis="X", modes=()):
    real, w, zeta = 60.6, 190.2, 0.456
    if order == 3:
        denominator = [real + 2 * zeta * w, w * w + 2 * zeta * w * real, real * w * w]
        numerator = [1.006, 234.2, 29240.0]
    else:
        denominator, numerator = [2 * zeta * w, w * w], [0.98, 120.0]
    nothing = {"rms_m": None, "max_m": None}
    effects = copy.deepcopy(list(effects))
    for effect in effects if rotary else []:
        for one in effect["parameters"].values():
            one["unit"] = re.sub("^m/", "rad/", one["unit"])
    return {"schema": "servotwin.model/1", "axis": axis, "version": 7, "parent": 0,
            "created": "2026-01-01T00:00:00Z", "kind": "rotary" if rotary else "linear",
            "sample_time_s": sample_time_s, "effects": effects,
            "loop": {"order": order, "denominator": denominator, "covariance": None,
                     "denominator_sd": [None] * order, "tracking_error_numerator": numerator,
                     "tracking_error_numerator_sd": [None] * order, "modes": list(modes),
                     "travel": TRAVEL},
            "fit": {"training": nothing, "holdout": nothing, "noise_floor_rms_m": None,
                    "condition_number": None, "method": "pole-search", "time_taken_s": None},
            "data": {"source": "a \"file\" & <more>.csv", "from": 0.0, "to": 10.0,
                     "training_to": 6.0, "rows": 10000,
                     "excitation": {"missing": [], "sufficient": True}}}


def path(step, seconds=4.0):
    """There and back with rests [m]."""
    def at(t):
        swell = 0.5 - 0.5 * math.cos(2 * math.pi * t / seconds)
        move = (0.02 * math.sin(2 * math.pi * 0.5 * t) + 0.002 * math.sin(2 * math.pi * 3.1 * t))
        return 0.1 + swell * move
    return [at(k * step) for k in range(int(seconds / step))]


class Exported(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def run_tool(self, *words):
        return subprocess.run([SERVOTWIN, *map(str, words)], check=True, text=True,
                              stdout=subprocess.PIPE).stdout

    def export(self, described, name="unit"):
        model_file = self.folder / (name + ".json")
        model_file.write_text(json.dumps(described))
        unit_file = self.folder / (name + ".fmu")
        self.run_tool("export", model_file, "--fmu", unit_file)
        unit = Unit(unit_file)
        self.addCleanup(unit.close)
        return unit

    def simulated(self, described, commands):
        """Tracking errors by `servotwin simulate`."""
        axis, unit = described["axis"], "rad" if described["kind"] == "rotary" else "m"
        table = self.folder / "path.csv"
        with table.open("w") as out:
            out.write(f"time[s],{axis}.command[{unit}]\n")
            for k, command in enumerate(commands):
                out.write(f"{k * described['sample_time_s']!r},{command!r}\n")
        model_file = self.folder / "model.json"
        model_file.write_text(json.dumps(described))
        self.run_tool("simulate", table, "--model", model_file, "--out", self.folder / "sim.csv")
        with (self.folder / "sim.csv").open() as lines:
            rows = list(csv.DictReader(lines))
        return [float(r[f"{axis}.command[{unit}]"]) - float(r[f"{axis}.actual[{unit}]"])
                for r in rows]

    def along(self, unit, commands, library=None):
        """Tracking errors of the unit with the derivatives of the spline through the commands."""
        h = unit.step
        one = Instance(unit, library)
        one.begin(commands[0])
        errors = [one.get("tracking_error")]
        first, second, third = spline(commands, h)
        for k in range(len(commands) - 1):
            one.set(command=commands[k])
            one.set_derivatives("command", first[k], second[k], third[k])
            one.do_step(k * h)
            errors.append(commands[k + 1] - one.get("position"))
        one.free()
        return errors

    def followed(self, unit, commands, library=None):
        """The same with the commands only."""
        one = Instance(unit, library)
        one.begin(commands[0])
        errors = [one.get("tracking_error")]
        for k in range(1, len(commands)):
            one.set(command=commands[k])
            one.do_step((k - 1) * unit.step)
            errors.append(one.get("tracking_error"))
        one.free()
        return errors

    def assert_same(self, ours, theirs, within=SAME):
        self.assertEqual(len(ours), len(theirs))
        worst = max(abs(a - b) for a, b in zip(ours, theirs))
        self.assertLessEqual(worst, within)
        return worst


class Simulation(Exported):
    def test_is_what_servotwin_simulates(self):
        for described in (model(PRESLIDING), model(COULOMB, LEAD_ERROR, order=2),
                          model(PRESLIDING, sample_time_s=3e-3), model(COULOMB, rotary=True),
                          model(order=2), model(order=2, modes=MOVING),
                          model(PRESLIDING, TWO_MASSES),
                          model(TWO_MASSES, COULOMB, LEAD_ERROR, order=2, sample_time_s=2e-3),
                          model(PRESLIDING, modes=MOVING, sample_time_s=2.5e-3),
                          model(COULOMB, order=2, modes=MOVING, rotary=True)):
            with self.subTest(effects=[e["id"] for e in described["effects"]],
                              step=described["sample_time_s"], kind=described["kind"],
                              modes=len(described["loop"]["modes"])):
                commands = path(described["sample_time_s"])
                theirs = self.simulated(described, commands)
                self.assertGreater(max(map(abs, theirs)), 1e-5)
                self.assert_same(self.along(self.export(described), commands), theirs)

    def test_from_commands_alone_differs_by_the_cubic(self):
        # docs/theory.md 2.2: less than 10 nm on smooth motion at 1 kHz.
        described = model(PRESLIDING)
        commands = path(1e-3)
        worst = self.assert_same(self.followed(self.export(described), commands),
                                 self.simulated(described, commands), within=1e-8)
        self.assertGreater(worst, 0.0)

    def test_modes_that_move_are_not_those_of_the_middle(self):
        middle = copy.deepcopy(MOVING)
        for name in ("log_frequency_slope", "log_frequency_curve", "log_damping_slope"):
            middle[0][name] = 0.0
        commands = path(1e-3)
        errors = [self.followed(self.export(model(PRESLIDING, modes=modes)), commands)
                  for modes in (MOVING, middle)]
        self.assertGreater(max(abs(a - b) for a, b in zip(*errors)), 1e-6)

    def test_a_delayed_command(self):
        for modes in ((), MOVING):
            described = model(PRESLIDING, DELAY, modes=modes)
            commands = path(1e-3)
            unit = self.export(described)
            ours = self.followed(unit, commands)
            self.assert_same(ours, self.simulated(described, commands), within=1e-8)
            self.assert_same(self.along(unit, commands), ours)

    def test_compiled_anew_is_the_same(self):
        unit = self.export(model(PRESLIDING, modes=MOVING))
        library = self.folder / "anew.so"
        sources = [unit.folder / "sources" / s.get("name")
                   for s in unit.co_simulation.find("SourceFiles")]
        flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-shared", "-fPIC"]
        subprocess.run(["cc", *flags, "-O1", "-DFMI2_OVERRIDE_FUNCTION_PREFIX", "-o", library,
                        *sources, "-lm"], check=True)
        commands = path(1e-3)
        self.assert_same(self.along(unit, commands, library), self.along(unit, commands))
        # For programs that link the sources the functions have the unit's prefix.
        prefixed = self.folder / "prefixed.so"
        subprocess.run(["cc", *flags, "-o", prefixed, *sources, "-lm"], check=True)
        symbols = subprocess.run(["nm", "-D", "--defined-only", prefixed], check=True, text=True,
                                 stdout=subprocess.PIPE).stdout
        self.assertIn(" servotwin_X_fmi2DoStep\n", symbols)
        self.assertNotIn(" fmi2DoStep\n", symbols)

    def test_steps_of_several_cycles_are_done_in_parts(self):
        unit = self.export(model(PRESLIDING))
        together, apart = Instance(unit), Instance(unit)
        for one in (together, apart):
            one.begin(0.0)
        for k in range(200):
            at, velocity = k * 5e-3, 0.01 * math.cos(0.1 * k)
            command = 0.0 if k == 0 else together.get("command")
            together.set(command=command)
            together.set_derivatives("command", velocity, 0.3, -4.0)
            together.do_step(at, 5e-3)
            for i in range(5):
                s = i * 1e-3
                apart.set(command=command + s * (velocity + s * (0.3 / 2 - s * 4.0 / 6)))
                apart.set_derivatives("command", velocity + s * (0.3 - s * 4.0 / 2), 0.3 - 4.0 * s,
                                      -4.0)
                apart.do_step(at + s)
            self.assertAlmostEqual(together.get("tracking_error"), apart.get("tracking_error"),
                                   delta=SAME)
        # Held: as often the same command.
        together.do_step(1.0, 5e-3)
        for i in range(5):
            apart.do_step(1.0 + i * 1e-3)
        self.assertAlmostEqual(together.get("position"), apart.get("position"), delta=SAME)
        together.free()
        apart.free()

    def test_inputs_that_effects_need(self):
        unit = self.export(model(PRESLIDING, CUT, NEIGHBOUR))
        self.assertEqual([n for n, v in unit.variables.items() if v.get("causality") == "input"],
                         ["command", "neighbour_acceleration", "in_cut"])
        positions = {}
        for case in ({}, {"in_cut": 1.0}, {"neighbour_acceleration": 1.0}):
            one = Instance(unit)
            one.begin(0.0, **case)
            for k in range(50):
                one.do_step(k * 1e-3)
            positions[str(case)] = one.get("position")
            one.free()
        self.assertEqual(len(set(positions.values())), 3)
        self.assertNotIn("in_cut", self.export(model(PRESLIDING), "plain").variables)


class Life(Exported):
    def setUp(self):
        super().setUp()
        self.unit = self.export(model(PRESLIDING, COULOMB, order=2))
        self.commands = path(1e-3, seconds=0.5)

    def errors(self, one, begin, count):
        out = []
        for k in range(begin, begin + count):
            one.set(command=self.commands[k])
            one.do_step((k - 1) * 1e-3)
            out.append(one.get("tracking_error"))
        return out

    def refused(self, *parts, status=3):
        test = self

        class Watch:
            def __enter__(self):
                return self

            def __exit__(self, kind, error, _trace):
                test.assertIs(kind, Refused)
                test.assertEqual(error.status, status)
                for part in parts:
                    test.assertIn(part, error.message)
                return True
        return Watch()

    def test_instances_do_not_know_of_each_other(self):
        alone = Instance(self.unit)
        alone.begin(self.commands[0])
        expected = self.errors(alone, 1, 300)
        alone.free()
        self.assertEqual(alone.memory, {})
        one, other = Instance(self.unit), Instance(self.unit)
        one.begin(self.commands[0])
        other.begin(5.0, presliding__breakaway=3.0)
        found = []
        for k in range(1, 301):
            found += self.errors(one, k, 1)
            other.set(command=5.0 + 0.01 * (k % 7))
            other.do_step((k - 1) * 1e-3)
        self.assertEqual(found, expected)
        one.free()
        other.free()

    def test_a_state_is_gone_back_to(self):
        # Modes that move are elsewhere by the time that one goes back.
        moving = self.export(model(PRESLIDING, order=2, sample_time_s=1e-3, modes=MOVING), "moving")
        two = self.export(model(PRESLIDING, TWO_MASSES), "two")
        for name, unit in (("plain", self.unit), ("moving", moving), ("two masses", two)):
            with self.subTest(name):
                self.check_states(unit)

    def check_states(self, unit):
        one = Instance(unit)
        one.begin(self.commands[0])
        self.errors(one, 1, 100)
        state = one.keep_state()
        data = one.serialized(state)
        expected = self.errors(one, 101, 300)
        one.call("SetFMUstate", state)
        self.assertEqual(one.serialized(state), data)
        self.assertEqual(self.errors(one, 101, 300), expected)
        one.free_state(state)
        other = Instance(unit)  # from the bytes, and never started
        state = other.deserialized(data)
        other.call("SetFMUstate", state)
        self.assertEqual(self.errors(other, 101, 300), expected)
        other.free_state(state)
        with self.refused("not a state of this unit"):
            other.deserialized(data[:-1])
        with self.refused("not a state of this unit"):
            other.deserialized(b"x" + data[1:])
        one.free()
        other.free()
        self.assertEqual((one.memory, other.memory), ({}, {}))

    def test_reset_begins_anew(self):
        one = Instance(self.unit)
        one.begin(self.commands[0])
        expected = self.errors(one, 1, 50)
        one.call("Terminate")
        one.call("Reset")
        one.begin(self.commands[0])
        self.assertEqual(self.errors(one, 1, 50), expected)
        one.free()

    def test_parameters_are_the_models_and_fixed_after_initialization(self):
        one = Instance(self.unit)
        self.assertEqual(one.get("presliding.breakaway"), 0.53)
        with self.refused("breakaway = -1", "outside 0 .. 10000"):
            one.set(presliding__breakaway=-1.0)
        with self.refused("nan is not finite"):
            one.set(presliding__breakaway=math.nan)
        one.begin(self.commands[0])
        expected = self.errors(one, 1, 200)
        with self.refused("breakaway is fixed after initialization"):
            one.set(presliding__breakaway=0.6)
        other = Instance(self.unit)
        other.begin(self.commands[0], presliding__breakaway=0.6)
        self.assertEqual(other.get("presliding.breakaway"), 0.6)
        # Without an integrator 0.07 m/s^2 more friction give way by 0.07 / a2.
        self.assertAlmostEqual(max(map(abs, self.errors(other, 1, 200))) - max(map(abs, expected)),
                               0.07 / 190.2 ** 2, delta=0.2e-6)
        one.free()
        other.free()

    def test_what_is_refused_says_why_and_changes_nothing(self):
        one = Instance(self.unit)
        with self.refused("not allowed in this state"):
            one.do_step(0.0)
        with self.refused("initialization mode"):
            one.get("position")
        one.begin(self.commands[0])
        with self.refused("0.0015 s", "not a whole multiple", "0.001 s"):
            one.do_step(0.0, 1.5e-3)
        for step in (0.0, -1e-3, 1e-4, math.nan, math.inf):
            with self.refused("not a whole multiple"):
                one.do_step(0.0, step)
        with self.refused("communication point is 0.1 s", "ended at 0 s"):
            one.do_step(0.1)
        with self.refused("not finite"):
            one.set(command=math.inf)
        with self.refused("cannot be set"):
            one.set(position=1.0)
        with self.refused("no real variable 9"):
            self.unit.variables["nine"] = {"valueReference": "9"}
            one.get("nine")
        with self.refused("nan is not finite"):
            one.call("SetReal", (REF * 2)(0, 0), ctypes.c_size_t(2), (REAL * 2)(7.0, math.nan))
        self.assertEqual(one.get("command"), self.commands[0])
        with self.refused("only derivatives 1 to 3 of the command"):
            one.set_derivatives("command", 1.0, 2.0, 3.0, 4.0)
        with self.refused("not allowed in this state"):
            one.call("EnterInitializationMode")
        with self.refused("step is done", status=DISCARD):
            one.call("GetStatus", 0, None)
        with self.refused("no integer"):
            one.call("GetInteger", None, 1, None)
        other = Instance(self.unit)
        other.begin(self.commands[0])
        one.set_derivatives("command", 0.0)  # the refused ones are not the next step's
        one.set(command=self.commands[0])
        one.do_step(0.0)
        other.do_step(0.0)
        self.assertEqual(self.errors(one, 2, 50), self.errors(other, 2, 50))
        one.free()
        other.free()

    def test_what_is_not_of_this_unit_is_not_instantiated(self):
        with self.refused("the GUID is {0}", self.unit.description.get("guid")):
            Instance(self.unit, guid="{0}")
        with self.refused("cannot be read"):
            Instance(self.unit, resources="file:///there/is/none")
        with self.refused("not a file: URI"):
            Instance(self.unit, resources="http://host/resources")
        with self.refused("co-simulation only"):
            Instance(self.unit, kind=0)

    def test_resources_may_be_anywhere(self):
        place = self.folder / "a folder, 100 % (ä)"
        shutil.copytree(self.unit.folder / "resources", place)
        for uri in (place.as_uri(), place.as_uri() + "/", place.as_uri().replace("//", "", 1),
                    place.as_uri().replace("file:///", "file://localhost/")):
            Instance(self.unit, resources=uri).free()

    def test_starts_at_rest_where_the_command_is(self):
        one = Instance(self.unit)
        one.begin(0.25, start=3.0)
        self.assertEqual(one.get("position"), 0.25)
        for k in range(20):
            one.do_step(3.0 + k * 1e-3)
        self.assertEqual((one.get("position"), one.get("velocity")), (0.25, 0.0))
        one.free()


class Packed(Exported):
    def test_the_library_needs_the_c_library_only_and_shows_the_standard_only(self):
        unit = self.export(model(PRESLIDING))
        needed = subprocess.run(["readelf", "-d", unit.library], check=True, text=True,
                                stdout=subprocess.PIPE).stdout
        self.assertEqual(set(re.findall(r"NEEDED.*\[(.*)\]", needed)), {"libc.so.6", "libm.so.6"})
        symbols = subprocess.run(["nm", "-D", "--defined-only", unit.library], check=True,
                                 text=True, stdout=subprocess.PIPE).stdout.split("\n")
        names = {line.split()[-1] for line in symbols if line}
        self.assertEqual({n for n in names if not n.startswith("fmi2")}, set())
        # Table of section 2.1 and 4.2 of the standard: common functions, and those of a slave.
        for name in """GetTypesPlatform GetVersion SetDebugLogging Instantiate FreeInstance
                SetupExperiment EnterInitializationMode ExitInitializationMode Terminate Reset
                GetReal GetInteger GetBoolean GetString SetReal SetInteger SetBoolean SetString
                GetFMUstate SetFMUstate FreeFMUstate SerializedFMUstateSize SerializeFMUstate
                DeSerializeFMUstate GetDirectionalDerivative SetRealInputDerivatives
                GetRealOutputDerivatives DoStep CancelStep GetStatus GetRealStatus
                GetIntegerStatus GetBooleanStatus GetStringStatus""".split():
            self.assertIn("fmi2" + name, names)

    def test_the_description_is_what_the_standard_asks_for(self):
        for described in (model(PRESLIDING, CUT, NEIGHBOUR, LEAD_ERROR, DELAY),
                          model(PRESLIDING, rotary=True, axis="C & <\"C\">"), model(order=2),
                          model(PRESLIDING, axis="Y", modes=MOVING)):
            with self.subTest(axis=described["axis"]):
                self.check_description(self.export(described), described)

    def check_description(self, unit, described):
        root = unit.description
        self.assertEqual(root.tag, "fmiModelDescription")
        self.assertEqual(root.get("fmiVersion"), "2.0")
        self.assertEqual(root.get("modelName"), "Servotwin axis " + described["axis"])
        self.assertRegex(root.get("guid"), r"^\{[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}\}$")
        self.assertIn("guid " + root.get("guid") + "\n",
                      (unit.folder / "resources" / "model.txt").read_text())
        # The order that the schema has.
        self.assertEqual([e.tag for e in root],
                         ["CoSimulation", "UnitDefinitions", "LogCategories", "DefaultExperiment",
                          "ModelVariables", "ModelStructure"])
        self.assertRegex(unit.identifier, r"^[A-Za-z_][A-Za-z0-9_]*$")
        self.assertIn(f"binaries/linux64/{unit.identifier}.so", unit.names)
        self.assertIn("documentation/index.html", unit.names)
        sources = [s.get("name") for s in unit.co_simulation.find("SourceFiles")]
        self.assertEqual(sorted("sources/" + s for s in sources),
                         sorted(n for n in unit.names if n.endswith(".c")))
        self.assertEqual(unit.co_simulation.get("canHandleVariableCommunicationStepSize"), "false")
        self.assertEqual(unit.step, described["sample_time_s"])

        length = "rad" if described["kind"] == "rotary" else "m"
        units = {u.get("name"): u for u in root.find("UnitDefinitions")}
        self.assertEqual(units[length].find("BaseUnit").get(length), "1")
        self.assertEqual(units[length + "/s"].find("BaseUnit").get(length), "1")
        self.assertEqual(units[length + "/s"].find("BaseUnit").get("s"), "-1")
        variables = root.find("ModelVariables").findall("ScalarVariable")
        references = [v.get("valueReference") for v in variables]
        self.assertEqual(len(references), len(set(references)))
        self.assertEqual(len(variables), len(unit.variables))
        values = {}
        for effect in described["effects"]:
            for name, one in effect["parameters"].items():
                values[f"{effect['id']}.{name}"] = one["value"]
        for v in variables:
            real = v.find("Real")
            if real.get("unit"):
                self.assertIn(real.get("unit"), units)
            if real.get("displayUnit"):
                self.assertIn(real.get("displayUnit"), [
                    d.get("name") for d in units[real.get("unit")].findall("DisplayUnit")])
            # A start value is there exactly where the standard's table asks for one.
            self.assertEqual(real.get("start") is not None,
                             v.get("causality") in ("input", "parameter"), v.get("name"))
            if v.get("causality") == "parameter":
                self.assertEqual((v.get("variability"), v.get("initial")), ("fixed", "exact"))
                self.assertEqual(float(real.get("start")), values.pop(v.get("name")))
                self.assertLessEqual(float(real.get("min")), float(real.get("start")))
                self.assertGreaterEqual(float(real.get("max")), float(real.get("start")))
        self.assertEqual(values, {})
        outputs = [str(i + 1) for i, v in enumerate(variables) if v.get("causality") == "output"]
        structure = root.find("ModelStructure")
        self.assertEqual([u.get("index") for u in structure.find("Outputs")], outputs)
        self.assertEqual([u.get("index") for u in structure.find("InitialUnknowns")], outputs)
        self.assertEqual([variables[int(i) - 1].get("name") for i in outputs],
                         ["tracking_error", "position", "velocity"])

    def test_the_page_says_how_modes_move(self):
        unit = self.export(model(PRESLIDING, modes=MOVING))
        page = (unit.folder / "documentation" / "index.html").read_text()
        self.assertIn("at 0.088", page)
        self.assertIn("at 0.109", page)
        self.assertIn("slope of the damping 0.4", page)

    def test_the_same_model_makes_the_same_unit_and_another_one_does_not(self):
        described = model(PRESLIDING)
        guid = self.export(described, "a").description.get("guid")
        self.export(described, "b")
        self.assertEqual(self.export(described, "a").times, {(1980, 1, 1, 0, 0, 0)})
        self.assertEqual((self.folder / "a.fmu").read_bytes(), (self.folder / "b.fmu").read_bytes())
        described["effects"][0]["parameters"]["breakaway"]["value"] += 1e-15
        self.assertNotEqual(self.export(described, "c").description.get("guid"), guid)


if __name__ == "__main__":
    unittest.main()

"""Servotwin for Python: identify, predict, simulate, diagnose and correct servo axes.

    import servotwin

    axis = servotwin.read("axis_production.csv")["X"]
    found = servotwin.identify(axis)
    prediction = found.model.predict(axis)
    diagnosis = servotwin.diagnose(axis)
    correction = servotwin.learn(found.model, axis)

Positions and errors are numpy arrays in m, or rad on a rotary axis; times in s. The figures are
those of the command-line tool, bit for bit. RuntimeError says what failed and what to do, ValueError
which argument is out of range.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any, Mapping, Sequence

import numpy

from . import _core, _plots
from ._core import (
    Axis,
    Correction,
    Diagnosis,
    Identification,
    Listener,
    Model,
    PredictedSegment,
    Prediction,
    Recording,
    Segment,
    __version__,
    read,
)

__all__ = [
    "Axis",
    "Check",
    "Correction",
    "Diagnosis",
    "Identification",
    "Listener",
    "Model",
    "PredictedSegment",
    "Prediction",
    "Recording",
    "Segment",
    "check",
    "compensate",
    "diagnose",
    "identify",
    "learn",
    "read",
    "recording",
]


def recording(
    table: Mapping[str, Any],
    *,
    columns: str = "",
    rate_hz: float | None = None,
    as_recorded: bool = False,
    source: str = "table",
) -> Recording:
    """A recording from columns named as in a file.

    `table` is a dict of arrays or a pandas frame: "time[s]", "X.command[mm]", "X.actual[mm]",
    "X.torque[Nm]". Columns with other names are assigned by `columns`, as of the tool:
    "X.command=qg[m],X.actual=qm[m],time=t[s]". Without a time, `rate_hz` gives the rows per second.
    Columns of text that nothing asks for are left out.
    """
    if not hasattr(table, "keys"):
        raise TypeError(
            f"a table is a dict of arrays or a pandas frame, with columns named as in a file; this is of "
            f"the type {type(table).__name__}"
        )
    names = list(table.keys())
    if len(set(map(str, names))) < len(names):
        raise ValueError(f"a name occurs twice among the columns: {', '.join(map(str, names))}")
    numbers = []
    for name in names:
        values = _numbers(str(name), table[name], asked="[" in str(name) or f"={name}" in columns)
        if values is not None:
            numbers.append((str(name), values))
    return _core.recording(
        numbers, columns=columns, rate_hz=rate_hz, as_recorded=as_recorded, source=source
    )


def _numbers(name: str, column: Any, asked: bool) -> Any:
    """The column as float64; None where it has no numbers and nobody asks for it."""
    values = column.to_numpy(dtype=float, na_value=numpy.nan) if _is_nullable(column) else numpy.asarray(column)
    if values.dtype.kind in "fiub":
        return values.astype(float)
    if not asked:
        return None
    if values.dtype.kind in "mM":
        raise ValueError(
            f"{name} has dates or durations; give seconds, as (t - t[0]) / numpy.timedelta64(1, 's')"
        )
    raise ValueError(f"{name} has values of the type {values.dtype}, not numbers")


def _is_nullable(column: Any) -> bool:
    """Whether it is one of pandas' columns of numbers that may be missing."""
    return str(getattr(column, "dtype", "")) in {
        "Float32", "Float64", "Int8", "Int16", "Int32", "Int64", "UInt8", "UInt16", "UInt32", "UInt64",
    }


def _one_axis(axis: Axis | Recording, what: str) -> Axis:
    if isinstance(axis, Recording):
        return axis.axis()
    if not isinstance(axis, Axis):
        raise TypeError(
            f'{what} takes an axis, as read("file.csv")["X"]; this is of the type {type(axis).__name__}'
        )
    return axis


@dataclass(frozen=True)
class Check:
    """Whether an axis can be identified, and what was noticed when it was read."""

    why_not: str  #: a sentence; empty where nothing is known against it
    notes: list[str]  #: gaps, repeats, units that were assumed

    def __bool__(self) -> bool:
        return not self.why_not


def check(axis: Axis | Recording) -> Check:
    """Whether something can be identified from this axis, before anything is fitted.

    False where it rests, is too short, has no command or no encoder, has a copy of the command in its
    place, or moves as no machine does (wrong unit). What only a fit shows (exchanged columns, an
    encoder that has nothing to do with the command, too few samples a second) the result of identify()
    says in its refusals.
    """
    one = _one_axis(axis, "check")
    return Check(_core.why_unusable(one), list(one.notes))


def identify(
    axis: Axis | Recording,
    *,
    method: str = "joint",
    friction: str | None = None,
    structure: str = "rigid",
    order: int = 0,
    modes: int = 0,
    coupling: bool = False,
    delay_max_s: float = 0.02,
    training_share: float | None = None,
    whole: bool = False,
) -> Identification:
    """The model of an axis, as of `servotwin identify`, whose help explains the options.

    `axis` is an Axis, or a Recording with one. method: "joint", "pole-search", "full-ls"; friction:
    a law by its name, None for the one that predicts best; structure: "rigid", "two-mass", "auto";
    order: 2, 3, 0 for the one that predicts best; modes: at most so many, 0 to 6; training_share:
    None for 0.6 of the time, up to 0.85 where the axis hardly accelerates before.
    """
    return _core.identify(
        _one_axis(axis, "identify"),
        method=method,
        friction=friction,
        structure=structure,
        order=order,
        modes=modes,
        coupling=coupling,
        delay_max_s=delay_max_s,
        training_share=training_share,
        whole=whole,
    )


def diagnose(
    axis: Axis | Recording,
    *,
    earlier: Model | None = None,
    leave_out: Sequence[str] = (),
    encoder_in_loop: bool = False,
    training_share: float | None = None,
    delay_max_s: float = 0.02,
) -> Diagnosis:
    """What the simulation of an axis gets wrong, and why, as of `servotwin diagnose`.

    earlier: a model of this axis, to find what has changed since; leave_out: causes that are not
    searched for; training_share: None for the division that the diagnosis finds best.
    """
    if isinstance(leave_out, str):
        leave_out = [leave_out]
    return _core.diagnose(
        _one_axis(axis, "diagnose"),
        earlier=earlier,
        leave_out=list(leave_out),
        encoder_in_loop=encoder_in_loop,
        training_share=training_share,
        delay_max_s=delay_max_s,
    )


def learn(
    models: Model | Sequence[Model],
    commands: Axis | Recording | Mapping[str, Any] | Any,
    *,
    sample_time_s: float | None = None,
    method: str = "inverse",
    aim: str = "tracking",
    trials: int = 10,
    bandwidth_hz: float | None = None,
    uncertainty: float | None = None,
    peak: float | None = None,
    rate: float | None = None,
) -> Correction:
    """Corrected commands of a path, learned in virtual trials on the twins, as of `servotwin learn`.

    models: one for each axis that is corrected. commands: a dict of arrays by axis, one array for one
    model, or a recording or an axis without gaps, whose commands are used. sample_time_s: of arrays;
    None for that of the first model. method: "inverse", "norm-optimal", "p", "pd", or "feedforward",
    the inverse of the model without trials. aim: "tracking" or "contour". uncertainty: share of every
    pole and coefficient, None for what the model states. peak [m | rad] and rate [m/s | rad/s] limit
    the correction. Ctrl-C ends it after its present trial.
    """
    if not isinstance(models, Model) and not isinstance(models, (list, tuple)):
        raise TypeError(f"learn takes models, as identify(..).model; this is of the type {type(models).__name__}")
    several = [models] if isinstance(models, Model) else list(models)
    for model in several:
        if not isinstance(model, Model):
            raise TypeError(f"learn takes models, as identify(..).model; this is of the type {type(model).__name__}")
    names = [model.axis for model in several]
    by_axis, step = _commands(commands, names)
    if sample_time_s is not None and step is not None and sample_time_s != step:
        raise ValueError(f"sample_time_s is of arrays; the commands of this axis have cycles of {step:g} s")
    if sample_time_s is None:
        sample_time_s = step if step is not None or not several else several[0].sample_time_s
    missing = [name for name in names if name not in by_axis]
    if missing:
        raise ValueError(f"there is no command of axis {', '.join(missing)}; there are {', '.join(by_axis) or 'none'}")
    return _core.learn(
        several,
        [numpy.asarray(by_axis[name], dtype=float) for name in names],
        sample_time_s,
        method=method,
        aim=aim,
        trials=trials,
        bandwidth_hz=bandwidth_hz,
        uncertainty=uncertainty,
        peak=peak,
        rate=rate,
    )


def compensate(
    models: Model | Sequence[Model],
    commands: Axis | Recording | Mapping[str, Any] | Any,
    *,
    sample_time_s: float | None = None,
    uncertainty: float | None = None,
    peak: float | None = None,
    rate: float | None = None,
) -> dict[str, numpy.ndarray]:
    """The commands by which the axes follow `commands`, by the inverse of their models, in one step.

    The corrected commands [m | rad] by axis: those of learn(.., method="feedforward"), which says what
    they gain. What it notes is a warning here.
    """
    correction = learn(
        models,
        commands,
        sample_time_s=sample_time_s,
        method="feedforward",
        uncertainty=uncertainty,
        peak=peak,
        rate=rate,
    )
    for note in correction.notes:
        warnings.warn(note, stacklevel=2)
    return correction.corrected


def _commands(commands: Any, names: Sequence[str]) -> tuple[dict[str, Any], float | None]:
    """The command of every axis by its name, and the sampling time where the source has one."""
    if isinstance(commands, Recording):
        commands = {name: commands[name] for name in names if name in commands}
    elif isinstance(commands, Axis) or not hasattr(commands, "keys"):
        if len(names) != 1:
            raise ValueError(f"for the axes {', '.join(names)} give a dict with the command of each")
        commands = {names[0]: commands}
    step = None
    out = {}
    for name in commands.keys():
        command = commands[name]
        if isinstance(command, Axis):
            if len(command.segments) != 1:
                raise ValueError(
                    f"{name} has {len(command.segments)} segments, between which its command is not known: "
                    "give the array of one"
                )
            if command.name != str(name):
                raise ValueError(f"the command is of axis {command.name}, the model of axis {name}: give its array")
            if step is not None and step != command.sample_time_s:
                raise ValueError(f"the commands have cycles of {step:g} and {command.sample_time_s:g} s")
            step = command.sample_time_s
            command = command.command
        out[str(name)] = command
    return out, step


Correction.plot = _plots.plot_correction
Prediction.plot = _plots.plot_prediction
Axis.plot = _plots.plot_axis

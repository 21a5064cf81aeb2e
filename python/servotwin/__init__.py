"""Servotwin for Python: identify, predict, simulate and diagnose servo axes.

    import servotwin

    axis = servotwin.read("axis_production.csv")["X"]
    found = servotwin.identify(axis)
    prediction = found.model.predict(axis)
    diagnosis = servotwin.diagnose(axis)

Positions and errors are numpy arrays in m, or rad on a rotary axis; times in s. The figures are
those of the command-line tool, bit for bit. RuntimeError says what failed and what to do, ValueError
which argument is out of range.
"""

from __future__ import annotations

from typing import Any, Mapping, Sequence

import numpy

from . import _core, _plots
from ._core import (
    Axis,
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
    "Diagnosis",
    "Identification",
    "Listener",
    "Model",
    "PredictedSegment",
    "Prediction",
    "Recording",
    "Segment",
    "diagnose",
    "identify",
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
    training_share: float = 0.6,
    whole: bool = False,
) -> Identification:
    """The model of an axis, as of `servotwin identify`, whose help explains the options.

    `axis` is an Axis, or a Recording with one. method: "joint", "pole-search", "full-ls"; friction:
    a law by its name, None for the one that predicts best; structure: "rigid", "two-mass", "auto";
    order: 2, 3, 0 for the one that predicts best; modes: at most so many, 0 to 6.
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
    searched for; training_share: None for the division that the diagnosis finds best. Ctrl-C ends it
    after its present fit.
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


Prediction.plot = _plots.plot_prediction
Axis.plot = _plots.plot_axis

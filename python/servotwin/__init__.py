"""Servotwin for Python: identify, predict, simulate and diagnose servo axes.

    import servotwin

    axis = servotwin.read("axis_production.csv")["X"]
    found = servotwin.identify(axis)
    prediction = found.model.predict(axis)
    diagnosis = servotwin.diagnose(axis)

Positions and errors are numpy arrays in m, or rad on a rotary axis; times in s. The figures are
those of the command-line tool, bit for bit. Errors are RuntimeError (what failed, and what to do)
and ValueError (an argument out of range).
"""

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
from . import _core
from ._plots import plot_prediction, plot_recording

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
    "plot_prediction",
    "plot_recording",
    "read",
    "recording",
]


def recording(table, *, columns="", rate_hz=None, as_recorded=False, source="table"):
    """A recording from columns named as in a file.

    `table` is a dict of arrays or a pandas frame: "time[s]", "X.command[mm]", "X.actual[mm]",
    "X.torque[Nm]". Columns with other names are assigned by `columns`, as of the tool:
    "X.command=qg[m],X.actual=qm[m],time=t[s]". Without a time, `rate_hz` gives the rows per second.
    """
    named = {str(name): table[name] for name in (table.columns if hasattr(table, "columns") else table)}
    return _core.recording(
        named, columns=columns, rate_hz=rate_hz, as_recorded=as_recorded, source=source
    )


def _one_axis(axis):
    return axis.axis() if isinstance(axis, Recording) else axis


def identify(axis, **options):
    """The model of an axis, as of `servotwin identify`.

    `axis` is an Axis, or a Recording with one axis. Options: method ("joint", "pole-search",
    "full-ls"), friction (a law by its name), structure ("rigid", "two-mass", "auto"), order (2 or 3;
    0: chosen), modes, coupling, delay_max_s, training_share, whole.
    """
    return _core.identify(_one_axis(axis), **options)


def diagnose(axis, **options):
    """What the simulation of an axis gets wrong, and why, as of `servotwin diagnose`.

    Options: earlier (a Model: what has changed since it was identified), leave_out (causes that are
    not searched for), encoder_in_loop, training_share, delay_max_s. Ctrl-C stops it.
    """
    return _core.diagnose(_one_axis(axis), **options)


Prediction.plot = plot_prediction
Axis.plot = plot_recording

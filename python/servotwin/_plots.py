"""Plots, where matplotlib is installed."""


def plot_prediction(prediction, *, ax=None):
    """Predicted and measured tracking error over time. Returns the matplotlib axes."""
    import matplotlib.pyplot as plt

    ax = ax or plt.subplots()[1]
    unit = "µ" + prediction.unit
    for i, part in enumerate(prediction.segments):  # one line each: nothing is drawn over a gap
        time = part.segment.time
        ax.plot(time, 1e6 * part.measured_error, "C0", linewidth=2, label="" if i else "measured")
        ax.plot(time, 1e6 * part.predicted_error, "C1--", label="" if i else "predicted")
    ax.set_xlabel("time [s]")
    ax.set_ylabel(f"tracking error of {prediction.axis} [{unit}]")
    ax.set_title(f"measured minus predicted: {1e6 * prediction.rms:.3g} {unit} RMS")
    ax.legend()
    return ax


def plot_axis(axis, *, ax=None):
    """Measured tracking error over time. Returns the matplotlib axes."""
    import matplotlib.pyplot as plt

    ax = ax or plt.subplots()[1]
    for segment in axis.segments:
        ax.plot(segment.time, 1e6 * (segment.command - segment.actual), "C0")
    ax.set_xlabel("time [s]")
    ax.set_ylabel(f"tracking error of {axis.name} [µ{axis.unit}]")
    return ax


def plot_correction(correction, *, ax=None):
    """Tracking error of every axis on the twin, before and after. Returns the matplotlib axes."""
    import matplotlib.pyplot as plt
    import numpy

    ax = ax or plt.subplots()[1]
    for i, name in enumerate(correction.axes):
        before, after = correction.error_before[name], correction.error_after[name]
        time = correction.sample_time_s * numpy.arange(before.size)
        ax.plot(time, 1e6 * before, f"C{i}", alpha=0.4, label=f"{name} before")
        ax.plot(time, 1e6 * after, f"C{i}", label=f"{name} after")
    ax.set_xlabel("time [s]")
    ax.set_ylabel("tracking error on the twin [µm | µrad]")
    ax.legend()
    return ax

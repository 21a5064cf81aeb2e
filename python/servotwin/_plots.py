"""Plots, where matplotlib is installed."""


def _scale(rotary):
    return (1e6, "µrad") if rotary else (1e6, "µm")


def plot_prediction(prediction, *, rotary=False, ax=None):
    """Predicted and measured tracking error over time. Returns the matplotlib axes."""
    import matplotlib.pyplot as plt

    ax = ax or plt.subplots()[1]
    scale, unit = _scale(rotary)
    ax.plot(prediction.time, scale * prediction.measured_error, label="measured", linewidth=2)
    ax.plot(prediction.time, scale * prediction.predicted_error, "--", label="predicted")
    ax.set_xlabel("time [s]")
    ax.set_ylabel(f"tracking error [{unit}]")
    ax.set_title(f"measured minus predicted: {scale * prediction.rms:.3g} {unit} RMS")
    ax.legend()
    return ax


def plot_recording(axis, *, ax=None):
    """Measured tracking error over time. Returns the matplotlib axes."""
    import matplotlib.pyplot as plt

    ax = ax or plt.subplots()[1]
    scale, unit = _scale(axis.rotary)
    ax.plot(axis.time, scale * (axis.command - axis.actual))
    ax.set_xlabel("time [s]")
    ax.set_ylabel(f"tracking error of {axis.name} [{unit}]")
    return ax

from os import PathLike
from typing import Any, Iterator, Sequence

import numpy
from numpy.typing import ArrayLike, NDArray

__version__: str

_Array = NDArray[numpy.float64]

class Segment:
    start_s: float
    sample_time_s: float
    time: _Array
    command: _Array
    actual: _Array
    actual_motor: _Array
    torque: _Array
    def __len__(self) -> int: ...

class Axis:
    name: str
    source: str
    rotary: bool
    unit: str
    torque_unit: str
    sample_time_s: float
    notes: list[str]
    segments: list[Segment]
    time: _Array
    command: _Array
    actual: _Array
    actual_motor: _Array
    torque: _Array
    def plot(self, *, ax: Any = None) -> Any: ...

class Recording:
    source: str
    notes: list[str]
    axes: list[str]
    def axis(self, name: str | None = None) -> Axis: ...
    def __getitem__(self, name: str) -> Axis: ...
    def __contains__(self, name: str) -> bool: ...
    def __iter__(self) -> Iterator[str]: ...
    def __len__(self) -> int: ...

class PredictedSegment:
    segment: Segment
    predicted_error: _Array
    measured_error: _Array
    rms: float
    max: float

class Prediction:
    axis: str
    rotary: bool
    unit: str
    rms: float
    max: float
    noise_floor_rms: float
    noise_floor_interval: tuple[float, float]
    segments: list[PredictedSegment]
    time: _Array
    predicted_error: _Array
    measured_error: _Array
    residual: _Array
    def plot(self, *, ax: Any = None) -> Any: ...

class Model:
    axis: str
    rotary: bool
    sample_time_s: float
    settling_time_s: float
    @staticmethod
    def load(file: str | PathLike[str]) -> Model: ...
    @staticmethod
    def from_dict(values: dict[str, Any]) -> Model: ...
    def save(self, file: str | PathLike[str]) -> None: ...
    def to_dict(self) -> dict[str, Any]: ...
    def predict(self, axis: Axis | Recording) -> Prediction: ...
    def simulate(
        self, command: ArrayLike, *, sample_time_s: float | None = None, neighbour: ArrayLike | None = None
    ) -> _Array: ...

class Identification:
    model: Model
    refusals: list[str]
    excitation: list[str]
    training_rms: float
    holdout_rms: float
    holdout_max: float
    noise_floor_rms: float
    noise_floor_interval: tuple[float, float]
    def to_dict(self) -> dict[str, Any]: ...

class Diagnosis:
    verdict: str
    causes: list[dict[str, Any]]
    torque_causes: list[dict[str, Any]]
    suspected: list[dict[str, Any]]
    baseline: Model
    extended: Model
    steps: list[str]
    def to_dict(self) -> dict[str, Any]: ...
    def report(self) -> str: ...
    def _repr_html_(self) -> str: ...

class Correction:
    axes: list[str]
    sample_time_s: float
    notes: list[str]
    command: dict[str, _Array]
    correction: dict[str, _Array]
    corrected: dict[str, _Array]
    error_before: dict[str, _Array]
    error_after: dict[str, _Array]
    contour_before: _Array | None
    contour_after: _Array | None
    trials: list[dict[str, Any]]
    best: int
    bandwidth_hz: dict[str, float]
    contraction: dict[str, float]
    uncertainty: dict[str, str]
    def plot(self, *, ax: Any = None) -> Any: ...

class Listener:
    def __init__(self, machine: str = "machine", *, domain: int = 0, partition: str = "") -> None: ...
    def next(self, timeout_s: float = 1.0) -> dict[str, Any] | None: ...

def read(
    file: str | PathLike[str],
    *,
    columns: str = "",
    rate_hz: float | None = None,
    can_map: str | PathLike[str] | None = None,
    format: str | None = None,
    from_s: float = 0.0,
    to_s: float = ...,
    as_recorded: bool = False,
) -> Recording: ...
def recording(
    table: Sequence[tuple[str, ArrayLike]],
    *,
    columns: str = "",
    rate_hz: float | None = None,
    as_recorded: bool = False,
    source: str = "table",
) -> Recording: ...
def why_unusable(axis: Axis) -> str: ...
def identify(
    axis: Axis,
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
) -> Identification: ...
def diagnose(
    axis: Axis,
    *,
    earlier: Model | None = None,
    leave_out: Sequence[str] = (),
    encoder_in_loop: bool = False,
    training_share: float | None = None,
    delay_max_s: float = 0.02,
) -> Diagnosis: ...
def learn(
    models: Sequence[Model],
    commands: Sequence[ArrayLike],
    sample_time_s: float,
    *,
    method: str = "inverse",
    aim: str = "tracking",
    trials: int = 10,
    bandwidth_hz: float | None = None,
    uncertainty: float | None = None,
    peak: float | None = None,
    rate: float | None = None,
) -> Correction: ...

"""A recording of a head, checked when it is made."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.printhead import check_name
from inkjet_env.typing import Real

CHANNELS = ("self_sensing", "strain_gauge", "displacement")
INITIAL_STATES = ("demagnetised", "periodic", "free")
EXCITATIONS = (
    "trapezoid",
    "bipolar",
    "pulse_pair",
    "multisine",
    "sine",
    "minor_loops",
    "step",
    "zero",
    "arbitrary",
)
SENSOR_COLUMNS = {"V": "sensor_V", "um": "displacement_um", "nm": "displacement_nm"}
"""Name of the sensor's column in a file, by the unit of its signal."""
LARGEST_ORDER = 1_000_000
"""Largest position of a recording within its session."""
LARGEST_JITTER = 0.01
"""Largest accepted deviation of a sample's time from the uniform grid, in sampling steps."""


class CampaignError(ValueError):
    """A campaign that cannot be read; the message names the file, the row, the rule and a fix."""

    def __init__(self, message: str) -> None:
        # names of files and cells may hold line breaks and codes that a terminal obeys
        super().__init__("".join(letter if letter.isprintable() else "\ufffd" for letter in message))


def uniform_grid(time_s: Real) -> tuple[float, float]:
    """Start and step, in seconds, of the uniform grid that fits ``time_s`` (n,) best in the least-squares sense."""
    n = len(time_s)
    since_s = time_s - time_s[0]
    step_s = float(grid(n, 0.0, 1.0, (n - 1) / 2) @ since_s) / (n * (n * n - 1) / 12)
    return float(np.mean(since_s) + time_s[0]) - step_s * (n - 1) / 2, step_s


def grid(n: int, start_s: float, step_s: float, origin: float = 0.0) -> Real:
    """Times ``start_s + step_s (k - origin)`` in seconds, shape (n,)."""
    times: Real = np.arange(n, dtype=np.float64)  # changed in place: recordings may be large
    times -= origin
    times *= step_s
    times += start_s
    return times


def largest_departure(time_s: Real, start_s: float, step_s: float, origin: float = 0.0) -> tuple[int, float]:
    """Sample of ``time_s`` (n,) that is farthest from a `grid`, and how far, in seconds."""
    off_s = grid(len(time_s), start_s, step_s, origin)
    off_s -= time_s
    np.abs(off_s, out=off_s)
    k = int(np.argmax(off_s))
    return k, float(off_s[k])


@dataclass(frozen=True, eq=False)
class Recording:
    """One measured response, checked when it is made; its arrays are read-only.

    Parameters
    ----------
    name : str
        Name, unique within the campaign and valid as a file name.
    time_s : array_like, shape (n,)
        At least two uniform times in seconds; they may start anywhere, even before 0 s.
    drive_V : array_like, shape (n,)
        Commanded drive in volts, linear between samples.
    sensor : array_like, shape (n,)
        Signal of the sensor, in ``unit``.
    unit : {"V", "um", "nm"}
        Unit of the signal: volts, micrometres or nanometres.
    channel : {"self_sensing", "strain_gauge", "displacement"}
        Sensor that was recorded.
    excitation : str
        Kind of drive, one of `EXCITATIONS`; a label for people.
    initial_state : {"demagnetised", "periodic", "free"}
        State at the first sample: at rest on the virgin curve, in the steady state of the repeated drive, or unknown.
    order : int
        Position of the recording within the session: 1, 2, 3 …
    repeat_of : str or None
        Name of the recording of which this is a repeat.
    condition : mapping of str to float
        Conditions of the measurement by name with unit, such as ``{"temperature_C": 25.0}``.
    drive_monitor_V, neighbour_V : array_like, shape (n,), or None
        Voltage measured at the head, and drive of the neighbouring channel, in volts.

    Raises
    ------
    ValueError
        An invalid name or label, arrays of different lengths, a value that is not finite, or times that do not increase
        or are not uniform to 1 % of a step.

    Examples
    --------
    >>> recording = Recording("r001", [0, 1e-6, 2e-6], [0, 50, 90], [0, 0.1, 0.3], "V", "self_sensing")
    >>> recording.sensor_column, round(recording.sample_rate_Hz)
    ('sensor_V', 1000000)
    """

    name: str
    time_s: Real
    drive_V: Real
    sensor: Real
    unit: str
    channel: str
    excitation: str = "arbitrary"
    initial_state: str = "free"
    order: int = 1
    repeat_of: str | None = None
    condition: Mapping[str, float] = field(default_factory=dict)
    drive_monitor_V: Real | None = None
    neighbour_V: Real | None = None

    def __post_init__(self) -> None:
        _check_recording_name(self.name)
        check_label("unit", self.unit, SENSOR_COLUMNS)
        check_label("channel", self.channel, CHANNELS)
        check_label("initial_state", self.initial_state, INITIAL_STATES)
        if not isinstance(self.excitation, str):
            raise ValueError(f"excitation must be a string such as 'bipolar'; got {brief(self.excitation)}.")
        if not isinstance(self.order, int) or isinstance(self.order, bool) or not 1 <= self.order <= LARGEST_ORDER:
            raise ValueError(f"order must be a whole number from 1 to {LARGEST_ORDER:,}; got {brief(self.order)}.")
        if self.repeat_of is not None and not isinstance(self.repeat_of, str):
            raise ValueError(f"repeat_of must be a recording's name or null; got {brief(self.repeat_of)}.")
        object.__setattr__(self, "condition", _checked_condition(self.condition))
        for label in ("time_s", "drive_V", "sensor", "drive_monitor_V", "neighbour_V"):
            values = getattr(self, label)
            if values is not None or label in ("time_s", "drive_V", "sensor"):
                object.__setattr__(self, label, _checked_samples(label, values, len(np.atleast_1d(self.time_s))))
        _check_times(self.time_s)

    @property
    def step_s(self) -> float:
        """Time between samples, in seconds."""
        return float((self.time_s[-1] - self.time_s[0]) / (len(self.time_s) - 1))

    @property
    def sample_rate_Hz(self) -> float:
        """Samples per second."""
        return 1 / self.step_s

    @property
    def duration_s(self) -> float:
        """Time from the first sample to the last, in seconds."""
        return float(self.time_s[-1] - self.time_s[0])

    @property
    def sensor_column(self) -> str:
        """Name of the sensor's column in a file: ``sensor_V``, ``displacement_um`` or ``displacement_nm``."""
        return SENSOR_COLUMNS[self.unit]


def brief(value: Any) -> str:
    """``repr`` of a value, shortened to fit into a message."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}…"


def check_label(label: str, given: object, known: Mapping[str, Any] | tuple[str, ...]) -> None:
    if not isinstance(given, str) or len(given) > 60:
        raise ValueError(f"{label} must be one of {', '.join(known)}; got {brief(given)}.")
    check_name(label, given, known)


def _check_recording_name(name: object) -> None:
    if not isinstance(name, str):
        raise ValueError(f"a recording's name must be a string; got {brief(name)}.")
    if (
        name == ""
        or not name.isprintable()
        or len(name.encode()) > 150
        or set(name) & set('/\\:*?"<>|')
        or name[0] in ". "
    ):
        raise ValueError(
            "a recording's name must be fit for a file: 1 to 150 bytes, printable, without / \\ : * ? \" < > |, "
            f"not starting with a dot or a space; got {brief(name)}."
        )


def _checked_condition(condition: object) -> dict[str, float]:
    if not isinstance(condition, Mapping):
        raise ValueError(f"condition must map names to numbers; got {brief(condition)}.")
    checked = {}
    for key, value in condition.items():
        try:
            number = math.nan if isinstance(value, (bool, str)) else float(value)
        except (TypeError, ValueError, OverflowError):
            number = math.nan
        if not isinstance(key, str) or not math.isfinite(number):
            raise ValueError(f"condition must map names to finite numbers; got {brief(key)}: {brief(value)}.")
        checked[key] = number
    return checked


def _checked_samples(label: str, values: ArrayLike, length: int) -> Real:
    if np.iscomplexobj(values):
        raise ValueError(f"{label} must be real numbers; got complex ones. Give the real part, or the magnitude.")
    try:
        # An array that can no longer be written needs no copy; recordings may be large.
        frozen = isinstance(values, np.ndarray) and not values.flags.writeable and values.base is None
        samples = np.asarray(values, dtype=np.float64) if frozen else np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{label} must be numbers of shape (n,).") from None
    if samples.ndim != 1:
        raise ValueError(f"{label} must have shape (n,); got shape {samples.shape}.")
    if len(samples) != length:
        raise ValueError(f"{label} must be as long as time_s, {length} samples; got {len(samples)}.")
    if length < 2:
        raise ValueError(f"a recording must have at least 2 samples; got {length}.")
    finite = np.isfinite(samples)
    if not finite.all():
        k = int(np.argmin(finite))
        raise ValueError(f"{label} must be finite; got {samples[k]} at sample {k + 1} of {length}. Trim the recording.")
    samples.flags.writeable = False
    return samples


@np.errstate(over="ignore", invalid="ignore")
def _check_times(time_s: Real) -> None:
    rising = np.diff(time_s) > 0
    if not rising.all():
        k = int(np.argmin(rising))
        raise ValueError(
            f"time_s must increase; got {time_s[k + 1]:g} s after {time_s[k]:g} s at sample {k + 2} of {len(time_s)}. "
            "Sort the samples or remove the repeated one."
        )
    start_s, step_s = uniform_grid(time_s)
    k, off_s = largest_departure(time_s, start_s, step_s)
    if not off_s / step_s <= LARGEST_JITTER:
        raise ValueError(
            f"time_s must be uniform to {LARGEST_JITTER:.0%} of a step; sample {k + 1} of {len(time_s)} is "
            f"{off_s / step_s:.3g} steps of {step_s:.6g} s off. Resample, or cut the recording at the gap."
        )

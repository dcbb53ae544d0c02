"""A drive as corners that can be dragged: the seven-parameter waveform, or any number of segments of a drive file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.printhead import Waveform
from inkjet_env.printhead.waveform import LARGEST_DRIVE_V, LONGEST_DURATION_S
from inkjet_env.recordings.drive import read_drive
from inkjet_env.typing import Real

PUBLISHED_BEST = (100.0, -100.0, 1e-6, 10.481e-6, 13.769e-6, 9.613e-6, 20e-6)
"""U1 U2 in volts, t1 … t5 in seconds: what is shown first."""
SHORTEST_S = 0.1e-6
"""Shortest segment that dragging leaves, in seconds: a controller needs a rise time."""
STEP_V, STEP_S = 0.1, 1e-8
"""Steps to which a dragged corner is rounded."""
MOST_CORNERS = 200
"""Largest number of corners that are drawn as handles."""
STRAIGHT_V = 1e-6
"""Distance in volts from a straight line below which a sample is no corner."""


@dataclass(frozen=True)
class Corners:
    """A piecewise-linear drive of any number of segments.

    Parameters
    ----------
    time_s, drive_V : tuple of float
        Times in seconds, increasing from 0, and drive in volts at the corners.
    name : str
        Where it is from.
    """

    time_s: tuple[float, ...]
    drive_V: tuple[float, ...]
    name: str = "drive"

    def __post_init__(self) -> None:
        time, drive = np.array(self.time_s), np.array(self.drive_V)
        if time.shape != drive.shape or time.ndim != 1 or not 2 <= time.size <= MOST_CORNERS:
            raise ValueError(f"a drive must have 2 to {MOST_CORNERS} corners, each a time and a voltage.")
        if not (np.isfinite(time).all() and np.isfinite(drive).all() and time[0] == 0 and (np.diff(time) > 0).all()):
            raise ValueError("the corners of a drive must be finite, and their times must start at 0 s and increase.")
        if time[-1] > LONGEST_DURATION_S or np.abs(drive).max() > LARGEST_DRIVE_V:
            raise ValueError(
                f"a drive must last at most {LONGEST_DURATION_S:g} s and stay within ±{LARGEST_DRIVE_V:g} V."
            )

    @classmethod
    def from_file(cls, path: Path) -> Corners:
        """The corners of a drive file: CSV or a controller's segments; samples on a straight line are left out.

        Raises
        ------
        ValueError
            The file cannot be read, or has more corners than can be dragged; the message names it.
        """
        read = read_drive(path)
        time_s, drive_V = read.time_s - read.time_s[0], read.drive_V
        kept = corners_of(time_s, drive_V)
        if kept.size > MOST_CORNERS:
            raise ValueError(
                f"{path}: has {kept.size} corners; at most {MOST_CORNERS} can be dragged. Simulate it with inkjet "
                "simulate --drive."
            )
        try:
            return cls(tuple(time_s[kept].tolist()), tuple(drive_V[kept].tolist()), path.name)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None

    @property
    def duration_s(self) -> float:
        """Time from the first corner to the last, in seconds."""
        return self.time_s[-1]

    def knots(self) -> tuple[Real, Real]:
        """Times in seconds and drive in volts at the corners: two arrays of shape (n,)."""
        return np.array(self.time_s), np.array(self.drive_V)

    def drive_V_at(self, time_s: ArrayLike) -> Real:
        """Drive in volts at times in seconds, same shape; held at its last value afterwards."""
        return np.interp(np.asarray(time_s, dtype=np.float64), self.time_s, self.drive_V)


Drive = Waveform | Corners


def corners_of(time_s: Real, drive_V: Real) -> np.ndarray:
    """Indices of the samples, shape (n,) each, at which a drive bends, and of both ends."""
    slopes = np.diff(drive_V) / np.diff(time_s)
    bends_V = np.abs(np.diff(slopes)) * np.minimum(np.diff(time_s)[:-1], np.diff(time_s)[1:])
    bends = np.flatnonzero(bends_V > STRAIGHT_V) + 1
    return np.concatenate([[0], bends, [time_s.size - 1]])


def moved_corner(drive: Drive, k: int, time_s: float, drive_V: float) -> Drive:
    """The drive with one corner moved; the order of the corners is kept.

    Parameters
    ----------
    drive : Waveform or Corners
        The drive.
    k : int
        Number of the corner, from 0.
    time_s, drive_V : float
        Where it is dragged to, in seconds and volts. The time stays between those of the neighbouring corners; of a
        waveform, corners 1 and 2 share ``U1``, corners 3 and 4 ``U2``, the first and the last stay at 0 V.

    Raises
    ------
    ValueError
        There is no such corner.
    """
    times_s, volts = drive.knots()
    last = times_s.size - 1
    if not 0 <= k <= last:
        raise ValueError(f"corner must be 0 to {last}; got {k}.")
    low_s = 0.0 if k == 0 else times_s[k - 1] + SHORTEST_S
    high_s = 0.0 if k == 0 else (times_s[k + 1] - SHORTEST_S if k < last else LONGEST_DURATION_S)
    moved_s = times_s[k] if high_s < low_s else min(max(rounded(time_s, STEP_S), low_s), high_s)
    moved_V = min(max(rounded(drive_V, STEP_V), -LARGEST_DRIVE_V), LARGEST_DRIVE_V)
    if isinstance(drive, Corners):
        times_s[k], volts[k] = moved_s, moved_V
        return Corners(tuple(times_s.tolist()), tuple(volts.tolist()), drive.name)
    if k == 0:
        return drive
    values = drive.to_array()
    if k in (1, 2):
        values[0] = max(moved_V, 0.0)
    if k in (3, 4):
        values[1] = min(moved_V, 0.0)
    change_s = moved_s - times_s[k]
    values[k + 1] = rounded(values[k + 1] + change_s, 1e-12)
    if k < last:
        values[k + 2] = rounded(values[k + 2] - change_s, 1e-12)
    return Waveform.from_array(values)


def rounded(value: float, step: float) -> float:
    """The nearest multiple of a step, without rounding noise."""
    return float(f"{round(value / step) * step:.12g}")


def drive_json(drive: Drive) -> dict[str, Any]:
    """The drive as plain JSON values, exactly."""
    if isinstance(drive, Corners):
        return {"time_s": list(drive.time_s), "drive_V": list(drive.drive_V), "name": drive.name}
    return {"waveform": drive.to_array().tolist()}


def drive_of(stored: Mapping[str, Any]) -> Drive:
    """The drive that `drive_json` wrote; ``ValueError`` names the broken rule."""
    if "waveform" in stored:
        return Waveform.from_array(stored["waveform"])
    return Corners(numbers(stored["time_s"]), numbers(stored["drive_V"]), str(stored.get("name", "drive")))


def numbers(values: Sequence[Any]) -> tuple[float, ...]:
    """Floats of a stored list; ``ValueError`` if one is no number."""
    found = tuple(float(v) for v in values)
    if any(math.isnan(v) for v in found):
        raise ValueError("a number must not be NaN.")
    return found

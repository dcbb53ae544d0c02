"""Features of a remainder: by name, functions of what the head does.

A *push* is added to the hysteretic drive, so that the head with its effects responds to it; a *shown* feature is added
to the sensor's signal. Each is a dimensionless function of signals between -1 and 1, so it is bounded under any drive.
No feature depends on a measured signal or on the order of the recordings. A name ends with ``@k`` where the feature has
a time or a threshold: the k-th of its list.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from inkjet_env.plant.head_motion import ScaledMotion
from inkjet_env.typing import Real

Times = Mapping[str, Sequence[float]]
"""Lists of times and thresholds: ``drive_delays_s``, ``motion_delays_s``, ``lags_s`` and ``plays`` (shares of 1)."""
TIMES = ("drive_delays_s", "motion_delays_s", "lags_s", "plays")
"""Names of these lists."""

Shape = Callable[[ScaledMotion], Real]
Copy = Callable[[ScaledMotion, float], Real]

OF_THE_DRIVE: Mapping[str, Shape] = {
    "drive": lambda m: m["drive"],
    "|drive|": lambda m: np.abs(m["drive"]),
    "drive^2": lambda m: m["drive"] ** 2,
    "drive*|drive|": lambda m: m["drive"] * np.abs(m["drive"]),
    "drive^3": lambda m: m["drive"] ** 3,
    "hysteretic": lambda m: m["hysteretic"],
    "|hysteretic|": lambda m: np.abs(m["hysteretic"]),
    "hysteretic^2": lambda m: m["hysteretic"] ** 2,
    "hysteretic^3": lambda m: m["hysteretic"] ** 3,
    "hysteretic*|hysteretic|": lambda m: m["hysteretic"] * np.abs(m["hysteretic"]),
}
"""Features of the drive alone."""

OF_THE_MOTION: Mapping[str, Shape] = {
    "deflection": lambda m: m["deflection"],
    "deflection^2": lambda m: m["deflection"] ** 2,
    "deflection^3": lambda m: m["deflection"] ** 3,
    "deflection^5": lambda m: m["deflection"] ** 5,
    "deflection^7": lambda m: m["deflection"] ** 7,
    "deflection*|deflection|": lambda m: m["deflection"] * np.abs(m["deflection"]),
    "speed": lambda m: m["speed"],
    "speed^2": lambda m: m["speed"] ** 2,
    "speed^3": lambda m: m["speed"] ** 3,
    "speed*|speed|": lambda m: m["speed"] * np.abs(m["speed"]),
    "deflection*speed": lambda m: m["deflection"] * m["speed"],
    "deflection^2*speed": lambda m: m["deflection"] ** 2 * m["speed"],
    "deflection^4*speed": lambda m: m["deflection"] ** 4 * m["speed"],
    "|deflection|*speed": lambda m: np.abs(m["deflection"]) * m["speed"],
    "deflection*speed^2": lambda m: m["deflection"] * m["speed"] ** 2,
    "drive*deflection": lambda m: m["drive"] * m["deflection"],
    "drive*deflection^2": lambda m: m["drive"] * m["deflection"] ** 2,
    "drive*speed": lambda m: m["drive"] * m["speed"],
}
"""Features of the resonator's motion."""

COPIES_OF_THE_DRIVE: Mapping[str, tuple[str, Copy]] = {
    "delayed drive": ("drive_delays_s", lambda m, t: m.delayed("drive", t)),
    "change": ("drive_delays_s", lambda m, t: np.abs(_change(m, t))),
    "squared change": ("drive_delays_s", lambda m, t: _change(m, t) * np.abs(_change(m, t))),
    "lagged drive": ("lags_s", lambda m, t: m.lagged("drive", t)),
    "lagged drive^2": ("lags_s", lambda m, t: m.lagged("drive", t) ** 2),
    "play": ("plays", lambda m, r: m.play("drive", r)),
    "play^2": ("plays", lambda m, r: m.play("drive", r) ** 2),
    "drive*play": ("plays", lambda m, r: m["drive"] * m.play("drive", r)),
}
"""Features with a memory of the drive: the list that they take their times or thresholds from, and the copy."""

COPIES_OF_THE_MOTION: Mapping[str, tuple[str, Copy]] = {
    "delayed deflection": ("motion_delays_s", lambda m, t: m.delayed("deflection", t)),
    "delayed speed": ("motion_delays_s", lambda m, t: m.delayed("speed", t)),
}
"""Features with a memory of the motion."""

SHOWN_COPIES = ("delayed drive", "change")
"""Copies of the drive that a fast channel shows beside the motion."""


def _change(motion: ScaledMotion, delay_s: float) -> Real:
    """Change of the drive within a delay, at most 1 in magnitude."""
    return (motion["drive"] - motion.delayed("drive", delay_s)) / 2


def push_names(times: Times) -> list[str]:
    """Names of all features of a fast channel that are added to the hysteretic drive."""
    return [*OF_THE_DRIVE, *OF_THE_MOTION, *_indexed(COPIES_OF_THE_DRIVE, times)]


def shown_names(times: Times, fast: bool) -> list[str]:
    """Names of all features that are added to a channel's signal."""
    if not fast:
        return [*OF_THE_DRIVE, *_indexed(COPIES_OF_THE_DRIVE, times)]
    drive = {name: COPIES_OF_THE_DRIVE[name] for name in SHOWN_COPIES}
    return [*OF_THE_DRIVE, *OF_THE_MOTION, *_indexed(drive, times), *_indexed(COPIES_OF_THE_MOTION, times)]


def feature(name: str, motion: ScaledMotion, times: Times) -> Real:
    """One feature of a head's signals, shape (nodes,); dimensionless.

    Parameters
    ----------
    name : str
        One of `push_names` or `shown_names`.
    motion : ScaledMotion
        The head's signals.
    times : mapping of str to sequence of float
        Times and thresholds.
    """
    shapes = {**OF_THE_DRIVE, **OF_THE_MOTION}
    if name in shapes:
        return shapes[name](motion)
    kind, _, place = name.partition("@")
    of, copy = {**COPIES_OF_THE_DRIVE, **COPIES_OF_THE_MOTION}[kind]
    return copy(motion, times[of][int(place)])


def _indexed(copies: Mapping[str, tuple[str, Copy]], times: Times) -> list[str]:
    return [f"{name}@{k}" for name, (of, _) in copies.items() for k in range(len(times[of]))]

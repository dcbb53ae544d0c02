"""One line of the proof's table: a figure with its interval and the criterion of a first-rate diagnosis."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkjet_env.experiments.validation.verdict_scores import share

CONFIDENCE = 0.9
RESAMPLES = 2000


@dataclass(frozen=True)
class Goals:
    """Criteria of a first-rate diagnosis; None where there is none.

    Attributes
    ----------
    alarms, wrong, wrong_outside, size, calibration : float
        Largest fraction of false alarms, of wrong names inside and outside the catalogue, mean size of a set, and
        calibration error.
    detected, right, unknown, closure, tenth_closure, f1, worst_coverage, time, frequency : float
        Smallest values.
    """

    alarms: float
    detected: float
    right: float
    size: float
    wrong: float
    wrong_outside: float
    unknown: float
    closure: float
    tenth_closure: float
    f1: float
    worst_coverage: float | None = None
    time: float | None = None
    frequency: float | None = None
    calibration: float | None = None


GOALS = {
    1: Goals(8 / 300, 0.95, 0.90, 1.5, 0.03, 0.10, 0.80, 0.9, 0.6, 0.8),
    2: Goals(0.01, 0.99, 0.95, 1.3, 0.02, 0.05, 0.90, 0.99, 0.9, 0.93, 0.80, 0.80, 0.85, 0.05),
}
"""By version of the corpus."""


@dataclass(frozen=True)
class Figure:
    """A figure of the table.

    Attributes
    ----------
    name : str
        Name of the figure, in words.
    value, low, high : float
        Value and 90 % interval: Wilson's for a proportion, a bootstrap over cases otherwise; NaN if undefined.
    of : int
        Number of cases or other items over which it is computed.
    kind : {"share", "number"}
        Whether it is a proportion, printed in per cent, or a plain number.
    hits : int or None
        Number of hits of a proportion.
    least, most : float or None
        Bounds of the criterion; None if there is no bound.
    """

    name: str
    value: float
    low: float
    high: float
    of: int
    kind: str = "number"
    hits: int | None = None
    least: float | None = None
    most: float | None = None

    @property
    def met(self) -> bool | None:
        """Whether the criterion is met; None if there is no criterion or no value."""
        if (self.least is None and self.most is None) or math.isnan(self.value):
            return None
        return (self.least is None or self.value >= self.least) and (self.most is None or self.value <= self.most)

    @property
    def asked(self) -> str:
        """The criterion as text; empty if there is none."""

        def text(value: float) -> str:
            return f"{100 * value:.3g} %" if self.kind == "share" else f"{value:.3g}"

        if self.least is not None and self.most is not None:
            return f"{text(self.least)} … {text(self.most)}"
        if self.least is not None:
            return f"≥ {text(self.least)}"
        return f"≤ {text(self.most)}" if self.most is not None else ""

    def as_json(self) -> dict[str, Any]:
        """The figure as plain JSON values; undefined numbers are null."""
        numbers = {name: finite(getattr(self, name)) for name in ("value", "low", "high")}
        return {
            "name": self.name,
            **numbers,
            "of": self.of,
            "kind": self.kind,
            "hits": self.hits,
            "least": self.least,
            "most": self.most,
            "asked": self.asked,
            "met": self.met,
        }


def finite(value: float) -> float | None:
    """The number; None if it is not finite."""
    return float(value) if math.isfinite(value) else None


def counted(name: str, hits: Sequence[bool], least: float | None = None, most: float | None = None) -> Figure:
    """A proportion of cases with Wilson's interval."""
    number = int(sum(hits))
    value, low, high = share(number, len(hits), CONFIDENCE)
    return Figure(name, value, low, high, len(hits), "share", number, least, most)


def estimated(
    name: str,
    sample: Sequence[Any],
    statistic: Callable[[Sequence[Any]], float],
    least: float | None = None,
    most: float | None = None,
    kind: str = "number",
) -> Figure:
    """A statistic of cases with its bootstrap percentile interval over them; the same numbers at every call.

    A single case gives no interval.
    """
    if len(sample) < 2:
        value = statistic(sample) if sample else math.nan
        return Figure(name, value, math.nan, math.nan, len(sample), kind, None, least, most)
    rng = np.random.default_rng(0)
    places: NDArray[np.int64] = rng.integers(0, len(sample), (RESAMPLES, len(sample)))
    if isinstance(sample[0], float | tuple):  # numbers, drawn from an array: it is quicker
        numbers = np.array(sample, dtype=float)
        drawn = np.array([statistic(numbers[row]) for row in places])
    else:
        drawn = np.array([statistic([sample[k] for k in row]) for row in places])
    drawn = drawn[np.isfinite(drawn)]
    tails = 50 * (1 - CONFIDENCE)
    low, high = np.percentile(drawn, [tails, 100 - tails]) if drawn.size else (math.nan, math.nan)
    return Figure(name, statistic(sample), float(low), float(high), len(sample), kind, None, least, most)

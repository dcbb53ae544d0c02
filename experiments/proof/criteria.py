"""One line of the table: a figure with its interval, beside what is asked of a first-rate diagnosis."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.validation.verdict_scores import share

CONFIDENCE = 0.9
RESAMPLES = 2000


@dataclass(frozen=True)
class Figure:
    """A figure of the table.

    Attributes
    ----------
    name : str
        In words.
    value, low, high : float
        With the 90 % interval: Wilson's for a share, a bootstrap over cases for anything else; NaN where nothing tells.
    of : int
        Number of cases, or of what else it is counted over.
    kind : {"share", "number"}
    hits : int or None
        Of a share.
    least, most : float or None
        What is asked; None where nothing is.
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
        """Whether it is as good as asked; None where nothing is asked, or nothing was counted."""
        if (self.least is None and self.most is None) or math.isnan(self.value):
            return None
        return (self.least is None or self.value >= self.least) and (self.most is None or self.value <= self.most)

    @property
    def asked(self) -> str:
        """What is asked, in words; empty where nothing is."""

        def told(value: float) -> str:
            return f"{100 * value:.3g} %" if self.kind == "share" else f"{value:.3g}"

        if self.least is not None and self.most is not None:
            return f"{told(self.least)} … {told(self.most)}"
        if self.least is not None:
            return f"≥ {told(self.least)}"
        return f"≤ {told(self.most)}" if self.most is not None else ""

    def as_json(self) -> dict[str, Any]:
        """Plain JSON values; what does not exist is null."""
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
    """The number, or None where it is none."""
    return float(value) if math.isfinite(value) else None


def counted(name: str, hits: Sequence[bool], least: float | None = None, most: float | None = None) -> Figure:
    """A share of cases, with Wilson's interval."""
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
    """A statistic of cases, with the percentiles of its bootstrap over them; the same numbers at every call.

    One case tells nothing of the spread, and has no interval.
    """
    if len(sample) < 2:
        value = statistic(sample) if sample else math.nan
        return Figure(name, value, math.nan, math.nan, len(sample), kind, None, least, most)
    rng = np.random.default_rng(0)
    places: NDArray[np.int64] = rng.integers(0, len(sample), (RESAMPLES, len(sample)))
    drawn = np.array([statistic([sample[k] for k in row]) for row in places])
    drawn = drawn[np.isfinite(drawn)]
    tails = 50 * (1 - CONFIDENCE)
    low, high = np.percentile(drawn, [tails, 100 - tails]) if drawn.size else (math.nan, math.nan)
    return Figure(name, statistic(sample), float(low), float(high), len(sample), kind, None, least, most)

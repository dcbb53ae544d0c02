"""Peak cost of a response: the weighted sum of its peaks.

    J = A min(|y_e|, target_height_V) + B |y_{e+1}| + Σ |y_i| over all other peaks                         (9)

with the equation numbered as in docs/explanation/model.md, and an infinite ``target_height_V`` in the paper.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.naming import nearest_name

LARGEST_WEIGHT = 1e6
"""Largest magnitude of a weight; dimensionless."""

EFFECTIVE_RULES = ("largest", "first")


@dataclass(frozen=True)
class PeakCost:
    """Peak cost ``A min(|y_e|, target_height_V) + B|y_{e+1}| + Σ|y_i|``, Eq. (9) (Zhu et al. 2024, section 2.3).

    Parameters
    ----------
    A : float
        Weight of the effective peak ``y_e``, dimensionless; negative, since that peak ejects the drop.
    B : float
        Weight of the peak after it, dimensionless.
    effective : {"largest", "first"} or float
        Which peak ejects: the largest in magnitude (the earliest of equals), the first (the formula as printed), or
        the first whose magnitude reaches this threshold in volts. Where no peak reaches it, every peak has weight one.
    target_height_V : float
        Magnitude in volts that a drop of the wanted size needs; the effective peak counts no further beyond it. With a
        weight A that outweighs what each volt of it costs elsewhere, the best waveform reaches this magnitude and
        rings least. Infinite by default, as in the paper's formula.

    Examples
    --------
    >>> PeakCost(-5, 5)([6.0, -1.0, 0.5])
    -24.5
    """

    A: float = -5.0
    B: float = 5.0
    effective: str | float = "largest"
    target_height_V: float = math.inf

    def __post_init__(self) -> None:
        if not (isinstance(self.target_height_V, (int, float)) and self.target_height_V > 0):
            raise ValueError(
                f"target_height_V must be a magnitude above 0 V, or infinite; got {self.target_height_V!r}."
            )
        for name in ("A", "B"):
            value = getattr(self, name)
            if not (isinstance(value, (int, float)) and abs(value) <= LARGEST_WEIGHT):
                raise ValueError(f"{name} must be a number within ±{LARGEST_WEIGHT:g}; got {value!r}.")
        if isinstance(self.effective, str):
            if self.effective not in EFFECTIVE_RULES:
                raise ValueError(
                    f"effective must be 'largest', 'first' or a threshold in volts; got {self.effective!r}."
                    + nearest_name(self.effective, EFFECTIVE_RULES)
                )
        elif not (isinstance(self.effective, (int, float)) and math.isfinite(self.effective) and self.effective >= 0):
            raise ValueError(
                f"effective must be 'largest', 'first' or a threshold of at least 0 V; got {self.effective!r}."
            )

    def effective_index(self, peaks_V: ArrayLike) -> int | None:
        """Index of the effective peak among ``peaks_V`` (in time order), or None if there is none."""
        magnitude = np.abs(np.asarray(peaks_V, dtype=np.float64))
        if magnitude.size == 0:
            return None
        if self.effective == "largest":
            return int(np.argmax(magnitude))
        if self.effective == "first":
            return 0
        reached = magnitude >= float(self.effective)
        return int(np.argmax(reached)) if reached.any() else None

    def weights(self, peaks_V: ArrayLike) -> np.ndarray:
        """Weight of each peak's magnitude in the cost, same shape as ``peaks_V``."""
        weights = np.ones(np.shape(peaks_V))
        e = self.effective_index(peaks_V)
        if e is not None:
            weights[e] = self.A
            if e + 1 < weights.size:
                weights[e + 1] = self.B
        return weights

    def __call__(self, peaks_V: ArrayLike, tail_V: float = 0.0) -> float:
        """Cost in volts of peaks in time order; ``tail_V`` is the summed magnitude of peaks after the listed ones."""
        magnitude = np.abs(np.asarray(peaks_V, dtype=np.float64))
        weights, e = self.weights(peaks_V), self.effective_index(peaks_V)
        if e is not None:
            magnitude[e] = min(magnitude[e], self.target_height_V)
        return float(weights @ magnitude + tail_V)  # Eq. (9)

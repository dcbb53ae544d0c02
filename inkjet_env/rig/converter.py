"""Analogue-to-digital converter with a range and a step; it raises an error instead of clipping."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.typing import Real


@dataclass(frozen=True)
class Converter:
    """A uniform quantiser over a range.

    Parameters
    ----------
    low, high : float
        Ends of the range, in the recorded unit.
    bits : int or None
        Resolution, ``2**bits`` codes; None is an ideal converter, without steps.

    Examples
    --------
    >>> Converter(0.0, 4.0, 3).quantised([0.2, 0.3, 3.1])
    array([0. , 0.5, 3. ])
    """

    low: float
    high: float
    bits: int | None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise ValueError(
                f"the converter's range must be finite, low below high; got {self.low!r} to {self.high!r}."
            )
        if self.bits is not None and not (isinstance(self.bits, int) and 1 <= self.bits <= 32):
            raise ValueError(f"bits must be a whole number from 1 to 32, or None for no steps; got {self.bits!r}.")

    @property
    def step(self) -> float:
        """Size of one code in the recorded unit; 0 for an ideal converter."""
        return 0.0 if self.bits is None else (self.high - self.low) / 2**self.bits

    def quantised(self, values: ArrayLike) -> Real:
        """Output of the converter, same shape: the nearest of ``low + k step``, in the recorded unit.

        Raises
        ------
        ValueError
            A value is outside the range: a virtual rig does not clip silently.
        """
        values = np.asarray(values, dtype=np.float64)
        least, most = float(values.min()), float(values.max())
        if not (self.low <= least and most <= self.high):
            raise ValueError(
                f"the signal must stay within the converter's range of {self.low:g} to {self.high:g}; it goes from "
                f"{least:.4g} to {most:.4g}. Lower the gain or widen the range."
            )
        if self.bits is None:
            return values.copy()
        code = np.round((values - self.low) / self.step)
        return self.low + self.step * np.minimum(code, 2**self.bits - 1)

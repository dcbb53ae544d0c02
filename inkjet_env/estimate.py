"""A number with its confidence interval."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Estimate:
    """A number with its confidence interval, 90 % or 95 % as whoever makes it says.

    Parameters
    ----------
    value : float
        The estimate itself.
    low, high : float
        Ends of the interval, in the unit of ``value``; NaN or infinite where the data do not bound it.
    """

    value: float
    low: float
    high: float

    def as_json(self) -> dict[str, float | None]:
        """``value``, ``low`` and ``high`` as plain JSON values; null where one is not finite.

        Examples
        --------
        >>> Estimate(1.5, 1.0, math.inf).as_json()
        {'value': 1.5, 'low': 1.0, 'high': None}
        """
        return {name: number if math.isfinite(number) else None for name, number in vars(self).items()}

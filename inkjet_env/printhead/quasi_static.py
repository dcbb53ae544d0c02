"""A printhead of which only the hysteresis is known, because nothing fast was recorded."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NoReturn

from inkjet_env.printhead.hysteresis import BranchLaw
from inkjet_env.printhead.printhead import Printhead, UnknownDynamicsError

UNKNOWN_DYNAMICS = (
    "the dynamics a0, a1 and b1 of this printhead are unknown, because it was identified from slow recordings alone. "
    "Record pulses and a multisine with self_sensing or a fast displacement sensor and identify it again; `inkjet "
    "record --plan FOLDER` writes such drives."
)
"""Why nothing fast can be computed with such a head, and what to do about it."""
INTERVALS = {"a0": (0.0, math.inf), "a1": (0.0, math.inf), "b1": (-math.inf, math.inf)}
"""What is known of each coefficient of the dynamics: nothing."""


def _unknown(self: Printhead) -> NoReturn:
    raise UnknownDynamicsError(UNKNOWN_DYNAMICS)


class QuasiStaticPrinthead(Printhead):
    """A printhead without dynamics: the branch law of the hysteresis alone, as slow recordings determine it.

    A strain gauge, or a slow displacement sensor, can be simulated with it. Whatever needs the resonator reads ``a0``,
    ``a1`` or ``b1`` and gets an `UnknownDynamicsError`, a ``ValueError`` that says which recording is missing.

    Parameters
    ----------
    coefficients : tuple of float
        Dimensionless coefficients of the branch law, highest power first.
    full_scale_V : float
        Change of drive at ``x = 1``, in volts.

    Examples
    --------
    >>> head = QuasiStaticPrinthead((0.2, 0.8, 0.0))
    >>> head.has_dynamics, head.branch_law.Q(0.5)
    (False, 0.45)
    """

    a0 = property(_unknown)
    a1 = property(_unknown)
    b1 = property(_unknown)
    has_dynamics = False

    def __init__(self, coefficients: tuple[float, ...], full_scale_V: float = 180.0) -> None:
        object.__setattr__(self, "full_scale_V", full_scale_V)
        object.__setattr__(self, "coefficients", BranchLaw(coefficients, full_scale_V).coefficients)

    @classmethod
    def of(cls, printhead: Printhead) -> QuasiStaticPrinthead:
        """The hysteresis of a head, without its dynamics."""
        return cls(printhead.coefficients, printhead.full_scale_V)

    def with_dynamics(self) -> NoReturn:
        """Raise the `UnknownDynamicsError`, where a head with dynamics is needed."""
        _unknown(self)

    def with_placeholder(self, frequency_Hz: float = 50e3) -> Printhead:
        """The same hysteresis with any resonator, for code that takes a whole head but simulates slow channels alone.

        Parameters
        ----------
        frequency_Hz : float
            Resonance of the placeholder. Nothing that is computed for a slow channel depends on it, except the scale
            of times from which fits of effects start.
        """
        omega = 2 * math.pi * max(frequency_Hz, 1.0)
        return Printhead(omega * omega, 0.1 * omega, omega, self.coefficients, self.full_scale_V)

    def as_json(
        self, intervals: Mapping[str, tuple[float, float]] | None = None, fit: Mapping[str, Any] | None = None
    ) -> dict[str, Any]:
        """Content of the file that `to_json` writes: every number of the dynamics is null, and a sentence says why."""
        nothing = {
            name: {"value": None, "low": low if math.isfinite(low) else None, "high": None}
            for name, (low, _) in INTERVALS.items()
        }
        sentence = f"{UNKNOWN_DYNAMICS[0].upper()}{UNKNOWN_DYNAMICS[1:]}"
        return self._json(nothing, fit) | {"dynamics_unknown": sentence}

    def __repr__(self) -> str:
        return f"QuasiStaticPrinthead(coefficients={self.coefficients}, full_scale_V={self.full_scale_V})"

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, QuasiStaticPrinthead):
            return NotImplemented
        return (self.coefficients, self.full_scale_V) == (other.coefficients, other.full_scale_V)

    def __hash__(self) -> int:
        return hash((self.coefficients, self.full_scale_V))

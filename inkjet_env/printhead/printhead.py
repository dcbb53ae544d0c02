"""The printhead: hysteresis, then a second-order resonator; its parameters, and how they are written.

Equations are numbered as in docs/explanation/model.md.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NoReturn

from inkjet_env.printhead.hysteresis import BranchLaw
from inkjet_env.printhead.printhead_json import effect_ids, parameters_of, printhead_data
from inkjet_env.printhead.resonator import ImpossibleHeadError, check_resonator
from inkjet_env.printhead.response import Response
from inkjet_env.printhead.waveform import Waveform
from inkjet_env.printhead.window import DEFAULT_WINDOW_S, window_in_train
from inkjet_env.storage import write_json

UNKNOWN_DYNAMICS = (
    "the dynamics a0, a1 and b1 of this printhead are unknown, because it was identified from slow recordings alone. "
    "Record pulses and a multisine with self_sensing or a fast displacement sensor and identify it again; `inkjet "
    "record --plan FOLDER` writes such drives."
)
"""Why nothing fast can be computed with such a head, and what to do about it."""
UNKNOWN_INTERVALS = {"a0": (0.0, math.inf), "a1": (0.0, math.inf), "b1": (-math.inf, math.inf)}
"""What is known of each coefficient of the dynamics: nothing."""


class UnknownDynamicsError(ValueError):
    """``a0``, ``a1`` or ``b1`` of a head of which only the hysteresis is known; the message says what to record."""


@dataclass(frozen=True)
class Printhead:
    """A piezo printhead: branch law of the hysteresis, Eq. (3), then ``G_s(s) = b1 s / (s² + a1 s + a0)``, Eq. (7).

    Parameters
    ----------
    a0, a1, b1 : float
        Coefficients of the resonator, in 1/s², 1/s and 1/s (Zhu et al. 2024, section 3.2).
    coefficients : tuple of float
        Dimensionless coefficients of the branch law ``Q``, highest power first (section 3.1); see `BranchLaw`.
    full_scale_V : float
        Change of drive at ``x = 1``, in volts.

    Examples
    --------
    >>> head = Printhead.published()
    >>> round(head.frequency_Hz), round(head.damping_ratio, 4)
    (51695, 0.0469)
    """

    a0: float
    a1: float
    b1: float
    coefficients: tuple[float, ...]
    full_scale_V: float = 180.0
    has_dynamics: ClassVar[bool] = True
    """Whether ``a0``, ``a1`` and ``b1`` are known; False for a `QuasiStaticPrinthead`."""

    def __post_init__(self) -> None:
        check_resonator(self.a0, self.a1)
        if not (math.isfinite(self.b1) and self.b1 != 0):
            raise ImpossibleHeadError(f"b1 must be finite and not 0: the head must respond; got {self.b1!r}.")
        if not 1.0 <= self.frequency_Hz <= 1e9:
            raise ImpossibleHeadError(
                f"a0 must give a resonance of 1 Hz to 1 GHz; {self.a0:g} 1/s² gives {self.frequency_Hz:g} Hz."
            )
        if not 1e-9 <= abs(self.b1 / self.a1) <= 1e9:
            raise ImpossibleHeadError(
                f"b1 / a1, the gain at resonance, must be 1e-9 to 1e9; got {self.b1 / self.a1:g}. Check the units."
            )
        object.__setattr__(self, "coefficients", self.branch_law.coefficients)

    @classmethod
    def published(cls) -> Printhead:
        """The head identified by Zhu et al. 2024: ``A`` of section 3.1, ``a0, a1, b1`` of section 3.2.

        Its ``Q''`` is slightly negative (down to −0.054) for 0.836 < x < 0.886, so it is not quite a valid PI density.
        """
        return cls(
            a0=1.055e11,
            a1=3.046e4,
            b1=1.907e4,
            coefficients=(19.014, -75.155, 120.8, -101.21, 46.92, -11.697, 1.5782, 0.74743, 0.0),
        )

    @classmethod
    def from_json(cls, path: str | os.PathLike[str]) -> Printhead:
        """Read a ``printhead/1`` file; ``ValueError`` names the file and the broken rule.

        A file whose dynamics are null gives a `QuasiStaticPrinthead`.
        """
        data = printhead_data(path)
        if ids := effect_ids(data) + (["an unexplained remainder"] if data.get("remainder") else []):
            raise ValueError(
                f"{path}: has effects beyond the base model ({', '.join(ids)}), which a Printhead cannot represent. "
                "Use something that can: inkjet simulate, optimize, evaluate, gymnasium.make, or "
                "inkjet_env.plant.printhead_file.read_printhead."
            )
        try:
            return cls.from_data(data)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> Printhead:
        """Head described by the content of a ``printhead/1`` file, without effects; ``ValueError`` names the rule."""
        values = parameters_of(data)
        return cls(**values) if "a0" in values else QuasiStaticPrinthead(**values)

    def to_json(
        self,
        path: str | os.PathLike[str],
        intervals: Mapping[str, tuple[float, float]] | None = None,
        fit: Mapping[str, Any] | None = None,
    ) -> None:
        """Write a ``printhead/1`` file.

        Parameters
        ----------
        path : path
            Destination; written atomically.
        intervals : mapping of str to (low, high), optional
            90 % confidence intervals of ``a0``, ``a1``, ``b1``, in their units; the interval of a value that was given,
            not identified, is a point. An infinite end, of a value that no recording determines, is written as null.
        fit : mapping, optional
            Quality of the fit to the recordings from which the head was identified, such as ``noise_rms_V``.
        """
        write_json(path, self.as_json(intervals, fit))

    def as_json(
        self, intervals: Mapping[str, tuple[float, float]] | None = None, fit: Mapping[str, Any] | None = None
    ) -> dict[str, Any]:
        """Content of the file that `to_json` writes."""
        dynamics = {}
        for name, value in (("a0", self.a0), ("a1", self.a1), ("b1", self.b1)):
            low, high = (intervals or {}).get(name, (value, value))
            numbers = {"value": value, "low": low, "high": high}
            dynamics[name] = {key: v if math.isfinite(v) else None for key, v in numbers.items()}
        return self._json(dynamics, fit)

    def _json(self, dynamics: Mapping[str, Any], fit: Mapping[str, Any] | None) -> dict[str, Any]:
        """Content of a ``printhead/1`` file with these dynamics."""
        hysteresis = {
            "coefficients": list(self.coefficients),
            "full_scale_V": self.full_scale_V,
            "degree": len(self.coefficients) - 1,
        }
        return {"format": "printhead/1", "dynamics": dict(dynamics), "hysteresis": hysteresis, "fit": dict(fit or {})}

    @property
    def frequency_Hz(self) -> float:
        """Undamped natural frequency ``√a0 / 2π``, in hertz."""
        return math.sqrt(self.a0) / (2 * math.pi)

    @property
    def damping_ratio(self) -> float:
        """Damping ratio ``ζ = a1 / (2 √a0)``, dimensionless."""
        return self.a1 / (2 * math.sqrt(self.a0))

    @cached_property
    def branch_law(self) -> BranchLaw:
        """Branch law of the hysteresis."""
        return BranchLaw(self.coefficients, self.full_scale_V)

    def varied(
        self,
        frequency_Hz: float | None = None,
        damping_ratio: float | None = None,
        gain: float = 1.0,
        hysteresis_strength: float = 1.0,
    ) -> Printhead:
        """Head with another resonance, ``b1`` times ``gain`` and the PI density times ``hysteresis_strength``."""
        frequency = self.frequency_Hz if frequency_Hz is None else frequency_Hz
        damping = self.damping_ratio if damping_ratio is None else damping_ratio
        omega = 2 * math.pi * frequency
        return Printhead(
            a0=self.a0 if frequency_Hz is None else omega * omega,
            a1=self.a1 if frequency_Hz is None and damping_ratio is None else 2 * damping * omega,
            b1=self.b1 * gain,
            coefficients=self.branch_law.strengthened(hysteresis_strength).coefficients,
            full_scale_V=self.full_scale_V,
        )

    def respond(
        self,
        waveform: Waveform,
        initial_state: str = "periodic",
        window_s: float = DEFAULT_WINDOW_S,
        hysteresis: str = "full_memory",
        period_s: float = math.inf,
        earlier_drops: float = math.inf,
    ) -> Response:
        """Response to one waveform; the resonator is at rest at its start unless a period is given.

        Parameters
        ----------
        waveform : Waveform
            The drive.
        initial_state : {"periodic", "demagnetised"}
            State of the hysteresis: the waveform has been repeated, or it starts on the virgin curve.
        window_s : float
            Peaks later than this after the waveform's start do not count, in seconds; may be infinite.
        hysteresis : {"full_memory", "one_point", "play_operators"}
            Model of the hysteresis; see `inkjet_env.printhead.hysteresis.HYSTERESIS_MODELS`.
        period_s : float
            Firing period in seconds: the waveform has been repeated for ever and starts in the residual vibration of
            all those before it; peaks count within one period. Infinite, the default: the head is at rest.
        earlier_drops : float
            Number of waveforms fired before this one at that period, from rest; peaks then count within the window.
            Infinite, the default: for ever.

        Returns
        -------
        Response
            Peaks, and the signals at any time.

        Examples
        --------
        >>> head = Printhead.published()
        >>> response = head.respond(Waveform(100, -100, 1e-6, 10.481e-6, 13.769e-6, 9.613e-6, 20e-6))
        >>> response.peaks_V[:5].round(2)
        array([ 6.19, -6.94,  0.65, -0.52,  1.9 ])
        """
        time_s, drive_V = waveform.knots()
        period_s, window_s = window_in_train(window_s, period_s, earlier_drops, waveform.duration_s, initial_state)
        return Response(self, time_s, drive_V, initial_state, window_s, hysteresis, period_s, earlier_drops)


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
    >>> head.has_dynamics, float(head.branch_law.Q(0.5))
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
            for name, (low, _) in UNKNOWN_INTERVALS.items()
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

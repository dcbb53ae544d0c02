"""The printhead: hysteresis, then a second-order resonator; its response to one waveform.

Equations are numbered as in docs/explanation/model.md.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import ArrayLike

from inkjet_env.naming import check_name
from inkjet_env.printhead.cost import PeakCost
from inkjet_env.printhead.hysteresis import HYSTERESIS_MODELS, BranchLaw, PlayOperators, periods_before_recording
from inkjet_env.printhead.resonator import PiecewiseResponse, check_resonator
from inkjet_env.printhead.waveform import Waveform
from inkjet_env.storage import write_json
from inkjet_env.typing import Real

DEFAULT_WINDOW_S = 350e-6
"""Time after the waveform's start within which peaks count, in seconds."""

LONGEST_WINDOW_S = 0.01
"""Longest finite window accepted, in seconds."""

PLAY_OPERATORS = 200
"""Number of plays in the classic PI model, ``hysteresis="play_operators"``."""


def check_window(window_s: float) -> float:
    """Return the window in seconds; ``ValueError`` unless it is above 0 s and at most 0.01 s, or infinite."""
    if isinstance(window_s, (int, float, np.number)) and (0 < window_s <= LONGEST_WINDOW_S or window_s == math.inf):
        return float(window_s)
    raise ValueError(
        f"window_s must be a time above 0 s and at most {LONGEST_WINDOW_S:g} s, or infinite; got {window_s!r}. "
        "It is in seconds: 350 µs is 350e-6."
    )


def check_period(period_s: float, duration_s: float, initial_state: str) -> float:
    """Return the period in seconds; ``ValueError`` unless it holds the waveform and repetition has a steady state."""
    if period_s == math.inf:
        return math.inf
    if not (isinstance(period_s, (int, float, np.number)) and period_s > 0):
        raise ValueError(f"period_s must be a time above 0 s, or infinite; got {period_s!r}. 20 kHz is 50e-6 s.")
    if duration_s > period_s * (1 + 1e-12):
        raise ValueError(
            f"a waveform of {duration_s:g} s does not fit into a period of {period_s:g} s. Shorten it, or fire slower."
        )
    if periods_before_recording(initial_state) == 0:
        raise ValueError('period_s needs initial_state="periodic": only a repeated waveform has a steady state.')
    return float(period_s)


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

    def __post_init__(self) -> None:
        check_resonator(self.a0, self.a1)
        if not (math.isfinite(self.b1) and self.b1 != 0):
            raise ValueError(f"b1 must be finite and not 0: the head must respond; got {self.b1!r}.")
        if not 1.0 <= self.frequency_Hz <= 1e9:
            raise ValueError(
                f"a0 must give a resonance of 1 Hz to 1 GHz; {self.a0:g} 1/s² gives {self.frequency_Hz:g} Hz."
            )
        if not 1e-9 <= abs(self.b1 / self.a1) <= 1e9:
            raise ValueError(
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
        """Read a ``printhead/1`` file; ``ValueError`` names the file and the broken rule."""
        data = printhead_data(path)
        if ids := effect_ids(data):
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
        values = {name: _number(data, "dynamics", name, "value") for name in ("a0", "a1", "b1")}
        values["full_scale_V"] = _number(data, "hysteresis", "full_scale_V")
        coefficients = _entry(data, "hysteresis", "coefficients")
        if not isinstance(coefficients, list):
            raise ValueError(f"hysteresis.coefficients must be a list of numbers; got {coefficients!r}.")
        numbers = (_number({"coefficients": c}, "coefficients") for c in coefficients)
        return cls(coefficients=tuple(numbers), **values)

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
        hysteresis = {
            "coefficients": list(self.coefficients),
            "full_scale_V": self.full_scale_V,
            "degree": len(self.coefficients) - 1,
        }
        return {"format": "printhead/1", "dynamics": dynamics, "hysteresis": hysteresis, "fit": dict(fit or {})}

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
        period_s = check_period(period_s, waveform.duration_s, initial_state)
        window_s = min(check_window(window_s), period_s)
        return Response(self, time_s, drive_V, initial_state, window_s, hysteresis, period_s)


def printhead_data(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Content of a ``printhead/1`` file; ``ValueError`` names the file if it is not one."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise ValueError(f"{path}: cannot be read: {reason}. Check the file's name.") from None
    try:
        data: Any = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: is not JSON ({error}). Is this a printhead file?") from None
    if not isinstance(data, dict) or data.get("format") != "printhead/1":
        got = data.get("format") if isinstance(data, dict) else type(data).__name__
        raise ValueError(f'{path}: "format" must be "printhead/1"; got {got!r}. Is this a printhead file?')
    return data


def effect_ids(data: Mapping[str, Any]) -> list[str]:
    """Ids of the effects in the content of a ``printhead/1`` file; empty for the base model."""
    effects = data.get("effects") or []
    if not isinstance(effects, list):
        return ["effects"]
    return [str(entry.get("id")) if isinstance(entry, dict) else "?" for entry in effects]


def _entry(data: Any, *keys: str) -> Any:
    """Entry of a ``printhead/1`` file under nested keys."""
    for depth, key in enumerate(keys):
        if not isinstance(data, dict) or key not in data:
            raise ValueError(f"has no {'.'.join(keys[: depth + 1])}, which a printhead/1 file needs.")
        data = data[key]
    return data


def _number(data: Any, *keys: str) -> float:
    value = _entry(data, *keys)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or abs(value) > 1e300:
        raise ValueError(f"{'.'.join(keys)} must be a number; got {str(value)[:40]}.")
    return float(value)


@dataclass(frozen=True)
class Response:
    """Response of a head to a piecewise-linear drive that starts at time 0; made by `Printhead.respond`.

    Attributes
    ----------
    printhead : Printhead
        The head.
    knot_times_s, knot_drive_V : ndarray, shape (n,)
        Times in seconds and drive in volts at the knots of the drive.
    initial_state, window_s, hysteresis, period_s
        As in `Printhead.respond`.
    peak_times_s, peaks_V : ndarray, shape (k,)
        Times in seconds and signed values in volts of every local extremum of the self-sensed signal within the window,
        in time order.
    tail_V : float
        Summed magnitude of the extrema beyond those listed, in volts (infinite window only).
    """

    printhead: Printhead
    knot_times_s: Real
    knot_drive_V: Real
    initial_state: str
    window_s: float
    hysteresis: str = "full_memory"
    period_s: float = math.inf

    def __post_init__(self) -> None:
        check_name("hysteresis", self.hysteresis, HYSTERESIS_MODELS)
        times, values, tail = self._ringing.extrema(self.window_s)
        object.__setattr__(self, "peak_times_s", times)
        object.__setattr__(self, "peaks_V", values)
        object.__setattr__(self, "tail_V", tail)

    peak_times_s: Real = field(init=False)
    peaks_V: Real = field(init=False)
    tail_V: float = field(init=False)

    @cached_property
    def _ringing(self) -> PiecewiseResponse:
        head, law = self.printhead, self.printhead.branch_law
        if self.hysteresis == "play_operators":
            plays = PlayOperators.of_branch_law(law, PLAY_OPERATORS)
            rows = plays.pieces(self.knot_drive_V, self.initial_state)
            rates = rows[:, 3:4]
        else:
            rows = law.pieces(self.knot_drive_V, self.initial_state, self.hysteresis == "one_point")
            rates = branch_rates(law, rows)
        segment_s = np.diff(self.knot_times_s)
        durations: list[float] = []
        polynomials: list[Real] = []
        for segment, duration in enumerate(segment_s):
            mine = rows[:, 0] == segment
            durations.extend(rows[mine, 2] * duration if mine.any() else [duration])
            polynomials.extend(rates[mine] if mine.any() else np.zeros((1, rates.shape[1])))
        from_rest = PiecewiseResponse(head.a0, head.a1, head.b1, np.array(durations), np.array(polynomials))
        if math.isinf(self.period_s):
            return from_rest
        rest_s = max(self.period_s - float(from_rest.start_s[-1]), 0.0)
        left = from_rest.amplitude[-1] * np.exp(from_rest.pole * rest_s)
        return replace(from_rest, start_state=complex(left / (1 - np.exp(from_rest.pole * self.period_s))))

    def drive_V(self, time_s: ArrayLike) -> Real:
        """Drive in volts at times in seconds, same shape."""
        return np.interp(
            np.asarray(time_s, dtype=np.float64),
            self.knot_times_s,
            self.knot_drive_V,
            left=0.0,
            right=float(self.knot_drive_V[-1]),
        )

    def hysteretic_V(self, time_s: ArrayLike) -> Real:
        """Hysteretic drive in volts at times in seconds, same shape; zero at the start."""
        ringing = self._ringing
        antiderivative = np.array([poly.polyint(rate) for rate in ringing.rate_V])
        at_start = np.concatenate([[0.0], np.cumsum(antiderivative.sum(axis=1))])
        time = np.asarray(time_s, dtype=np.float64)
        where = np.searchsorted(ringing.start_s, time.ravel(), side="right") - 1
        value = np.where(where < 0, 0.0, at_start[np.clip(where, 0, None)])
        inside = (where >= 0) & (where < ringing.duration_s.size)
        piece = where[inside]
        tau = (time.ravel()[inside] - ringing.start_s[piece]) / ringing.duration_s[piece]
        value[inside] += np.sum(antiderivative[piece] * tau[:, None] ** np.arange(antiderivative.shape[1]), axis=1)
        return value.reshape(time.shape)

    def sensor_V(self, time_s: ArrayLike) -> Real:
        """Self-sensed signal in volts at times in seconds, same shape."""
        return self._ringing.sensor_V(time_s)

    def deflection_V(self, time_s: ArrayLike) -> Real:
        """Deflection at times in seconds, same shape, as the static hysteretic drive that would hold it, in volts.

        It is ``a0 / (s² + a1 s + a0)`` on the hysteretic drive, zero at the start, and follows from the state of the
        resonator: ``v - (a1 y + y') / b1`` with ``y`` the self-sensed signal. Multiplied by the static gain it is a
        displacement.
        """
        ringing = self._ringing
        amplitude = ringing.amplitude_at(time_s)
        # y' = Im λA and y = Im A, Eq. (8a) of `resonator`; b1 cancels.
        moved = ((ringing.pole + self.printhead.a1) * amplitude).imag
        return self.hysteretic_V(time_s) - moved / self.printhead.b1

    def cost(self, peak_cost: PeakCost | None = None) -> float:
        """Peak cost in volts; the default is `PeakCost()`."""
        return (peak_cost or PeakCost())(self.peaks_V, self.tail_V)


def branch_rates(law: BranchLaw, pieces: Real) -> Real:
    """``dv/dτ`` on branch pieces as polynomials of ``τ``, lowest power first, in volts: shape (pieces, degree)."""
    slope = poly.polyder(law.ascending)
    rates = np.zeros((len(pieces), slope.size))
    for row, (x, dx, scale) in zip(rates, pieces[:, 3:6], strict=True):
        if x >= 1.0:
            row[0] = scale * dx * float(law.slope(1.0))
            continue
        derivative = slope
        for k in range(slope.size):  # Taylor coefficients of Q' at x, Eq. (3) and (5) of `hysteresis`
            row[k] = scale * dx ** (k + 1) * poly.polyval(x, derivative) / math.factorial(k)
            derivative = poly.polyder(derivative)
    return rates

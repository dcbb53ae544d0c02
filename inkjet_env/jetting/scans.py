"""Scans of a waveform on a head: pulse width, voltage and jetting frequency, and a map of its robustness."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from inkjet_env.naming import check_name
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import PeakCost, Printhead, Waveform
from inkjet_env.printhead.waveform import LARGEST_DRIVE_V, LONGEST_DURATION_S, PARAMETER_NAMES
from inkjet_env.printhead.window import DEFAULT_WINDOW_S, check_window
from inkjet_env.typing import Real

LOWEST_Hz = 1e3
"""Lowest jetting frequency of a sweep, in hertz."""
WIDEST_PERIODS = 2.0
"""Largest pulse width of a scan, in periods of the head's resonance."""
VOLTAGE_FACTORS = (0.05, 1.2)
"""Smallest and largest factor of both voltages."""
RELATIVE = 0.05
"""Relative half width of a robustness map."""
STEADY = 0.1
"""Relative change of the effective peak with the jetting frequency that still counts as steady."""
SAMPLES_A_PERIOD = 64
"""Times in the last period of the resonance before the next drop at which the residual vibration is read."""


@dataclass(frozen=True, eq=False)
class Curve:
    """Figures of merit against one quantity.

    Attributes
    ----------
    quantity, unit : str
        What is varied, and its unit.
    values : ndarray, shape (n,)
        Its values, increasing.
    effective_V : ndarray, shape (n,)
        Height of the effective peak in volts; NaN where there is none.
    residual_V : ndarray, shape (n,)
        Residual vibration in volts. Of a single drop: the largest peak after the effective one. In a sweep of the
        jetting frequency: the largest magnitude in the last period of the resonance before the next drop starts, or
        since the waveform's end if that is later.
    cost_V : ndarray, shape (n,)
        Peak cost in volts.
    """

    quantity: str
    unit: str
    values: Real
    effective_V: Real
    residual_V: Real
    cost_V: Real

    def as_json(self) -> dict[str, Any]:
        """The curve as plain JSON values; null where there is no effective peak."""
        columns = {name: [_finite(v) for v in getattr(self, name)] for name in ("effective_V", "residual_V", "cost_V")}
        return {"quantity": self.quantity, "unit": self.unit, "values": self.values.tolist(), **columns}


@dataclass(frozen=True, eq=False)
class RobustnessMap:
    """Peak cost around a waveform, against relative changes of two of its parameters.

    Attributes
    ----------
    names : tuple of two str
        The parameters: of the columns, and of the rows.
    changes : ndarray, shape (n,)
        Relative changes of each, from ``-RELATIVE`` to ``RELATIVE``; the middle is 0.
    cost_V : ndarray, shape (n, n)
        Peak costs in volts; row i, column k: second parameter changed by ``changes[i]``, first by ``changes[k]``.
    """

    names: tuple[str, str]
    changes: Real
    cost_V: Real

    @property
    def middle_V(self) -> float:
        """Cost of the waveform itself, in volts."""
        middle = self.changes.size // 2
        return float(self.cost_V[middle, middle])

    @property
    def loss_V(self) -> float:
        """Largest increase of the cost on the map, in volts."""
        return float(self.cost_V.max()) - self.middle_V

    def as_json(self) -> dict[str, Any]:
        """The map as plain JSON values."""
        return {
            "names": list(self.names), "changes": self.changes.tolist(), "cost_V": self.cost_V.tolist(),
            "loss_V": self.loss_V,
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class Scan:
    """Scans of one waveform on one head; made by `scan`.

    Attributes
    ----------
    head : str
        Name of the head.
    waveform : Waveform
        The waveform.
    width : Curve
        Against the first dwell ``t2``, in seconds; everything else is as in the waveform.
    voltage : Curve
        Against a factor of both voltages.
    frequency : Curve
        Against the jetting frequency in hertz, in the steady state of the repeated waveform, up to the highest at which
        the waveform still ends before the next one starts.
    robustness : RobustnessMap
        Cost against two parameters.
    """

    head: str
    waveform: Waveform
    width: Curve
    voltage: Curve
    frequency: Curve
    robustness: RobustnessMap

    @property
    def frequency_change(self) -> tuple[float, float]:
        """Smallest and largest relative change of the effective peak over the sweep; NaN if it has none somewhere."""
        changes = self._changes
        return float(changes.min()), float(changes.max())

    @property
    def steady_up_to_Hz(self) -> float:
        """Highest frequency in hertz up to which the effective peak stays within `STEADY` of that of rare drops.

        0 if there is no effective peak.
        """
        beyond = ~(np.abs(self._changes) <= STEADY)
        if not beyond.any():
            return float(self.frequency.values[-1])
        first = int(np.argmax(beyond))
        return float(self.frequency.values[first - 1]) if first else 0.0

    @property
    def _changes(self) -> Real:
        """Relative change of the effective peak with the frequency, from that at the lowest."""
        heights_V = self.frequency.effective_V
        return heights_V / heights_V[0] - 1

    def as_json(self) -> dict[str, Any]:
        """The scan of one head within a ``scan/1``."""
        return {
            "head": self.head,
            "pulse_width": self.width.as_json(),
            "voltage": self.voltage.as_json(),
            "jetting_frequency": self.frequency.as_json() | {"steady_up_to_Hz": self.steady_up_to_Hz},
            "robustness": self.robustness.as_json(),
        }


def scan(
    head: Printhead | AugmentedPrinthead,
    waveform: Waveform,
    name: str = "head",
    cost: PeakCost | None = None,
    vary: Sequence[str] = ("t2", "t4"),
    points: int = 121,
    window_s: float = DEFAULT_WINDOW_S,
    progress: Callable[[str], None] | None = None,
) -> Scan:
    """Scan a waveform on a head.

    Parameters
    ----------
    head : Printhead or AugmentedPrinthead
        The head; one with effects takes some hundred times longer.
    waveform : Waveform
        The waveform, of some duration.
    name : str
        Name of the head in tables and figures.
    cost : PeakCost, optional
        Which peak is effective, and the cost; by default ``PeakCost()``.
    vary : sequence of two str
        Parameters of the robustness map; neither may be 0.
    points : int
        Number of values of width and voltage, at least 3. The sweep of the frequency has twice as many, the map a
        sixth in each direction.
    window_s : float
        Peaks of a single drop count up to this time after its start, in seconds; finite.
    progress : callable, optional
        Told what is scanned.

    Raises
    ------
    ValueError
        A waveform that lasts no time, an unknown parameter or one that is 0, too few points, or a head that cannot be
        simulated.
    """
    cost = cost or PeakCost()
    tell = progress or (lambda _: None)
    if waveform.duration_s == 0:
        raise ValueError("the waveform lasts 0 s. Give it a duration.")
    if len(vary) != 2 or vary[0] == vary[1]:
        raise ValueError(f"vary must name two different parameters of the waveform; got {', '.join(vary)}.")
    for parameter in vary:
        check_name("vary", parameter, PARAMETER_NAMES)
        if getattr(waveform, parameter) == 0:
            raise ValueError(f"vary: {parameter} of the waveform is 0, and 5 % of it too. Name another parameter.")
    if points < 3:
        raise ValueError(f"points must be at least 3; got {points}.")
    if math.isinf(check_window(window_s)):
        raise ValueError("a scan needs a finite window_s, such as 350e-6 s.")

    def single(changed: Sequence[Waveform], quantity: str, unit: str, values: Real) -> Curve:
        tell(f"{name}: {quantity}")
        figures = [_single(head, one, cost, window_s) for one in changed]
        return Curve(quantity, unit, values, *np.array(figures).T)

    def changed(**parameters: float) -> Waveform:
        return replace(waveform, **parameters)

    most = min(VOLTAGE_FACTORS[1], LARGEST_DRIVE_V / max(abs(waveform.U1), abs(waveform.U2), 1e-300))
    factors = np.linspace(VOLTAGE_FACTORS[0], most, points)
    tell(f"{name}: pulse width")
    width = pulse_width_scan(head, waveform, cost, points, window_s)
    scaled = [changed(U1=float(f) * waveform.U1, U2=float(f) * waveform.U2) for f in factors]
    voltage = single(scaled, "factor of the voltages", "1", factors)
    tell(f"{name}: jetting frequency")
    frequency = _sweep(head, waveform, cost, 2 * points)
    tell(f"{name}: robustness")
    return Scan(
        name, waveform, width, voltage, frequency,
        _map(head, waveform, cost, (vary[0], vary[1]), 2 * max(points // 12, 1) + 1, window_s),
    )  # fmt: skip


def pulse_width_scan(
    head: Printhead | AugmentedPrinthead,
    waveform: Waveform,
    cost: PeakCost,
    points: int = 121,
    window_s: float = DEFAULT_WINDOW_S,
) -> Curve:
    """Single drops against the first dwell ``t2``, from 0 s to `WIDEST_PERIODS`; everything else is as it is.

    Parameters
    ----------
    head, waveform, cost, points, window_s
        As of `scan`.
    """
    widths_s = np.linspace(0.0, min(WIDEST_PERIODS / head.frequency_Hz, LONGEST_DURATION_S), points)
    figures = [_single(head, replace(waveform, t2=float(t)), cost, window_s) for t in widths_s]
    return Curve("pulse width", "s", widths_s, *np.array(figures).T)


def _single(
    head: Printhead | AugmentedPrinthead, waveform: Waveform, cost: PeakCost, window_s: float
) -> tuple[float, float, float]:
    """Effective peak, largest later peak and cost of one drop from rest, in volts."""
    if isinstance(head, AugmentedPrinthead):
        peaks_V = head.respond(waveform, window_s=window_s).peaks_V
    else:
        from inkjet_env.printhead import batch

        _, peaks_V = batch.peaks(waveform, head, window_s=window_s)
    heights_V, e = np.abs(peaks_V), cost.effective_index(peaks_V)
    if e is None:
        return math.nan, math.nan, cost(peaks_V)
    return float(heights_V[e]), float(heights_V[e + 1 :].max(initial=0.0)), cost(peaks_V)


def _sweep(head: Printhead | AugmentedPrinthead, waveform: Waveform, cost: PeakCost, count: int) -> Curve:
    """Figures in the steady state of the repeated waveform, against its frequency."""
    highest_Hz = 1 / waveform.duration_s
    frequencies_Hz = np.linspace(min(LOWEST_Hz, highest_Hz), highest_Hz * (1 - 1e-9), count)
    figures = np.empty((count, 3))
    for row, frequency_Hz in zip(figures, frequencies_Hz, strict=True):
        period_s = 1 / float(frequency_Hz)
        response = head.respond(waveform, window_s=min(period_s, LONGEST_DURATION_S), period_s=period_s)
        e = cost.effective_index(response.peaks_V)
        begin_s = max(period_s - 1 / head.frequency_Hz, min(waveform.duration_s, period_s))
        before_next = response.sensor_V(np.linspace(begin_s, period_s, SAMPLES_A_PERIOD, endpoint=False))
        effective_V = math.nan if e is None else abs(float(response.peaks_V[e]))
        row[:] = effective_V, float(np.abs(before_next).max()), response.cost(cost)
    return Curve("jetting frequency", "Hz", frequencies_Hz, *figures.T)


def _map(
    head: Printhead | AugmentedPrinthead,
    waveform: Waveform,
    cost: PeakCost,
    names: tuple[str, str],
    count: int,
    window_s: float,
) -> RobustnessMap:
    """Costs of waveforms with two parameters changed."""
    changes = RELATIVE * np.linspace(-1.0, 1.0, count)
    first, second = (PARAMETER_NAMES.index(name) for name in names)
    rows = np.tile(waveform.to_array(), (count, count, 1))
    rows[:, :, first] *= 1 + changes[None, :]
    rows[:, :, second] *= 1 + changes[:, None]
    costs = _costs(head, rows.reshape(-1, 7), cost, window_s)
    return RobustnessMap(names, changes, costs.reshape(count, count))


def _costs(head: Printhead | AugmentedPrinthead, waveforms: Real, cost: PeakCost, window_s: float) -> Real:
    if isinstance(head, AugmentedPrinthead):
        return head.costs(waveforms, cost, window_s=window_s)
    from inkjet_env.printhead import batch

    return batch.costs(waveforms, head, cost, window_s=window_s)


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None

"""Creep: the ceramic continues to move with the logarithm of time, or with relaxations of its own."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values, complete
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.lag import lagged
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

SPACING = 0.8
"""Spacing of the logarithms of the relaxation rates; the error falls as exp(-π² / spacing)."""
SLOWEST = 5e-3
"""Smallest rate times the recording's duration; slower relaxations grow in proportion to time."""
FASTEST = 20.0
"""Largest rate times the onset; faster relaxations have weights below exp(-20)."""


class Creep(Effect):
    """Logarithmic creep of every change of the hysteretic drive, and two retarded elements; changes superpose.

    In steady state the mean has crept for ever. Its displacement is unknown and indistinguishable from a constant
    offset, so the mean stays in place.
    """

    id = "creep"
    stage = "hysteresis"
    sentence = "The displacement continues long after a change of drive, nearly with the logarithm of time."
    equation = "v(t) + ∫ γ lg(1 + (t - s) / t0) + c1 (1 - exp((s - t) / τ1)) + c2 (1 - exp((s - t) / τ2)) dv(s)"
    source = (
        "K. Kuhnen, Modeling, identification and compensation of complex hysteretic and log(t)-type creep "
        "nonlinearities, Control and Intelligent Systems 33(2), 2005; retarded elements, Kelvin's and Voigt's: R. S. "
        "Lakes, Viscoelastic Materials, Cambridge University Press, 2009"
    )
    parameters = (
        Parameter("creep_per_decade", "1", -0.2, 0.2, meaning="γ: fraction of a change added in every decade of time"),
        Parameter("onset_s", "s", 1e-4, 10.0, "log", "t0: time from which decades are counted", open_ended=True),
        Parameter("retarded_1", "1", -0.2, 0.2, meaning="c1: fraction of a change that a viscoelastic element adds"),
        Parameter("time_1_s", "s", 1e-4, 100.0, "log", "τ1: time constant of that element", open_ended=True, plain=0.1),
        Parameter("retarded_2", "1", -0.2, 0.2, meaning="c2: the same for a second element"),
        Parameter("time_2_s", "s", 1e-4, 100.0, "log", "τ2: time constant of that element", open_ended=True, plain=3.0),
    )
    strengths = ("creep_per_decade", "retarded_1", "retarded_2")
    plain_leaves = 0.025  # a logarithm that begins or ends within the records may leave this share unexplained
    terms = (("creep_per_decade",), ("retarded_1", "time_1_s"), ("retarded_2", "time_2_s"))
    signature = "after a step the displacement is linear in the logarithm of time, over decades"
    confusable_with = ("baseline_drift", "meniscus_refill", "rate_dependent_hysteresis")
    shown_by = "a slow recording of a step that is held over three decades of time"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        return [complete(self, creep_per_decade=0.02, onset_s=onset_s) for onset_s in (0.1, 0.01, 1.0)]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"creep_per_decade": 0.015, "onset_s": 0.1}

    def bounds(self, printhead: Printhead, excitations: Sequence[Excitation]) -> dict[str, tuple[float, float]]:
        slow = [excitation for excitation in excitations if not excitation.fast] or excitations
        times_s = (
            min(excitation.step_s for excitation in slow),
            max(excitation.samples * excitation.step_s for excitation in slow),
        )
        return {"time_1_s": times_s, "time_2_s": times_s}

    def description(self, values: Values, unit: str = "V") -> str:
        term, onset_s = values["creep_per_decade"], values["onset_s"]
        said = [
            f"goes {_where(term)} by {percent(abs(term))} of what it moved with every tenfold time, from about "
            f"{with_prefix(onset_s, 's')} on"
        ] * bool(term)
        said += [
            f"goes {_where(values[f'retarded_{k}'])} by {percent(abs(values[f'retarded_{k}']))} within about "
            f"{with_prefix(values[f'time_{k}_s'], 's')}"
            for k in (1, 2)
            if values[f"retarded_{k}"]
        ]
        return f"After a change of the drive the head {', and '.join(said)}." if said else self.sentence

    def hysteresis(
        self, values: Values, hysteretic_V: Real, drive_V: Real, printhead: Printhead, excitation: Excitation
    ) -> Real:
        result = hysteretic_V
        if values["creep_per_decade"]:
            creep_V = crept(hysteretic_V, values["onset_s"], excitation.node_step_s, excitation.periodic)
            result = result + values["creep_per_decade"] * creep_V
        moved_V = hysteretic_V - (hysteretic_V.mean() if excitation.periodic else hysteretic_V[0])
        for k in (1, 2):
            if values[f"retarded_{k}"]:
                late_V = lagged(moved_V, values[f"time_{k}_s"], excitation.node_step_s, excitation.periodic)
                result = result + values[f"retarded_{k}"] * late_V
        return result


def _where(term: float) -> str:
    return "back" if term < 0 else "on"


def crept(signal: Real, onset_s: float, step_s: float, periodic: bool) -> Real:
    """``∫ lg(1 + (t - s) / t0) dv(s)`` of a signal that is linear between its values, shape (n,).

    The kernel is a sum of first-order lags: ``lg(1 + t / t0) = ∫ (1 - exp(-r t)) exp(-r t0) d(ln r) / ln 10``.

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Values at equal steps.
    onset_s, step_s : float
        t0, and the time between the values, in seconds.
    periodic : bool
        Whether the signal is repeated and in its steady state, where the mean does not creep; otherwise it is at rest
        before its first value.
    """
    duration_s = step_s * signal.size
    moved = signal - (signal.mean() if periodic else signal[0])
    first = math.floor(math.log(1e-9 * duration_s / max(duration_s, onset_s)) / SPACING)
    last = math.ceil(math.log(FASTEST * duration_s / onset_s) / SPACING)
    rates = np.exp(SPACING * np.arange(first, last + 1)) / duration_s
    weights = SPACING / math.log(10) * np.exp(-rates * onset_s)
    slow = rates * duration_s < SLOWEST

    # Relaxations so slow that 1 - exp(-r t) = r t.
    area = np.zeros(signal.size)
    np.cumsum(0.5 * step_s * (moved[1:] + moved[:-1]), out=area[1:])
    result: Real = float(weights[slow] @ rates[slow]) * (area - area.mean() if periodic else area)
    for rate, weight in zip(rates[~slow], weights[~slow], strict=True):
        result += weight * lagged(moved, 1 / rate, step_s, periodic)
    return result

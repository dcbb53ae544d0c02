"""Hysteresis loops that widen with the drive's rate."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.plays import PLAYS, play_sum_V
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.printhead.hysteresis import BranchLaw
from inkjet_env.typing import Real

MIDDLING = 0.15
"""Relative growth of the thresholds of a start at the highest of the channels' usual rates."""
MIDDLING_V = 3.0
"""Growth in volts of thresholds that all grow by the same amount, in a start."""
SETTLING = 0.07
"""Time until the plays respond to a rate, in a start, in periods of the head."""
AT_ONCE_S = 1e-9
"""Settling time, in seconds, up to which the plays respond to a rate at once."""


class RateDependentHysteresis(Effect):
    """Plays whose thresholds or weights follow the logarithm of the rate of the drive, or that lag behind the drive."""

    id = "rate_dependent_hysteresis"
    stage = "hysteresis"
    sentence = "The hysteresis loop widens with the drive's rate."
    equation = (
        "m = ln(1 + |u'| / ρ) after a lag of settling_s; thresholds r (1 + growth m) + widening_V m, not below 0; "
        "weights w (1 + gain m); a play follows its branch with a lag of relaxation_s"
    )
    source = (
        "M. Al Janaideh, S. Rakheja, C.-Y. Su, Experimental characterization and modeling of rate-dependent hysteresis "
        "of a piezoceramic actuator, Mechatronics 19(5), 2009: plays whose thresholds depend on the rate; W. T. Ang, "
        "P. K. Khosla, C. N. Riviere, Feedforward controller with inverse rate-dependent model for piezoelectric "
        "actuators in trajectory-tracking applications, IEEE/ASME Trans. Mechatronics 12(2), 2007: weights that do; "
        "G. Bertotti, Hysteresis in Magnetism, Academic Press, 1998: operators that relax"
    )
    parameters = (
        Parameter("growth", "1", -0.5, 2.0, meaning="relative rise of the thresholds per e-fold rate"),
        Parameter("widening_V", "V", -20.0, 20.0, meaning="equal rise of all thresholds per e-fold rate"),
        Parameter("gain", "1", -0.5, 2.0, meaning="relative rise of the plays' weights per e-fold rate"),
        Parameter("relaxation_s", "s", 0.0, 1.0, meaning="lag with which a play follows its branch"),
        Parameter("rate_V_s", "V/s", 1e-1, 1e9, "log", "ρ: rate at which the rise begins", open_ended=True, plain=1.0),
        Parameter(
            "settling_s",
            "s",
            AT_ONCE_S,
            10.0,
            "log",
            "lag of the response to the rate",
            open_ended=True,
            plain=AT_ONCE_S,
        ),
    )
    strengths = ("growth", "widening_V", "gain", "relaxation_s")
    signature = "loops of one amplitude are wider at a higher rate, by more than the resonance explains"
    confusable_with = ("creep", "quadratic_damping")
    shown_by = "slow loops of the same amplitude at rates over several decades"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        usual = []
        for channel in sorted({excitation.channel for excitation in excitations}):
            rates = np.concatenate([np.abs(np.diff(s.drive_V)) / s.step_s for s in excitations if s.channel == channel])
            if rates.any():
                usual.append(float(np.median(rates[rates > 0])))
        highest = max(usual, default=0.0) or printhead.full_scale_V * printhead.frequency_Hz
        settling_s = SETTLING / printhead.frequency_Hz
        off = dict.fromkeys(self.strengths, 0.0) | {"settling_s": settling_s}
        begins = [float(np.clip(r * rate, 0.1, 1e9)) for rate in usual or [highest] for r in (0.1, 1.0, 10.0)]
        grown = [off | {"growth": MIDDLING / math.log1p(highest / rate), "rate_V_s": rate} for rate in begins]
        others = [
            off | {name: size / math.log1p(highest / rate), "rate_V_s": rate}
            for rate in begins[::3]
            for name, size in (("widening_V", MIDDLING_V), ("gain", MIDDLING))
        ]
        return [*grown, *others, off | {"relaxation_s": settling_s, "rate_V_s": highest}]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"growth": 0.06, "rate_V_s": 100.0}

    def description(self, values: Values, unit: str = "V") -> str:
        said = []
        growth = values["growth"] * math.log(10)
        wide = [percent(abs(growth))] if growth else []
        widening_V = values["widening_V"] * math.log(10)
        if widening_V and (not growth or (widening_V > 0) == (growth > 0)):
            wide.append(with_prefix(2 * abs(widening_V), "V"))
        if wide:
            said.append(
                f"Above about {with_prefix(values['rate_V_s'], 'V/s')}, the hysteresis loop becomes "
                f"{' and '.join(wide)} {'wider' if growth + widening_V > 0 else 'narrower'} along the drive for every "
                "tenfold increase of the rate."
            )
        elif values["gain"]:
            gain = values["gain"] * math.log(10)
            said.append(
                f"Above about {with_prefix(values['rate_V_s'], 'V/s')}, the hysteresis loop becomes "
                f"{percent(abs(gain))} {'higher' if gain > 0 else 'lower'} for every tenfold increase of the rate."
            )
        if values["relaxation_s"]:
            said.append(f"The hysteresis follows the drive with a lag of {with_prefix(values['relaxation_s'], 's')}.")
        return " ".join(said) or self.sentence

    def hysteresis(
        self, values: Values, hysteretic_V: Real, drive_V: Real, printhead: Printhead, excitation: Excitation
    ) -> Real:
        if not any(values[name] for name in self.strengths):
            return hysteretic_V
        ends_V = np.append(drive_V, drive_V[0]) if excitation.periodic else np.ascontiguousarray(drive_V)
        measure = rate_measure(
            ends_V, values["rate_V_s"], values["settling_s"], excitation.node_step_s, excitation.periodic
        )
        law = printhead.branch_law
        asked = drive_V is excitation.drive_at_nodes_V
        plain = excitation.cache.get(self.id) if asked else None
        if plain is None or plain[0] != law:
            plain = law, plays_V(ends_V, np.zeros_like(measure), law, excitation.periodic)
            if asked:
                excitation.cache[self.id] = plain
        relaxation = values["relaxation_s"] / excitation.node_step_s
        changed_V = plays_V(
            ends_V, measure, law, excitation.periodic, values["growth"], values["widening_V"], relaxation
        ) * (1 + values["gain"] * measure)
        return hysteretic_V + (changed_V - plain[1])[: drive_V.size]


def rate_measure(ends_V: Real, rate_V_s: float, settling_s: float, step_s: float, periodic: bool) -> Real:
    """``ln(1 + |u'| / ρ)`` behind a first-order lag, from rest or in steady state, at the nodes, shape (n,).

    Exact, since the rate is constant between nodes. A lag below a hundredth of a step is neglected: a node between two
    rates then has their mean.
    """
    from inkjet_env.plant import compiled

    logs = np.log1p(np.abs(np.diff(ends_V)) / (step_s * rate_V_s))
    if settling_s <= max(AT_ONCE_S, 0.01 * step_s):
        at_once = np.empty(ends_V.size)
        at_once[1:-1] = 0.5 * (logs[:-1] + logs[1:])
        at_once[0], at_once[-1] = (0.5 * (logs[-1] + logs[0]),) * 2 if periodic else (0.0, logs[-1])
        return at_once
    keep = math.exp(-step_s / settling_s)
    behind, after = np.empty(ends_V.size), np.append(0.0, logs)
    end = compiled.lagged(after, keep, 0.0, 1 - keep, 0.0, behind)
    if periodic:
        compiled.lagged(after, keep, 0.0, 1 - keep, end / (1 - keep**logs.size), behind)
    return behind


def plays_V(
    ends_V: Real,
    measure: Real,
    law: BranchLaw,
    periodic: bool,
    growth: float = 0.0,
    widening_V: float = 0.0,
    relaxation: float = 0.0,
    plays: int = PLAYS,
) -> Real:
    """Output in volts of plays that replace the law, with thresholds that follow the rate, shape (n,).

    The linear part of the law is left out.

    Parameters
    ----------
    ends_V : ndarray, shape (n,)
        Drive at the nodes, in volts; if periodic, the first one again at its end.
    measure : ndarray, shape (n,)
        Measure m of the rate at the nodes, dimensionless; see `rate_measure`.
    law : BranchLaw
        Branch law that the plays replace.
    periodic : bool
        Whether the drive has been repeated; otherwise it starts from the demagnetised state.
    growth, widening_V : float
        A threshold r becomes ``r (1 + growth m) + widening_V m``, but not below 0.
    relaxation : float
        Lag of a play, in steps.
    plays : int
        Number of plays; the difference from the law falls with its square.
    """
    from inkjet_env.plant import compiled_hysteresis

    change = measure, growth, widening_V, relaxation
    return play_sum_V(compiled_hysteresis.rated_plays, ends_V, change, law, periodic, plays)

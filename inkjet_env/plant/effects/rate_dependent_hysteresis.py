"""Hysteresis loops that widen with the drive's rate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.plays import PLAYS, play_sum_V
from inkjet_env.plant.shot import Shot
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.printhead.hysteresis import BranchLaw

Real = NDArray[np.float64]

MIDDLING = 0.15
"""By how much the thresholds of a start grow at the highest of the channels' usual rates."""


class RateDependentHysteresis(Effect):
    """Thresholds of all plays grow with the logarithm of the drive's rate."""

    id = "rate_dependent_hysteresis"
    stage = "hysteresis"
    sentence = "The hysteresis loop widens with the drive's rate."
    equation = "thresholds r [1 + β ln(1 + |u'| / ρ)], not below 0"
    source = (
        "M. Al Janaideh, S. Rakheja, C.-Y. Su, Experimental characterization and modeling of rate-dependent hysteresis "
        "of a piezoceramic actuator, Mechatronics 19(5), 2009: plays whose thresholds depend on the rate"
    )
    parameters = (
        Parameter("growth", "1", -0.5, 2.0, meaning="of the thresholds, relative, for an e-fold rate"),
        Parameter("rate_V_s", "V/s", 1e-1, 1e9, "log", "rate at which growth begins", open_ended=True),
    )
    strengths = ("growth",)
    signature = "loops of one amplitude are wider at a higher rate, beyond what the resonance does"
    confusable_with = ("creep", "quadratic_damping")
    shown_by = "slow loops of one amplitude at rates over several decades"

    def starts(self, printhead: Printhead, shots: Sequence[Shot]) -> list[dict[str, float]]:
        usual = []
        for channel in sorted({shot.channel for shot in shots}):
            rates = np.concatenate([np.abs(np.diff(s.drive_V)) / s.step_s for s in shots if s.channel == channel])
            if rates.any():
                usual.append(float(np.median(rates[rates > 0])))
        highest = max(usual, default=0.0) or printhead.full_scale_V * printhead.frequency_Hz
        begins = np.clip([ratio * rate for rate in usual or [highest] for ratio in (0.1, 1.0, 10.0)], 0.1, 1e9)
        return [{"growth": MIDDLING / float(np.log1p(highest / rate)), "rate_V_s": float(rate)} for rate in begins]

    def told(self, values: Values, unit: str = "V") -> str:
        growth = values["growth"] * np.log(10)
        return (
            f"From about {with_prefix(values['rate_V_s'], 'V/s')} on, the hysteresis loop is {percent(abs(growth))} "
            f"{'wider' if growth > 0 else 'narrower'}, along the drive, with every tenfold rate of the drive."
        )

    def hysteresis(self, values: Values, hysteretic_V: Real, drive_V: Real, printhead: Printhead, shot: Shot) -> Real:
        if values["growth"] == 0:
            return hysteretic_V
        ends_V = np.append(drive_V, drive_V[0]) if shot.periodic else np.ascontiguousarray(drive_V)
        rates = np.abs(np.diff(ends_V)) / shot.node_step_s
        widening = np.maximum(1 + values["growth"] * np.log1p(rates / values["rate_V_s"]), 0.0)
        law = printhead.branch_law
        asked = drive_V is shot.drive_at_nodes_V
        plain = shot.kept.get(self.id) if asked else None
        if plain is None or plain[0] != law:
            plain = law, plays_V(ends_V, np.ones(rates.size), law, shot.periodic)
            if asked:
                shot.kept[self.id] = plain
        change_V = plays_V(ends_V, widening, law, shot.periodic) - plain[1]
        return hysteretic_V + change_V[: drive_V.size]


def plays_V(ends_V: Real, widening: Real, law: BranchLaw, periodic: bool, plays: int = PLAYS) -> Real:
    """What plays in place of the law give, but for its linear part, with wider thresholds, shape (n,): `play_sum_V`.

    ``widening``: factor on the thresholds between nodes, shape (n - 1,).
    """
    from inkjet_env.plant import compiled_hysteresis

    return play_sum_V(compiled_hysteresis.widened_plays, ends_V, widening, law, periodic, plays)

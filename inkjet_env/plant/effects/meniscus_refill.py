"""The head's tuning depends on the pulses just before: each one draws the meniscus back, and it refills."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.resonance import Resonance, too_slow
from inkjet_env.plant.shot import Shot
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead

EDGES_V = 100.0
"""Travel of the drive that the change of stiffness is told for."""


class MeniscusRefill(Effect):
    """Stiffness follows a slow state that each edge of the drive pushes and that recovers."""

    id = "meniscus_refill"
    stage = "resonator"
    sentence = "The head's tuning depends on the pulses just before and recovers in the time after them."
    equation = "x'' + a1 x' + a0 (1 + k s) x = a0 v, s' = -s / τ + |u'| / 100 V"
    source = (
        "after the refill in H. Wijshoff, The dynamics of the piezo inkjet printhead operation, Physics Reports 491, "
        "2010; the slow state is an empirical law"
    )
    parameters = (
        Parameter("recovery_s", "s", 1e-9, 1e4, "log", "time constant of the refill"),
        Parameter("stiffness_change", "1", -1.0, 1.0, meaning="relative, after edges of 100 V together"),
    )
    strengths = ("stiffness_change",)
    signature = "the same pulse rings at another pitch after a busy history than after a rest"
    confusable_with = ("thermal_drift", "cubic_stiffness", "creep")
    shown_by = "pairs of equal pulses with several gaps between them"

    def starts(self, printhead: Printhead, shots: Sequence[Shot]) -> list[dict[str, float]]:
        found = []
        for periods in (1.0, 4.0, 15.0):
            recovery_s = periods / printhead.frequency_Hz
            largest = max((float(drawn_back(shot, recovery_s).max()) for shot in shots if shot.fast), default=1.0)
            change = 0.3 * printhead.damping_ratio / max(largest, 1e-12)
            found.append({"recovery_s": recovery_s, "stiffness_change": change})
        return found

    def bounds(self, printhead: Printhead, shots: Sequence[Shot]) -> dict[str, tuple[float, float]]:
        longest_s = max((shot.samples * shot.step_s for shot in shots if shot.fast), default=1.0)
        shortest_s = 0.3 / printhead.frequency_Hz
        return {"recovery_s": (shortest_s, max(10 * longest_s, 2 * shortest_s))}

    def untestable(self, shots: Sequence[Shot]) -> str | None:
        return too_slow(shots)

    def told(self, values: Values, unit: str = "V") -> str:
        change = values["stiffness_change"]
        how = "stiffer" if change > 0 else "softer"
        return (
            f"Edges of {EDGES_V:g} V together leave the head {percent(abs(change))} {how}; "
            f"it recovers with a time constant of {with_prefix(values['recovery_s'], 's')}."
        )

    def resonator(self, values: Values, resonance: Resonance, shot: Shot) -> Resonance:
        change = values["stiffness_change"]
        if change == 0:
            return resonance
        return resonance.with_softening(change * drawn_back(shot, values["recovery_s"]))


def drawn_back(shot: Shot, recovery_s: float) -> NDArray[np.float64]:
    """The slow state ``s`` at the nodes, shape (nodes,): exact, as the drive's rate is constant between them."""
    from inkjet_env.plant import compiled

    drive_V = shot.drive_at_nodes_V
    ends_V = np.append(drive_V, drive_V[0]) if shot.periodic else drive_V
    travel = np.abs(np.diff(ends_V, prepend=ends_V[0])) / EDGES_V
    z = shot.node_step_s / recovery_s
    keep, new = math.exp(-z), -math.expm1(-z) / z
    state = np.empty(travel.size)
    start = 0.0
    if shot.periodic:
        start = compiled.lagged(travel, keep, 0.0, new, 0.0, state) / -math.expm1(-z * drive_V.size)
    compiled.lagged(travel, keep, 0.0, new, start, state)
    return state[: drive_V.size]

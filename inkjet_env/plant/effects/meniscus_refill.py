"""The head's tuning depends on the preceding pulses: each one draws the meniscus back, and it refills."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.recorded_motion import reach_V, too_slow
from inkjet_env.plant.refill import FLOW_V, Refill
from inkjet_env.plant.resonance import Resonance
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

EDGES_V = 100.0
"""Travel of the drive, in volts, to which the change of stiffness refers."""


class MeniscusRefill(Effect):
    """Stiffness follows a slow state that edges of the drive, or the flow in the nozzle, excite and that recovers."""

    id = "meniscus_refill"
    stage = "resonator"
    sentence = "The head's resonance depends on the preceding pulses and recovers in the time after them."
    equation = (
        "x'' + a1 x' + a0 (1 + k s + m n) x = a0 v; s' = -s / τ + |u'| / 100 V; "
        "n + τ n' + q τ² n'' = (|p| / 100 V)^power, p = x'/ω0 of the head without it"
    )
    source = (
        "after the refill in H. Wijshoff, The dynamics of the piezo inkjet printhead operation, Physics Reports 491, "
        "2010; the slow state is an empirical law"
    )
    parameters = (
        Parameter("recovery_s", "s", 1e-9, 1e4, "log", "time constant of the refill"),
        Parameter(
            "stiffness_change", "1", -1.0, 1.0, meaning="relative, of the stiffness after edges of 100 V in total"
        ),
        Parameter("flow_change", "1", -10.0, 10.0, meaning="relative, of the stiffness at a steady flow of 100 V"),
        Parameter("power", "1", 1.0, 2.0, meaning="exponent of the flow", open_ended=True, plain=1.0),
        Parameter(
            "second_order", "1", 0.0, 10.0, meaning="q: above 1/4 the recovery oscillates", open_ended=True, plain=0.0
        ),
    )
    strengths = ("stiffness_change", "flow_change")
    signature = "the same pulse rings at a different frequency after other pulses than after a rest"
    confusable_with = ("thermal_drift", "cubic_stiffness", "creep", "self_heating")
    shown_by = "pairs of equal pulses with several different gaps"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        off = {"stiffness_change": 0.0, "flow_change": 0.0, "power": 1.0, "second_order": 0.0}
        found = []
        shift = 0.3 * printhead.damping_ratio
        flow = reach_V(printhead, excitations) / FLOW_V
        for periods in (1.0, 4.0, 15.0):
            recovery_s = periods / printhead.frequency_Hz
            largest = max(
                (float(drawn_back(excitation, recovery_s).max()) for excitation in excitations if excitation.fast),
                default=1.0,
            )
            found.append(off | {"recovery_s": recovery_s, "stiffness_change": shift / max(largest, 1e-12)})
            change = min(shift * max(1.0, periods / 3) / flow, 10.0)
            found.append(off | {"recovery_s": recovery_s, "flow_change": change})
            if periods < 15:
                swings = {"recovery_s": recovery_s, "flow_change": 1.5 * change, "power": 2.0, "second_order": 1.0}
                found.append(off | swings)
        return found

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"recovery_s": 6 * (1 / printhead.frequency_Hz), "stiffness_change": 0.02}

    def bounds(self, printhead: Printhead, excitations: Sequence[Excitation]) -> dict[str, tuple[float, float]]:
        longest_s = max(
            (excitation.samples * excitation.step_s for excitation in excitations if excitation.fast), default=1.0
        )
        shortest_s = 0.3 / printhead.frequency_Hz
        return {"recovery_s": (shortest_s, max(10 * longest_s, 2 * shortest_s))}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return too_slow(excitations)

    def description(self, values: Values, unit: str = "V") -> str:
        said = []
        for name, after in (
            ("stiffness_change", f"after edges of {EDGES_V:g} V in total"),
            ("flow_change", f"at a steady flow of {FLOW_V:g} V"),
        ):
            if values[name]:
                change = "stiffer" if values[name] > 0 else "softer"
                said.append(f"{after} the head is {percent(abs(values[name]))} {change}")
        change = " and ".join(said) or "the head does not change"
        recovery = with_prefix(values["recovery_s"], "s")
        return f"{change[0].upper()}{change[1:]}; it recovers with a time constant of {recovery}."

    def resonator(self, values: Values, resonance: Resonance, excitation: Excitation) -> Resonance:
        change, flow = values["stiffness_change"], values["flow_change"]
        if change:
            resonance = resonance.with_softening(change * drawn_back(excitation, values["recovery_s"]))
        if flow:
            refill = Refill(flow, values["power"], values["recovery_s"], values["second_order"])
            resonance = replace(resonance, refills=(*resonance.refills, refill))
        return resonance


def drawn_back(excitation: Excitation, recovery_s: float) -> Real:
    """Slow state ``s`` at the nodes, shape (nodes,): exact, since the rate of the drive is constant between them."""
    from inkjet_env.plant import compiled

    drive_V = excitation.drive_at_nodes_V
    ends_V = np.append(drive_V, drive_V[0]) if excitation.periodic else drive_V
    travel = np.abs(np.diff(ends_V, prepend=ends_V[0])) / EDGES_V
    z = excitation.node_step_s / recovery_s
    keep, new = math.exp(-z), -math.expm1(-z) / z
    state = np.empty(travel.size)
    start = 0.0
    if excitation.periodic:
        start = compiled.lagged(travel, keep, 0.0, new, 0.0, state) / -math.expm1(-z * drive_V.size)
    compiled.lagged(travel, keep, 0.0, new, start, state)
    return state[: drive_V.size]

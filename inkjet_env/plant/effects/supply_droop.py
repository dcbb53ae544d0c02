"""A supply that sags with the charge of each pulse and recovers: later pulses of a burst are smaller."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.errors import SimulationError
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.recorded_motion import too_slow
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

CHARGE_V = 100.0
"""Rise of the voltage's magnitude, in volts, that draws one unit of charge."""
SAG = 0.03
"""Largest sag in the starts."""
RECOVERIES = (1.0, 4.0, 15.0, 60.0)
"""Recovery times of the starts, in periods of the head."""
LEAST_LEFT = 0.05
"""Share of the supply that must be left."""


class SupplyDroop(Effect):
    """The drive is multiplied by what is left of a supply that every charging of the ceramic draws down.

    Charge is drawn while the magnitude of the requested drive rises. Discharging returns none; it may draw some from a
    supply that feeds both directions of the current.
    """

    id = "supply_droop"
    stage = "drive"
    sentence = "The supply sags with the charge that the pulses draw, and recovers with a time constant."
    equation = (
        "u = u_requested (1 - droop s), s' = -s / τ + (max(|u_requested|', 0) + discharge_share "
        "max(-|u_requested|', 0)) / 100 V"
    )
    source = (
        "P. Horowitz, W. Hill, The Art of Electronics, 3rd edition, 2015, chapter 9: reservoir capacitors and the "
        "output impedance of supplies"
    )
    parameters = (
        Parameter("droop", "1", -0.1, 0.9, meaning="relative fall of the supply after charging by 100 V"),
        Parameter("recovery_s", "s", 1e-9, 1e4, "log", "τ: time constant of the supply's recovery"),
        Parameter(
            "discharge_share", "1", 0.0, 1.0, meaning="share of its charge that discharging draws", open_ended=True,
            plain=0.0, later=True,
        ),
    )  # fmt: skip
    strengths = ("droop",)
    signature = "later pulses of a burst are smaller, in proportion to the charge drawn before; a gap restores them"
    confusable_with = ("slew_limit", "rate_dependent_hysteresis", "meniscus_refill")
    shown_by = "bursts of equal pulses with several gaps, and the voltage at the head (column drive_monitor_V)"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        found = []
        for periods in RECOVERIES:
            recovery_s = periods / printhead.frequency_Hz
            largest = max((float(drawn(s.drive_at_nodes_V, recovery_s, s).max()) for s in excitations), default=1.0)
            found.append(
                {"droop": min(SAG / max(largest, 1e-12), 0.5), "recovery_s": recovery_s, "discharge_share": 0.0}
            )
        return found

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"droop": 0.05, "recovery_s": 10 / printhead.frequency_Hz}

    def bounds(self, printhead: Printhead, excitations: Sequence[Excitation]) -> dict[str, tuple[float, float]]:
        longest_s = max((s.samples * s.step_s for s in excitations if s.fast), default=1.0)
        shortest_s = 0.1 / printhead.frequency_Hz
        return {"recovery_s": (shortest_s, max(10 * longest_s, 2 * shortest_s))}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return too_slow(excitations)

    def description(self, values: Values, unit: str = "V") -> str:
        does = "sags" if values["droop"] > 0 else "rises"
        return (
            f"Charging the head by {CHARGE_V:g} V, the supply {does} by {percent(abs(values['droop']))}; it recovers "
            f"with a time constant of {with_prefix(values['recovery_s'], 's')}."
        )

    def drive(self, values: Values, drive_V: Real, excitation: Excitation) -> Real:
        if values["droop"] == 0:
            return drive_V
        charge = drawn(drive_V, values["recovery_s"], excitation, values["discharge_share"])
        left = 1 - values["droop"] * charge
        if left.min() < LEAST_LEFT:
            raise SimulationError("the supply collapses.")
        return drive_V * left


def drawn(drive_V: Real, recovery_s: float, excitation: Excitation, discharge_share: float = 0.0) -> Real:
    """Charge drawn and not yet returned, ``s``, in units of 100 V, at the nodes, shape (nodes,).

    Exact for a drive that is linear between nodes. In steady state if periodic, otherwise from rest.
    """
    from inkjet_env.plant import compiled

    ends_V = np.append(drive_V, drive_V[0]) if excitation.periodic else drive_V
    before_V, after_V = np.abs(ends_V[:-1]), np.abs(ends_V[1:])
    crosses = ends_V[:-1] * ends_V[1:] < 0
    z = excitation.node_step_s / recovery_s
    # The magnitude rises during the last part of a step across 0 V, and during all of any other.
    part = np.where(crosses, after_V / np.where(crosses, before_V + after_V, 1.0), 1.0)
    gained_V = np.where(crosses, after_V, np.maximum(after_V - before_V, 0.0)) * _kept(part * z)
    if discharge_share:
        fallen_V = np.where(crosses, before_V, np.maximum(before_V - after_V, 0.0))
        first = np.where(crosses, 1 - part, 1.0)
        gained_V = gained_V + discharge_share * fallen_V * _kept(first * z) * np.exp(-(1 - first) * z)
    gained = np.append(0.0, gained_V / CHARGE_V)
    state = np.empty(gained.size)
    start = 0.0
    if excitation.periodic:
        start = compiled.lagged(gained, math.exp(-z), 0.0, 1.0, 0.0, state) / -math.expm1(-z * drive_V.size)
    compiled.lagged(gained, math.exp(-z), 0.0, 1.0, start, state)
    return state[: drive_V.size]


def _kept(z: Real) -> Real:
    """Share of what is drawn evenly over a time that is left at its end; the time in time constants, shape (n,)."""
    kept: Real = np.where(z > 1e-12, -np.expm1(-z) / np.maximum(z, 1e-300), 1.0)
    return kept

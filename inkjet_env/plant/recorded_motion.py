"""What recordings show of the resonator: whether it rings in any of them, its largest deflection, its mean power."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.resonance import Resonance
from inkjet_env.plant.stages import Plant
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real


def too_slow(excitations: Sequence[Excitation]) -> str | None:
    """Why recordings do not show the resonator, as the end of a sentence after "because"; None if they do."""
    if any(excitation.fast for excitation in excitations):
        return None
    return "every recording is too slow to show the resonance"


def reach_V(printhead: Printhead, excitations: Sequence[Excitation]) -> float:
    """Largest deflection of the head in these recordings, in hysteretic volts; 1 V if none moves it.

    The width of the hysteresis is neglected.
    """
    law = printhead.branch_law
    reach = 0.0
    for excitation in excitations:
        drive_V = excitation.drive_at_nodes_V
        swing = float(np.ptp(drive_V))
        if excitation.fast and swing > 0:
            slope = float(law.Q(swing / law.full_scale_V)) * law.full_scale_V / swing
            rings = Resonance(printhead.a0, printhead.a1, printhead.a0)
            deflection = rings.motion(slope * drive_V, replace(excitation, channel="displacement"))
            reach = max(reach, float(np.abs(deflection).max()))
    return reach or 1.0


def speed_V(printhead: Printhead, excitation: Excitation) -> Real:
    """Speed ``x' / ω0`` of the head without effects at the nodes, in hysteretic volts, shape (nodes,)."""
    hysteretic_V = Plant(printhead).hysteretic_V(excitation.drive_at_nodes_V, excitation)
    rings = Resonance(printhead.a0, printhead.a1, printhead.a0).oscillator
    speed: Real = rings.linear_speed(hysteretic_V, excitation) / math.sqrt(printhead.a0)
    return speed


def session_of(printhead: Printhead, excitations: Sequence[Excitation]) -> tuple[tuple[int, float], ...]:
    """`Excitation.session` of recordings of one session, each given once."""
    fast = sorted((e for e in excitations if e.fast), key=lambda e: e.order)
    return tuple((e.order, float(np.mean(speed_V(printhead, e) ** 2))) for e in fast)

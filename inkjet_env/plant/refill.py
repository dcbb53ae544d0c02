"""Refill: the stiffness of the head follows the flow of the preceding pulses behind a low-pass."""

from __future__ import annotations

from dataclasses import dataclass

from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.low_pass import low_passed
from inkjet_env.typing import Real

FLOW_V = 100.0
"""Scaled speed, in hysteretic volts, that is one unit of flow."""


@dataclass(frozen=True)
class Refill:
    """A stiffness that depends on the preceding flow.

    Attributes
    ----------
    change : float
        Relative change of stiffness per unit of the state, ``(|p| / 100 V)^power`` behind a low-pass, where
        ``p = x' / ω0`` is the scaled speed of the head without it.
    power : float
        Exponent of the flow, dimensionless.
    recovery_s, second_order : float
        τ in seconds and q, dimensionless, of the low-pass ``1 / (1 + τ s + q τ² s²)``.
    """

    change: float
    power: float
    recovery_s: float
    second_order: float

    def softening(self, flow: Real, excitation: Excitation) -> Real:
        """Relative change of stiffness at the nodes, shape (nodes,), by a flow ``|p| / 100 V`` of the same shape."""
        pushed = flow**self.power
        drawn = low_passed(pushed, self.recovery_s, self.second_order, excitation.node_step_s, excitation.periodic)
        return self.change * drawn

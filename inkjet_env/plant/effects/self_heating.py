"""Self-heating: the power that the motion dissipates warms the ceramic within a recording, which shifts the resonance.

In Eq. (11) of docs/explanation/model.md it is the force ``F = (k x + d (a1/ω0) p) w`` with ``w + τ w' = (p / 100 V)²``.
What carries it warms up more slowly, from recording to recording: ``W`` is the same power's mean over each recording,
summed over the session with a memory of so many recordings.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.force import Force, compiled_force
from inkjet_env.plant.lag import lag_weights, lagged
from inkjet_env.plant.recorded_motion import speed_V, too_slow
from inkjet_env.plant.resonance import Resonance
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

SPEED_V = 100.0
"""Scaled speed, in hysteretic volts, whose power is one unit."""
COOLING = (3.0, 12.0, 50.0)
"""Cooling times of the starts, in periods of the head."""
MEMORIES = (1.0, 3.0, 10.0)
"""Numbers of recordings in which the head cools, of the starts."""
MEMORY = 4.0
"""The same while the law of the session is off."""
FEWEST = 4
"""Smallest number of fast recordings of a session that can show what they share."""
WARMTH = 5
"""Place of w among the values of the law."""


class SelfHeating(Effect):
    """Stiffness and damping change in proportion to the dissipated power behind a first-order low-pass.

    The ceramic is cold at the start of a recording, unless the drive has been repeated. A head that was driven in
    earlier recordings is warm throughout a recording, by what these and this one dissipate.
    """

    id = "self_heating"
    stage = "resonator"
    sentence = "The power that the motion dissipates warms the ceramic, so frequency and damping shift within a burst."
    equation = (
        "x'' + a1 (1 + d w + D W) x' + a0 (1 + k w + K W) x = a0 v, w + τ w' = (p / 100 V)², p = x'/ω0, "
        "W = Σ exp(-(order - order_j) / memory_orders) mean_j (p / 100 V)² over the recordings j up to this one"
    )
    source = (
        "J. Zheng, S. Takahashi, S. Yoshikawa, K. Uchino, J. W. C. de Vries, Heat generation in multilayer "
        "piezoelectric actuators, Journal of the American Ceramic Society 79, 1996"
    )
    parameters = (
        Parameter("cooling_s", "s", 1e-9, 1e4, "log", "τ: time constant with which the ceramic cools", open_ended=True),
        Parameter("stiffness_change", "1", -10.0, 10.0, meaning="k: relative change at a steady speed of 100 V"),
        Parameter("damping_change", "1", -10.0, 100.0, meaning="d: the same of the damping"),
        Parameter("session_stiffness_change", "1", -10.0, 10.0, meaning="K: the same of W"),
        Parameter("session_damping_change", "1", -10.0, 100.0, meaning="D: the same of the damping"),
        Parameter(
            "memory_orders", "1", 0.3, 1e4, "log", "recordings in which the head cools",
            open_ended=True, plain=MEMORY,
        ),
    )  # fmt: skip
    strengths = ("stiffness_change", "damping_change", "session_stiffness_change", "session_damping_change")
    signature = "frequency and damping shift during a burst with the square of its amplitude, and recover in a pause"
    confusable_with = ("meniscus_refill", "air_bubble", "thermal_drift")
    shown_by = "a long burst at the resonance at several amplitudes, each followed by a pause and a weak pulse"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        off = dict.fromkeys(self.strengths, 0.0) | {"memory_orders": MEMORY}
        found = []
        for periods in COOLING:
            cooling_s = periods / printhead.frequency_Hz
            largest = max((float(warmth(printhead, s, cooling_s).max()) for s in excitations if s.fast), default=1.0)
            base = off | {"cooling_s": cooling_s}
            change = min(0.3 * printhead.damping_ratio / max(largest, 1e-9), 5.0)
            found += [base | {"stiffness_change": sign * change} for sign in (-1.0, 1.0)]
            found.append(base | {"damping_change": min(0.2 / max(largest, 1e-9), 50.0)})
        session = max((s.session for s in excitations), key=len, default=())
        if len(session) < FEWEST:
            return found
        for memory in MEMORIES:
            largest = max(session_warmth(session, order, memory) for order, _ in session)
            base = off | {"cooling_s": COOLING[0] / printhead.frequency_Hz, "memory_orders": memory}
            change = min(0.3 * printhead.damping_ratio / max(largest, 1e-9), 5.0)
            found += [base | {"session_stiffness_change": sign * change} for sign in (-1.0, 1.0)]
            found.append(base | {"session_damping_change": min(0.2 / max(largest, 1e-9), 50.0)})
        return found

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"cooling_s": 15 / printhead.frequency_Hz, "stiffness_change": -0.3, "damping_change": 1.0}

    def bounds(self, printhead: Printhead, excitations: Sequence[Excitation]) -> dict[str, tuple[float, float]]:
        longest_s = max((s.samples * s.step_s for s in excitations if s.fast), default=1.0)
        shortest_s = 0.5 / printhead.frequency_Hz
        return {"cooling_s": (shortest_s, max(100 * longest_s, 2 * shortest_s))}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return too_slow(excitations)

    def description(self, values: Values, unit: str = "V") -> str:
        within, session = _words(values, "", 1 / 8), _words(values, "session_", 1 / 8)
        steady = f"a steady oscillation as large as the deflection under {with_prefix(SPEED_V / 2, 'V')}"
        said = []
        if within:
            said.append(
                f"In {steady}, the head becomes {within} by its own heat, with a time constant of "
                f"{with_prefix(values['cooling_s'], 's')}."
            )
        if session:
            said.append(
                f"A recording with {steady} leaves the head {session}; it cools within "
                f"{values['memory_orders']:.2g} recordings."
            )
        return " ".join(said) or self.sentence

    def resonator(self, values: Values, resonance: Resonance, excitation: Excitation) -> Resonance:
        resonance = self._after_session(values, resonance, excitation)
        stiffening, damping = values["stiffness_change"], values["damping_change"]
        if stiffening == damping == 0:
            return resonance
        stiffness = resonance.a0 / resonance.drive_a0
        rate = resonance.a1 * math.sqrt(resonance.a0) / resonance.drive_a0
        lag = lag_weights(values["cooling_s"], 2 * excitation.node_step_s)
        numbers = np.array([stiffening * stiffness, damping * rate, *lag, 0.0, 0.0, 0.0])
        force = Force(_compiled(), numbers, ((WARMTH, values["cooling_s"]),))
        return replace(resonance, forces=(*resonance.forces, force))

    @staticmethod
    def _after_session(values: Values, resonance: Resonance, excitation: Excitation) -> Resonance:
        stiffening, damping = values["session_stiffness_change"], values["session_damping_change"]
        if stiffening == damping == 0 or not excitation.session:
            return resonance
        warm = session_warmth(excitation.session, excitation.order, values["memory_orders"])
        a0, a1 = (1 + change * warm for change in (stiffening, damping))
        return replace(resonance, a0=resonance.a0 * a0, a1=resonance.a1 * a1)


def _words(values: Values, prefix: str, power: float) -> str:
    """How stiffness and damping change at a power, dimensionless; empty if they do not."""
    said = []
    for name, more, less in (("stiffness_change", "stiffer", "softer"), ("damping_change", "more", "less")):
        if change := values[prefix + name]:
            word = more if change > 0 else less
            said.append(f"{percent(abs(change) * power)} {word}{' damped' if name.startswith('damp') else ''}")
    return " and ".join(said)


def warmth(printhead: Printhead, excitation: Excitation, cooling_s: float) -> Real:
    """``w`` of the head without the effect, at the nodes, shape (nodes,)."""
    power = (speed_V(printhead, excitation) / SPEED_V) ** 2
    return lagged(power, cooling_s, excitation.node_step_s, excitation.periodic)


def session_warmth(session: Sequence[tuple[int, float]], order: float, memory_orders: float) -> float:
    """``W`` in the recording of this order, dimensionless.

    Parameters
    ----------
    session : sequence of (int, float)
        As `Excitation.session`.
    order : float
        Order of the recording.
    memory_orders : float
        Number of recordings in which the head cools.
    """
    return sum(
        power / SPEED_V**2 * math.exp(-(order - earlier) / memory_orders)
        for earlier, power in session
        if earlier <= order
    )


def _law(x_V: float, speed_V: float, values: Real) -> float:
    power, begun = (speed_V / SPEED_V) ** 2, values[7]
    if begun:
        values[5] = values[2] * values[5] + values[3] * values[6] + values[4] * power
    values[6] = power
    values[7] = 1.0
    force: float = values[5] * (values[0] * x_V + values[1] * speed_V)
    return force


@functools.cache
def _compiled() -> Any:
    return compiled_force(_law)

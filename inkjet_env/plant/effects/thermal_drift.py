"""The head warms up: frequency and damping wander from recording to recording."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.recorded_motion import too_slow
from inkjet_env.plant.resonance import Resonance
from inkjet_env.plant.wording import percent
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

KNOTS = 9
"""Number of knots, equally spaced over the session after the first recording, where the drift is zero."""
FEWEST_ORDERS = 4
"""Smallest number of fast recordings of different order that can show a drift."""
ORDERS_A_KNOT = 2.0
"""Smallest number of fast recordings per knot."""


class ThermalDrift(Effect):
    """Frequency and damping ratio as smooth curves over the order, through values at nine knots of the session."""

    id = "thermal_drift"
    stage = "resonator"
    sentence = "The head's frequency and damping drift during the session."
    equation = "ω0 (1 + f), ζ (1 + z); f, z cubic splines (Catmull & Rom) over the order, zero at the first recording"
    source = (
        "H. Wijshoff, The dynamics of the piezo inkjet printhead operation, Physics Reports 491, 2010; any course: "
        "E. Catmull, R. Rom, A class of local interpolating splines, Computer Aided Geometric Design, 1974"
    )
    parameters = (
        Parameter("last_order", "1", 1.0, 1e6, meaning="order at the last of the nine knots", open_ended=True),
        *(
            Parameter(f"frequency_{k}", "1", -0.5, 0.5, meaning=f"relative change of frequency at knot {k}")
            for k in range(1, KNOTS + 1)
        ),
        *(
            Parameter(f"damping_{k}", "1", -3.0, 3.0, meaning=f"relative change of the damping ratio at knot {k}")
            for k in range(1, KNOTS + 1)
        ),
    )
    strengths = tuple(parameter.name for parameter in parameters[1:])
    terms = (strengths[:KNOTS], strengths[KNOTS:])
    signature = "width and frequency of the resonance follow the order of the recordings, whatever their drives"
    confusable_with = ("air_bubble", "meniscus_refill", "quadratic_damping", "self_heating")
    shown_by = "the same drive repeatedly throughout the session, and amplitudes in random order"
    depends_on_order = True

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        places = np.arange(1, KNOTS + 1) / KNOTS
        courses = (places, np.sin(math.pi * places), np.sin(2 * math.pi * places), 1 - np.cos(2 * math.pi * places))
        off = {"last_order": last_order(excitations)} | dict.fromkeys(self.strengths, 0.0)
        return [
            off | {f"{name}_{k}": float(size * course[k - 1]) for k in range(1, KNOTS + 1)}
            for name, size in (("frequency", 0.1 * printhead.damping_ratio), ("damping", 0.1))
            for course in courses
        ]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        places = range(1, KNOTS + 1)
        frequency = {f"frequency_{k}": -0.01 * k / KNOTS + 0.012 * k * (KNOTS - k) / KNOTS**2 for k in places}
        return {"last_order": 29.0, **frequency, **{f"damping_{k}": -0.1 * k / KNOTS for k in places}}

    def bounds(self, printhead: Printhead, excitations: Sequence[Excitation]) -> dict[str, tuple[float, float]]:
        last = last_order(excitations)
        latest = max((excitation.order for excitation in excitations if excitation.fast), default=1)
        reached = math.ceil(KNOTS * (latest - 1) / (last - 1))
        beyond = range(reached + 1, KNOTS + 1)
        return {"last_order": (last, last)} | {f"{n}_{k}": (0.0, 0.0) for n in ("frequency", "damping") for k in beyond}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        if len({excitation.order for excitation in excitations if excitation.fast}) < FEWEST_ORDERS:
            return too_slow(excitations) or f"the fast recordings have fewer than {FEWEST_ORDERS} different orders"
        return None

    def changes(self, name: str, excitation: Excitation, values: Values) -> bool:
        if name == "last_order":
            return True
        return bool(_weights(excitation.order, values["last_order"])[int(name.rpartition("_")[2])])

    def description(self, values: Values, unit: str = "V") -> str:
        said, orders = [], 1.0
        for name, more, less, verb in (
            ("frequency", "higher", "lower", "rings"),
            ("damping", "more", "less", "is damped"),
        ):
            course = np.array([0.0, *(values[f"{name}_{k}"] for k in range(1, KNOTS + 1))])
            if course.any():
                ends = int(np.flatnonzero(course)[-1])
                orders = max(orders, 1 + (values["last_order"] - 1) * ends / KNOTS)
                end, far = float(course[ends]), float(course[np.abs(course).argmax()])
                words = f"{verb} {percent(abs(end))} {more if end > 0 else less}"
                if abs(far) > 1.2 * abs(end):
                    words += f" (in between, {percent(abs(far))} {more if far > 0 else less})"
                said.append(words)
        if not said:
            return self.sentence
        return f"After {round(orders)} recordings the head {' and '.join(said)}."

    def resonator(self, values: Values, resonance: Resonance, excitation: Excitation) -> Resonance:
        weights = _weights(excitation.order, values["last_order"])
        frequency = 1 + sum(float(weights[k]) * values[f"frequency_{k}"] for k in range(1, KNOTS + 1))
        damping = 1 + sum(float(weights[k]) * values[f"damping_{k}"] for k in range(1, KNOTS + 1))
        return replace(resonance, a0=resonance.a0 * frequency**2, a1=resonance.a1 * frequency * damping)


def last_order(excitations: Sequence[Excitation]) -> float:
    """Order of the ninth knot: that of the last fast recording, or later if the recordings are too few for nine."""
    orders = {excitation.order for excitation in excitations if excitation.fast} or {2}
    latest = max(*orders, 2)
    return 1 + (latest - 1) * max(1.0, KNOTS * ORDERS_A_KNOT / len(orders))


def _weights(order: float, last: float) -> Real:
    """Weights of the knots 0 … KNOTS in the curve's value at an order, shape (KNOTS + 1,); constant beyond the ends."""
    at = KNOTS * min(max((order - 1) / max(last - 1, 1.0), 0.0), 1.0)
    left = min(int(at), KNOTS - 1)
    t = at - left
    four = np.array(
        [
            -0.5 * t + t * t - 0.5 * t**3,
            1 - 2.5 * t * t + 1.5 * t**3,
            0.5 * t + 2 * t * t - 1.5 * t**3,
            -0.5 * t * t + 0.5 * t**3,
        ]
    )
    weights = np.zeros(KNOTS + 1)
    for place, weight in zip(range(left - 1, left + 3), four, strict=True):
        if place < 0:  # beyond its ends the curve is extrapolated linearly
            weights[0] += 2 * weight
            weights[1] -= weight
        elif place > KNOTS:
            weights[KNOTS] += 2 * weight
            weights[KNOTS - 1] -= weight
        else:
            weights[place] += weight
    return weights

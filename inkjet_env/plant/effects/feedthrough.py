"""Current of the drive itself that the capacitance compensation leaves in the self-sensing signal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.low_pass import low_passed
from inkjet_env.plant.stages import Plant
from inkjet_env.plant.wording import with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

MIDDLING = 0.05
"""Strength of the starts, as a share of the signal's RMS."""


class Feedthrough(Effect):
    """Two currents added to self-sensing: one proportional to the slope of the drive, one to the drive."""

    id = "feedthrough"
    stage = "sensing"
    sentence = "The capacitance compensation is imperfect: part of the drive's own current reaches the sensor."
    equation = "y = y₀ + k_C w' + k_R u, w + τ w' = u"
    source = (
        "Dosch, Inman & Garcia, A self-sensing piezoelectric actuator for collocated control, "
        "J. Intell. Mater. Syst. Struct. 3(1), 1992: the unbalanced bridge"
    )
    parameters = (
        Parameter("capacitive_s", "V s/V", -1.0, 1.0, "linear", "sensor voltage for a drive that rises by 1 V/s"),
        Parameter("lossy", "1", -10.0, 10.0, "linear", "sensor voltage for 1 V of drive"),
        Parameter("lag_s", "s", 0.0, 1.0, meaning="τ: time constant of the capacitance", open_ended=True, plain=0.0),
    )
    strengths = ("capacitive_s", "lossy")
    signature = "present on the edges of the drive only, as a step for as long as the edge; it does not ring"
    confusable_with = ("crosstalk", "second_mode")
    shown_by = "the self-sensing signal under edges of several slopes to the same voltage"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        own = [excitation for excitation in excitations if excitation.channel == "self_sensing"]
        size = rms([Plant(printhead).signal(excitation) for excitation in own])
        slope = rms([slopes(excitation.drive_at_nodes_V, excitation) for excitation in own])
        drive = rms([excitation.drive_V for excitation in own])
        return [
            {"capacitive_s": MIDDLING * size / slope, "lossy": 0.0, "lag_s": 0.0},
            {"capacitive_s": 0.0, "lossy": MIDDLING * size / drive, "lag_s": 0.0},
        ]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"capacitive_s": 0.01 * printhead.b1 / printhead.a0, "lossy": 2e-4}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        if any(excitation.channel == "self_sensing" and np.ptp(excitation.drive_V) > 0 for excitation in excitations):
            return None
        return "no recording of self-sensing has a drive that changes"

    def description(self, values: Values, unit: str = "V") -> str:
        per_s = values["capacitive_s"]
        edge_V_s = 1e7 if abs(per_s) < 1e-5 else 1e4
        heard = []
        if per_s:
            heard.append(f"{with_prefix(edge_V_s * per_s, 'V')} on an edge of {with_prefix(edge_V_s, 'V/s')}")
        if values["lossy"]:
            heard.append(f"{with_prefix(100 * values['lossy'], 'V')} at a steady drive of 100 V")
        return f"The capacitance compensation is imperfect; the sensor shows {' and '.join(heard)}."

    def sensing(
        self, values: Values, signal: Real, drive_V: Real, printhead: Printhead, excitation: Excitation
    ) -> Real:
        if excitation.channel != "self_sensing":
            return signal
        charging_V = low_passed(drive_V, values["lag_s"], 0.0, excitation.node_step_s, excitation.periodic)
        return (
            signal
            + values["capacitive_s"] * slopes(charging_V, excitation)
            + values["lossy"] * excitation.sampled(drive_V)
        )


def slopes(at_nodes_V: Real, excitation: Excitation) -> Real:
    """Slope at the samples, shape (n,), in V/s: the mean of the slopes to the nodes on either side.

    At the ends of a drive that does not repeat it is the slope on the inner side.
    """
    h = excitation.node_step_s
    after, before = at_nodes_V[1 :: excitation.substeps], at_nodes_V[excitation.substeps - 1 :: excitation.substeps]
    if excitation.periodic:
        return (after - np.roll(before, 1)) / (2 * h)
    first, last = at_nodes_V[1] - at_nodes_V[0], at_nodes_V[-1] - at_nodes_V[-2]
    return np.concatenate([[first / h], (after[1:] - before[:-1]) / (2 * h), [last / h]])


def rms(signals: Sequence[Real]) -> float:
    """Root mean square of all values of all signals, in their unit; 1 if all are zero."""
    values = np.concatenate(signals) if signals else np.zeros(1)
    return float(np.sqrt(np.mean(values**2))) or 1.0

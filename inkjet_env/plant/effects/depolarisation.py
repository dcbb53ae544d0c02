"""Depolarisation: the ceramic loses gain beyond a coercive voltage of negative sign, and with every recording."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values
from inkjet_env.plant.errors import SimulationError
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

REFERENCE_V = 100.0
"""Excess over the coercive voltage, in volts, to which the loss refers."""
SHARES = (0.3, 0.6)
"""Coercive voltages of the starts, as shares of the most negative drive."""
RECOVERIES = (2.0, 30.0)
"""Recovery times of the starts, in periods of the head."""
LOST = 0.03
"""Largest loss in the starts."""
AGEING = 0.02
"""Loss per decade of recordings in the start."""
LEAST_LEFT = 0.02
"""Share of the gain that must be left."""


class Depolarisation(Effect):
    """A gain that falls with the largest excess over the coercive voltage so far, forgotten with a time constant.

    Or with the share of domains that are reversed: it grows towards 1 beyond the coercive voltage, and falls towards 0
    beyond the opposite one, with the same time constant. At the start of a recording from the demagnetised state the
    ceramic is fully polarised, but for its ageing, which goes with the logarithm of the recording's order.
    """

    id = "depolarisation"
    stage = "hysteresis"
    sentence = "Strong negative drives, or many drives, depolarise the ceramic, which loses gain."
    equation = (
        "v (1 - loss (permanent n∞ + (1 - permanent) n) - reversal r - ageing log10(order)), "
        "n(t) = max over s ≤ t of e(s) exp((s - t) / recovery_s), n∞ "
        "the same with recovery_s = ∞, e = max(-u - coercive_V, 0) / 100 V; "
        "recovery_s r' = [u < -coercive_V] (1 - r) - [u > coercive_V] r"
    )
    source = (
        "B. Jaffe, W. R. Cook, H. Jaffe, Piezoelectric Ceramics, Academic Press, 1971: depoling, and ageing by "
        "decades; the recovery is an empirical law"
    )
    parameters = (
        Parameter("loss", "1", -0.2, 5.0, meaning="relative fall of the gain, 100 V beyond the coercive voltage"),
        Parameter("coercive_V", "V", 0.0, 1e3, meaning="magnitude of the negative voltage at which the loss begins"),
        Parameter("recovery_s", "s", 1e-9, 1e6, "log", "time constant of the recovery", open_ended=True),
        Parameter(
            "permanent", "1", 0.0, 1.0, meaning="share of the loss that does not recover", open_ended=True, plain=0.0
        ),
        Parameter("ageing", "1", -0.2, 0.3, meaning="relative fall of the gain per decade of recordings"),
        Parameter("reversal", "1", -0.2, 0.5, meaning="relative fall of the gain when all domains are reversed"),
    )
    strengths = ("loss", "ageing", "reversal")
    signature = "after strong negative voltages, or after many recordings, the same pulse moves the head less"
    confusable_with = ("asymmetric_hysteresis", "voltage_dependent_gain")
    shown_by = "the same small pulse before and after negative pulses of growing voltage, throughout the session"
    depends_on_order = True

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        lowest_V = _lowest_V(excitations) or 0.5 * printhead.full_scale_V
        longest_s = max((s.samples * s.step_s for s in excitations), default=1.0)
        by_voltage = [
            {
                "loss": min(LOST * REFERENCE_V / ((1 - share) * lowest_V), 5.0),
                "coercive_V": min(share * lowest_V, 1e3),
                "recovery_s": periods / printhead.frequency_Hz,
                "permanent": 0.0,
                "ageing": 0.0,
                "reversal": 0.0,
            }
            for share in SHARES
            for periods in RECOVERIES
        ]
        aged = [by_voltage[0] | {"loss": 0.0, "ageing": AGEING}] if len({s.order for s in excitations}) > 1 else []
        turned = [
            by_voltage[k] | {"loss": 0.0, "reversal": LOST, "recovery_s": longest_s / 10} for k in (0, len(RECOVERIES))
        ]
        return ([*by_voltage, *turned] if _lowest_V(excitations) > 0 else []) + aged

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"loss": 0.2, "coercive_V": 30.0, "recovery_s": 10 / printhead.frequency_Hz, "ageing": 0.01}

    def bounds(self, printhead: Printhead, excitations: Sequence[Excitation]) -> dict[str, tuple[float, float]]:
        lowest_V = _lowest_V(excitations)
        narrower = {"coercive_V": (0.0, min(0.95 * lowest_V, 1e3))} if lowest_V > 1e-6 else {}
        shortest_s = min((s.step_s for s in excitations), default=1e-9)
        longest_s = max((s.samples * s.step_s for s in excitations), default=1e4)
        return narrower | {"recovery_s": (max(shortest_s, 1e-9), min(100 * longest_s, 1e6))}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        if _lowest_V(excitations) > 0 or len({excitation.order for excitation in excitations}) > 1:
            return None
        return "no recording has a negative drive or another order"

    def description(self, values: Values, unit: str = "V") -> str:
        said = []
        if values["loss"]:
            text = (
                f"below -{with_prefix(values['coercive_V'], 'V')} it {_loses(values['loss'])} "
                f"{percent(abs(values['loss']) / 10)} of its gain per 10 V, with a recovery time of "
                f"{with_prefix(values['recovery_s'], 's')}"
            )
            said.append(f"{text} ({percent(values['permanent'])} is permanent)" if values["permanent"] else text)
        if values["reversal"]:
            share = percent(abs(values["reversal"]))
            said.append(
                f"it {_loses(values['reversal'])} up to {share} of its gain while it is held "
                f"below -{with_prefix(values['coercive_V'], 'V')}, with a time constant of "
                f"{with_prefix(values['recovery_s'], 's')}, and regains it above the opposite voltage"
            )
        if values["ageing"]:
            share = percent(abs(values["ageing"]))
            said.append(
                f"it {_loses(values['ageing'])} {share} of its gain in every decade of recordings (1 to 10 to 100)"
            )
        return f"The ceramic changes: {', and '.join(said)}." if said else self.sentence

    def hysteresis(
        self, values: Values, hysteretic_V: Real, drive_V: Real, printhead: Printhead, excitation: Excitation
    ) -> Real:
        aged: Real | float = values["ageing"] * math.log10(max(excitation.order, 1))
        keep = math.exp(-excitation.node_step_s / values["recovery_s"])
        if values["reversal"]:
            aged = aged + values["reversal"] * reversed_share(drive_V, values["coercive_V"], keep, excitation.periodic)
        if values["loss"] == 0:
            return hysteretic_V * (1 - aged) if np.any(aged) else hysteretic_V
        excess = np.maximum(-drive_V - values["coercive_V"], 0.0) / REFERENCE_V
        lost = remembered(excess, keep, excitation.periodic)
        if values["permanent"]:
            lost = lost + values["permanent"] * (remembered(excess, 1.0, excitation.periodic) - lost)
        left = 1 - aged - values["loss"] * lost
        if left.min() < LEAST_LEFT:
            raise SimulationError("nothing is left of the piezoelectric gain.")
        return hysteretic_V * left


def _loses(change: float) -> str:
    return "loses" if change > 0 else "gains"


def remembered(excess: Real, keep: float, periodic: bool) -> Real:
    """Largest excess so far, of which a share ``keep`` is remembered from node to node, at the nodes, shape (n,).

    Exact for maxima at the nodes. In steady state if periodic; otherwise there was none before the first node.
    """
    from inkjet_env.plant import compiled_hysteresis

    result = np.empty(excess.size)
    # An excess is largest in the period in which it occurs, so one period before the recording is enough.
    compiled_hysteresis.remembered_maximum(np.ascontiguousarray(excess), keep, 2 if periodic else 1, result)
    return result


def reversed_share(drive_V: Real, coercive_V: float, keep: float, periodic: bool) -> Real:
    """Share of domains that are reversed, at the nodes, shape (n,): 0 before the first node, or in steady state.

    Parameters
    ----------
    drive_V : ndarray, shape (n,)
        Voltage at the ceramic at the nodes, in volts.
    coercive_V : float
        Magnitude of the voltage beyond which the share changes, in volts.
    keep : float
        Share of the way to 0 or 1 that is left after a node step.
    periodic : bool
        Whether the drive is repeated.
    """
    from inkjet_env.plant import compiled_hysteresis

    result, drive_V = np.empty(drive_V.size), np.ascontiguousarray(drive_V)
    start = 0.0
    if periodic:  # over a period, the share is linear in that at its start
        ends = [compiled_hysteresis.reversed_share(drive_V, coercive_V, keep, share, result) for share in (0.0, 1.0)]
        kept = ends[1] - ends[0]
        start = ends[0] / (1 - kept) if kept < 1 else 0.0
    compiled_hysteresis.reversed_share(drive_V, coercive_V, keep, start, result)
    return result


def _lowest_V(excitations: Sequence[Excitation]) -> float:
    """Magnitude of the most negative drive, in volts; 0 if none is negative."""
    return max((-float(s.drive_V.min()) for s in excitations), default=0.0)

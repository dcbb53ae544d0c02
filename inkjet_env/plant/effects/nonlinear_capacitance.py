"""A head whose capacitance depends on the voltage: its lag behind a resistance, and its current in self-sensing."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values, complete
from inkjet_env.plant.effects.feedthrough import MIDDLING, rms, slopes
from inkjet_env.plant.errors import SimulationError
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.lag import decay_per_period
from inkjet_env.plant.recorded_motion import too_slow
from inkjet_env.plant.stages import Plant
from inkjet_env.plant.wording import percent, with_prefix
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

REFERENCE_V = 100.0
"""Voltage to which the change of the capacitance refers, in volts."""
LAGS = (0.01, 0.03, 0.1)
"""Lags of the starts, in periods of the head."""
CURVATURES = (0.7, -0.3)
"""Changes of the capacitance in the starts."""
FEWEST_STEPS = 1e-6
"""Lag in node steps below which there is none."""
EDGE_V_S = 1e7
"""Slope of the edge for which a description states the self-sensing signal."""
MOST_PERIODS = 60
"""Largest number of periods until the steady state."""
SETTLED = 1e-10
"""Change over a period below which the state is steady, as a share of the largest voltage."""


class NonlinearCapacitance(Effect):
    """First-order lag of a source with a resistance, in proportion to a capacitance that depends on the voltage.

    With a constant capacitance it is an amplifier bandwidth of one pole. A self-sensing bridge is balanced for a
    constant capacitance, so the current of the rest reaches its signal, with a resistance or without.
    """

    id = "nonlinear_capacitance"
    stage = "drive"
    also = ("sensing",)
    sentence = "The head's capacitance depends on the voltage, so the drive lags by a time that depends on the level."
    equation = (
        "τ c(u) u' = u_requested - u, c = 1 + slope w ± branch w + curvature w², w = u / 100 V, + while u rises; "
        "y = y₀ + (bridge_s w² + tilted_bridge_s w) u'"
    )
    source = (
        "D. Damjanovic, Ferroelectric, dielectric and piezoelectric properties of ferroelectric thin films and "
        "ceramics, Reports on Progress in Physics 61, 1998: permittivity and field"
    )
    parameters = (
        Parameter("lag_s", "s", 0.0, 1.0, meaning="τ: resistance of the source times the capacitance at 0 V"),
        Parameter("curvature", "1", -0.9, 10.0, meaning="relative change of the capacitance at ±100 V"),
        Parameter("slope", "1", -0.9, 0.9, meaning="further change at 100 V, opposite at -100 V", plain=0.0),
        Parameter("branch", "1", -0.9, 0.9, meaning="the same while u rises, and opposite while it falls", plain=0.0),
        Parameter("bridge_s", "V s/V", -1.0, 1.0, meaning="self-sensing at ±100 V, for a drive that rises by 1 V/s"),
        Parameter("tilted_bridge_s", "V s/V", -1.0, 1.0, meaning="the same at 100 V, and opposite at -100 V"),
    )
    strengths = ("lag_s", "bridge_s", "tilted_bridge_s")
    characteristic = ("curvature", "slope", "branch", "bridge_s", "tilted_bridge_s")
    signature = "edges lag like those behind a resistance, but by another time at high voltage than near 0 V"
    confusable_with = ("amplifier_bandwidth", "sensor_bandwidth", "trigger_delay", "slew_limit")
    shown_by = "small steps on top of several bias voltages, and the voltage at the head (column drive_monitor_V)"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        largest_V = max((float(np.abs(s.drive_V).max()) for s in excitations), default=0.0)
        least = -0.7 * (REFERENCE_V / max(largest_V, 1.0)) ** 2
        lags = [
            complete(self, lag_s=lag / printhead.frequency_Hz, curvature=max(curvature, least))
            for lag in LAGS
            for curvature in CURVATURES
        ]
        own = [excitation for excitation in excitations if excitation.channel == "self_sensing"]
        if not own:
            return lags
        size = MIDDLING * rms([Plant(printhead).signal(excitation) for excitation in own])
        currents = [[current(s.drive_at_nodes_V, s, *of) for s in own] for of in ((1.0, 0.0), (0.0, 1.0))]
        bridges = zip(("bridge_s", "tilted_bridge_s"), currents, strict=True)
        return lags + [complete(self, curvature=CURVATURES[0], **{name: size / rms(one)}) for name, one in bridges]

    def example_values(self, printhead: Printhead, largest: float = 1.0, noise_rms: float = 1.0) -> dict[str, float]:
        return {"lag_s": 0.02 / printhead.frequency_Hz, "curvature": 0.6}

    def bounds(self, printhead: Printhead, excitations: Sequence[Excitation]) -> dict[str, tuple[float, float]]:
        return {"lag_s": (0.0, min(1.0 / printhead.frequency_Hz, 1.0))}

    def untestable(self, excitations: Sequence[Excitation]) -> str | None:
        return too_slow(excitations)

    def description(self, values: Values, unit: str = "V") -> str:
        rises = [values["curvature"] + side * values["slope"] for side in (1, -1)]
        signed = [f"{percent(rise, signed=True)} at {'' if k == 0 else '-'}100 V" for k, rise in enumerate(rises)]
        at = " and ".join(signed) if values["slope"] else f"{percent(rises[0], signed=True)} at ±100 V"
        butterfly = " and differs between rising and falling voltages" if values["branch"] else ""
        said = []
        if values["lag_s"]:
            said.append(
                f"Behind the source's resistance the drive lags by {with_prefix(values['lag_s'], 's')} near 0 V; the "
                f"lag changes with the head's capacitance by {at}{butterfly}."
            )
        if values["bridge_s"] or values["tilted_bridge_s"]:
            heard = [EDGE_V_S * (values["bridge_s"] + side * values["tilted_bridge_s"]) for side in (1, -1)]
            above, below = (with_prefix(volts, "V") for volts in heard)
            said.append(
                "The head's capacitance changes with the voltage, so the self-sensing bridge is unbalanced: on an edge "
                f"of {with_prefix(EDGE_V_S, 'V/s')} it shows {above} at 100 V and {below} at -100 V."
            )
        return " ".join(said) or self.sentence

    def drive(self, values: Values, drive_V: Real, excitation: Excitation) -> Real:
        lag = values["lag_s"] / excitation.node_step_s
        if lag < FEWEST_STEPS:
            return drive_V
        slope, branch = values["slope"] / REFERENCE_V, values["branch"] / REFERENCE_V
        return charged_V(drive_V, lag, slope, branch, values["curvature"] / REFERENCE_V**2, excitation.periodic)

    def sensing(
        self, values: Values, signal: Real, drive_V: Real, printhead: Printhead, excitation: Excitation
    ) -> Real:
        even_s, odd_s = values["bridge_s"], values["tilted_bridge_s"]
        if excitation.channel != "self_sensing" or even_s == odd_s == 0:
            return signal
        return signal + current(drive_V, excitation, even_s, odd_s)


def current(drive_V: Real, excitation: Excitation, even_s: float, odd_s: float) -> Real:
    """Self-sensing voltage of the charge's slope, (even_s w² + odd_s w) u' with w = u / 100 V, at the samples: (n,)."""
    ratio = drive_V / REFERENCE_V
    return slopes(drive_V * ratio * (even_s * ratio / 3 + odd_s / 2), excitation)


def charged_V(
    drive_V: Real, lag: float, slope_per_V: float, branch_per_V: float, curvature_per_V2: float, periodic: bool
) -> Real:
    """Voltage of the capacitance at the nodes, in volts, shape (n,).

    Parameters
    ----------
    drive_V : ndarray, shape (n,)
        Voltage of the source at the nodes, in volts, linear between them.
    lag : float
        Time constant at 0 V, in nodes; above 0.
    slope_per_V, branch_per_V, curvature_per_V2 : float
        Relative change of the capacitance with the voltage, the same with its sign while it falls, and with its square.
    periodic : bool
        Whether the result is the steady state of the repeated drive; otherwise it starts at the first value.

    Raises
    ------
    SimulationError
        The capacitance is not positive at some voltage, or no steady state was found.
    """
    from inkjet_env.plant import compiled_drive

    ends_V = np.append(drive_V, drive_V[0]) if periodic else np.ascontiguousarray(drive_V)
    result = np.empty(ends_V.size)
    start = float(ends_V[0])
    decay = decay_per_period(lag, drive_V.size)
    least_V = SETTLED * max(float(np.abs(ends_V).max()), 1e-12)
    for _ in range(MOST_PERIODS if periodic else 1):
        end = compiled_drive.charged(ends_V, lag, slope_per_V, branch_per_V, curvature_per_V2, start, result)
        if not math.isfinite(end):
            raise SimulationError("the capacitance is not positive at some voltage.")
        if not periodic or abs(end - start) <= least_V:
            return result[: drive_V.size]
        start += (end - start) / decay
    raise SimulationError("there is no steady state under the repeated drive.")

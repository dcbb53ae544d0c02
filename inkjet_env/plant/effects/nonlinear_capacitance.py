"""A head whose capacitance depends on the voltage, behind a resistance: the lag depends on the level."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from inkjet_env.plant.effect import Effect, Parameter, Values, complete
from inkjet_env.plant.errors import SimulationError
from inkjet_env.plant.excitation import Excitation
from inkjet_env.plant.lag import decay_per_period
from inkjet_env.plant.recorded_motion import too_slow
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
MOST_PERIODS = 60
"""Largest number of periods until the steady state."""
SETTLED = 1e-10
"""Change over a period below which the state is steady, as a share of the largest voltage."""


class NonlinearCapacitance(Effect):
    """First-order lag of a source with a resistance, in proportion to a capacitance that depends on the voltage.

    With a constant capacitance it is an amplifier bandwidth of one pole.
    """

    id = "nonlinear_capacitance"
    stage = "drive"
    sentence = "The head's capacitance depends on the voltage, so the drive lags by a time that depends on the level."
    equation = "τ c(u) u' = u_requested - u, c = 1 + slope w ± branch w + curvature w², w = u / 100 V, + while u rises"
    source = (
        "D. Damjanovic, Ferroelectric, dielectric and piezoelectric properties of ferroelectric thin films and "
        "ceramics, Reports on Progress in Physics 61, 1998: permittivity and field"
    )
    parameters = (
        Parameter("lag_s", "s", 0.0, 1.0, meaning="τ: resistance of the source times the capacitance at 0 V"),
        Parameter("curvature", "1", -0.9, 10.0, meaning="relative change of the capacitance at ±100 V"),
        Parameter("slope", "1", -0.9, 0.9, meaning="further change at 100 V, opposite at -100 V", plain=0.0),
        Parameter("branch", "1", -0.9, 0.9, meaning="the same while u rises, and opposite while it falls", plain=0.0),
    )
    strengths = ("lag_s",)
    signature = "edges lag like those behind a resistance, but by another time at high voltage than near 0 V"
    confusable_with = ("amplifier_bandwidth", "sensor_bandwidth", "trigger_delay", "slew_limit")
    shown_by = "small steps on top of several bias voltages, and the voltage at the head (column drive_monitor_V)"

    def starts(self, printhead: Printhead, excitations: Sequence[Excitation]) -> list[dict[str, float]]:
        largest_V = max((float(np.abs(s.drive_V).max()) for s in excitations), default=0.0)
        least = -0.7 * (REFERENCE_V / max(largest_V, 1.0)) ** 2
        return [
            complete(self, lag_s=lag / printhead.frequency_Hz, curvature=max(curvature, least))
            for lag in LAGS
            for curvature in CURVATURES
        ]

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
        return (
            f"Behind the source's resistance the drive lags by {with_prefix(values['lag_s'], 's')} near 0 V; the lag "
            f"changes with the head's capacitance by {at}{butterfly}."
        )

    def drive(self, values: Values, drive_V: Real, excitation: Excitation) -> Real:
        lag = values["lag_s"] / excitation.node_step_s
        if lag < FEWEST_STEPS:
            return drive_V
        slope, branch = values["slope"] / REFERENCE_V, values["branch"] / REFERENCE_V
        return charged_V(drive_V, lag, slope, branch, values["curvature"] / REFERENCE_V**2, excitation.periodic)


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

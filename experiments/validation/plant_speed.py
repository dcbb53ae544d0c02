"""Speed of the plant on one core: compared with SciPy's integrators at the same accuracy, and the cost of effects.

`speed` prints both. All methods compute the same quantity: the
velocity of a head with a cubic spring at the samples of a bipolar pulse, from rest, with a given hysteretic drive that
is linear between nodes. Errors are relative to SciPy's integrator at the tightest tolerance; a baseline's tolerance is
the loosest of a ladder with which it is as accurate as the plant. It integrates from corner to corner of the drive,
which suits it best; its equation is in Python, as users write it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from inkjet_env.experiments.validation.simulator_speed import best_seconds
from inkjet_env.plant import Excitation, Plant, Resonance
from inkjet_env.plant.effects.cubic_stiffness import CubicStiffness
from inkjet_env.plant.effects.second_mode import SecondMode
from inkjet_env.plant.effects.wave_echo import WaveEcho
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

REPETITIONS = 15
CALLS = 50
SAMPLES = 2000
SAMPLES_A_PERIOD = 100
STIFFENING_PER_V2 = 2e-6
LADDER = (1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7)
FINEST = 3e-13
EFFECTS = (CubicStiffness(), WaveEcho(), SecondMode())


@dataclass(frozen=True)
class Baseline:
    """A baseline integrator: method, tolerance, errors of both relative to the largest value, seconds of both."""

    method: str
    rtol: float
    error: float
    plant_error: float
    seconds: float
    plant_seconds: float

    @property
    def ratio(self) -> float:
        """Factor by which the plant is faster."""
        return self.seconds / self.plant_seconds


def standard_shot(head: Printhead, initial_state: str) -> Excitation:
    """A recording of a bipolar pulse, 20 resonance periods long, whose corners are samples."""
    corners = [0, 10, 65, 95, 160, 180]
    drive_V = np.interp(np.arange(SAMPLES), corners, [0.0, 90.0, 90.0, -80.0, -80.0, 0.0])
    return Excitation("self_sensing", initial_state, 1 / (SAMPLES_A_PERIOD * head.frequency_Hz), drive_V)


def integrated(method: str, rtol: float, head: Printhead, excitation: Excitation) -> Real:
    """Velocity at the samples divided by ``a0``, from `scipy.integrate.solve_ivp` between the corners of the drive."""
    from scipy.integrate import solve_ivp

    a0, a1, k = head.a0, head.a1, STIFFENING_PER_V2
    drive_V, step_s = excitation.drive_V, excitation.step_s
    bends = np.flatnonzero(np.abs(np.diff(drive_V, 2)) > 1e-9) + 1
    state, speed = np.zeros(2), np.zeros(excitation.samples)
    for begin, end in zip([0, *bends], [*bends, excitation.samples - 1], strict=True):
        level, rate = drive_V[begin], (drive_V[end] - drive_V[begin]) / ((end - begin) * step_s)

        def slopes(t: float, y: Real, level: float = level, rate: float = rate) -> list[float]:
            x, p = y
            return [p, a0 * (level + rate * t - x - k * x * x * x) - a1 * p]

        times_s = step_s * np.arange(end - begin + 1)
        found = solve_ivp(
            slopes, (0.0, times_s[-1]), state, method, times_s, rtol=rtol, atol=rtol * np.array([1.0, math.sqrt(a0)])
        )
        speed[begin : end + 1], state = found.y[1], found.y[:, -1]
    return speed / a0


def baselines(head: Printhead) -> list[Baseline]:
    """The plant's resonator compared with SciPy's integrators, each at the plant's accuracy."""
    excitation = standard_shot(head, "demagnetised")
    base = Resonance(head.a0, head.a1, head.a0)
    resonance = CubicStiffness().resonator({"stiffening_per_V2": STIFFENING_PER_V2}, base, excitation)
    drive_V = excitation.drive_at_nodes_V
    exact = integrated("DOP853", FINEST, head, excitation)

    def error(signal: Real) -> float:
        return float(np.abs(signal - exact).max() / np.abs(exact).max())

    plant_error = error(resonance.motion(drive_V, excitation))

    def ours() -> None:
        for _ in range(CALLS):  # one after another, as in a fit
            resonance.motion(drive_V, excitation)

    found = []
    for method in ("RK45", "DOP853", "LSODA"):
        rtol = next((r for r in LADDER if error(integrated(method, r, head, excitation)) <= plant_error), LADDER[-1])
        theirs = partial(integrated, method, rtol, head, excitation)
        seconds = best_seconds({"plant": ours, method: theirs}, REPETITIONS)
        error_there = error(integrated(method, rtol, head, excitation))
        found.append(Baseline(method, rtol, error_there, plant_error, seconds[method], seconds["plant"] / CALLS))
    return found


def costs(head: Printhead) -> dict[str, float]:
    """Nanoseconds per sample of the whole plant by active effect, in steady state under a repeated pulse."""
    excitation = standard_shot(head, "periodic")
    plants = {"base": Plant(head)}
    for effect in EFFECTS:
        plants[effect.id] = Plant(head, effects=((effect, effect.starts(head, [excitation])[-1]),))
    calls: dict[str, Callable[[], Any]] = {name: partial(plant.signal, excitation) for name, plant in plants.items()}
    return {name: 1e9 * seconds / SAMPLES for name, seconds in best_seconds(calls, 200).items()}

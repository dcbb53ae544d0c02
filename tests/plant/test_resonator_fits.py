"""Fits of effects of the resonator from their starts, to recordings without noise, find the truth."""

import numpy as np
import pytest

from inkjet_env.plant import Plant, catalogue
from inkjet_env.plant.effect import complete, coordinates, limits, values_at
from inkjet_env.printhead import Printhead
from tests.plant.sessions import PERIOD_S, session

HEAD = Printhead.published()
EFFECTS = {effect.id: effect for effect in catalogue() if effect.stage == "resonator"}
TRUTHS = {
    "cubic_stiffness": [{"stiffening_per_V2": -8e-7}, {"stiffening_per_V2": 3e-6}],
    "quadratic_damping": [{"damping_per_V": 5e-4}],
    "ferroelastic_softening": [
        {"softening_per_V": 2e-4, "loss_ratio": 0.15},
        {"softening_per_V": 5e-5, "loss_ratio": 6.0},
        {"rayleigh_per_V": 3e-4, "loss_ratio": 1.0},
    ],
    "coulomb_friction": [
        {"friction_V": 0.7, "speed_V": 2.0},
        {"friction_V": 0.7, "speed_V": 1.0, "slip_V": 5.0},
    ],
    "self_heating": [
        {"cooling_s": 20 * PERIOD_S, "stiffness_change": -0.2},
        {"cooling_s": 6 * PERIOD_S, "damping_change": 2.0},
    ],
    "structural_damping": [{"loss_factor": 0.03}],
    "meniscus_refill": [
        {"recovery_s": 30 * PERIOD_S, "stiffness_change": -0.02},
        {"recovery_s": 10 * PERIOD_S, "flow_change": 0.1},
        {"recovery_s": 2 * PERIOD_S, "flow_change": -0.05, "power": 2.0, "second_order": 1.5},
    ],
    "second_mode": [
        {"frequency_Hz": 0.43 * HEAD.frequency_Hz, "damping_ratio": 0.01, "strength": -0.1},
        {"frequency_Hz": 2.7 * HEAD.frequency_Hz, "damping_ratio": 0.006, "strength": 0.03},
        {"frequency_Hz": 5.0 * HEAD.frequency_Hz, "damping_ratio": 0.15, "strength": 0.02},
        {"frequency_Hz": 1.12 * HEAD.frequency_Hz, "damping_ratio": 0.02, "strength": 0.1},
    ],
    "wave_echo": [
        {"delay_s": 0.45 * PERIOD_S, "strength": 0.1},
        {"delay_s": 1.9 * PERIOD_S, "strength": -0.2},
        {"delay_s": 3.05 * PERIOD_S, "strength": 0.1},
    ],
    "air_bubble": [
        {"onset_order": 6.0, "frequency_change": -0.03, "bubble_frequency_Hz": 2.1 * HEAD.frequency_Hz,
         "bubble_damping_ratio": 0.05, "bubble_strength": 0.04},
        {"onset_order": 4.0, "frequency_change": 0.02, "bubble_frequency_Hz": 0.4 * HEAD.frequency_Hz,
         "bubble_damping_ratio": 0.1, "bubble_strength": -0.08},
    ],
    "thermal_drift": [
        {"last_order": 16.75, "frequency_1": -0.02, "frequency_2": -0.03, "damping_1": 0.2, "damping_2": 0.3},
    ],
}  # fmt: skip


@pytest.mark.parametrize(("name", "truth"), [(name, truth) for name, truths in TRUTHS.items() for truth in truths])
def test_a_fit_from_the_starts_that_look_most_like_it_finds_the_truth(name, truth, damped_least_squares):
    effect, excitations = EFFECTS[name], session()
    plant = Plant(HEAD)
    bounds = limits(effect, HEAD, excitations)

    def added(values):
        on = plant.with_effects([(effect, values)])
        return np.concatenate([on.signal(excitation) for excitation in excitations]) - base

    base = np.concatenate([plant.signal(excitation) for excitation in excitations])
    seen = added(complete(effect, **truth))
    size = np.linalg.norm(seen)
    looks = []
    for start in effect.starts(HEAD, excitations):
        column = added(start)
        factor = column @ seen / (column @ column)
        looks.append((abs(column @ seen) / np.linalg.norm(column), np.clip(factor, -3.0, 3.0), start))
    looks.sort(key=lambda look: -look[0])
    best = np.inf
    for _, factor, start in looks[:3]:
        scaled = {n: value * factor if n in effect.strengths else value for n, value in start.items()}
        begin = np.clip(coordinates(effect, scaled), *bounds)
        left = damped_least_squares(lambda z: added(values_at(effect, z)) - seen, begin, bounds)
        best = min(best, left / size)
        if best < 1e-3:
            break
    assert best < 1e-3

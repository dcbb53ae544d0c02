"""Fits of drive, hysteresis and sensing effects from their starts, to recordings without noise, find the truth."""

import numpy as np
import pytest

from inkjet_env.plant import Excitation, Plant, catalogue
from inkjet_env.plant.effect import complete, coordinates, limits, values_at
from inkjet_env.printhead import Printhead

HEAD = Printhead.published()
PERIOD_S = 1 / HEAD.frequency_Hz
STEP_S = PERIOD_S / 50
EFFECTS = {effect.id: effect for effect in catalogue()}
PULSES = np.interp(
    np.arange(600), [0, 10, 35, 55, 80, 100, 300, 305, 325, 330], [0.0, 80, 80, -60, -60, 0, 0, 45, 45, 0]
)
TRUTHS = {
    "supply_droop": [{"droop": 0.08, "recovery_s": 0.6 * PERIOD_S}, {"droop": 0.03, "recovery_s": 20 * PERIOD_S}],
    "nonlinear_capacitance": [
        {"lag_s": 0.015 * PERIOD_S, "curvature": 1.3},
        {"lag_s": 0.05 * PERIOD_S, "curvature": -0.4},
    ],
    "generator_steps": [{"update_s": 0.04 * PERIOD_S}, {"update_s": 0.11 * PERIOD_S}],
    "voltage_dependent_gain": [{"electrostriction": -0.06}, {"stiffening": 0.05}],
    "depolarisation": [
        {"loss": 0.3, "coercive_V": 35.0, "recovery_s": 8 * PERIOD_S},
        {"loss": 0.1, "coercive_V": 10.0, "recovery_s": 60 * PERIOD_S},
    ],
    "backlash": [{"gap_V": 1.2}, {"dead_zone_V": 2.5}],
    "sensor_highpass": [{"corner_Hz": ratio * HEAD.frequency_Hz} for ratio in (0.002, 0.04, 0.3)],
    "timebase_error": [{"skew": skew} for skew in (5e-5, -8e-4, 7e-3)],
}


@pytest.mark.parametrize(("name", "truth"), [(name, truth) for name, truths in TRUTHS.items() for truth in truths])
def test_a_fit_from_the_starts_that_look_most_like_it_finds_the_truth(name, truth, damped_least_squares):
    effect = EFFECTS[name]
    excitations = [
        Excitation("self_sensing", "demagnetised", STEP_S, PULSES),
        Excitation("self_sensing", "periodic", STEP_S, -0.7 * PULSES),
        Excitation("displacement", "demagnetised", STEP_S, 0.4 * PULSES - 10),
    ]
    scales = [np.abs(Plant(HEAD).signal(excitation)).max() for excitation in excitations]
    plant = Plant(HEAD)
    bounds = limits(effect, HEAD, excitations)

    def added(values):
        on = plant.with_effects([(effect, values)])
        signals = [on.signal(excitation) / scale for excitation, scale in zip(excitations, scales, strict=True)]
        return np.concatenate(signals) - base

    base = np.concatenate([plant.signal(one) / scale for one, scale in zip(excitations, scales, strict=True)])
    seen = added(complete(effect, **truth))
    columns = [(added(start), start) for start in effect.starts(HEAD, excitations)]
    columns.sort(key=lambda pair: -abs(pair[0] @ seen) / np.linalg.norm(pair[0]))
    best = np.inf
    for column, start in columns[:4]:
        factor = np.clip(column @ seen / (column @ column), -3.0, 3.0)
        begun = {n: value * factor if n in effect.strengths else value for n, value in start.items()}
        z = np.clip(coordinates(effect, begun), *bounds)
        free = np.array([p.name not in effect.strengths or begun[p.name] != 0 for p in effect.parameters])
        scale = np.where(z == 0, 1.0, np.abs(z))[free]

        def missing(own, z=z, free=free, scale=scale):
            there = z.copy()
            there[free] = own * scale
            return added(values_at(effect, there)) - seen

        left = damped_least_squares(missing, z[free] / scale, tuple(end[free] / scale for end in bounds))
        best = min(best, left / np.linalg.norm(seen))
        if best < 1e-3:
            break
    assert best < (0.1 if name == "generator_steps" else 1e-3)

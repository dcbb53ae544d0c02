"""Whatever values a fit tries within an effect's bounds, the plant shows finite signals or refuses; it never warns."""

import warnings

import numpy as np
import pytest

from inkjet_env.plant import Excitation, Plant, SimulationError, catalogue
from inkjet_env.printhead import Printhead

HEAD = Printhead.published()
EFFECTS = {effect.id: effect for effect in catalogue()}
NEWEST = (
    "backlash", "coulomb_friction", "depolarisation", "drive_resonance", "ferroelastic_softening", "generator_steps",
    "nonlinear_capacitance", "self_heating", "sensor_highpass", "slew_limit", "structural_damping", "supply_droop",
    "timebase_error", "voltage_dependent_gain",
)  # fmt: skip
DRAWS = 40


def drawn(effect, rng):
    """Values at random coordinates: each at an end, near 0, or anywhere between."""
    values = {}
    for p in effect.parameters:
        low, high = p.bounds
        place = rng.choice([low, high, np.clip(10.0 ** -rng.uniform(1, 14), low, high), rng.uniform(low, high)])
        values[p.name] = min(max(p.value(float(place)), p.low), p.high)
    return values


def recordings():
    """Fast and slow ones, from every initial state, with few samples per period."""
    pulse = np.interp(np.arange(250), [5, 9, 20, 26, 40, 44], [0, 80, 80, -60, -60, 0.0])
    fast_s = 1 / (20 * HEAD.frequency_Hz)
    return [
        Excitation("self_sensing", "demagnetised", fast_s, pulse),
        Excitation("displacement", "periodic", fast_s, pulse - 5),
        Excitation("self_sensing", "free", fast_s, pulse, start=(5.0, -3.0)),
        Excitation("strain_gauge", "periodic", 0.01, pulse),
        Excitation("drive_monitor", "demagnetised", fast_s, pulse),
    ]


@pytest.mark.parametrize("name", NEWEST)
def test_values_within_the_bounds_are_simulated_or_refused_without_a_warning(name):
    effect, rng = EFFECTS[name], np.random.default_rng(3)
    simulated = 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(DRAWS):
            values = drawn(effect, rng)
            plant = Plant(HEAD, effects=((effect, values),))
            for excitation in recordings():
                try:
                    signal = plant.signal(excitation)
                except SimulationError:
                    continue
                assert np.isfinite(signal).all(), values
                simulated += 1
    assert simulated > 2 * DRAWS

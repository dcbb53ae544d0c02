"""A trial value at which there is no head, or no motion, is a trial that fails: no traceback, no answer of its own."""

import math
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.mismatch.fitting.base_parameters import Head, in_convention
from inkjet_env.mismatch.fitting.dataset import observe
from inkjet_env.mismatch.selection.truncated_law import narrower
from inkjet_env.plant import Excitation, Plant, SimulationError
from inkjet_env.plant.effect import complete
from inkjet_env.plant.effects.mains_hum import MainsHum


def test_a_resonator_about_to_be_overdamped_has_one_sided_sensitivities(recorded, head):
    edge = replace(head, a1=2 * math.sqrt(head.a0) * (1 - 1e-7))
    o = next(o for o in observe(recorded()) if o.excitation.fast and not o.still)
    start = Head(edge, {"strain_gauge": 0.02, "self_sensing": edge.b1}, {"strain_gauge": 0.0, "self_sensing": 0.0})
    columns = start.sensitivities(o)
    assert np.isfinite(columns).all()
    inside = Head(replace(edge, a1=0.999 * edge.a1), start.gains, start.offsets).sensitivities(o)
    place = start.degree + 1
    assert columns[:, place] == pytest.approx(inside[:, place], abs=0.02 * np.abs(inside[:, place]).max())


def test_an_effect_whose_values_make_an_impossible_head_fails_as_a_trial(head, effects):
    pulse_V = np.interp(np.arange(300), [10, 25, 60, 75], [0.0, 80.0, 80.0, 0.0])
    excitation = Excitation("self_sensing", "demagnetised", 2e-7, pulse_V, neighbour_V=pulse_V)
    values = complete(effects["crosstalk"], mechanical=0.1, damping_change=5.0)
    damped = head.varied(damping_ratio=0.5)
    with pytest.raises(SimulationError, match="a1 must be below"):
        Plant(damped, effects=((effects["crosstalk"], values),)).signal(excitation)


def test_a_law_without_a_valid_head_is_a_failed_trial_and_no_convention(head):
    flat = Head(replace(head, coefficients=(1e-20, 0.0)), {"self_sensing": head.b1}, {"self_sensing": 0.0})
    assert in_convention(flat) is flat
    with pytest.raises(SimulationError):
        narrower(Head(replace(head, full_scale_V=1e-3), flat.gains, flat.offsets), 0.5)


@pytest.mark.parametrize("samples", [2, 3, 7])
def test_a_hum_with_more_waves_than_a_recording_has_samples_is_no_error(samples):
    excitation = Excitation("strain_gauge", "demagnetised", 1e-3, np.zeros(samples))
    basis = MainsHum().random_effect_basis({"frequency_Hz": 50.0, "multiples": 5.0, "amplitude": 1.0}, excitation)
    assert basis is not None
    assert basis.shape[1] <= samples

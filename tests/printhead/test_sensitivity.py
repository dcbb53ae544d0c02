"""Responses at given times, and derivatives in the waveform and in the head."""

import math

import numpy as np
import pytest

from inkjet_env.printhead import Bounds, PeakCost, Printhead, Waveform, batch
from inkjet_env.printhead.sensitivity import (
    HeadParameters,
    by_parameters,
    costs_and_derivatives,
    pull_back,
    responses,
)

HEAD = Printhead.published()
BEYOND_FULL_SCALE = Printhead(9e10, 2.5e4, 2.1e4, (0.4, -0.3, 0.2, 0.7, 0.0), 110.0)
"""Its largest swing, 200 V, goes beyond x = 1, where the law is its tangent."""
TIME_S = np.array([0.0, 1e-9, 3e-6, 3e-6, 17e-6, 40e-6, 77e-6, 300e-6])
SETTINGS = [
    {},
    {"initial_state": "demagnetised"},
    {"hysteresis": "one_point"},
    {"period_s": 110e-6},
    {"period_s": 110e-6, "earlier_drops": 3},
    {"period_s": 110e-6, "earlier_drops": 0},
]


def drawn(count, seed):
    return Bounds().from_unit(np.random.default_rng(seed).uniform(-1, 1, (count, 7)))


def one(head):
    return HeadParameters(*(value[None] for value in HeadParameters.of(head)))


def several(head, count):
    return HeadParameters(*(np.repeat(values, count, axis=0) for values in one(head)))


@pytest.mark.parametrize("head", [HEAD, BEYOND_FULL_SCALE])
@pytest.mark.parametrize("settings", SETTINGS)
def test_the_response_is_that_of_the_plain_model(head, settings):
    rows = drawn(6, seed=1)
    found = responses(rows, one(head).table(head.full_scale_V), TIME_S, **settings)
    for row, signal in zip(rows, found, strict=True):
        plain = head.respond(Waveform.from_array(row), **settings).sensor_V(TIME_S)
        np.testing.assert_allclose(signal, plain, rtol=1e-10, atol=1e-10)


def test_heads_given_by_their_parameters_are_those_given_as_printheads():
    rows = drawn(20, seed=2)
    np.testing.assert_array_equal(batch.costs(rows, one(HEAD).table()), batch.costs(rows, HEAD))


@pytest.mark.parametrize("head", [HEAD, BEYOND_FULL_SCALE])
@pytest.mark.parametrize("settings", SETTINGS)
def test_pull_back_equals_central_differences_of_the_response(head, settings):
    """In every parameter of waveform and head."""
    rows, rng = drawn(3, seed=3), np.random.default_rng(4)
    weights = rng.standard_normal((3, len(TIME_S)))
    table = several(head, 3)
    by_waveform, by_head = pull_back(rows, table.table(head.full_scale_V), TIME_S, weights, **settings)

    def total(rows, parameters):
        return (weights * responses(rows, parameters.table(head.full_scale_V), TIME_S, **settings)).sum(axis=1)

    def differs(step, change):
        return (change(step) - change(-step)) / (2 * step)

    for k, half_width in enumerate(Bounds().half_width):
        difference = differs(1e-5, lambda step, k=k, w=half_width: total(rows + step * w * np.eye(7)[k], table))
        np.testing.assert_allclose(by_waveform[:, k] * half_width, difference, rtol=1e-5, atol=1e-5)
    found = by_parameters(by_head, len(head.coefficients) - 1)
    for name in ("a0", "a1", "b1"):
        value = getattr(table, name)
        difference = differs(1e-5, lambda step, n=name, v=value: total(rows, table._replace(**{n: v * (1 + step)})))
        np.testing.assert_allclose(getattr(found, name) * value, difference, rtol=1e-5, atol=1e-5)
    for m in range(len(head.coefficients) - 1):
        unit = np.eye(len(head.coefficients) - 1)[m]
        difference = differs(
            1e-4, lambda step, u=unit: total(rows, table._replace(coefficients=table.coefficients + step * u))
        )
        np.testing.assert_allclose(found.coefficients[:, m], difference, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("cost", [PeakCost(), PeakCost(-5, 1, "first")])
@pytest.mark.parametrize("head", [HEAD, BEYOND_FULL_SCALE])
def test_the_cost_scales_with_gain_law_and_time(cost, head):
    """It is proportional to b1 and to the law; slower waveforms on a slower head give the same peaks (Euler)."""
    rows = drawn(200, seed=5)
    parameters = several(head, 200)
    costs, by_waveform, by_head = costs_and_derivatives(
        rows, parameters.table(head.full_scale_V), cost, window_s=math.inf
    )
    found = by_parameters(by_head, len(head.coefficients) - 1)
    np.testing.assert_allclose(found.b1 * parameters.b1, costs, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose((found.coefficients * parameters.coefficients).sum(axis=1), costs, rtol=1e-9, atol=1e-9)
    slower = (by_waveform[:, 2:] * rows[:, 2:]).sum(axis=1)
    slower -= 2 * found.a0 * parameters.a0 + found.a1 * parameters.a1 + found.b1 * parameters.b1
    np.testing.assert_allclose(slower, 0.0, atol=1e-7)


def test_the_derivatives_in_the_waveform_are_those_of_batch():
    rows = drawn(50, seed=6)
    costs, by_waveform, by_head = costs_and_derivatives(rows, one(HEAD).table(), with_head=False)
    plain_costs, gradients = batch.costs_and_gradients(rows, HEAD)
    np.testing.assert_array_equal(costs, plain_costs)
    np.testing.assert_array_equal(by_waveform, gradients)
    assert by_head.shape == (50, 0)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"a1": np.array([3e4, 1e6])}, "head 1: a1 must be below 2√a0"),
        ({"b1": np.array([0.0, 2e4])}, "head 0: b1 must be finite and not 0"),
        ({"a0": np.array([1e11, math.nan])}, "head 1: a0 must be a positive number"),
        ({"coefficients": np.full((2, 3), 1e10)}, "head 0: hysteresis coefficients must be within"),
        ({"coefficients": np.zeros((2, 17))}, "hysteresis coefficients must be 2 to 17 numbers"),
    ],
)
def test_parameters_of_no_head_are_refused_with_their_row(change, sentence):
    with pytest.raises(ValueError, match=sentence):
        several(HEAD, 2)._replace(**change).table()


@pytest.mark.parametrize("time_s", [[-1e-6, 0.0], [2e-6, 1e-6], [0.0, math.nan], [[0.0]]])
def test_times_that_cannot_be_are_refused(time_s):
    with pytest.raises(ValueError, match="time_s must be finite times in seconds"):
        responses(drawn(1, seed=7), one(HEAD).table(), time_s)

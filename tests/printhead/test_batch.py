"""The compiled path: equal to the plain one, accurate against 80 digits, and its gradient against differences."""

import math

import numpy as np
import pytest

from inkjet_env.experiments.validation.closed_form_accuracy import compare, draw_waveforms
from inkjet_env.printhead import Bounds, PeakCost, Printhead, Waveform, batch, respond_sampled

HEAD = Printhead.published()
OPTIMUM = (100, -100, 1e-6, 10.481e-6, 13.769e-6, 9.613e-6, 20e-6)


def waveforms(count: int, seed: int = 0) -> np.ndarray:
    return draw_waveforms(np.random.default_rng(seed), count)


@pytest.mark.parametrize("initial_state", ["periodic", "demagnetised"])
@pytest.mark.parametrize("path", ["compiled", "plain"])
def test_peaks_agree_with_an_80_digit_reference_and_none_is_missed_or_invented(initial_state, path):
    found = compare(8, seed=11, initial_state=initial_state, compiled=path == "compiled")
    assert found.peaks > 150
    assert found.different_count == 0
    assert found.worst_peak < 1e-9
    assert found.worst_time < 1e-9


@pytest.mark.parametrize("window_s", [350e-6, 60e-6, math.inf])
@pytest.mark.parametrize("hysteresis", ["full_memory", "one_point"])
@pytest.mark.parametrize("initial_state", ["periodic", "demagnetised"])
def test_compiled_costs_equal_the_plain_path(window_s, hysteresis, initial_state):
    rows = waveforms(40, seed=1)
    for cost in (PeakCost(), PeakCost(-5, 1, "first"), PeakCost(-5, 5, 3.0), PeakCost(-50, 5, target_height_V=3.0)):
        compiled = batch.costs(rows, HEAD, cost, initial_state, window_s, hysteresis)
        plain = [
            HEAD.respond(Waveform.from_array(row), initial_state, window_s, hysteresis).cost(cost) for row in rows[::4]
        ]
        np.testing.assert_allclose(compiled[::4], plain, rtol=1e-10, atol=1e-10)


def test_compiled_peaks_equal_the_plain_path_peak_by_peak():
    for row in waveforms(40, seed=2):
        waveform = Waveform.from_array(row)
        times, peaks = batch.peaks(waveform, HEAD)
        plain = HEAD.respond(waveform)
        np.testing.assert_allclose(times, plain.peak_times_s, rtol=1e-11)
        np.testing.assert_allclose(peaks, plain.peaks_V, rtol=1e-9, atol=1e-12)


def test_a_row_does_not_depend_on_its_neighbours():
    rows = waveforms(64, seed=3)
    together = batch.costs(rows, HEAD)
    assert (together == [batch.costs(row, HEAD)[0] for row in rows]).all()


def test_varied_head_rows_are_the_varied_heads():
    rng = np.random.default_rng(4)
    values = rng.uniform([35e3, 0.03, 0.7, 0.6], [70e3, 0.08, 1.3, 1.4], (40, 4))
    rows = Bounds().from_unit(rng.uniform(-1, 1, (40, 7)))
    plain = [
        HEAD.varied(*value).respond(Waveform.from_array(row)).cost() for value, row in zip(values, rows, strict=True)
    ]
    table = batch.varied_head_table(HEAD, *values.T)
    np.testing.assert_allclose(batch.costs(rows, table), plain, rtol=1e-9, atol=1e-9)


def test_the_known_optimum_costs_what_was_computed_before():
    assert batch.costs(OPTIMUM, HEAD)[0] == pytest.approx(-22.8301, abs=1e-3)
    np.testing.assert_allclose(HEAD.respond(Waveform(*OPTIMUM)).peaks_V[:4], [6.19, -6.94, 0.65, -0.52], atol=0.02)


@pytest.mark.parametrize("initial_state", ["periodic", "demagnetised"])
@pytest.mark.parametrize("cost", [PeakCost(), PeakCost(-5, 1, "first"), PeakCost(-5, 5, 2.0)])
def test_gradient_equals_central_differences_where_the_cost_is_smooth(initial_state, cost):
    """Fourth-order differences; rows across whose stencil the peaks change number or part are not smooth there."""
    half_width = Bounds().half_width
    rows = Bounds().from_unit(np.random.default_rng(5).uniform(-0.95, 0.95, (20, 7)))
    _, gradients = batch.costs_and_gradients(rows, HEAD, cost, initial_state)

    def shape_of(row):
        _, peaks = batch.peaks(Waveform.from_array(row), HEAD, initial_state)
        return len(peaks), cost.effective_index(peaks)

    h, weights = 1e-4, {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12}
    compared = 0
    for row, gradient in zip(rows, gradients, strict=True):
        here = shape_of(row)
        for k in range(7):
            stencil = {j: row + j * h * half_width[k] * np.eye(7)[k] for j in weights}
            if any(shape_of(stencil[j]) != here for j in (-2, 2)):
                continue
            values = batch.costs(list(stencil.values()), HEAD, cost, initial_state)
            difference = values @ np.array(list(weights.values())) / h
            assert gradient[k] * half_width[k] == pytest.approx(difference, rel=1e-6, abs=3e-7)
            compared += 1
    assert compared > 75


def test_gradient_of_an_infinite_window_includes_the_tail():
    row = Bounds().from_unit(np.random.default_rng(6).uniform(-0.9, 0.9, 7))
    _, gradients = batch.costs_and_gradients(row, HEAD, window_s=math.inf)
    h = 1e-6
    for k in range(7):
        step = h * Bounds().half_width[k] * np.eye(7)[k]
        up, down = batch.costs([row + step, row - step], HEAD, window_s=math.inf)
        assert gradients[0, k] * Bounds().half_width[k] == pytest.approx((up - down) / (2 * h), rel=1e-5, abs=1e-5)


def short_waveforms(count: int, seed: int) -> np.ndarray:
    return Bounds(upper=(100, 0, *[9e-6] * 5)).from_unit(np.random.default_rng(seed).uniform(-1, 1, (count, 7)))


@pytest.mark.parametrize("period_s", [50e-6, 110e-6])
@pytest.mark.parametrize("cost", [PeakCost(), PeakCost(-5, 1, "first"), PeakCost(-50, 5, target_height_V=3.0)])
def test_a_repeated_waveform_costs_the_same_in_three_ways(period_s, cost):
    """Compiled, plain, and sampled with the steady state of its ringing."""
    for row in short_waveforms(10, seed=8):
        waveform = Waveform.from_array(row)
        knots_s, knots_V = waveform.knots()
        step_s = (period_s - waveform.duration_s) / 4
        time_s, drive_V = [*knots_s, period_s - 2 * step_s, period_s - step_s], [*knots_V, 0.0, 0.0]
        sampled = respond_sampled(HEAD, time_s, drive_V, ringing="steady", window_s=period_s)
        wanted = cost(sampled.peaks_V[sampled.peak_times_s <= period_s])
        assert batch.costs(row, HEAD, cost, period_s=period_s)[0] == pytest.approx(wanted, abs=1e-9)
        assert HEAD.respond(waveform, period_s=period_s).cost(cost) == pytest.approx(wanted, abs=1e-9)


def test_a_waveform_that_is_seldom_repeated_meets_a_head_at_rest():
    rows = short_waveforms(20, seed=9)
    np.testing.assert_allclose(batch.costs(rows, HEAD, period_s=3e-3), batch.costs(rows, HEAD), atol=1e-9)


def test_the_ringing_of_a_repeated_waveform_repeats():
    waveform, period_s = Waveform.from_array(short_waveforms(1, seed=10)[0]), 70e-6
    response = HEAD.respond(waveform, period_s=period_s)
    assert response.sensor_V([0.0])[0] == pytest.approx(response.sensor_V([period_s])[0], rel=1e-9)
    assert abs(response.sensor_V([0.0])[0]) > 1e-3


@pytest.mark.parametrize("cost", [PeakCost(), PeakCost(-50, 5, target_height_V=3.0)])
def test_gradient_of_a_repeated_waveform_equals_central_differences(cost):
    half_width, size = Bounds().half_width, 1e-6
    rows = short_waveforms(20, seed=11)
    _, gradients = batch.costs_and_gradients(rows, HEAD, cost, period_s=50e-6)
    right = []
    for row, gradient in zip(rows, gradients, strict=True):
        for k in range(7):
            step = size * half_width[k] * np.eye(7)[k]
            up, down = batch.costs([row + step, row - step], HEAD, cost, period_s=50e-6)
            right.append((up - down) / (2 * size) == pytest.approx(gradient[k] * half_width[k], rel=1e-4, abs=1e-4))
    assert np.mean(right) > 0.97  # a peak that appears or changes its part makes the cost break


def test_a_period_is_refused_in_one_sentence():
    waveform = Waveform(*OPTIMUM)
    for period_s, state, sentence in (
        (20e-6, "periodic", "a waveform of 5.4863e-05 s does not fit into a period of 2e-05 s"),
        (100e-6, "demagnetised", "only a repeated waveform has a steady state"),
        (-1.0, "periodic", "period_s must be a time above 0 s, or infinite; got -1.0"),
    ):
        for call in (
            lambda p, s: HEAD.respond(waveform, s, period_s=p),
            lambda p, s: batch.costs(waveform.to_array(), HEAD, initial_state=s, period_s=p),
        ):
            with pytest.raises(ValueError, match=sentence):
                call(period_s, state)


TINY = (0.0, 5e-324, 1e-308, 1e-200, 1e-30, 1e-20, 1e-12, 1e-9, 1e-6, 1e-3)


def test_no_combination_of_tiny_durations_or_voltages_breaks_either_path():
    rng = np.random.default_rng(7)
    durations = rng.choice(TINY, (80, 5))
    voltages = rng.choice((0.0, 5e-324, 1e-200, 1e-30, 1e-12, 1.0, 100.0), (80, 2))
    rows = np.column_stack([voltages[:, 0], -voltages[:, 1], durations])
    costs, gradients = batch.costs_and_gradients(rows, HEAD)
    assert np.isfinite(costs).all()
    assert np.isfinite(gradients).all()
    plain = [HEAD.respond(Waveform.from_array(row)).cost() for row in rows]
    np.testing.assert_allclose(costs, plain, rtol=1e-8, atol=1e-9)


def test_a_voltage_that_vanishes_beside_the_other_is_no_edge():
    """100 V + 1.7e-14 V is 100 V in floating point: the edge has a length in time and none in drive."""
    row = np.array([1.6653345369377348e-14, -100, 1e-6, 6.8e-6, 2e-5, 2e-5, 1.9e-5])
    without = row * (np.arange(7) > 0)
    np.testing.assert_allclose(batch.costs(row, HEAD), batch.costs(without, HEAD), atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"initial_state": "periodical"}, "initial_state must be one of .*'periodic'"),
        ({"hysteresis": "fullmemory"}, "hysteresis must be one of .*'full_memory'"),
        ({"window_s": 0.0}, "window_s must be a time above 0 s"),
        ({"window_s": math.nan}, "window_s must be a time above 0 s"),
        ({"heads": np.zeros((2, 3))}, "head table of 1 or 1 rows"),
        ({"waveforms": [1, 2, 3]}, r"shape \(7,\) or \(n, 7\)"),
        ({"waveforms": (100, -100, 1, 1, 1, 1, 1)}, "t1 must be at most 0.01 s; got 1 s.*10 µs is 10e-6"),
    ],
)
def test_bad_input_is_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        batch.costs(**{"waveforms": OPTIMUM, "heads": HEAD, **arguments})

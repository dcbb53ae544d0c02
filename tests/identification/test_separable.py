"""The fit of everything together: its slopes, its minimum and its covariance, each seen a second way."""

import math
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.identification.basis import drive_basis
from inkjet_env.identification.measurements import RepeatedMeasurement
from inkjet_env.identification.model import Fitted, Model, channels_of
from inkjet_env.identification.noise import NoiseModel
from inkjet_env.identification.separable import fit_everything
from inkjet_env.printhead import Printhead

HEAD = Printhead.published()
DEGREE, STEP_S, SAMPLES = 2, 4e-7, 300
TRUTH = Model(
    HEAD.a0,
    HEAD.a1,
    np.array([0.7, 0.3]) * 0.01,
    {"strain_gauge": 1.0, "self_sensing": HEAD.b1 / 0.01, "displacement": 30.0},
    {"strain_gauge": 0.3, "self_sensing": 0.02, "displacement": -0.1},
)
NOISE_MODELS = {
    "strain_gauge": NoiseModel(np.ones(1), 0.005, 0.005, "a test"),
    "self_sensing": NoiseModel(np.ones(1), 0.05, 0.05, "a test"),
    "displacement": NoiseModel(np.array([1.0, -0.5]), 0.1, 0.1 / math.sqrt(0.75), "a test"),
}
DRIVES = (
    ("strain_gauge", "demagnetised", 1),
    ("self_sensing", "demagnetised", 2),
    ("self_sensing", "free", 1),
    ("self_sensing", "periodic", 1),
    ("displacement", "periodic", 1),
    ("displacement", "free", 1),
)


def noise_of(channel, rng, samples):
    model = NOISE_MODELS[channel]
    noise = np.zeros(samples + 100)
    for t, e in enumerate(model.innovation * rng.standard_normal(noise.size)):
        noise[t] = e - (model.coefficients[1] * noise[t - 1] if model.lost and t else 0.0)
    return noise[100:]


def recorded(rng, channels=tuple(NOISE_MODELS)):
    """Every drive recorded with the truth, fresh noise and fresh initial states."""
    fitted = []
    for i, (channel, state, repeats) in enumerate(DRIVES):
        if channel not in channels:
            continue
        corners = np.random.default_rng(i).uniform(-90, 90, 10)
        drive_V = np.interp(np.arange(SAMPLES), np.linspace(5, SAMPLES - 5, 12), [0, *corners, 0])
        basis = drive_basis(drive_V, STEP_S, 180.0, DEGREE, state)
        psi = basis.response(channel, TRUTH.a0, TRUTH.a1)
        clean = TRUTH.ratios[channel] * (psi @ TRUTH.weights) + TRUTH.offsets[channel]
        if state == "free":
            clean = clean + basis.free_states(TRUTH.a0, TRUTH.a1) @ rng.normal(0, 1, 2)
        signals = tuple(clean + noise_of(channel, rng, SAMPLES) for _ in range(repeats))
        unit = "um" if channel == "displacement" else "V"
        names = tuple(f"r{i}-{k}" for k in range(repeats))
        measurement = RepeatedMeasurement(channel, unit, state, drive_V, STEP_S, signals, names, SAMPLES)
        fitted.append(Fitted(measurement, basis, NOISE_MODELS[channel]))
    return fitted


def packed(model, channels):
    return np.concatenate(
        [
            model.weights,
            [math.log(model.a0), math.log(model.a1)],
            [model.ratios[c] for c in channels[1:]],
            [model.offsets[c] for c in channels],
        ]
    )


def unpacked(values, channels):
    d, k = DEGREE, len(channels)
    ratios = dict(zip(channels, [1.0, *values[d + 2 : d + 1 + k]], strict=True))
    offsets = dict(zip(channels, values[d + 1 + k :], strict=True))
    return Model(math.exp(values[d]), math.exp(values[d + 1]), values[:d], ratios, offsets)


def free_run_residual(values, fitted, channels):
    """Whitened residuals of the free-run prediction of every recording's repeats' mean."""
    model = unpacked(values, channels)
    parts = []
    for f in fitted:
        residuals = f.measurement.mean - model.predicted(f.measurement, f.basis, f.noise)
        parts.append(f.whitened(residuals[:, None])[:, 0])
    return np.concatenate(parts)


def slopes_of(values, fitted, channels):
    """Central differences of the free-run residual."""
    columns = []
    for i, value in enumerate(values):
        h = 1e-6 * (abs(value) if i not in (DEGREE, DEGREE + 1) else 1.0) + 1e-9
        up, down = values.copy(), values.copy()
        up[i] += h
        down[i] -= h
        columns.append((free_run_residual(up, fitted, channels) - free_run_residual(down, fitted, channels)) / (2 * h))
    return np.column_stack(columns)


START = replace(TRUTH, a0=1.05 * TRUTH.a0, a1=0.8 * TRUTH.a1)


@pytest.fixture(scope="module")
def fitted():
    return recorded(np.random.default_rng(0))


@pytest.fixture(scope="module")
def solution(fitted):
    return fit_everything(fitted, START)


def test_the_covariance_is_that_of_free_run_differences(fitted, solution):
    channels = channels_of(fitted)
    slopes = slopes_of(packed(solution.model, channels), fitted, channels)
    expected = np.linalg.inv(slopes.T @ slopes)
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(solution.covariance / np.outer(size, size), expected / np.outer(size, size), atol=2e-3)
    assert solution.names[DEGREE : DEGREE + 2] == ("ln a0", "ln a1")


def test_the_minimum_has_no_slope(fitted, solution):
    channels = channels_of(fitted)
    values = packed(solution.model, channels)
    slopes = slopes_of(values, fitted, channels)
    residuals = free_run_residual(values, fitted, channels)
    assert solution.converged
    # A step along the slope would promise less than 1e-3 of χ².
    promise = residuals @ slopes @ np.linalg.solve(slopes.T @ slopes, slopes.T @ residuals)
    assert promise < 1e-3
    assert solution.chi_square == pytest.approx(residuals @ residuals, rel=1e-9)


def test_residuals_are_as_large_as_the_noise_says(solution):
    for channel, rms in solution.rms.items():
        assert rms == pytest.approx(1.0, abs=0.15), channel


def test_the_covariance_is_the_scatter_over_noise():
    rng = np.random.default_rng(1)
    draws = 60
    found, expected = [], []
    for _ in range(draws):
        fitted = recorded(rng)
        solution = fit_everything(fitted, START)
        assert solution.converged
        found.append(packed(solution.model, channels_of(fitted)))
        expected.append(solution.covariance)
    off = np.array(found) - packed(TRUTH, channels_of(fitted))
    covariance = np.mean(expected, axis=0)
    sigma = np.sqrt(np.diag(covariance))
    ratio = np.mean(off**2, axis=0) / sigma**2
    # Each is χ² of 60 degrees over 60: within 0.52 … 1.65 but for 1 in 1,000.
    assert (ratio > 0.5).all(), ratio
    assert (ratio < 1.7).all(), ratio
    together = np.einsum("ij,jk,ik->i", off, np.linalg.inv(covariance), off).mean() / sigma.size
    assert together == pytest.approx(1.0, abs=4 * math.sqrt(2 / (draws * sigma.size)))


def test_a_start_far_off_leads_to_the_same_minimum(fitted, solution):
    start = replace(TRUTH, a0=1.3 * TRUTH.a0, a1=3 * TRUTH.a1)
    again = fit_everything(fitted, start).model
    assert again.a0 == pytest.approx(solution.model.a0, rel=1e-6)
    assert again.a1 == pytest.approx(solution.model.a1, rel=1e-5)


def test_more_repeats_narrow_the_covariance_with_their_number():
    (one,) = [f for f in recorded(np.random.default_rng(3), ("self_sensing",)) if len(f.measurement.signals) == 2]
    four = replace(
        one, measurement=replace(one.measurement, signals=4 * one.measurement.signals[:1], names=tuple("abcd"))
    )
    single = replace(one, measurement=replace(one.measurement, signals=one.measurement.signals[:1], names=("a",)))
    start = replace(START, weights=TRUTH.weights * HEAD.b1 / 0.01, ratios={"self_sensing": 1.0})
    narrow, wide = fit_everything([four], start), fit_everything([single], start)
    np.testing.assert_allclose(np.diag(narrow.covariance) * 4, np.diag(wide.covariance), rtol=1e-4)

"""Residuals with a condition left out, held against refits without it."""

import numpy as np
import pytest

from inkjet_env.mismatch import DiagnosisSettings
from inkjet_env.mismatch.selection.cross_validation import orthonormal, predicted

SINGLE = DiagnosisSettings().selection.single_condition

CONDITIONS = (40, 25, 60, 31)


def rows_of(sizes):
    ends = np.cumsum(sizes)
    return [np.arange(end - size, end) for end, size in zip(ends, sizes, strict=True)]


@pytest.fixture
def linear():
    """A linear model of four conditions, a column of which only the last one tells, and data."""
    rng = np.random.default_rng(5)
    groups = rows_of(CONDITIONS)
    design = rng.standard_normal((sum(CONDITIONS), 4)) * [1.0, 1e-6, 1e5, 1.0]
    data = design @ [1.0, 2e6, -3e-5, 0.5] + 0.3 * rng.standard_normal(len(design))
    return design, data, groups


def refitted(design, data, rows):
    """Residual there of a fit to everything else."""
    rest = np.setdiff1d(np.arange(len(data)), rows)
    scale = np.linalg.norm(design, axis=0)
    weights = np.linalg.lstsq((design / scale)[rest], data[rest], rcond=1e-12)[0]
    return (data - (design / scale) @ weights)[rows]


def residual(design, data):
    q = orthonormal(design)
    return data - q @ (q.T @ data)


def test_each_condition_left_out_is_predicted_as_by_a_refit_without_it(linear):
    design, data, groups = linear
    result = predicted(residual(design, data), orthonormal(design), groups, SINGLE)
    for rows in groups:
        np.testing.assert_allclose(result.residuals[rows], refitted(design, data, rows), rtol=1e-9, atol=1e-11)


def test_columns_said_twice_and_empty_ones_change_nothing(linear):
    design, data, groups = linear
    again = np.column_stack([design, design[:, 0] - 3 * design[:, 3], np.zeros(len(data))])
    assert orthonormal(again).shape[1] == 4
    residuals = residual(design, data)
    np.testing.assert_allclose(
        predicted(residuals, orthonormal(again), groups, SINGLE).residuals,
        predicted(residuals, orthonormal(design), groups, SINGLE).residuals,
        rtol=1e-8,
        atol=1e-10,
    )


def test_a_parameter_that_one_condition_alone_tells_stays_as_fitted_there(linear):
    design, data, groups = linear
    alone = np.zeros((len(data), 1))
    alone[groups[3]] = np.random.default_rng(6).standard_normal((CONDITIONS[3], 1))
    both = np.column_stack([design, alone])
    result = predicted(residual(both, data), orthonormal(both), groups, SINGLE)
    # Elsewhere the column says nothing: leaving another condition out goes as ever.
    np.testing.assert_allclose(result.residuals[groups[1]], refitted(both, data, groups[1]), rtol=1e-8, atol=1e-10)
    # In its own condition: a refit without it, its weight held.
    weight = np.linalg.lstsq(both / np.linalg.norm(both, axis=0), data, rcond=1e-12)[0][-1] / np.linalg.norm(alone)
    own = orthonormal(both[groups[3]])  # what that condition's rows make of the shared columns stays predicted
    shared = refitted(design, data - weight * alone[:, 0], groups[3])
    assert own.shape[1] == 5
    assert np.linalg.norm(result.residuals[groups[3]]) == pytest.approx(np.linalg.norm(shared), rel=0.2)
    assert np.isfinite(result.residuals).all()


def test_gains_are_differences_of_the_likelihood_condition_by_condition(linear):
    design, data, groups = linear
    poor = predicted(residual(design[:, :2], data), orthonormal(design[:, :2]), groups, SINGLE)
    rich = predicted(residual(design, data), orthonormal(design), groups, SINGLE)
    gains, errors = poor.log_likelihood_gain(rich)
    for gain, error, rows in zip(gains, errors, groups, strict=True):
        a, b = refitted(design[:, :2], data, rows), refitted(design, data, rows)
        assert gain == pytest.approx(0.5 * np.sum(a**2) - 0.5 * np.sum(b**2), rel=1e-9)
        assert error == pytest.approx(np.linalg.norm(a - b), rel=1e-9)
    np.testing.assert_array_equal(rich.log_likelihood_gain(rich), np.zeros((2, 4)))
    np.testing.assert_allclose(rich.log_likelihood_gain(poor)[0], -gains)


def test_the_standard_error_is_that_of_the_gain_under_noise():
    """Of two models that are equally wrong, the gain has the told standard error about zero."""
    rng = np.random.default_rng(7)
    (rows,) = groups = rows_of([400])
    shape = 0.2 * np.sin(np.arange(400))
    gains, errors = [], []
    for _ in range(400):
        noise = rng.standard_normal(400)
        one, other = (predicted(noise + sign * shape, np.zeros((400, 0)), groups, SINGLE) for sign in (1, -1))
        gain, error = one.log_likelihood_gain(other)
        gains.append(gain[0])
        errors.append(error[0])
    assert np.std(gains) == pytest.approx(np.mean(errors), rel=0.12)
    assert abs(np.mean(gains)) < 4 * np.std(gains) / 20
    assert rows.size == 400

"""Standard errors from the scatter between conditions."""

import numpy as np
import pytest

from inkjet_env.mismatch.selection.clustered_errors import clustered_errors, robust_errors, scatter_p_value
from inkjet_env.mismatch.selection.cross_validation import predicted
from inkjet_env.mismatch.settings import DiagnosisSettings
from tests.mismatch.shares import GROUPS, held_by_shares, without

SETTINGS = DiagnosisSettings().selection


def regression(rng, shared):
    """Columns, and what they measure with an error that each condition shares."""
    columns = rng.standard_normal((480, 3))
    direction = np.concatenate([np.full(40, rng.standard_normal()) for _ in GROUPS])
    return columns, columns @ [1.0, -2.0, 0.5] + rng.standard_normal(480) + shared * direction * columns[:, 0]


def fitted(columns, target):
    """Classical errors for noise of 1, and what the others need."""
    q, r = np.linalg.qr(columns)
    residuals, weights = target - q @ (q.T @ target), np.linalg.inv(r)
    return np.linalg.norm(weights, axis=1), weights, q, predicted(residuals, q, GROUPS, 0.9)


def test_they_are_those_of_refits_without_each_condition():
    """The second way: leave each condition out in earnest."""
    columns, target = regression(np.random.default_rng(1), 1.0)
    whole = np.linalg.lstsq(columns, target, rcond=None)[0]
    changes = []
    for rows in GROUPS:
        rest = np.setdiff1d(np.arange(480), rows)
        changes.append(np.linalg.lstsq(columns[rest], target[rest], rcond=None)[0] - whole)
    _, *model = fitted(columns, target)
    errors, conditions = clustered_errors(*model)
    assert errors == pytest.approx(np.sqrt(np.sum(np.square(changes), axis=0)))
    assert np.all((conditions > 10) & (conditions <= 12))


@pytest.mark.parametrize(("shared", "least", "most"), [(0.0, 0.86, 0.96), (0.5, 0.82, 0.97)])
def test_intervals_hold_the_truth(shared, least, most):
    """Whether residuals are noise, or each condition shares an error, where the classical intervals fail."""
    rng = np.random.default_rng(2)
    inside = classical_inside = 0
    for _ in range(400):
        columns, target = regression(rng, shared)
        value = np.linalg.lstsq(columns, target, rcond=None)[0]
        classical, *model = fitted(columns, target)
        inside += abs(value[0] - 1) < 1.645 * robust_errors(classical, *model, SETTINGS)[0]
        classical_inside += abs(value[0] - 1) < 1.645 * classical[0]
    assert least * 400 < inside < most * 400
    assert not shared or classical_inside < 0.6 * 400


def test_a_parameter_of_one_condition_alone_keeps_its_classical_error():
    columns = np.zeros((480, 2))
    columns[:, 0] = 1.0
    columns[:40, 1] = np.linspace(-1, 1, 40)
    classical, *model = fitted(columns, 5 * np.sin(np.arange(480.0) / 40))
    errors = robust_errors(classical, *model, SETTINGS)
    assert errors[1] == classical[1]
    assert errors[0] > classical[0]


def test_what_one_condition_favours_scatters_and_what_all_favour_does_not():
    rng = np.random.default_rng(3)
    for shares, least, most in (([7.0] + 11 * [0.0], 0.05, 1.0), (12 * [7 / 12], 0.0, 1e-3)):
        residuals, direction = held_by_shares(shares, rng)
        left_out = predicted(without(residuals, direction), direction[:, None], GROUPS, 0.9)
        assert least < scatter_p_value(7.0, direction, left_out) < most


def test_the_p_value_by_scatter_is_calibrated_in_noise():
    rng = np.random.default_rng(4)
    p_values = []
    for _ in range(600):
        direction = rng.standard_normal(480)
        direction /= np.linalg.norm(direction)
        residuals = rng.standard_normal(480)
        size = float(direction @ residuals)
        left_out = predicted(without(residuals, direction), direction[:, None], GROUPS, 0.9)
        p_values.append(scatter_p_value(size, direction, left_out))
    # of the magnitude: half the uniform distribution
    assert 0.02 * 600 < sum(p < 0.025 for p in p_values) < 0.08 * 600

"""What may be chance: a small gain from one condition, and one that independent noise reaches."""

from types import SimpleNamespace

import numpy as np
import pytest

from inkjet_env.mismatch import DiagnosisSettings
from inkjet_env.mismatch.selection.cross_validation import predicted
from inkjet_env.mismatch.selection.significance import largest_by_scatter, stands_out
from tests.mismatch.shares import GROUPS, held_by_shares, without


@pytest.mark.parametrize(
    ("shares", "gain", "found"),
    [
        ([7.0] + 11 * [0.0], 24.5, False),  # one condition alone
        (12 * [7 / 12], 24.5, True),
        (12 * [3 / 12], 4.5, False),  # within the reach of chance
        ([12.0] + 11 * [0.0], 72.0, True),  # beyond any doubt about the noise
    ],
)
def test_a_small_gain_must_come_from_several_conditions(shares, gain, found):
    before, direction = held_by_shares(shares, np.random.default_rng(5))
    after, joint = without(before, direction), SimpleNamespace(settings=DiagnosisSettings())
    left_out = predicted(after, direction[:, None], GROUPS, 0.9)
    bare = SimpleNamespace(residuals=before, fit=SimpleNamespace(nll=gain, idle=np.array([True])), joint=joint)
    fit = SimpleNamespace(nll=0.0, idle=np.array([False]))
    with_it = SimpleNamespace(residuals=after, fit=fit, joint=joint, predicted=left_out)
    assert stands_out(bare, with_it, tried=30) == found


@pytest.mark.parametrize(
    ("shares", "least", "most"),
    [
        ([7.0] + 11 * [0.0], 0.05, 1.0),
        (12 * [7 / 12], 0.0, 1e-3),
        ([12.0] + 11 * [0.0], -1.0, 1e-300),  # 72 nats need no such test
    ],
)
def test_the_largest_score_is_judged_by_its_scatter_too(shares, least, most):
    residuals, direction = held_by_shares(shares, np.random.default_rng(6))
    conditions = [SimpleNamespace(condition=k, fitted=40) for k in range(12)]
    joint = SimpleNamespace(settings=DiagnosisSettings(), seen=conditions)
    base = SimpleNamespace(residuals=residuals, columns=np.zeros((480, 0)), joint=joint)
    test = SimpleNamespace(scores=lambda r: np.array([direction @ r]), column=lambda k: direction)
    assert least < largest_by_scatter(base, test) < most

"""What may be chance: a small gain from one condition, and one that independent noise reaches."""

from types import SimpleNamespace

import numpy as np
import pytest

from inkjet_env.mismatch import DiagnosisSettings
from inkjet_env.mismatch.selection.cross_validation import predicted
from inkjet_env.mismatch.selection.significance import stands_out


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
    rng, groups = np.random.default_rng(5), [np.arange(40 * k, 40 * (k + 1)) for k in range(12)]
    direction = rng.standard_normal(480)
    direction /= np.linalg.norm(direction)
    before = rng.standard_normal(480)
    before -= direction * (direction @ before)
    for rows, share in zip(groups, shares, strict=True):
        before[rows] += share * direction[rows] / np.linalg.norm(direction[rows]) ** 2
    after, idle = before - direction * (direction @ before), np.array([False])
    joint = SimpleNamespace(settings=DiagnosisSettings())
    left_out = predicted(after, direction[:, None], groups, 0.9)
    without = SimpleNamespace(residuals=before, fit=SimpleNamespace(nll=gain, idle=np.array([True])), joint=joint)
    with_it = SimpleNamespace(residuals=after, fit=SimpleNamespace(nll=0.0, idle=idle), joint=joint, predicted=left_out)
    assert stands_out(without, with_it, tried=30) == found

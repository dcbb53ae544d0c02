"""What recordings are expected to tell about which hypothesis holds."""

import numpy as np
import pytest

from inkjet_env.mismatch.design.information import Hypotheses
from inkjet_env.mismatch.design.predictions import Judged


def judged(separations, from_none):
    return Judged(None, np.array(separations, dtype=float), np.array(from_none, dtype=float), ())


def mutual_information_bits(means, probabilities, draws=200_000):
    """By drawing: observations of unit variance around the mean of a hypothesis that is drawn."""
    rng = np.random.default_rng(0)
    means, p = np.atleast_2d(means), np.array(probabilities)
    which = rng.choice(len(p), draws, p=p)
    seen = means[which] + rng.standard_normal((draws, means.shape[1]))
    ln = -0.5 * ((seen[:, None, :] - means[None]) ** 2).sum(axis=2)
    ln_mean = np.log(np.exp(ln - ln.max(axis=1, keepdims=True)) @ p) + ln.max(axis=1)
    return float(np.mean(ln[np.arange(draws), which] - ln_mean) / np.log(2))


def test_nothing_tells_nothing_and_far_predictions_tell_all():
    hypotheses = Hypotheses(2, 0.0, ((0, 1),))
    assert hypotheses.information_bits([]) == 0
    assert hypotheses.information_bits([judged([0.0], [0.0, 0.0])]) == pytest.approx(0, abs=1e-12)
    assert hypotheses.information_bits([judged([1e5], [0.0, 0.0])]) == pytest.approx(1)


@pytest.mark.parametrize("means", [[[0.0], [1.0]], [[0.0], [3.0]], [[0.0, 0.0], [2.0, 1.0], [0.5, -2.0]]])
@pytest.mark.parametrize("none", [0.0, 0.1])
def test_it_is_a_lower_bound_that_comes_close(means, none):
    means = np.array(means)
    count = len(means)
    pairs = tuple((i, j) for i in range(count) for j in range(i + 1, count))
    separations = [0.5 * np.sum((means[i] - means[j]) ** 2) for i, j in pairs]
    elsewhere = np.full(means.shape[1], 5.0)
    from_none = [0.5 * np.sum((mean - elsewhere) ** 2) for mean in means]
    hypotheses = Hypotheses(count, none, pairs)
    found = hypotheses.information_bits([judged(separations, from_none)])
    true = mutual_information_bits(np.vstack([means, elsewhere]), hypotheses.probabilities)
    assert found <= true + 0.01
    assert found > 0.75 * true - 0.05


def test_recordings_add_and_what_is_left_is_told_apart_however_little_it_is():
    hypotheses = Hypotheses(2, 0.0, ((0, 1),))
    once, twice = judged([2.0], [0.0, 0.0]), judged([4.0], [0.0, 0.0])
    assert hypotheses.ln_left([once, once]) == pytest.approx(hypotheses.ln_left([twice]))
    far, farther = judged([1e5], [0.0, 0.0]), judged([1.1e5], [0.0, 0.0])
    assert np.isfinite(hypotheses.ln_left([farther]))
    assert hypotheses.ln_left([farther]) < hypotheses.ln_left([far])  # though both leave 0 in floating point


def test_a_drive_that_separates_none_of_these_is_worth_something():
    rivals = Hypotheses(2, 0.2, ((0, 1),))
    blind, open_minded = judged([10.0], [0.0, 0.0]), judged([10.0], [10.0, 10.0])
    assert rivals.information_bits([open_minded]) > rivals.information_bits([blind]) + 0.3

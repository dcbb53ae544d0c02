"""Bayesian optimisation with a prior that is learnt from heads."""

import numpy as np
import pytest

from inkjet_env.envs.tune_waveform import TuneWaveformVectorEnv
from inkjet_env.experiments.learning.few_shot_tuners import kept_costs_V
from inkjet_env.experiments.learning.heads import TEST_SEED
from inkjet_env.experiments.learning.learnt_prior import LearntPriorOptimiser, learnt_prior

POINTS = np.linspace(-1, 1, 4)[:, None] * np.ones(7)


def optimiser(mean_V, covariance_V2, noise_V=0.0):
    return LearntPriorOptimiser(POINTS, np.array(mean_V), np.array(covariance_V2), noise_V)


def test_first_it_fires_what_promises_most_over_firing_nothing():
    sure = optimiser([-1.0, -3.0, -2.0, 1.0], 1e-6 * np.eye(4))
    assert (sure.fire(np.zeros((2, 3))) == POINTS[1]).all()
    daring = optimiser([-1.0, -3.0, -2.0, 1.0], np.diag([1e-6, 1e-6, 1e-6, 400.0]))
    assert (daring.fire(np.zeros((1, 3))) == POINTS[3]).all()


def test_what_one_waveform_costs_tells_what_its_like_cost():
    covariance_V2 = np.array([[4.0, 3.9, 0, 0], [3.9, 4.0, 0, 0], [0, 0, 4.0, 3.9], [0, 0, 3.9, 4.0]])
    heads = optimiser([-5.0, -4.9, -4.0, -3.9], covariance_V2, 0.1)
    assert (heads.fire(np.zeros((2, 3))) == POINTS[0]).all()
    heads.tell(np.array([-9.0, 1.0]))  # the first head likes it, the second does not
    second = heads.fire(np.zeros((2, 3)))
    assert (second == POINTS[[1, 2]]).all()


def test_its_posterior_is_that_of_all_costs_given_some():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(4, 4))
    covariance_V2, mean_V = root @ root.T, rng.normal(size=4)
    samples_V = rng.multivariate_normal(mean_V, covariance_V2, 2_000_000)
    near = np.abs(samples_V[:, 1] - 0.7) < 0.02
    expected = np.maximum(min(0.0, 0.7) - samples_V[near], 0).mean(axis=0)
    found = optimiser(mean_V, covariance_V2, 1e-3)._improvement_V([1], [0.7])
    np.testing.assert_allclose(np.delete(found, 1), np.delete(expected, 1), atol=0.02)


def test_on_drawn_heads_it_comes_down_from_try_to_try_and_knows_no_head():
    tuner, spent = learnt_prior(0, sampled=100, evaluations=4000)
    assert spent > 4000
    kept_V = np.median(kept_costs_V(tuner, 30, 6, TEST_SEED), axis=0)
    assert (np.diff(kept_V) <= 0).all()
    assert kept_V[-1] < -5
    envs = TuneWaveformVectorEnv(2)
    again, _ = learnt_prior(0, sampled=100, evaluations=4000)
    first = again.fire(envs.reset(seed=1)[0])
    assert first[0] == pytest.approx(first[1])

"""Kinds of noise: unit variance, and for each property a second way to see it."""

import numpy as np
import pytest

from inkjet_env.experiments.validation.noise_zoo import ZOO, exponential_memory, heavy_tails, rounded
from inkjet_env.typing import Real


def rows(kind, seed, count=40, signal: Real | None = None):
    law, rng = ZOO[kind](np.random.default_rng(seed)), np.random.default_rng([seed, 1])
    return np.array([law.row(rng, np.zeros(2000) if signal is None else signal, 1.0) for _ in range(count)])


@pytest.mark.parametrize("kind", ZOO)
def test_noise_has_unit_variance(kind):
    """Mean over eight laws; where the level differs between recordings, its mean square is larger by its spread."""
    found = np.mean([np.mean(rows(kind, seed) ** 2) for seed in range(8)])
    assert found == pytest.approx(1.0, abs=0.4 if kind in ("level_by_recording", "mixture") else 0.06)


def test_a_memory_falls_exponentially():
    law = exponential_memory(np.random.default_rng(3))
    rng = np.random.default_rng(4)
    many = np.array([law.row(rng, np.zeros(2000), 1.0) for _ in range(200)])
    covariance = [np.mean(many[:, lag:] * many[:, : 2000 - lag]) for lag in (1, 5, 20)]
    time = 4 / np.log(covariance[0] / covariance[1])
    assert covariance[2] == pytest.approx(covariance[0] * np.exp(-19 / time), rel=0.3)


def test_noise_that_grows_is_louder_where_the_signal_is():
    signal = np.where(np.arange(2000) < 1000, 1.0, 0.0)
    found = rows("grows_with_signal", 5, signal=signal)
    assert np.std(found[:, :1000]) > 1.15 * np.std(found[:, 1000:])
    assert np.std(found[:, 1000:]) == pytest.approx(1.0, rel=0.02)


def test_tails_are_heavier_than_normal():
    law, rng = heavy_tails(np.random.default_rng(6)), np.random.default_rng(7)
    row = law.row(rng, np.zeros(100_000), 1.0)
    assert np.mean(row**4) / np.mean(row**2) ** 2 > 3.5


def test_a_rounded_recording_has_whole_steps():
    law = rounded(np.random.default_rng(8))
    recorded = law.recorded(np.linspace(0, 3, 500), 0.1, 3.0, 1.0, np.random.default_rng(9))
    steps = recorded / (0.1 * law.converter_step)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)


def test_a_law_is_the_same_for_the_same_seed():
    for kind in ZOO:
        np.testing.assert_array_equal(rows(kind, 2, count=2), rows(kind, 2, count=2))

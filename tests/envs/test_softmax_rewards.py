"""Softmax rewards, and the recipe that leads PPO out of the trap."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="learners need Stable-Baselines3, the extra rl")

from stable_baselines3 import PPO

from inkjet_env.envs.sb3 import BipolarWaveformVecEnv
from inkjet_env.envs.softmax_rewards import SoftmaxRewards


def test_rewards_are_the_softmax_of_the_batch_at_a_falling_temperature():
    plain, env = BipolarWaveformVecEnv(8), SoftmaxRewards(BipolarWaveformVecEnv(8), steps=16, first_V=4.0, last_V=1.0)
    plain.reset()
    env.reset()
    rng = np.random.default_rng(0)
    for temperature_V in (4.0, 2.0, 1.0, 1.0):
        actions = rng.uniform(-1, 1, (8, 7)).astype(np.float32)
        assert env.temperature_V == pytest.approx(temperature_V)
        rewards = plain.step(actions)[1].astype(float)
        weights = env.step(actions)[1]
        wanted = np.exp(rewards / temperature_V)
        np.testing.assert_allclose(weights, wanted / wanted.mean(), rtol=1e-4)
        assert np.mean(weights) == pytest.approx(1.0, abs=1e-6)


def test_the_best_waveform_so_far_is_kept():
    plain, env = BipolarWaveformVecEnv(8), SoftmaxRewards(BipolarWaveformVecEnv(8), steps=100)
    plain.reset()
    env.reset()
    rng = np.random.default_rng(1)
    seen, tried = [], []
    for _ in range(5):
        tried.append(rng.uniform(-1, 1, (8, 7)).astype(np.float32))
        seen.append(plain.step(tried[-1])[1])
        env.step(tried[-1])
    best = int(np.argmax(np.concatenate(seen)))
    assert env.best_V == np.concatenate(seen)[best]
    np.testing.assert_array_equal(env.best_action, np.concatenate(tried)[best])


def test_drawn_heads_and_impossible_temperatures_are_refused():
    with pytest.raises(ValueError, match="all must be of one head"):
        SoftmaxRewards(BipolarWaveformVecEnv(4, context="random"), steps=10)
    with pytest.raises(ValueError, match="steps must be at least 1"):
        SoftmaxRewards(BipolarWaveformVecEnv(4), steps=0)
    with pytest.raises(ValueError, match="last_V must be a temperature above 0 V"):
        SoftmaxRewards(BipolarWaveformVecEnv(4), steps=10, last_V=0.0)


def test_ppo_comes_within_a_tenth_of_the_best_known():
    steps = 120_000
    env = SoftmaxRewards(BipolarWaveformVecEnv(1024), steps)
    settings = {"n_steps": 1, "batch_size": 1024, "learning_rate": 1e-3, "gamma": 1.0, "device": "cpu"}
    model = PPO("MlpPolicy", env, seed=0, policy_kwargs={"log_std_init": -1.0}, **settings).learn(steps)
    test = BipolarWaveformVecEnv(1)
    actions, _ = model.predict(test.reset(), deterministic=True)
    assert test.step(actions)[1][0] > 0.9 * 22.83
    assert env.best_V > 0.97 * 22.83

"""A few roundings beyond a bound are the bound, to the last bit; anything further is refused or clipped as before."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

import inkjet_env
from inkjet_env.envs.sb3 import BipolarWaveformVecEnv, TuneWaveformVecEnv
from inkjet_env.envs.task import make_task

IDS = (inkjet_env.ENV_ID, inkjet_env.TUNE_ID)
ULP = 2.0**-23
CORNERS = np.random.default_rng(0).choice([-1.0, 1.0], (6, 7)).astype(np.float32)
BEYOND = [(ulps, kind) for ulps in (1, 4) for kind in (np.float32, np.float64)]


@pytest.mark.parametrize(("ulps", "kind"), BEYOND)
@pytest.mark.parametrize("clip", [False, True])
@pytest.mark.parametrize("name", IDS)
def test_single_and_vector_environments_take_it_for_the_bound(name, clip, ulps, kind):
    def two_steps(actions):
        env = gymnasium.make(name, clip_actions=clip).unwrapped
        envs = gymnasium.make_vec(name, num_envs=len(CORNERS), clip_actions=clip)
        seen = [env.reset(seed=3), envs.reset(seed=3)]
        seen += [env.step(actions[0]), envs.step(actions), envs.step(actions[::-1])]
        return seen

    beyond = (CORNERS * kind(1 + ulps * ULP)).astype(kind)
    assert (np.abs(beyond) > 1).all()
    assert data_equivalence(two_steps(beyond), two_steps(CORNERS), exact=True)


@pytest.mark.parametrize("envs", [BipolarWaveformVecEnv, TuneWaveformVecEnv])
def test_so_does_the_stable_baselines3_environment(envs):
    def step(actions):
        made = envs(len(CORNERS), noise=0.1)
        made.seed(1)
        made.reset()
        return made.step(actions)

    assert data_equivalence(step(CORNERS * np.float32(1 + 4 * ULP)), step(CORNERS), exact=True)


def test_so_does_the_task_with_any_bounds():
    task = make_task(bounds={"lower": (3, -70, *[2e-6] * 5), "upper": (91, -7, *[13e-6] * 5)})
    np.testing.assert_array_equal(task.waveforms(CORNERS * (1 + 4 * ULP), (6, 7)), task.bounds.from_unit(CORNERS))


@pytest.mark.parametrize("name", IDS)
def test_five_roundings_are_refused(name):
    env, envs = gymnasium.make(name).unwrapped, gymnasium.make_vec(name, num_envs=6)
    env.reset(seed=0)
    envs.reset(seed=0)
    for act, actions in ((env.step, CORNERS[0]), (envs.step, CORNERS)):
        with pytest.raises(ValueError, match=r"must be within \[-1, 1\]; got -?1.0000006"):
            act(actions * np.float32(1 + 5 * ULP))


def test_clipped_actions_are_observed_as_fired():
    env = gymnasium.make(inkjet_env.TUNE_ID, clip_actions=True).unwrapped
    env.reset(seed=0)
    observation = env.step(3 * CORNERS[0])[0]
    np.testing.assert_array_equal(observation[2:9], CORNERS[0])


@pytest.mark.parametrize("name", IDS)
@pytest.mark.parametrize(("low", "high"), [(0.3, 0.9), (0.6, 1.7), (0.1, 0.7), (0.0, 1.0)])
def test_rescaled_actions_reach_both_bounds(name, low, high):
    env = gymnasium.wrappers.RescaleAction(gymnasium.make(name), np.full(7, low, "f4"), np.full(7, high, "f4"))
    many = gymnasium.make_vec(name, num_envs=20)
    envs = gymnasium.wrappers.vector.RescaleAction(many, np.float32(low), np.float32(high))
    envs.reset(seed=0)
    for envs_actions in (envs.action_space.low, envs.action_space.high):
        envs.step(envs_actions)
        env.reset(seed=0)
        info = env.step(envs_actions[0])[4]
        bounds = env.unwrapped.task.bounds if name == inkjet_env.ENV_ID else env.unwrapped.tuning.task.bounds
        wanted = bounds.lower if envs_actions is envs.action_space.low else bounds.upper
        np.testing.assert_allclose(info["waveform"], wanted, atol=1e-5, rtol=1e-6)

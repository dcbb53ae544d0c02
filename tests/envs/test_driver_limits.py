"""Environments of a driver with limits: every action is a legal waveform, and the numbers stay the same everywhere."""

import gymnasium
import numpy as np
import pytest

import inkjet_env
from inkjet_env.envs.sb3 import BipolarWaveformVecEnv
from inkjet_env.printhead import Bounds, DriverLimits, Printhead, Waveform

LIMITS = DriverLimits(-50, 60, 20, 15, 0.1, longest_us=40, bits=10)
ACTIONS = np.random.default_rng(0).uniform(-1, 1, (8, 7)).astype(np.float32)
IDS = ("inkjet_env/BipolarWaveform-v0", "inkjet_env/TuneWaveform-v0")


@pytest.mark.parametrize("env_id", IDS)
def test_every_action_fires_a_legal_waveform(env_id):
    env = gymnasium.make(env_id, limits=LIMITS)
    for action in ACTIONS:
        env.reset(seed=0)
        waveform = env.step(action)[4]["waveform"]
        np.testing.assert_array_equal(waveform, Bounds(limits=LIMITS).from_unit(action.astype(float)))
        assert LIMITS.excesses(*Waveform.from_array(waveform).knots()) == []


def test_the_reward_is_that_of_the_legal_waveform():
    env = gymnasium.make(inkjet_env.ENV_ID, limits=LIMITS.as_json())
    env.reset(seed=0)
    _, reward, _, _, info = env.step(ACTIONS[0])
    assert reward == pytest.approx(-Printhead.published().respond(Waveform.from_array(info["waveform"])).cost())


@pytest.mark.parametrize("env_id", IDS)
def test_many_environments_equal_single_ones(env_id):
    envs = gymnasium.make_vec(env_id, num_envs=8, limits=LIMITS)
    envs.reset(seed=3)
    rewards = envs.step(ACTIONS)[1]
    for k, action in enumerate(ACTIONS):
        env = gymnasium.make(env_id, limits=LIMITS)
        env.reset(seed=3 + k)
        assert env.step(action)[1] == rewards[k]


def test_the_stable_baselines_environment_takes_limits_too():
    envs = BipolarWaveformVecEnv(8, limits=LIMITS)
    envs.reset()
    _, rewards, _, infos = envs.step(ACTIONS)
    assert all(not LIMITS.excesses(*Waveform.from_array(info["waveform"]).knots()) for info in infos)
    np.testing.assert_allclose(rewards, [-info["cost"] for info in infos], rtol=1e-6)


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ("rise_V_per_us=20", "limits must be DriverLimits, a dict or None; got 'rise_V_per_us=20'"),
        ({"rise": 20}, "a driver has no limit 'rise'; there are lowest_V"),
        ({"longest_us": 4}, "the shortest waveform of the search box lasts 5 us"),
    ],
)
def test_bad_limits_are_refused(limits, said):
    with pytest.raises(ValueError, match=said):
        gymnasium.make(inkjet_env.ENV_ID, limits=limits)

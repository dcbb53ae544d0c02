"""Attributes and methods of single environments, as Stable-Baselines3's vector environments offer them."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from stable_baselines3.common.vec_env import DummyVecEnv

import inkjet_env
from inkjet_env.envs.sb3 import BipolarWaveformVecEnv, TuneWaveformVecEnv

HEADS = 3
FORMS = [
    (BipolarWaveformVecEnv, inkjet_env.ENV_ID, {"context": "random"}),
    (TuneWaveformVecEnv, inkjet_env.TUNE_ID, {}),
]


def both(form, name, options):
    theirs = DummyVecEnv([lambda: gymnasium.make(name, **options)] * HEADS)
    for envs in (ours := form(HEADS, **options), theirs):
        envs.seed(5)
        envs.reset()
    return ours, theirs


@pytest.mark.parametrize(("form", "name", "options"), FORMS)
def test_attributes_are_those_of_single_environments(form, name, options):
    ours, theirs = both(form, name, options)
    for attribute in ("action_space", "observation_space", "render_mode", "np_random_seed"):
        assert ours.get_attr(attribute) == theirs.get_attr(attribute)
    assert [g.random() for g in ours.get_attr("np_random")] == [g.random() for g in theirs.get_attr("np_random")]
    assert ours.get_attr("observation_space", indices=[2]) == [ours.observation_space]
    assert ours.has_attr("num_envs")
    assert not ours.has_attr("no_such_thing")


@pytest.mark.parametrize(("form", "name", "options"), FORMS)
def test_an_attribute_is_set_in_the_environments_that_are_asked_for(form, name, options):
    ours, theirs = both(form, name, options)
    for envs in (ours, theirs):
        envs.set_attr("difficulty", 1)
        envs.set_attr("difficulty", 7, indices=1)
        assert envs.get_attr("difficulty") == [1, 7, 1]
        envs.set_attr("np_random", np.random.default_rng(4), indices=[0])
    ours.step(np.zeros((HEADS, 7)))
    assert ours.get_attr("np_random_seed")[0] == -1
    with pytest.raises(AttributeError, match="threads is shared by all environments and cannot be set: give it as"):
        ours.set_attr("threads", 3)


@pytest.mark.parametrize(("form", "name", "options"), FORMS)
def test_methods_act_on_single_environments(form, name, options):
    ours, theirs = both(form, name, options)
    actions = np.random.default_rng(0).uniform(-1, 1, (4, HEADS, 7)).astype(np.float32)
    for call, arguments, keywords in (
        ("reset", (), {"indices": 1, "seed": 30}),
        ("step", (actions[3, 0],), {"indices": [1]}),
        ("reset", (), {"indices": 1}),
    ):
        mine, other = (envs.env_method(call, *arguments, **keywords) for envs in (ours, theirs))
        assert data_equivalence(mine, other, exact=True)
    for batch in actions:
        mine, other = ours.step(batch), theirs.step(batch)
        assert data_equivalence(mine[:3], other[:3], exact=True)
    assert ours.env_method("has_wrapper_attr", "row") == [True] * HEADS
    with pytest.raises(AttributeError):
        ours.env_method("no_such_method")
    with pytest.raises(ValueError, match="action must be 7 numbers"):
        ours.env_method("step", np.zeros(6), indices=0)


def test_pictures_of_single_environments():
    envs = BipolarWaveformVecEnv(2, render_mode="rgb_array")
    envs.reset()
    envs.step(np.array([[0.5] * 7, [-0.5] * 7]))
    first, second = envs.env_method("render")
    np.testing.assert_array_equal(envs.env_method("render", indices=1)[0], second)
    assert first.shape == (640, 960, 3)
    assert (first != second).any()
    assert envs.render().shape[2] == 3


def test_episodes_restart_in_the_same_step_only():
    with pytest.raises(ValueError, match="Stable-Baselines3 restarts episodes in the same step"):
        TuneWaveformVecEnv(2, autoreset_mode="Disabled")

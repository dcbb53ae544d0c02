"""Every wrapper that Gymnasium brings runs a few episodes of both environments, or is listed with why it cannot."""

import importlib
import inspect

import gymnasium
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.spaces import Box, Dict
from gymnasium.vector import AutoresetMode, VectorObservationWrapper
from gymnasium.wrappers import vector as vector_wrappers

import inkjet_env

IDS = (inkjet_env.ENV_ID, inkjet_env.TUNE_ID)
UNIT = Box(0.0, 1.0, (7,), np.float32)
NEEDS = {
    "RecordVideo": "moviepy", "HumanRendering": "pygame", "ResizeObservation": "cv2", "GrayscaleObservation": "cv2",
    "NumpyToTorch": "array_api_compat", "ArrayConversion": "array_api_compat",
}  # fmt: skip
"""Packages that a wrapper imports; it is tried where they are installed."""
NEEDS_OF_VECTOR = NEEDS | {"HumanRendering": "cv2"}
CANNOT = {
    "AtariPreprocessing": "it is for the Atari emulator, whose lives and screen it reads",
    "JaxToNumpy": "it is for environments whose arrays are JAX's; these have NumPy's",
    "JaxToTorch": "it is for environments whose arrays are JAX's; these have NumPy's",
}


def seen(env):
    """The environment with its picture as the observation."""
    return wrappers.AddRenderObservation(env)


def square(env):
    size = int(np.prod(env.observation_space.shape))
    return wrappers.ReshapeObservation(env, (2, size // 2))


SINGLE = {
    "AddRenderObservation": seen,
    "AddWhiteNoise": lambda env: wrappers.AddWhiteNoise(env, 0.1),
    "ArrayConversion": lambda env: wrappers.ArrayConversion(env, np, np),
    "Autoreset": wrappers.Autoreset,
    "ClipAction": wrappers.ClipAction,
    "ClipReward": lambda env: wrappers.ClipReward(env, -1, 1),
    "DelayObservation": lambda env: wrappers.DelayObservation(env, 1),
    "DiscretizeAction": lambda env: wrappers.DiscretizeAction(env, 3),
    "DiscretizeObservation": lambda env: wrappers.DiscretizeObservation(env, 3, multidiscrete=True),
    "DtypeObservation": lambda env: wrappers.DtypeObservation(env, np.float64),
    "FilterObservation": lambda env: wrappers.FilterObservation(
        wrappers.AddRenderObservation(env, render_only=False), ["state"]
    ),
    "FlattenObservation": wrappers.FlattenObservation,
    "FrameStackObservation": lambda env: wrappers.FrameStackObservation(env, 3),
    "GrayscaleObservation": lambda env: wrappers.GrayscaleObservation(seen(env)),
    "HumanRendering": wrappers.HumanRendering,
    "MaxAndSkipObservation": lambda env: wrappers.MaxAndSkipObservation(env, 2),
    "NormalizeObservation": wrappers.NormalizeObservation,
    "NormalizeReward": wrappers.NormalizeReward,
    "NumpyToTorch": lambda env: wrappers.NumpyToTorch(env),
    "ObstructView": lambda env: wrappers.ObstructView(env, 0.1, 8),
    "OrderEnforcing": wrappers.OrderEnforcing,
    "PassiveEnvChecker": wrappers.PassiveEnvChecker,
    "RecordEpisodeStatistics": wrappers.RecordEpisodeStatistics,
    "RecordVideo": lambda env: wrappers.RecordVideo(env, "videos", episode_trigger=lambda episode: episode == 0),
    "RenderCollection": wrappers.RenderCollection,
    "RepeatAction": lambda env: wrappers.RepeatAction(env, 2),
    "RescaleAction": lambda env: wrappers.RescaleAction(env, np.float32(0.3), np.float32(0.9)),
    "RescaleObservation": lambda env: wrappers.RescaleObservation(env, np.float32(0), np.float32(1)),
    "ReshapeObservation": square,
    "ResizeObservation": lambda env: wrappers.ResizeObservation(seen(env), (64, 96)),
    "StickyAction": lambda env: wrappers.StickyAction(env, 0.5),
    "TimeAwareObservation": lambda env: wrappers.TimeAwareObservation(wrappers.TimeLimit(env, 5)),
    "TimeLimit": lambda env: wrappers.TimeLimit(env, 2),
    "TransformAction": lambda env: wrappers.TransformAction(env, lambda action: 2 * action - 1, UNIT),
    "TransformObservation": lambda env: wrappers.TransformObservation(env, lambda seen: seen / 2, None),
    "TransformReward": lambda env: wrappers.TransformReward(env, lambda reward: reward / 20),
}


def halved(observation):
    return observation / np.float32(2)


class Halved(wrappers.TransformObservation):
    """A wrapper of single environments for the vector wrappers that take one."""

    def __init__(self, env):
        super().__init__(env, halved, None)


def as_dict(envs):
    """Observations as dicts of one entry."""
    one, many = envs.single_observation_space, envs.observation_space
    return vector_wrappers.TransformObservation(envs, lambda seen: {"seen": seen}, Dict(seen=many), Dict(seen=one))


def as_picture(envs):
    """Every observation replaced by a grey picture."""
    one = Box(0, 255, (64, 96, 3), np.uint8)
    return vector_wrappers.VectorizeTransformObservation(
        envs,
        wrappers.TransformObservation,
        func=lambda seen: np.full((64, 96, 3), 128, np.uint8),
        observation_space=one,
    )


VECTOR = {
    "ArrayConversion": lambda envs: vector_wrappers.ArrayConversion(envs, np, np),
    "ClipAction": vector_wrappers.ClipAction,
    "ClipReward": lambda envs: vector_wrappers.ClipReward(envs, -1, 1),
    "DictInfoToList": vector_wrappers.DictInfoToList,
    "DtypeObservation": lambda envs: vector_wrappers.DtypeObservation(envs, np.float64),
    "FilterObservation": lambda envs: vector_wrappers.FilterObservation(as_dict(envs), ["seen"]),
    "FlattenObservation": vector_wrappers.FlattenObservation,
    "GrayscaleObservation": lambda envs: vector_wrappers.GrayscaleObservation(as_picture(envs)),
    "HumanRendering": vector_wrappers.HumanRendering,
    "NormalizeObservation": vector_wrappers.NormalizeObservation,
    "NormalizeReward": vector_wrappers.NormalizeReward,
    "NumpyToTorch": lambda envs: vector_wrappers.NumpyToTorch(envs),
    "RecordEpisodeStatistics": vector_wrappers.RecordEpisodeStatistics,
    "RecordVideo": lambda envs: vector_wrappers.RecordVideo(envs, "videos", episode_trigger=lambda number: number == 0),
    "RescaleAction": lambda envs: vector_wrappers.RescaleAction(envs, np.float32(0.3), np.float32(0.9)),
    "RescaleObservation": lambda envs: vector_wrappers.RescaleObservation(envs, np.float32(0), np.float32(1)),
    "ReshapeObservation": lambda envs: vector_wrappers.ReshapeObservation(
        envs, (2, envs.single_observation_space.shape[0] // 2)
    ),
    "ResizeObservation": lambda envs: vector_wrappers.ResizeObservation(as_picture(envs), (32, 48)),
    "TransformAction": lambda envs: vector_wrappers.TransformAction(envs, np.tanh),
    "TransformObservation": lambda envs: vector_wrappers.TransformObservation(envs, halved),
    "TransformReward": lambda envs: vector_wrappers.TransformReward(envs, lambda reward: reward / 20),
    "VectorizeTransformAction": lambda envs: vector_wrappers.VectorizeTransformAction(
        envs, wrappers.TransformAction, func=np.tanh, action_space=None
    ),
    "VectorizeTransformObservation": lambda envs: vector_wrappers.VectorizeTransformObservation(envs, Halved),
    "VectorizeTransformReward": lambda envs: vector_wrappers.VectorizeTransformReward(
        envs, wrappers.TransformReward, func=lambda reward: reward / 20
    ),
}


def accepted_modes(name):
    """Modes that a vector wrapper of Gymnasium accepts."""
    if name == "NormalizeObservation":
        return {AutoresetMode.NEXT_STEP}
    if issubclass(getattr(vector_wrappers, name), VectorObservationWrapper):
        return {AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED}
    return set(AutoresetMode)


@pytest.fixture
def here(monkeypatch, tmp_path):
    """A folder for videos, and windows that nobody sees."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    return tmp_path


def test_every_wrapper_is_tried_or_cannot_be():
    assert {*SINGLE, *CANNOT} == {name for name in wrappers.__all__ if name != "vector"}
    assert {*VECTOR, *CANNOT} - {"AtariPreprocessing"} == set(vector_wrappers.__all__)
    for name in ("JaxToNumpy", "JaxToTorch"):
        if importlib.util.find_spec("jax"):
            assert inspect.isclass(getattr(wrappers, name))


@pytest.mark.parametrize("env_id", IDS)
@pytest.mark.parametrize("name", SINGLE)
def test_a_single_environment_runs_in_each_wrapper(here, name, env_id):
    options = {"context": "random"} if env_id == inkjet_env.ENV_ID else {"tries": 2}
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    env = SINGLE[name](gymnasium.make(env_id, render_mode="rgb_array", **options))
    env.action_space.seed(0)
    ended = 0
    for episode in range(2):
        observation, _ = env.reset(seed=episode)
        over = False
        while not over:
            assert_inside(observation, env.observation_space)
            observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
            assert np.isfinite(float(reward))
            over = bool(terminated or truncated)
        ended += over
    env.close()
    assert ended == 2
    if name == "RecordVideo":
        assert list((here / "videos").glob("*.mp4"))


@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("env_id", IDS)
@pytest.mark.parametrize("name", VECTOR)
def test_a_vector_environment_runs_in_each_wrapper(here, name, env_id, mode):
    options = {"context": "random"} if env_id == inkjet_env.ENV_ID else {"tries": 3}
    made = gymnasium.make_vec(env_id, num_envs=3, render_mode="rgb_array", autoreset_mode=mode, **options)
    if name in NEEDS_OF_VECTOR:
        pytest.importorskip(NEEDS_OF_VECTOR[name])
    if mode not in accepted_modes(name):
        with pytest.raises((AssertionError, ValueError), match="autoreset_mode"):
            VECTOR[name](made)
        return
    if name in ("ArrayConversion", "NumpyToTorch") and mode is AutoresetMode.SAME_STEP:
        pytest.skip("Gymnasium cannot convert final_obs, an array of objects; nor can it with its own SyncVectorEnv")
    envs = VECTOR[name](made)
    envs.action_space.seed(0)
    observations, _ = envs.reset(seed=0)
    ended = 0
    for _ in range(8):
        assert_inside(observations, envs.observation_space)
        observations, rewards, terminated, truncated, _ = envs.step(envs.action_space.sample())
        assert np.isfinite(np.asarray(rewards)).all()
        over = np.asarray(terminated) | np.asarray(truncated)
        ended += over.sum()
        if over.any() and mode is AutoresetMode.DISABLED:
            observations, _ = envs.reset(options={"reset_mask": over})
    envs.close()
    assert ended >= 3
    if name == "RecordVideo":
        assert list((here / "videos").glob("*.mp4"))


def assert_inside(observation, space):
    """The observation, which may be a tensor, is one of the space."""
    if isinstance(observation, dict):
        assert all(np.asarray(part) in space[key] for key, part in observation.items())
    else:
        assert np.asarray(observation) in space

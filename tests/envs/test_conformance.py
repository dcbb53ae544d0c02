"""The environment keeps the rules of Gymnasium and Stable-Baselines3, and is registered as promised."""

import json
import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode

import inkjet_env
from inkjet_env.printhead import Printhead

OPTIONS = (
    {},
    {"context": "random", "noise": 0.2},
    {"printhead": Printhead.published().varied(frequency_Hz=120e3, damping_ratio=0.01), "window_s": float("inf")},
)


@pytest.fixture
def strict(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def run_python(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize("options", OPTIONS)
def test_gymnasium_finds_no_fault_with_the_bare_environment(strict, options):
    check_env(gymnasium.make(inkjet_env.ENV_ID, **options).unwrapped)


@pytest.mark.parametrize("options", OPTIONS)
def test_gymnasium_finds_no_fault_with_the_wrapped_environment(strict, options):
    # The one warning it may give is that it was handed a wrapped environment.
    warnings.filterwarnings("ignore", ".*is different from the unwrapped version.*")
    check_env(gymnasium.make(inkjet_env.ENV_ID, **options))


@pytest.mark.parametrize("options", OPTIONS)
def test_stable_baselines3_finds_no_fault(strict, options):
    from stable_baselines3.common.env_checker import check_env as check_for_sb3

    check_for_sb3(gymnasium.make(inkjet_env.ENV_ID, **options).unwrapped)


def test_importing_the_package_registers_it_and_loads_no_compiler_plots_or_networks():
    code = (
        "import inkjet_env, gymnasium, json, sys; gymnasium.spec('inkjet_env/BipolarWaveform-v0');"
        "print(json.dumps([m for m in ('numba', 'matplotlib', 'torch', 'stable_baselines3', 'pandas', 'scipy.stats')"
        " if m in sys.modules]))"
    )
    assert json.loads(run_python(code)) == []


@pytest.mark.parametrize(
    "code",
    [
        "import gymnasium; env = gymnasium.make('inkjet_env:inkjet_env/BipolarWaveform-v0')",
        "import gymnasium, inkjet_env; env = gymnasium.make('inkjet_env/BipolarWaveform-v0')",
    ],
)
def test_it_is_made_by_id_with_and_without_an_import(code):
    printed = run_python(
        f"{code}; env.reset(seed=0); env.action_space.seed(0); _, r, *end, i = env.step(env.action_space.sample());"
        "print(r == -i['cost'], *end)"
    )
    assert printed.split() == ["True", "True", "False"]


def test_the_episode_is_ended_by_the_environment_and_by_no_time_limit():
    assert gymnasium.spec(inkjet_env.ENV_ID).max_episode_steps is None


@pytest.mark.parametrize("wrapped", [True, False])
def test_step_needs_a_reset_before_and_after_each_episode(wrapped):
    env = gymnasium.make(inkjet_env.ENV_ID)
    env = env if wrapped else env.unwrapped
    action = np.zeros(7, dtype=np.float32)
    with pytest.raises(ResetNeeded):
        env.step(action)
    env.reset(seed=0)
    env.step(action)
    with pytest.raises(ResetNeeded, match="single step: call reset"):
        env.step(action)
    env.reset()
    env.step(action)


def test_a_refused_action_leaves_the_episode_open():
    env = gymnasium.make(inkjet_env.ENV_ID)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="must be a number; got nan"):
        env.step(np.full(7, np.nan, dtype=np.float32))
    assert env.step(np.zeros(7, dtype=np.float32))[2]


def test_reward_and_flags_are_native_python_values():
    env = gymnasium.make(inkjet_env.ENV_ID, noise=0.1)
    env.reset(seed=0)
    _, reward, terminated, truncated, _ = env.step(env.action_space.sample())
    assert [type(v) for v in (reward, terminated, truncated)] == [float, bool, bool]
    assert (terminated, truncated) == (True, False)


@pytest.mark.parametrize("name", [inkjet_env.ENV_ID, inkjet_env.TUNE_ID])
def test_infos_are_numpy_values(name):  # TorchRL reads their dtype
    env, envs = gymnasium.make(name), gymnasium.make_vec(name, num_envs=2)
    env.reset(seed=0)
    envs.reset(seed=0)
    info, infos = env.step(env.action_space.sample())[4], envs.step(envs.action_space.sample())[4]
    assert {key: value.dtype for key, value in info.items()} == dict.fromkeys(info, np.float64)
    assert all(infos[key].dtype == np.float64 and infos[f"_{key}"].dtype == np.bool_ for key in info)
    assert isinstance(info["cost"], float)


def test_the_vector_environment_tells_its_autoreset_mode():
    envs = gymnasium.make_vec(inkjet_env.ENV_ID, num_envs=2, vectorization_mode="vector_entry_point")
    assert envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    with pytest.raises(ResetNeeded):
        envs.step(np.zeros((2, 7), dtype=np.float32))


def test_returned_data_of_the_vector_environment_can_be_overwritten_without_harm():
    def three_steps(spoil):
        envs = gymnasium.make_vec(inkjet_env.ENV_ID, num_envs=3, context="random", noise=0.1)
        envs.action_space.seed(0)
        observations, _ = envs.reset(seed=0)
        kept = []
        for _ in range(3):
            observations, rewards, _, _, infos = envs.step(envs.action_space.sample())
            kept.append([observations.copy(), rewards.copy(), infos["final_info"]["waveform"].copy()])
            if spoil:
                for array in (observations, rewards, infos["waveform"], infos["cost"], infos["final_obs"][0]):
                    array[:] = 99.0
        return kept

    assert data_equivalence(three_steps(spoil=False), three_steps(spoil=True), exact=True)


def test_ppo_learns_on_the_stable_baselines3_environment():
    from stable_baselines3 import PPO

    from inkjet_env.envs.sb3 import BipolarWaveformVecEnv

    envs = BipolarWaveformVecEnv(16, context="random", noise=0.1)
    model = PPO("MlpPolicy", envs, n_steps=2, batch_size=16, n_epochs=1, seed=0, device="cpu")
    before = [p.detach().clone() for p in model.policy.parameters()]
    model.learn(64)
    assert model.num_timesteps == 64
    assert any((p != q).any() for p, q in zip(before, model.policy.parameters(), strict=True))

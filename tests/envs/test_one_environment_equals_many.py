"""Number for number: N single environments, the vector environment, the Stable-Baselines3 environment."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import inkjet_env
from inkjet_env.envs.parallel import simulated_costs
from inkjet_env.envs.sb3 import BipolarWaveformVecEnv
from inkjet_env.printhead import Bounds, PeakCost, batch

CASES = (
    {},
    {"context": "random"},
    {"noise": 0.3},
    {"context": "random", "noise": 0.3, "reference": (100, -100, 1e-6, 10.5e-6, 13.7e-6, 9.8e-6, 20e-6)},
    {"context": "random", "noise": 0.3, "initial_state": "demagnetised", "window_s": float("inf")},
)
SEED, HEADS, STEPS = 11, 5, 200  # 1,000 actions


def single_environments(options):
    return [gymnasium.make(inkjet_env.ENV_ID, **options) for _ in range(HEADS)]


def drawn_actions():
    return np.random.default_rng(3).uniform(-1, 1, (STEPS, HEADS, 7)).astype(np.float32)


@pytest.mark.parametrize("options", CASES)
def test_the_vector_environment_equals_single_ones_bit_for_bit(options):
    singles = single_environments(options)
    envs = gymnasium.make_vec(inkjet_env.ENV_ID, num_envs=HEADS, vectorization_mode="vector_entry_point", **options)
    observations, infos = envs.reset(seed=SEED)
    assert infos == {}
    seen = np.array([env.reset(seed=SEED + i)[0] for i, env in enumerate(singles)])
    np.testing.assert_array_equal(observations, seen)
    for actions in drawn_actions():
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        ended = [env.step(action) for env, action in zip(singles, actions, strict=True)]
        seen = np.array([env.reset()[0] for env in singles])
        np.testing.assert_array_equal(rewards, [e[1] for e in ended])
        assert terminated.all()
        assert not truncated.any()
        for told in (infos, infos["final_info"]):
            np.testing.assert_array_equal(told["waveform"], [e[4]["waveform"] for e in ended])
            np.testing.assert_array_equal(told["cost"], [e[4]["cost"] for e in ended])
        np.testing.assert_array_equal(np.stack(infos["final_obs"]), [e[0] for e in ended])
        np.testing.assert_array_equal(observations, seen)


@pytest.mark.parametrize("options", CASES)
def test_the_vector_environment_equals_gymnasiums_own_vector_of_single_ones(options):
    mode = {"autoreset_mode": AutoresetMode.SAME_STEP}
    theirs = gymnasium.make_vec(
        inkjet_env.ENV_ID, num_envs=HEADS, vectorization_mode="sync", vector_kwargs=mode, **options
    )
    assert isinstance(theirs.unwrapped, SyncVectorEnv)
    ours = gymnasium.make_vec(inkjet_env.ENV_ID, num_envs=HEADS, **options)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    seeds = [5, 90, 3, 17, 4]
    assert data_equivalence(ours.reset(seed=seeds), theirs.reset(seed=seeds), exact=True)
    assert ours.np_random_seed == theirs.np_random_seed
    for actions in drawn_actions()[:20]:
        *mine, infos = ours.step(actions)
        *other, their_infos = theirs.step(actions)
        assert data_equivalence(mine, other, exact=True)
        told = {key: infos[key] for key in their_infos}
        assert data_equivalence(told, their_infos, exact=True)
    assert data_equivalence(ours.reset(), theirs.reset(), exact=True)


@pytest.mark.parametrize("options", CASES)
def test_the_stable_baselines3_environment_equals_single_ones(options):
    singles = single_environments(options)
    envs = BipolarWaveformVecEnv(HEADS, **options)
    envs.seed(SEED)
    np.testing.assert_array_equal(envs.reset(), [env.reset(seed=SEED + i)[0] for i, env in enumerate(singles)])
    for actions in drawn_actions():
        observations, rewards, dones, infos = envs.step(actions)
        ended = [env.step(action) for env, action in zip(singles, actions, strict=True)]
        np.testing.assert_array_equal(rewards, np.array([e[1] for e in ended], dtype=np.float32))
        assert dones.all()
        for info, (last, *_, told) in zip(infos, ended, strict=True):
            assert data_equivalence(info, told | {"terminal_observation": last, "TimeLimit.truncated": False}, True)
        np.testing.assert_array_equal(observations, [env.reset()[0] for env in singles])


def test_costs_do_not_depend_on_the_number_of_threads():
    task = gymnasium.make(inkjet_env.ENV_ID, context="random").unwrapped.task
    rng = np.random.default_rng(0)
    waveforms = task.waveforms(rng.uniform(-1, 1, (1100, 7)), (1100, 7))
    heads = task.heads(task.contexts([rng] * 1100))
    arguments = (waveforms, heads, *task._prepared)
    alone = simulated_costs(*arguments, threads=1)
    np.testing.assert_array_equal(simulated_costs(*arguments, threads=3), alone)
    np.testing.assert_array_equal(batch.costs(waveforms, heads), alone)


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(
    "options", [{}, {"context": "random", "reference": (100, -100, 1e-6, 10.5e-6, 13.7e-6, 9.8e-6, 20e-6)}]
)
def test_lanes_give_the_same_costs_but_for_their_last_digits(options, threads):
    exact, fast = (
        gymnasium.make_vec(inkjet_env.ENV_ID, num_envs=4100, threads=threads, simulator=name, **options)
        for name in ("scalar", "lanes")
    )
    np.testing.assert_array_equal(exact.reset(seed=SEED)[0], fast.reset(seed=SEED)[0])
    for seed in range(2):
        actions = np.random.default_rng(seed).uniform(-1, 1, (4100, 7)).astype(np.float32)
        (_, rewards, *_, infos), (_, others, *_, told) = exact.step(actions), fast.step(actions)
        np.testing.assert_allclose(others, rewards, rtol=0, atol=6e-10)
        np.testing.assert_allclose(told["cost"], infos["cost"], rtol=0, atol=3e-10)
        np.testing.assert_array_equal(told["waveform"], infos["waveform"])
        assert (told["cost"] != infos["cost"]).any(), "lanes were not used"


@pytest.mark.parametrize(
    "options",
    [{"noise": 0.1}, {"cost": {"effective": "first"}}, {"initial_state": "demagnetised"}, {"hysteresis": "one_point"},
     {"window_s": float("inf")}],
)  # fmt: skip
def test_a_task_that_lanes_cannot_simulate_is_refused(options):
    with pytest.raises(ValueError, match=r"simulator=\"lanes\" needs "):
        gymnasium.make_vec(inkjet_env.ENV_ID, num_envs=3, simulator="lanes", **options)


def test_waveforms_are_those_of_the_bounds():
    bounds = Bounds(lower=(20, -90, 2e-6, 1e-6, 3e-6, 1e-6, 5e-6), upper=(80, -30, 9e-6, 8e-6, 3e-6, 30e-6, 6e-6))
    env = gymnasium.make(inkjet_env.ENV_ID, bounds=bounds)
    for action in (*drawn_actions()[0], np.ones(7, dtype=np.float32), -np.ones(7, dtype=np.float32)):
        env.reset(seed=0)
        np.testing.assert_array_equal(env.step(action)[4]["waveform"], bounds.from_unit(action))


def test_the_cost_is_that_of_the_head_the_observation_tells():
    cost = PeakCost(-10, 5, "first")
    env = gymnasium.make(inkjet_env.ENV_ID, context="random", cost={"A": -10, "B": 5, "effective": "first"})
    env.action_space.seed(0)
    for seed in range(5):
        observation, _ = env.reset(seed=seed)
        head = env.unwrapped.printhead
        _, reward, _, _, info = env.step(env.action_space.sample())
        assert head.frequency_Hz == pytest.approx(52.5e3 + 17.5e3 * float(observation[0]), rel=1e-12)
        assert head.damping_ratio == pytest.approx(0.055 + 0.025 * float(observation[1]), rel=1e-12)
        assert head.b1 == pytest.approx(1.907e4 * (1 + 0.3 * float(observation[2])), rel=1e-12)
        assert head.coefficients[0] == pytest.approx(19.014 * (1 + 0.4 * float(observation[3])), rel=1e-12)
        assert -reward == pytest.approx(batch.costs(info["waveform"], head, cost)[0], rel=1e-9)
        assert -reward == info["cost"]


def test_drawn_heads_fill_their_ranges_evenly():
    envs = gymnasium.make_vec(inkjet_env.ENV_ID, num_envs=2000, context="random")
    observations, _ = envs.reset(seed=0)
    assert np.abs(observations).max() <= 1
    # A uniform number in [-1, 1]: mean 0 ± 0.013, mean square 1/3 ± 0.007 for 2,000 draws.
    assert np.abs(observations.mean(axis=0)).max() < 0.05
    assert np.abs((observations**2).mean(axis=0) - 1 / 3).max() < 0.03
    assert np.abs(np.corrcoef(observations.T) - np.eye(4)).max() < 0.1

"""A few tries on a head that nobody knows: the rules, the numbers, and that something can be learnt of it."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode

import inkjet_env
from inkjet_env.envs.sb3 import TuneWaveformVecEnv
from inkjet_env.envs.tune_waveform import TuneWaveformVectorEnv
from inkjet_env.printhead import Printhead, Waveform, batch

OPTIONS = ({}, {"tries": 3, "peaks": 20, "noise": 0.0}, {"noise": 0.3, "window_s": float("inf")})
HEADS, SEED = 4, 21


def drawn_actions(steps=25):
    return np.random.default_rng(3).uniform(-1, 1, (steps, HEADS, 7)).astype(np.float32)


@pytest.mark.parametrize("options", OPTIONS)
def test_gymnasium_and_stable_baselines3_find_no_fault(options):
    from stable_baselines3.common.env_checker import check_env as check_for_sb3

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(inkjet_env.TUNE_ID, **options).unwrapped)
        check_for_sb3(gymnasium.make(inkjet_env.TUNE_ID, **options).unwrapped)


@pytest.mark.parametrize("options", OPTIONS)
def test_the_vector_environment_equals_gymnasiums_own_vector_of_single_ones(options):
    mode = {"autoreset_mode": AutoresetMode.SAME_STEP}
    theirs = gymnasium.make_vec(
        inkjet_env.TUNE_ID, num_envs=HEADS, vectorization_mode="sync", vector_kwargs=mode, **options
    )
    ours = gymnasium.make_vec(inkjet_env.TUNE_ID, num_envs=HEADS, vectorization_mode="vector_entry_point", **options)
    assert ours.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert ours.observation_space == theirs.observation_space
    assert data_equivalence(ours.reset(seed=SEED), theirs.reset(seed=SEED), exact=True)
    for actions in drawn_actions():
        *mine, infos = ours.step(actions)
        *other, their_infos = theirs.step(actions)
        assert data_equivalence(mine, other, exact=True)
        for name in ("final_obs", "final_info"):
            assert (name in infos) == (name in their_infos) == bool(mine[2].all())
        if "final_info" in infos:
            np.testing.assert_array_equal(np.stack(infos["final_obs"]), np.stack(their_infos["final_obs"]))
            infos, their_infos = infos["final_info"], their_infos["final_info"]
        for name in ("waveform", "cost", "reading", "kept_cost"):
            np.testing.assert_array_equal(infos[name], their_infos[name])


def test_the_stable_baselines3_environment_equals_the_vector_one():
    ours, theirs = TuneWaveformVecEnv(HEADS, tries=4), gymnasium.make_vec(inkjet_env.TUNE_ID, num_envs=HEADS, tries=4)
    ours.seed(SEED)
    np.testing.assert_array_equal(ours.reset(), theirs.reset(seed=SEED)[0])
    for step, actions in enumerate(drawn_actions(9), start=1):
        observations, rewards, dones, told = ours.step(actions)
        wanted, pay, ended, _, infos = theirs.step(actions)
        np.testing.assert_array_equal(observations, wanted)
        np.testing.assert_array_equal(rewards, pay.astype(np.float32))
        assert (dones == ended).all()
        assert all(("terminal_observation" in info) == (step % 4 == 0) for info in told)
        assert [info["kept_cost"] for info in told] == infos["kept_cost"].tolist()


@pytest.mark.parametrize("noise", [0.0, 0.4])
def test_rewards_add_up_to_minus_the_true_cost_of_the_waveform_that_is_kept(noise):
    env = gymnasium.make(inkjet_env.TUNE_ID, noise=noise)
    for seed in range(6):
        env.reset(seed=seed)
        env.action_space.seed(seed)
        total, tried = 0.0, []
        for _ in range(10):
            _, reward, terminated, _, info = env.step(env.action_space.sample())
            total += reward
            tried.append((info["reading"], info["cost"]))
        assert terminated
        _, true = min([(0.0, 0.0), *tried])
        assert total == pytest.approx(-true, abs=1e-9)
        assert info["kept_cost"] == true
        if noise == 0:
            assert all(read == true for read, true in tried)


def test_an_observation_shows_what_was_fired_and_read_and_not_the_head():
    env = gymnasium.make(inkjet_env.TUNE_ID, noise=0.0, peaks=6).unwrapped
    first, _ = env.reset(seed=1)
    assert not first.any()
    action = np.array([0.9, -0.8, -0.5, 0.1, 0.2, -0.3, 0.4], dtype=np.float32)
    seen, *_, info = env.step(action)
    head = env.tuning.task.head(env.tuning.contexts[0])
    times_s, peaks_V = batch.peaks(Waveform.from_array(info["waveform"]), head)
    np.testing.assert_allclose(seen[16:22], np.clip(peaks_V[:6] / 5, -10, 10), rtol=1e-5)
    np.testing.assert_allclose(seen[22:28], times_s[:6] / 100e-6, rtol=1e-5)
    np.testing.assert_array_equal(seen[2:9], action)
    assert seen[0] == np.float32(0.1)
    kept = info["kept_cost"] == info["cost"]
    np.testing.assert_array_equal(seen[9:16], action if kept else np.zeros(7))


def test_the_best_of_what_was_fired_is_kept():
    env = gymnasium.make(inkjet_env.TUNE_ID, noise=0.0)
    env.reset(seed=2)
    env.action_space.seed(2)
    kept = [env.step(env.action_space.sample())[4]["kept_cost"] for _ in range(10)]
    assert (np.diff(kept) <= 0).all()


def test_heads_that_are_put_on_the_bench_are_those_that_answer():
    envs = TuneWaveformVectorEnv(3, noise=0.0)
    envs.reset(seed=0)
    contexts = np.array([[1.5, 0, 0, 0], [-1.5, 0, 0, 1.2], [0, 0, 0, 0]], dtype=np.float32)
    envs.tuning.put_on_the_bench(contexts)
    actions = np.tile([0.9, -0.9, -0.8, 0.1, 0.2, 0.1, 0.6], (3, 1)).astype(np.float32)
    *_, infos = envs.step(actions)
    for k, waveform in enumerate(infos["waveform"]):
        head = envs.tuning.task.head(contexts[k])
        assert infos["cost"][k] == pytest.approx(head.respond(Waveform.from_array(waveform)).cost(), abs=1e-9)
    assert envs.tuning.task.head(contexts[0]).frequency_Hz == pytest.approx(78750)
    with pytest.raises(ValueError, match=r"shape \(3, 4\)"):
        envs.tuning.put_on_the_bench(contexts[:2])
    given = TuneWaveformVectorEnv(3, heads=[Printhead.published()])
    with pytest.raises(ValueError, match="option heads"):
        given.tuning.put_on_the_bench(contexts)


def test_an_episode_has_as_many_tries_as_asked_for():
    env = gymnasium.make(inkjet_env.TUNE_ID, tries=2)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(7, dtype=np.float32))
    env.reset(seed=0)
    assert not env.step(np.zeros(7, dtype=np.float32))[2]
    assert env.step(np.zeros(7, dtype=np.float32))[2]
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(7, dtype=np.float32))


def test_what_is_not_offered_is_refused():
    for options, sentence in (
        ({"context": "fixed"}, "context cannot be given"),
        ({"tries": 0}, "tries must be 1 to 10000; got 0"),
        ({"peaks": 2.5}, "peaks must be a whole number; got 2.5"),
    ):
        with pytest.raises(ValueError, match=sentence):
            gymnasium.make(inkjet_env.TUNE_ID, **options)


def test_a_refused_action_costs_no_try():
    env = gymnasium.make(inkjet_env.TUNE_ID, tries=1)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="must be a number; got nan"):
        env.step(np.full(7, np.nan, dtype=np.float32))
    assert env.step(np.zeros(7, dtype=np.float32))[2]


def test_a_picture_of_the_last_try():
    env = gymnasium.make(inkjet_env.TUNE_ID, render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    env.step(np.full(7, 0.5, dtype=np.float32))
    after = env.render()
    assert before.shape == after.shape == (640, 960, 3)
    assert (before != after).any()

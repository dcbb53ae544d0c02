"""When ended episodes are restarted: step for step as Gymnasium's vector of single environments does in each mode."""

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, VectorEnv

import inkjet_env
from inkjet_env.envs import BipolarWaveformVectorEnv, TuneWaveformVectorEnv

HEADS, STEPS, SEED = 4, 30, 8
CASES = [
    (inkjet_env.ENV_ID, {"context": "random", "noise": 0.2}),
    (inkjet_env.ENV_ID, {}),
    (inkjet_env.TUNE_ID, {"tries": 3, "noise": 0.2}),
]


def both(name, mode, options):
    theirs = gymnasium.make_vec(
        name, num_envs=HEADS, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **options
    )
    return gymnasium.make_vec(name, num_envs=HEADS, autoreset_mode=mode, **options), theirs


def assert_equal_infos(ours, theirs, mode, ended):
    told = dict(ours)
    if mode is AutoresetMode.SAME_STEP and ended.any():
        # Where an episode has ended, ours repeat the final info under the names of the single environment.
        for name in theirs["final_info"]:
            extra = told.pop(name)
            if name in theirs:
                shown = ~ended.reshape(-1, *[1] * (extra.ndim - 1))
                told[name] = np.where(shown, extra, np.zeros_like(extra))
    finals = told.pop("final_obs", None), theirs.get("final_obs")
    assert data_equivalence(told, {key: value for key, value in theirs.items() if key != "final_obs"}, exact=True)
    assert (finals[0] is None) == (finals[1] is None)
    for our, their in zip(*finals, strict=True) if finals[0] is not None else ():
        assert data_equivalence(our, their, exact=True)


@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("resets", ["none", "some"])
@pytest.mark.parametrize(("name", "options"), CASES)
def test_every_mode_equals_gymnasiums(name, options, mode, resets):
    ours, theirs = both(name, mode, options)
    assert ours.metadata["autoreset_mode"] is ours.autoreset_mode is mode
    rng = np.random.default_rng(1)
    assert data_equivalence(ours.reset(seed=SEED), theirs.reset(seed=SEED), exact=True)
    for step in range(STEPS):
        actions = rng.uniform(-1, 1, (HEADS, 7)).astype(np.float32)
        *mine, infos = ours.step(actions)
        *other, their_infos = theirs.step(actions)
        assert data_equivalence(mine, other, exact=True)
        ended = mine[2] | mine[3]
        assert_equal_infos(infos, their_infos, mode, ended)
        mask = ended if mode is AutoresetMode.DISABLED else np.zeros(HEADS, dtype=np.bool_)
        if resets == "some":
            mask = mask | (rng.random(HEADS) < 0.2)
        if mask.any():
            seeds = [step, None, 3 * step, None]
            again = [envs.reset(seed=seeds, options={"reset_mask": mask.copy()}) for envs in (ours, theirs)]
            assert data_equivalence(*again, exact=True)
    assert data_equivalence(ours.reset(), theirs.reset(), exact=True)


def test_the_mode_may_be_given_by_its_string():
    for mode in AutoresetMode:
        for given in (mode.value, mode.name):
            envs = gymnasium.make_vec(inkjet_env.TUNE_ID, num_envs=2, autoreset_mode=given)
            assert envs.unwrapped.autoreset_mode is envs.metadata["autoreset_mode"] is mode
    assert TuneWaveformVectorEnv.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP


@pytest.mark.parametrize(("name", "options"), CASES)
def test_an_ended_episode_is_not_stepped_if_restarts_are_disabled(name, options):
    envs = gymnasium.make_vec(name, num_envs=3, autoreset_mode="Disabled", **options)
    with pytest.raises(ResetNeeded, match="before the first step"):
        envs.step(np.zeros((3, 7)))
    envs.reset(seed=0, options={"reset_mask": np.array([True, False, True])})
    with pytest.raises(ResetNeeded, match="before the first step"):
        envs.step(np.zeros((3, 7)))
    envs.reset(seed=0)
    over = np.zeros(3, dtype=np.bool_)
    while not over.any():
        over = envs.step(np.zeros((3, 7)))[2]
    with pytest.raises(ResetNeeded, match=r"episode of head 0 has ended: call reset\(\), or reset\(options="):
        envs.step(np.zeros((3, 7)))
    envs.reset(options={"reset_mask": over})
    envs.step(np.zeros((3, 7)))


@pytest.mark.parametrize("mask", [[True, False], np.ones(3, dtype=np.bool_), np.ones(2), np.zeros(2, dtype=np.bool_)])
def test_a_mask_is_one_boolean_for_every_head(mask):
    envs = gymnasium.make_vec(inkjet_env.TUNE_ID, num_envs=2)
    with pytest.raises(ValueError, match="reset_mask must be"):
        envs.reset(options={"reset_mask": mask})
    with pytest.raises(ValueError, match="reset takes no options; got 'head'"):
        envs.reset(options={"reset_mask": np.ones(2, dtype=np.bool_), "head": 1})


def test_the_action_of_a_head_that_restarts_is_ignored_and_a_refused_one_changes_nothing():
    envs = gymnasium.make_vec(inkjet_env.ENV_ID, num_envs=2, autoreset_mode="NextStep", context="random")
    envs.reset(seed=0)
    envs.step(np.zeros((2, 7)))
    envs.reset(options={"reset_mask": np.array([False, True])})
    actions = np.array([[np.nan] * 7, [0.5] * 7])
    with pytest.raises(ValueError, match="U1 must be a number; got nan in row 1"):
        envs.step(actions[::-1])
    _, rewards, over, _, infos = envs.step(actions)
    assert over.tolist() == infos["_cost"].tolist() == [False, True]
    assert (rewards[0], rewards[1]) == (0, -infos["cost"][1])


@pytest.mark.parametrize(("name", "options"), CASES)
def test_single_environments_are_called_and_read_as_gymnasiums(name, options):
    ours, theirs = both(name, AutoresetMode.DISABLED, options)
    actions = np.random.default_rng(0).uniform(-1, 1, (HEADS, 7))
    for envs in (ours, theirs):
        envs.reset(seed=3)
        envs.set_attr("label", ["a", "b", "c", "d"])
        envs.set_attr("difficulty", 2)
    for attribute in ("label", "difficulty", "np_random_seed", "action_space", "observation_space"):
        assert ours.get_attr(attribute) == theirs.get_attr(attribute)
    for call, arguments in (("step", (actions[0],)), ("reset", ()), ("render", ())):
        assert data_equivalence(ours.call(call, *arguments), theirs.call(call, *arguments), exact=True)
    for sentence, error, values in (
        ("values must be one for each of 4 environments; got 2", ValueError, [1, 2]),
        ("task is shared by all environments|tuning is shared", AttributeError, 3),
    ):
        with pytest.raises(error, match=sentence):
            ours.set_attr("task" if hasattr(ours, "task") else "tuning", values)


@pytest.mark.parametrize("kind", [BipolarWaveformVectorEnv, TuneWaveformVectorEnv])
def test_libraries_recognise_a_vector_environment(kind):
    assert VectorEnv in kind.__bases__  # skrl looks there
    assert len(kind(5)) == kind(5).num_envs == 5


@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("name", [inkjet_env.ENV_ID, inkjet_env.TUNE_ID])
def test_no_number_depends_on_the_threads(name, mode):
    def three_steps(threads):
        options = {"context": "random"} if name == inkjet_env.ENV_ID else {"tries": 2}
        envs = gymnasium.make_vec(name, num_envs=1100, noise=0.1, threads=threads, autoreset_mode=mode, **options)
        rng, seen = np.random.default_rng(0), [envs.reset(seed=0)]
        for _ in range(3):
            seen.append(envs.step(rng.uniform(-1, 1, (1100, 7))))
            if mode is AutoresetMode.DISABLED:
                seen.append(envs.reset())
        return [step[:-1] for step in seen], [step[-1].get("cost") for step in seen]

    assert data_equivalence(three_steps(1), three_steps(3), exact=True)


def test_several_threads_find_a_crowded_response_whole():
    task = gymnasium.make(inkjet_env.ENV_ID).unwrapped.task
    waveforms = task.bounds.from_unit(np.random.default_rng(0).uniform(-1, 1, (1100, 7)))
    from inkjet_env.envs.parallel import simulated_peaks

    (warm_up_periods, one_point, window_s, *_), capacity = task._prepared
    settings = warm_up_periods, one_point, window_s
    whole = simulated_peaks(waveforms, task.heads([]), settings, capacity, 1)
    grown = simulated_peaks(waveforms, task.heads([]), settings, 1, 3)  # one column is too few for every response
    np.testing.assert_array_equal(grown[2], whole[2])
    most = whole[2].max()
    for ours, theirs in ((grown[0], whole[0]), (grown[1], whole[1])):
        np.testing.assert_array_equal(ours[:, :most], theirs[:, :most])

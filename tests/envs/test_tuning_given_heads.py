"""Tuning heads that are given: corrected ones, or those that a diagnosis leaves possible."""

import json
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode

import inkjet_env
from inkjet_env.envs.given_heads import ensemble_of_heads
from inkjet_env.plant import catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.head_ensemble import HeadEnsemble
from inkjet_env.printhead import Printhead, QuasiStaticPrinthead, Waveform

BASE = Printhead.published()
EFFECTS = {effect.id: effect for effect in catalogue()}
WITH_MODE = AugmentedPrinthead(BASE, ((EFFECTS["second_mode"], EFFECTS["second_mode"].example_values(BASE)),))
SATURATED = AugmentedPrinthead(BASE, ((EFFECTS["sensor_saturation"], {"limit": 5.0, "hardness": 20.0}),))
POSSIBLE = HeadEnsemble((BASE, WITH_MODE, BASE.varied(48e3), SATURATED), (2.0, 1.0, 1.0, 4.0))
COUNT, SEED = 5, 21
ACTION = np.array([0.9, -0.8, -0.5, 0.1, 0.2, -0.3, 0.4], dtype=np.float32)


def corrected_file(folder, **more):
    """A file as diagnose writes it."""
    path = folder / "corrected.json"
    path.write_text(json.dumps(SATURATED.as_json() | {"ensemble": POSSIBLE.as_json()} | more))
    return path


@pytest.mark.parametrize("heads", [SATURATED, POSSIBLE, [BASE, WITH_MODE]], ids=["corrected", "ensemble", "sequence"])
def test_gymnasium_and_stable_baselines3_find_no_fault(heads):
    from stable_baselines3.common.env_checker import check_env as check_for_sb3

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(inkjet_env.TUNE_ID, heads=heads).unwrapped)
        check_for_sb3(gymnasium.make(inkjet_env.TUNE_ID, heads=heads).unwrapped)


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_the_vector_environment_equals_gymnasiums_own_vector_of_single_ones(noise):
    options = {"heads": POSSIBLE, "tries": 2, "noise": noise, "peaks": 5}
    mode = {"autoreset_mode": AutoresetMode.SAME_STEP}
    theirs = gymnasium.make_vec(
        inkjet_env.TUNE_ID, num_envs=COUNT, vectorization_mode="sync", vector_kwargs=mode, **options
    )
    ours = gymnasium.make_vec(inkjet_env.TUNE_ID, num_envs=COUNT, vectorization_mode="vector_entry_point", **options)
    assert ours.observation_space == theirs.observation_space
    assert data_equivalence(ours.reset(seed=SEED), theirs.reset(seed=SEED), exact=True)
    met = set()
    for actions in np.random.default_rng(3).uniform(-1, 1, (9, COUNT, 7)).astype(np.float32):
        met |= set(ours.tuning.numbers.tolist())
        *mine, infos = ours.step(actions)
        *other, their_infos = theirs.step(actions)
        assert data_equivalence(mine, other, exact=True)
        if "final_info" in infos:
            infos, their_infos = infos["final_info"], their_infos["final_info"]
        for name in ("waveform", "cost", "reading", "kept_cost"):
            np.testing.assert_array_equal(infos[name], their_infos[name])
    assert met == {0, 1, 2, 3}


def test_what_is_read_is_what_the_head_shows_and_a_seed_draws_the_same_head_again():
    env = gymnasium.make(inkjet_env.TUNE_ID, heads=POSSIBLE, noise=0.0, peaks=6).unwrapped
    met = set()
    for seed in range(12):
        seen = []
        for _ in range(2):
            env.reset(seed=seed)
            observed, *_, info = env.step(ACTION)
            seen.append(observed)
        np.testing.assert_array_equal(*seen)
        head = env.tuning.head(0)
        met.add(POSSIBLE.heads.index(head))
        response = head.respond(Waveform.from_array(info["waveform"]))
        assert info["cost"] == info["reading"] == pytest.approx(response.cost(), rel=1e-9)
        np.testing.assert_allclose(observed[16:22], np.clip(response.peaks_V[:6] / 5, -10, 10), rtol=1e-5)
        np.testing.assert_allclose(observed[22:28], response.peak_times_s[:6] / 100e-6, rtol=1e-5)
    assert len(met) > 1


def test_heads_are_drawn_as_often_as_they_weigh():
    envs = gymnasium.make_vec(inkjet_env.TUNE_ID, num_envs=4000, heads=POSSIBLE)
    envs.reset(seed=0)
    shares = np.bincount(envs.tuning.numbers, minlength=4) / 4000
    np.testing.assert_allclose(shares, POSSIBLE.weights, atol=4 * 0.5 / np.sqrt(4000))


def test_a_file_stands_for_the_heads_that_it_leaves_possible_or_for_its_head(tmp_path):
    from_file = ensemble_of_heads(corrected_file(tmp_path))
    waveforms = np.array([[90.0, -80.0, 5e-6, 8e-6, 8e-6, 8e-6, 8e-6]])
    assert from_file.weights == POSSIBLE.weights
    np.testing.assert_allclose(from_file.costs(waveforms), POSSIBLE.costs(waveforms), rtol=1e-12)
    WITH_MODE.to_json(tmp_path / "one.json")
    alone = ensemble_of_heads(tmp_path / "one.json")
    assert alone.weights == (1.0,)
    np.testing.assert_allclose(alone.costs(waveforms)[0], WITH_MODE.costs(waveforms), rtol=1e-12)
    both = ensemble_of_heads([str(tmp_path / "corrected.json"), BASE])  # of a file in a list, its head
    assert both.weights == (0.5, 0.5)
    expected = [SATURATED.costs(waveforms)[0], BASE.respond(Waveform.from_array(waveforms[0])).cost()]
    np.testing.assert_allclose(both.costs(waveforms)[:, 0], expected, rtol=1e-9)


def test_an_episode_on_a_corrected_head_has_a_picture_and_stable_baselines3_plays_it():
    from inkjet_env.envs.sb3 import TuneWaveformVecEnv

    env = gymnasium.make(inkjet_env.TUNE_ID, heads=SATURATED, render_mode="rgb_array")
    env.reset(seed=0)
    empty = env.render()
    env.step(ACTION)
    assert (env.render() != empty).any()
    vector = TuneWaveformVecEnv(2, heads=SATURATED, noise=0.0)
    vector.seed(0)
    vector.reset()
    *_, infos = vector.step(np.tile(ACTION, (2, 1)))
    expected = SATURATED.costs([info["waveform"] for info in infos])
    assert [info["cost"] for info in infos] == pytest.approx(expected.tolist(), rel=1e-12)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"heads": []}, "heads must be a head, the path of a printhead.json, a sequence"),
        ({"heads": 3}, "heads must be a head"),
        ({"heads": [BASE, None]}, "heads must be a head"),
        ({"heads": BASE, "printhead": BASE}, "printhead cannot be given beside heads"),
        ({"heads": BASE, "context": "fixed"}, "context cannot be given"),
        ({"heads": [BASE, SATURATED], "window_s": np.inf}, "an infinite window needs a printhead without effects"),
        ({"heads": [BASE, SATURATED], "hysteresis": "one_point"}, "must be one of full_memory"),
        ({"heads": QuasiStaticPrinthead.of(BASE)}, "the dynamics a0, a1 and b1 of this printhead are unknown"),
        ({"heads": "nowhere.json"}, "nowhere.json: cannot be read"),
        ({"printhead": SATURATED}, "give it as heads"),
    ],
)
def test_what_cannot_be_tuned_is_refused_when_made(options, message):
    for make in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(ValueError, match=message):
            make(inkjet_env.TUNE_ID, **options)


def test_a_damaged_ensemble_is_refused_with_its_file(tmp_path):
    path = corrected_file(tmp_path, ensemble=[{"weight": 1.0}])
    with pytest.raises(ValueError, match=r"corrected.json: ensemble must be a list"):
        gymnasium.make(inkjet_env.TUNE_ID, heads=path)

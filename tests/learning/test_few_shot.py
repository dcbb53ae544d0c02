"""A few tries on an unknown head: everybody meets the same heads, and only what is told may be used."""

import functools
import json

import numpy as np
import pytest

from inkjet_env.envs.tune_waveform import TuneWaveformVectorEnv
from inkjet_env.experiments.learning import benches, few_shot, few_shot_tuners, recurrent_training, repeated_training
from inkjet_env.experiments.learning.benches import heads_on_the_bench
from inkjet_env.experiments.learning.few_shot_tuners import (
    MIDDLE,
    PULSE,
    Agent,
    ConstantWaveform,
    FixedSequence,
    Optimisers,
    best_list,
    kept_costs_V,
)
from inkjet_env.experiments.learning.heads import Heads, drawn, stretched
from inkjet_env.experiments.learning.policies import Policy

SEED = 5


@pytest.mark.parametrize("entry", few_shot_tuners.SCRATCH.values(), ids=list(few_shot_tuners.SCRATCH))
def test_tuning_repeats_itself_and_an_optimiser_beside_others_asks_what_it_would_alone(entry):
    name, options = entry
    kept = kept_costs_V(Optimisers(name, 3, 7, SEED, **options), 3, 7, SEED)
    assert kept.shape == (3, 7)
    assert (kept == kept_costs_V(Optimisers(name, 3, 7, SEED, **options), 3, 7, SEED)).all()
    alone = Optimisers(name, 1, 7, SEED + 2, **options)
    first = Optimisers(name, 3, 7, SEED, **options).fire(np.zeros((3, 32), dtype=np.float32))[2]
    assert (alone.fire(np.zeros((1, 32), dtype=np.float32))[0] == first).all()


def test_the_heads_on_the_bench_are_those_whose_best_is_searched_for():
    point = np.array([0.9, -0.8, -0.5, 0.1, 0.3, -0.2, 0.4], dtype=np.float32)
    envs = TuneWaveformVectorEnv(4, tries=2, noise=0.0)
    envs.reset(seed=SEED)
    *_, infos = envs.step(np.tile(point, (4, 1)))
    costs = heads_on_the_bench(4, SEED).evaluate(np.tile(point.astype(float), (4, 1)))
    np.testing.assert_allclose(infos["cost"], costs, rtol=1e-9)


def test_the_same_waveform_again_gains_nothing():
    kept = kept_costs_V(ConstantWaveform(np.full(7, 0.3)), 5, 4, SEED)
    assert (np.diff(kept, axis=1) <= 0).all()  # nothing but nothing itself may be given up for it
    costs = heads_on_the_bench(5, SEED).evaluate(np.tile(np.float32(0.3).astype(float), (5, 7)))
    for row, cost in zip(kept, costs, strict=True):
        assert set(np.round(row, 9)) <= {0.0, round(cost, 9)}


def test_one_waveform_for_all_is_better_on_new_heads_than_any_guess():
    point, spent = few_shot_tuners.one_for_all(0, heads=20, waveforms=600)
    assert spent == 20 * 600
    heads = heads_on_the_bench(40, SEED)
    guesses = np.random.default_rng(0).uniform(-1, 1, (50, 7))
    means = [heads.evaluate(np.tile(guess, (40, 1))).mean() for guess in guesses]
    assert heads.evaluate(np.tile(point, (40, 1))).mean() < min(means)


def test_a_list_begins_with_what_is_best_alone_and_goes_on_with_what_helps_most():
    labelled = drawn(12, 3).astype(float)
    points = np.random.default_rng(1).uniform(-1, 1, (12, 7))
    points[:, 0], points[:, 1] = 0.9, -0.9
    chosen, spent = best_list(labelled, points, 3, stretch=False)
    assert spent == 12 * 12
    costs = np.array([Heads(labelled.astype(np.float32)).evaluate(np.tile(point, (12, 1))) for point in points])
    numbers = [int(np.flatnonzero((points == point).all(axis=1))[0]) for point in chosen]
    left = np.minimum(costs, 0.0)
    assert numbers[0] == left.mean(axis=1).argmin()
    assert numbers[1] == np.minimum(left, left[numbers[0]]).mean(axis=1).argmin()


def test_a_list_is_stretched_to_the_resonance_that_rings():
    names = TuneWaveformVectorEnv(1).tuning.observation_names()
    points = np.array([[0.8, -0.8, -0.9, -0.2, -0.5, -0.3, -0.6], [0.7, -0.8, -0.9, -0.3, -0.5, -0.3, -0.6]])
    envs = TuneWaveformVectorEnv(5)
    observations, _ = envs.reset(seed=SEED)
    tuner = FixedSequence(points, names)
    first = tuner.fire(observations)
    assert (first == PULSE).all()
    observations, *_ = envs.step(first.astype(np.float32))
    second, third = tuner.fire(observations), tuner.fire(np.zeros_like(observations))  # it has read what it needs
    truly = np.zeros((5, 4))
    truly[:, 0] = envs.tuning.contexts[:, 0]
    np.testing.assert_allclose(second, stretched(points[[0] * 5], MIDDLE, truly), atol=0.01)
    np.testing.assert_allclose(third, stretched(points[[1] * 5], MIDDLE, truly), atol=0.01)
    plain = FixedSequence(points)
    plain.fire(observations)
    assert (plain.fire(observations) == points[1]).all()


def test_an_agent_is_kept_with_what_its_observations_are(tmp_path):
    policy = few_shot_tuners.trained_agent(2000, 4, seed=0)
    assert policy.made["evaluations"] == 2 * 64 * 16  # whole rollouts
    names = TuneWaveformVectorEnv(1, tries=4).tuning.observation_names()
    assert len(names) == TuneWaveformVectorEnv(1).single_observation_space.shape[0]
    policy.save(tmp_path / "agent.npz")
    again = Policy.load(tmp_path / "agent.npz", names)
    kept = [kept_costs_V(Agent(one), 3, 4, SEED) for one in (policy, again)]
    assert (kept[0] == kept[1]).all()
    with pytest.raises(ValueError, match="made for other observations"):
        Policy.load(tmp_path / "agent.npz")


def test_a_study_tells_everybody_on_the_same_heads_and_the_same_again(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(
        few_shot, "SCRATCH", {name: few_shot_tuners.SCRATCH[name] for name in ("random", "cma-es of 4")}
    )
    monkeypatch.setattr(few_shot_tuners, "LISTED", 1500)
    monkeypatch.setattr(repeated_training, "RESAMPLES", 100)
    few = functools.partial(few_shot_tuners.one_for_all, heads=8, waveforms=300)
    monkeypatch.setattr(few_shot_tuners, "one_for_all", few)
    monkeypatch.setattr(few_shot, "ModelBasedTuner", functools.partial(few_shot.ModelBasedTuner, budget=50))
    prior = functools.partial(few_shot.learnt_prior, sampled=50, evaluations=1500)
    monkeypatch.setattr(few_shot, "learnt_prior", prior)
    small = {"HEADS": 4, "HEADS_WITH_EFFECTS": 2, "EFFECTS": 2, "LABELLED": 3000, "CANDIDATES": 2}
    for name, value in small.items():
        monkeypatch.setattr(recurrent_training, name, value)
    monkeypatch.setattr(benches, "EFFECTS", 3)
    # three heads must not stay in the cache for later tests
    monkeypatch.setattr(benches, "_heads_with_effects", functools.cache(benches._heads_with_effects.__wrapped__))
    monkeypatch.setattr(benches, "BUDGET", 60)
    monkeypatch.setattr(few_shot, "OF_A_GRADIENT", 1)
    arguments = ["--folder", str(tmp_path), "--evaluations", "2560", "--heads", "4", "--labelling", "2"]
    arguments += ["--trainings", "2", "--workers", "1"]
    few_shot.main(arguments)
    text = (tmp_path / "few_tries.json").read_bytes()
    monkeypatch.setattr(few_shot, "trained_agent", lambda *_: pytest.fail("trained again"))
    monkeypatch.setattr(benches, "kept_costs_V", lambda *_: pytest.fail("tried again"))
    few_shot.main(arguments)
    assert (tmp_path / "few_tries.json").read_bytes() == text
    found = json.loads(text)
    learning = {row["name"]: row["learning"] for row in found["rows"]}
    assert learning["random"] == learning["cma-es of 4"] == learning["tune"] == 0
    assert learning["one for all"] == learning["cma-es from one for all"] > 0
    assert learning["list"] == learning["list, stretched"] >= 1500
    assert learning["learnt prior"] >= 1500 + 9 * 50
    assert len({*next(row for row in found["rows"] if row["name"] == "list")["after"]["10"]["each"]}) == 2
    assert learning["sb3-ppo"] == 2560
    assert learning["recurrent policy"] > 3000
    for row in found["rows"]:
        medians = [row["after"][count]["value"] for count in ("1", "3", "10")]
        nothing_V = found["nothing_V"]["as expected"]
        assert 0 <= min(medians) <= max(medians) < nothing_V + 0.5  # as far as errors of reading mislead
        assert set(row["elsewhere"]) == {"noise × 3", "heads beyond", "effects"}
        assert row["after"] != row["elsewhere"]["heads beyond"]["after"]
        assert (
            len(row["after"]["10"]["each"])
            == row["trainings"]
            == (1 if row["name"] in (*few_shot.SCRATCH, "tune") else 2)
        )
        assert ("behind" in row) == (row["name"] != "list, stretched")
        assert row["after"]["10"]["low"] <= medians[2] <= row["after"]["10"]["high"]
    assert "unseen heads" in capsys.readouterr().out
    (tmp_path / "sb3-ppo-1-tested.npz").unlink()
    (tmp_path / "sb3-ppo-1.npz").write_bytes(b"no policy")
    with pytest.raises(SystemExit) as ended:
        few_shot.main(arguments)
    assert ended.value.code == 2
    assert "sb3-ppo-1.npz: is not a policy" in capsys.readouterr().err

"""Heads to learn on and ways of learning: the ledger, the chain rule, and that something is learnt."""

import tempfile

import numpy as np
import pytest

from inkjet_env.experiments.learning import learners
from inkjet_env.experiments.learning.heads import (
    TEST_SEED,
    TRAIN_SEED,
    Heads,
    OneHead,
    descended,
    drawn,
    stretched,
    the_task,
)
from inkjet_env.printhead import Waveform


def test_heads_side_by_side_cost_what_each_costs_alone():
    heads = Heads(drawn(6, 1))
    points = np.random.default_rng(0).uniform(-1, 1, (6, 7))
    costs, gradients = heads.evaluate_with_gradient(points)
    for k in range(6):
        head = the_task().head(heads.observations[k])
        waveform = Waveform.from_array(the_task().bounds.from_unit(points[k]))
        assert costs[k] == pytest.approx(head.respond(waveform).cost(), abs=1e-8)
        alone = heads.one(k).evaluate_with_gradient(points[k : k + 1])
        assert (alone[0][0], *alone[1][0]) == pytest.approx((costs[k], *gradients[k]), abs=1e-9)


def test_a_waveform_stretched_to_the_period_gets_the_same_peaks_times_its_ratio():
    heads = np.array([[0.0, -1.0, 0.0, 0.5], [0.4, -1.0, 0.0, 0.5]])
    waveform = Waveform(60, -60, 2e-6, 6e-6, 3e-6, 8e-6, 4e-6)
    point = the_task().bounds.to_unit(waveform.to_array())[None, :]
    there = the_task().bounds.from_unit(stretched(point, heads[:1], heads[1:]))[0]
    frequencies = the_task().head_values(heads)[:, 0]
    np.testing.assert_allclose(there[2:], waveform.to_array()[2:] * frequencies[0] / frequencies[1], rtol=1e-9)
    fired = (waveform, Waveform.from_array(there))
    peaks = [the_task().head(head).respond(one).peaks_V for head, one in zip(heads, fired, strict=True)]
    np.testing.assert_allclose(peaks[0][:8], peaks[1][:8] * frequencies[1] / frequencies[0], rtol=1e-6)


def test_stretching_stays_in_the_box():
    slow, fast = np.array([[-1.0, 0, 0, 0]]), np.array([[1.0, 0, 0, 0]])
    assert stretched(np.ones((1, 7)), fast, slow).max() == 1.0
    assert stretched(-np.ones((1, 7)), slow, fast).min() >= -1.0


def test_a_table_gives_the_nearest_heads_waveform_and_costs_what_its_descents_did():
    table = learners.table_of(3000, seed=2)
    assert 3000 <= table.made["evaluations"] < 3000 + 8 * 400
    assert len(table.points) == table.made["heads"] > 1
    np.testing.assert_allclose(table.act(table.observations), table.points, atol=1e-9)
    assert (np.abs(table.act(table.observations + 0.01) - table.points) < 0.05).all()
    assert learners.one_waveform(0).made["heads"] == 1


def test_heads_to_train_on_and_to_test_on_are_different():
    train, test = drawn(200, TRAIN_SEED), drawn(100, TEST_SEED)
    assert len({tuple(row) for row in (*train, *test)}) == 300
    assert (drawn(3, 7) == drawn(5, 7)[:3]).all()


def test_a_policy_that_is_trained_on_gradients_does_better_than_an_untrained_one():
    heads = Heads(drawn(60, TEST_SEED))
    costs = {}
    for evaluations in (256, 256 * 60):
        policy = learners.by_gradient(evaluations, seed=1)
        assert policy.made["evaluations"] == evaluations
        costs[evaluations] = heads.evaluate(policy.act(heads.observations)).mean()
    assert costs[256 * 60] < costs[256] - 3


def test_imitation_spends_no_more_than_it_says_and_repeats_what_it_saw():
    policy = learners.by_imitation(3000, seed=2)
    spent = policy.made["evaluations"]
    assert policy.made == {"by": "imitation", "evaluations": spent, "heads": policy.made["heads"], "seed": 2}
    assert 3000 <= spent < 3000 + 8 * 400
    first = drawn(1, TRAIN_SEED + 200_000)
    point, _, _ = descended(OneHead(first), learners.LABELLING_STARTS, 2)
    assert np.abs(policy.act(first)[0] - point).max() < 0.3


@pytest.mark.parametrize("name", ["sb3-ppo", "sb3-sac"])
def test_an_agent_is_charged_for_every_evaluation_and_leaves_nothing_behind(name, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    policy = learners.LEARNERS[name](1000, seed=3)
    assert policy.made == {"by": name, "evaluations": policy.made["evaluations"], "seed": 3}
    assert 1000 <= policy.made["evaluations"] < 1000 + 512
    assert policy.act(drawn(5, TEST_SEED)).shape == (5, 7)
    assert not list(tmp_path.iterdir())

"""The recurrent policy: what it reads, that it acts as it was trained, its file, and what its training follows."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.stats import spearmanr

from inkjet_env.envs.tune_waveform import TuneWaveformVectorEnv
from inkjet_env.experiments.learning import few_shot_tuners, recurrent_training
from inkjet_env.experiments.learning.few_shot_tuners import MIDDLE, kept_costs_V, lists
from inkjet_env.experiments.learning.heads import heads_with_effects, stretched
from inkjet_env.experiments.learning.policies import PolicyFileError
from inkjet_env.experiments.learning.recurrent_policy import (
    SHIPPED,
    RecurrentPolicy,
    RecurrentTuner,
    features,
    shapes,
    terms,
)
from inkjet_env.experiments.learning.recurrent_training import (
    Network,
    TrainingBench,
    loss_of_an_episode,
    most_telling,
    trained_recurrent_policy,
)
from inkjet_env.storage import archive_bytes

LISTED = np.random.default_rng(0).uniform(-0.8, 0.8, (5, 7))
FIRST = np.array([0.9, -0.8, -0.5, 0.1, 0.3, 0.2, 0.6])


def a_network():
    torch.manual_seed(0)
    network = Network(LISTED, FIRST)
    with torch.no_grad():
        network.corrections[:, 1:] = 0.1 * torch.randn(network.corrections[:, 1:].shape)
    return network


def read_observations(count=4, tries=3):
    """Observations of an episode with random waveforms, one array for each try."""
    envs = TuneWaveformVectorEnv(count, tries=10)
    shown = [envs.reset(seed=3)[0]]
    for k in range(tries):
        shown.append(envs.step(np.random.default_rng(k).uniform(-1, 1, (count, 7)).astype(np.float32))[0])
    return shown


def test_a_policy_acts_as_the_network_that_was_trained():
    network = a_network()
    policy = network.policy({})
    state, of_network, stepped = None, None, set()
    for k, observations in enumerate(read_observations()):
        actions, state = policy.act(observations, state)
        with torch.no_grad():
            estimates, scores, of_network = network(observations, of_network)
            chosen = scores.argmax(1, keepdim=True)
            points = network.points(observations, estimates, of_network, chosen)[:, 0].clamp(-1, 1)
        stepped |= set((chosen >= len(LISTED)).flatten().tolist())
        np.testing.assert_allclose(state, of_network, atol=1e-12)
        np.testing.assert_allclose(actions, points if k else np.tile(FIRST, (4, 1)), atol=1e-12)
    assert stepped == {False, True}


def test_points_are_stretched_to_the_period():
    network = a_network()
    estimates = torch.tensor([[0.3, 0.0, 0.0, 0.0], [-1.2, 0.0, 0.0, 0.0]], dtype=torch.float64)
    state = torch.zeros(2, recurrent_training.UNITS, dtype=torch.float64)
    with torch.no_grad():
        network.corrections[:, 1:] = 0
        found = network.points(np.zeros((2, 32)), estimates, state, torch.tensor([[0, 2], [1, 4]])).clamp(-1, 1).numpy()
    for row, numbers in enumerate([[0, 2], [1, 4]]):
        wanted = stretched(LISTED[numbers], MIDDLE, np.tile(estimates[row].numpy(), (2, 1)))
        np.testing.assert_allclose(found[row], wanted, atol=1e-12)


def test_features_tell_free_ringing_and_have_no_peaks_where_there_are_none():
    observations = np.zeros((2, 32))
    observations[0, 16:24] = 0.8 * np.array([1, -0.5, 0.25, -0.125, 0, 0, 0, 0])
    observations[0, 24:28] = np.array([12, 21, 30, 39]) / 100
    found = features(observations)
    assert found.shape[1] == 16 + 6 * 8 - 2
    np.testing.assert_allclose(found[0, 40:47], [-0.1, -0.1, -0.1, 0, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(found[0, 55:62], [np.log(0.5)] * 3 + [0] * 4, atol=1e-12)
    assert not found[1].any()
    with pytest.raises(ValueError, match=r"observations of 8 peaks; got shape \(1, 20\)"):
        features(np.zeros(20))


def test_steps_lead_from_the_waveform_that_is_kept():
    network = a_network()
    observations = read_observations()[-1].astype(float)
    policy = network.policy({})
    policy.arrays["score_bias"][len(LISTED) + 3] = 100.0
    actions, state = policy.act(observations)
    steps = state @ policy.arrays["steps"][21:28].T + policy.arrays["steps_bias"][21:28]
    assert np.abs(steps).max() > 0.05
    np.testing.assert_allclose(actions, np.clip(observations[:, 9:16] + steps, -1, 1), atol=1e-12)


def test_terms_are_all_of_third_degree():
    (found,) = terms(np.array([[2.0, 3.0, 5.0, 7.0]]))
    powers = itertools.product(range(4), repeat=4)
    assert sorted(found) == sorted(np.prod([2.0, 3.0, 5.0, 7.0] ** np.array(n)) for n in powers if sum(n) <= 3)


def test_the_first_waveform_tells_more_than_others():
    listed = np.random.default_rng(2).uniform(-1, 1, (30, 7))
    first, spent = most_telling(listed, 0)
    assert spent == 30 * recurrent_training.HEADS_OF_THE_FIRST
    envs = TuneWaveformVectorEnv(1000, tries=2)

    def told(waveform):
        """Largest rank correlation of a number that is read with each parameter of other heads, averaged."""
        envs.reset(seed=5)
        read = features(envs.step(np.tile(waveform, (1000, 1)).astype(np.float32))[0])[:, 16:]
        found = spearmanr(read[:, read.std(axis=0) > 0], envs.tuning.contexts).statistic
        return np.abs(found[:-4, -4:]).max(axis=0).mean()

    assert told(first) > np.quantile([told(one) for one in listed], 0.6)


def test_the_loss_has_the_gradient_of_the_expected_cost(monkeypatch):
    monkeypatch.setattr(recurrent_training, "JITTER", 0.0)
    monkeypatch.setattr(recurrent_training, "CANDIDATES", 5 + recurrent_training.STEPS)
    monkeypatch.setattr(recurrent_training, "LEARNING_OF_THE_ESTIMATE", 0.0)
    monkeypatch.setattr(recurrent_training, "PLAIN", 1.0)
    monkeypatch.setattr(recurrent_training, "STEEPEST_V", 1e9)
    network, bench = a_network(), TrainingBench(6, 2, noise_V=0.0)
    every = len(LISTED) + recurrent_training.STEPS
    loss, spent = loss_of_an_episode(network, bench, 2, 1, torch.Generator().manual_seed(0))
    loss.backward()
    assert spent == 6 * (2 + every)

    def expected():
        """Mean over the heads of the expected cost of the second waveform: the first is always the same."""
        observations = bench.reset(1)
        state = network(observations, None)[2]
        observations = bench.envs.step(np.tile(FIRST, (6, 1)).astype(np.float32))[0].astype(float)
        with torch.no_grad():
            estimates, scores, state = network(observations, state)
            points = network.points(observations, estimates, state, torch.arange(every).expand(6, every))
            return float((torch.softmax(scores, 1).numpy() * bench.evaluate(points.numpy())[0]).sum(1).mean())

    for parameter, at in (
        (network.score.bias, (2,)),
        (network.corrections, (3, 0, 1)),
        (network.estimate.bias, (0,)),
        (network.steps.bias, (9,)),
    ):
        ends = []
        for step in (1e-6, -1e-6):
            with torch.no_grad():
                parameter[at] += step
            ends.append(expected())
            with torch.no_grad():
                parameter[at] -= step
        assert float(parameter.grad[at]) == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-3, abs=1e-6)


def test_heads_with_effects_cost_what_the_environment_says():
    effects = heads_with_effects(4, 0)
    assert len({one.effects[0][0].id for one in effects[0].heads}) == 4
    bench = TrainingBench(8, 2, effects=effects)
    bench.reset(5)
    points = np.random.default_rng(1).uniform(-1, 1, (8, 2, 7)).astype(np.float32)
    *_, infos = bench.envs.step(points[:, 1])
    costs_V, gradients = bench.evaluate(points.astype(float))
    np.testing.assert_allclose(costs_V[:, 1], infos["cost"], rtol=1e-9)
    assert bench.parameters.shape == (8, 4)
    assert not gradients.any()


def test_training_repeats_itself_and_is_counted(monkeypatch, tmp_path, capsys):
    small = {"HEADS": 4, "HEADS_WITH_EFFECTS": 2, "EFFECTS": 2, "LABELLED": 4000, "CANDIDATES": 2}
    for name, value in small.items():
        monkeypatch.setattr(recurrent_training, name, value)
    asked = ["--evaluations", "600", "--tries", "3", "--seed", "4"]
    recurrent_training.main(["--out", str(tmp_path / "a.npz"), *asked])
    assert "a policy of" in capsys.readouterr().out
    found, again = RecurrentPolicy.load(tmp_path / "a.npz"), trained_recurrent_policy(600, 3, 4)
    assert found.made == again.made
    assert found.made["evaluations"] > 4600
    for name, value in again.arrays.items():
        assert (found.arrays[name] == value.astype(np.float32)).all()


@pytest.mark.parametrize("better", [0, 1])
def test_the_better_policy_is_kept_and_all_evaluations_are_counted(monkeypatch, better):
    asked = []

    def one_policy(evaluations, tries, seed):
        asked.append((evaluations, tries, seed))
        one = RecurrentPolicy.load() if len(asked) - 1 == better else a_network().policy({})
        return replace(one, made={"evaluations": 10 ** len(asked)})

    monkeypatch.setattr(recurrent_training, "_one_policy", one_policy)
    found = trained_recurrent_policy(5000, 4, 30)
    assert asked == [(2500, 4, 30), (2500, 4, 31)]
    np.testing.assert_array_equal(found.arrays["first"], RecurrentPolicy.load().arrays["first"])
    assert found.made == {"by": "recurrent", "evaluations": 110 + 2 * 500 * 4, "tries": 4, "seed": 30}


def test_the_policy_of_the_package_is_better_on_new_heads_than_a_stretched_list(monkeypatch):
    monkeypatch.setattr(few_shot_tuners, "LISTED", 30_000)
    assert SHIPPED.stat().st_size < 2e6
    listed = lists(10, 0)[0]["list, stretched"]
    kept_V = {name: kept_costs_V(one, 60, 10, 99) for name, one in (("own", RecurrentTuner()), ("list", listed))}
    gains_V = kept_V["list"] - kept_V["own"]
    assert np.median(gains_V[:, 2]) > 0.8
    assert gains_V[:, 2].mean() > 0.8
    assert gains_V[:, 9].mean() > 0.3


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"header": np.array("{}")}, "its format is None"),
        ({"score": np.zeros((8, 127))}, "must have the shapes"),
        ({"estimate_bias": np.full(4, np.nan)}, "must be finite"),
        ({"encoder": np.array([{}], dtype=object)}, "pickled objects, which are never loaded"),
        ({"score_bias": None}, "'score_bias"),
    ],
)
def test_what_is_no_policy_is_refused(tmp_path, change, said):
    with np.load(SHIPPED) as archive:
        arrays = {name: archive[name] for name in archive.files} | change
    assert set(arrays) == {*shapes(1, 1, 1), "header"}
    if change.get("encoder") is not None:
        np.savez(tmp_path / "p.npz", **arrays)
    else:
        kept = {name: value for name, value in arrays.items() if value is not None}
        (tmp_path / "p.npz").write_bytes(archive_bytes(kept))
    with pytest.raises(PolicyFileError, match=r"p\.npz: is not a policy.*RecurrentPolicy\.save wrote") as refused:
        RecurrentPolicy.load(tmp_path / "p.npz")
    assert said in str(refused.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(PolicyFileError, match="there is no such file"):
        RecurrentPolicy.load(tmp_path / "none.npz")


def test_its_header_says_how_it_was_made():
    made = RecurrentPolicy.load().made
    assert json.loads(json.dumps(dict(made))) == made
    assert made["by"] == "recurrent"

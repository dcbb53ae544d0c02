"""Trainings are kept, reused, refused if made with other settings or code, and the same in parallel."""

import errno
import json

import numpy as np
import pytest

from inkjet_env.envs.tune_waveform import TuneWaveformVectorEnv
from inkjet_env.envs.vector import BipolarWaveformVectorEnv
from inkjet_env.experiments.execution.jobs import ClusterError
from inkjet_env.experiments.learning import repeated_training
from inkjet_env.experiments.learning.benches import heads_on_the_bench
from inkjet_env.experiments.learning.heads import TEST_SEED, TRAIN_SEED, drawn
from inkjet_env.experiments.learning.repeated_training import KeptFileError, each, kept_arrays, kept_policy, over, seeds
from tests.learning.test_policies import a_policy


def never(*_):
    pytest.fail("made again")


def test_trainings_learn_from_different_heads_and_none_is_tested_on():
    """Ten trainings of each kind, by the generators that they draw with; heads side by side have seeds in a row."""
    learnt = []
    for seed in seeds(0, repeated_training.TRAININGS):
        learnt.append(np.concatenate([drawn(1, TRAIN_SEED + seed * 100_000 + k) for k in range(190)]))  # labelled
        learnt.append(drawn(256, TRAIN_SEED + seed * 100_000 + 190))  # by the gradient, beyond the first steps
        learnt.append(BipolarWaveformVectorEnv(512, context="random").reset(seed=seed)[0])
        bench = TuneWaveformVectorEnv(64)
        bench.reset(seed=seed)
        learnt.append(bench.tuning.contexts)
    tested = [drawn(100, TEST_SEED), heads_on_the_bench(200, TEST_SEED).observations]
    heads = [tuple(row) for some in learnt for row in np.asarray(some, dtype=np.float32)]
    of_tests = {tuple(row) for some in tested for row in some}
    assert not of_tests & set(heads)
    # both environments draw a head first, so the bench has the first 64 of the other's, which another agent learns from
    assert len(set(heads)) >= len(heads) - 64 * repeated_training.TRAININGS


def test_arrays_are_kept_and_made_once(tmp_path):
    made = {"regret": np.arange(3.0), "spent": np.array(7)}
    for make in (lambda: made, never):
        found = kept_arrays(tmp_path / "one.npz", {"seed": 1}, make)
        assert found.keys() == made.keys()
        assert all((found[name] == made[name]).all() for name in made)


def test_what_other_code_or_settings_made_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "one.npz"
    kept_arrays(path, {"seed": 1}, lambda: {"regret": np.zeros(2)})
    with pytest.raises(
        KeptFileError, match=r"one\.npz was made with other .*: seed is 1 there and 2 here\. Give another"
    ):
        kept_arrays(path, {"seed": 2}, never)
    other = tmp_path / "array.npz"
    np.save(other.open("wb"), np.zeros(3))
    with pytest.raises(KeptFileError, match=r"array\.npz: is damaged"):
        kept_arrays(other, {}, never)
    monkeypatch.setattr(repeated_training, "circumstances", lambda: {"code": "other"})
    with pytest.raises(KeptFileError, match=r"code is .* there and other here"):
        kept_arrays(path, {"seed": 1}, never)


@pytest.mark.parametrize("damage", [b"", b"nothing of the kind", "cut", "pickled", "unlabelled"])
def test_a_damaged_file_is_named_and_not_replaced(tmp_path, damage):
    path = tmp_path / "one.npz"
    kept_arrays(path, {}, lambda: {"regret": np.zeros(100)})
    whole = path.read_bytes()
    if damage == "pickled":
        np.savez(path, asked=np.array([{}], dtype=object))
    elif damage == "unlabelled":
        np.savez(path, regret=np.zeros(3))
    else:
        path.write_bytes(whole[: len(whole) // 2] if damage == "cut" else damage)
    left = path.read_bytes()
    with pytest.raises(KeptFileError, match=r"one\.npz: is damaged \(.+\)\. Delete it to make it again\."):
        kept_arrays(path, {}, never)
    assert path.read_bytes() == left


def test_a_file_that_cannot_be_read_now_is_not_called_damaged(tmp_path, monkeypatch):
    path = tmp_path / "one.npz"
    kept_arrays(path, {}, lambda: {"regret": np.zeros(2)})

    def full(*_, **__):
        raise OSError(errno.EMFILE, "Too many open files", str(path))

    monkeypatch.setattr(np, "load", full)
    with pytest.raises(OSError, match="Too many open files"):
        kept_arrays(path, {}, never)


def test_a_policy_is_kept_with_what_it_was_trained_with(tmp_path):
    path = tmp_path / "policy.npz"
    policy = a_policy()
    first = kept_policy(path, {"seed": 1}, lambda: policy)
    again = kept_policy(path, {"seed": 1}, never)
    assert first.made == again.made == {**policy.made, "asked": {"seed": 1, **repeated_training.circumstances()}}
    with pytest.raises(KeptFileError, match="seed is 1 there and 2 here"):
        kept_policy(path, {"seed": 2}, never)


def test_jobs_side_by_side_return_what_they_return_one_after_another():
    jobs = {f"{k}": (k, 3) for k in range(5)}
    assert each("seeds", seeds, jobs, 2) == each("seeds", seeds, jobs, 1) == {f"{k}": seeds(k, 3) for k in range(5)}


def test_a_table_says_whether_another_training_is_in_its_intervals():
    assert "over heads alone" in over(5, 1)
    assert "too narrow" in over(5, repeated_training.FEW - 1)
    assert over(5, repeated_training.FEW).endswith(
        "6 trainings of each learning method, with a 95 % interval over both"
    )


def test_a_difference_on_the_same_heads_is_told_finer_than_two_medians():
    rng = np.random.default_rng(0)
    heads_V = 3 * rng.standard_normal(80)
    mine, theirs = heads_V + 1 + 0.1 * rng.standard_normal((8, 80)), heads_V + 0.1 * rng.standard_normal((3, 80))
    apart = repeated_training.median_difference(mine, theirs, rng)
    single = repeated_training.median_of(mine, rng)
    assert apart["low"] < 1 < apart["high"]
    assert apart["high"] - apart["low"] < 0.3 * (single["high"] - single["low"])


def test_a_file_is_no_folder(tmp_path, capsys):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(SystemExit) as ended:
        repeated_training.run_command(
            "study", tmp_path, "", 1, 2, never, never, never, ["--folder", str(tmp_path / "file")]
        )
    assert ended.value.code == 2
    assert "--folder must be a folder" in capsys.readouterr().err


def test_a_cluster_that_cannot_do_the_work_is_told_in_a_sentence(tmp_path, capsys):
    def run(**_):
        raise ClusterError("one was begun 5 times and never ended.")

    with pytest.raises(SystemExit) as ended:
        repeated_training.run_command("study", tmp_path, "", 1, 2, run, never, never, ["--folder", str(tmp_path)])
    assert ended.value.code == 2
    assert "study: one was begun 5 times" in capsys.readouterr().err


def test_circumstances_are_plain_json():
    assert json.loads(json.dumps(repeated_training.circumstances())) == repeated_training.circumstances()


@pytest.mark.parametrize(("option", "value"), [("--heads", "1"), ("--trainings", "0"), ("--workers", "0")])
def test_too_little_is_refused(option, value, tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        repeated_training.run_command(
            "study", tmp_path, "", 1, 2, never, never, never, ["--folder", str(tmp_path), option, value]
        )
    assert ended.value.code == 2
    assert f"{option} must be at least {int(value) + 1}; got {value}." in capsys.readouterr().err

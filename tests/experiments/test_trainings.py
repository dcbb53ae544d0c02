"""Trainings are told apart, kept, refused where they were made otherwise, and the same side by side."""

import json

import numpy as np
import pytest

from experiments import trainings
from experiments.trainings import KeptFileError, each, kept_arrays, kept_policy, over, seeds
from tests.experiments.test_policies import a_policy


def never(*_):
    pytest.fail("made again")


def test_trainings_share_no_seed_of_a_head():
    first, second = seeds(3, 2)
    assert first == 3
    assert second - first == trainings.SEED_STEP


def test_arrays_are_kept_and_made_once(tmp_path):
    made = {"regret": np.arange(3.0), "spent": np.array(7)}
    for make in (lambda: made, never):
        found = kept_arrays(tmp_path / "one.npz", {"seed": 1}, make)
        assert found.keys() == made.keys()
        assert all((found[name] == made[name]).all() for name in made)


def test_what_other_code_or_settings_made_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "one.npz"
    kept_arrays(path, {"seed": 1}, lambda: {"regret": np.zeros(2)})
    with pytest.raises(KeptFileError, match=r"one\.npz was made otherwise: seed is 1 there and 2 here\. Give another"):
        kept_arrays(path, {"seed": 2}, never)
    monkeypatch.setattr(trainings, "circumstances", lambda: {"code": "other"})
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
    with pytest.raises(KeptFileError, match=r"one\.npz: is damaged \(.+\)\. Delete it to have it made again\."):
        kept_arrays(path, {}, never)
    assert path.read_bytes() == left


def test_a_policy_is_kept_with_what_it_was_trained_with(tmp_path):
    path = tmp_path / "policy.npz"
    policy = a_policy()
    first = kept_policy(path, {"seed": 1}, lambda: policy)
    again = kept_policy(path, {"seed": 1}, never)
    assert first.made == again.made == {**policy.made, "asked": {"seed": 1, **trainings.circumstances()}}
    with pytest.raises(KeptFileError, match="seed is 1 there and 2 here"):
        kept_policy(path, {"seed": 2}, never)


def test_jobs_side_by_side_return_what_they_return_one_after_another():
    jobs = {f"{k}": (k, 3) for k in range(5)}
    assert each("seeds", seeds, jobs, 2) == each("seeds", seeds, jobs, 1) == {f"{k}": seeds(k, 3) for k in range(5)}


def test_a_table_says_whether_another_training_is_in_its_intervals():
    assert "over heads alone" in over(5, 1)
    assert "over 10 trainings" in over(5, 10)


def test_circumstances_are_plain_json():
    assert json.loads(json.dumps(trainings.circumstances())) == trainings.circumstances()


@pytest.mark.parametrize(("option", "value"), [("--heads", "1"), ("--trainings", "0"), ("--workers", "0")])
def test_too_little_is_refused(option, value, tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        trainings.run_command("study", "", 1, 2, never, never, ["--folder", str(tmp_path), option, value])
    assert ended.value.code == 2
    assert f"{option} must be at least {int(value) + 1}; got {value}." in capsys.readouterr().err

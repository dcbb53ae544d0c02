"""The cases of the study of the diagnosis on its own plant."""

import json

import numpy as np
import pytest

from inkjet_env.experiments.validation import diagnosis_study
from inkjet_env.experiments.validation.diagnosis_study import STRENGTHS, Case, cases, head_of, recorded
from inkjet_env.experiments.validation.synthetic_campaigns import largest_signal_V, synthetic_values
from inkjet_env.identification import UnidentifiableError
from inkjet_env.plant import catalogue


@pytest.mark.parametrize(("part", "count"), [("null", 100), ("single", 64), ("pairs", 20), ("withheld", 32)])
def test_every_part_has_its_cases_each_of_its_own_name(part, count):
    names = [case.name for case in cases(part, 1)]
    assert len(names) == len(set(names)) == count


def test_pairs_are_of_different_stages():
    from inkjet_env.experiments.validation.synthetic_campaigns import effect_named

    for case in cases("pairs", 1):
        assert len({effect_named(name).stage for name in case.effects}) == 2


def test_nothing_is_planted_where_nothing_is_to_be():
    campaign, planted = recorded(Case("null", (), "none", 0))
    assert planted == []
    assert len(campaign.recordings) == 29


def test_what_is_planted_changes_the_recordings():
    campaign, planted = recorded(Case("single", ("feedthrough",), "medium", 0))
    plain, _ = recorded(Case("null", (), "none", 0))
    assert [effect.id for effect, _ in planted] == ["feedthrough"]
    fast = [i for i, r in enumerate(plain.recordings) if r.channel == "self_sensing" and r.excitation != "zero"]
    assert all((campaign.recordings[i].sensor != plain.recordings[i].sensor).any() for i in fast)


@pytest.mark.parametrize("effect", catalogue(), ids=lambda effect: effect.id)
def test_medium_is_not_strong(effect):
    head = head_of(0)
    strong, medium = (synthetic_values(effect, s, head, largest_signal_V(head)) for s in STRENGTHS.values())
    assert {name for name in strong if strong[name] != medium[name]} <= set(effect.strengths)
    assert strong != medium


def test_a_medium_saturation_changes_the_recordings_about_a_third_as_much_as_a_strong_one():
    plain, _ = recorded(Case("null", (), "none", 0))
    loudest = int(np.argmax([np.std(r.sensor) if r.channel == "self_sensing" else 0.0 for r in plain.recordings]))
    changes, limits = [], []
    for strength in STRENGTHS:
        campaign, ((_, values),) = recorded(Case("single", ("sensor_saturation",), strength, 0))
        changes.append(np.std(campaign.recordings[loudest].sensor - plain.recordings[loudest].sensor))
        limits.append(values["limit"])
    strong, medium = changes
    assert strong > 0.05 * np.std(plain.recordings[loudest].sensor)
    assert 0.2 < medium / strong < 0.5
    assert limits[0] == 0.75 * largest_signal_V(head_of(0))
    assert limits[0] < limits[1] < 2 * limits[0]


@pytest.fixture
def short_study(tmp_path, monkeypatch):
    """A study of two cases that take no time, in a file of its own; what was diagnosed, when."""
    file = tmp_path / "cases.jsonl"
    monkeypatch.setattr(diagnosis_study, "RESULTS", file)
    monkeypatch.setattr(
        diagnosis_study, "cases", lambda part, seeds: [Case(part, (), "none", seed) for seed in range(seeds)]
    )
    result = {"verdict": "none", "found": [], "closure": None, "located": False, "seconds": 1.0}
    monkeypatch.setattr(
        diagnosis_study,
        "outcome",
        lambda case: {"part": case.part, "effects": [], "strength": "none", "name": case.name} | result,
    )
    return file


def test_a_stopped_study_goes_on_with_what_is_missing(short_study):
    diagnosis_study.run(["null"], 1, 1)
    first = short_study.read_text()
    diagnosis_study.run(["null"], 2, 1)
    assert short_study.read_text().startswith(first)
    assert [row["name"] for row in diagnosis_study.rows()] == ["null nothing none 0", "null nothing none 1"]


def test_the_summary_of_campaigns_without_an_effect_counts_their_p_values(short_study, capsys):
    row = {"part": "noise", "effects": [], "strength": "white", "verdict": "none", "found": [], "seconds": 1.0}
    p_values = [0.005, 0.05, 0.15, 0.95]
    lines = [json.dumps(row | {"name": f"{p}", "seed": 0, "headline": "", "p_value": p}) for p in p_values]
    lines.append(json.dumps(row | {"name": "other", "seed": 1, "verdict": "refused", "headline": "nothing rings"}))
    short_study.write_text("\n".join(lines))
    diagnosis_study.summary()
    said = "p-values below 0.01: 25.0%; in tenths from 0 to 1: [2, 1, 0, 0, 0, 0, 0, 0, 0, 1]"
    assert said in capsys.readouterr().out


def failing(error):
    """In place of `outcome`: the case of seed 1 fails."""
    done = diagnosis_study.outcome

    def fails(case):
        if case.seed == 1:
            raise error
        return done(case)

    return fails


def test_a_campaign_without_an_identifiable_head_is_refused_and_the_study_goes_on(short_study, monkeypatch):
    monkeypatch.setattr(diagnosis_study, "outcome", failing(UnidentifiableError("nothing in them rings.")))
    diagnosis_study.run(["null"], 3, 1)
    assert [row["verdict"] for row in diagnosis_study.rows()] == ["none", "refused", "none"]
    assert diagnosis_study.rows()[1]["headline"] == "nothing in them rings."


@pytest.mark.parametrize("error", [ValueError("a fault"), np.linalg.LinAlgError("a fault"), KeyError("a fault")])
def test_any_other_error_is_no_refusal_and_stops_the_study(short_study, monkeypatch, error):
    monkeypatch.setattr(diagnosis_study, "outcome", failing(error))
    with pytest.raises(type(error), match="a fault"):
        diagnosis_study.run(["null"], 3, 1)
    assert [row["verdict"] for row in diagnosis_study.rows()] == ["none"]


def test_results_of_other_code_or_packages_are_not_gone_on_with(short_study, monkeypatch, capsys):
    diagnosis_study.run(["null"], 1, 1)
    before = short_study.read_text()
    monkeypatch.setattr(diagnosis_study, "versions", lambda: {"numpy": "0.1"})
    with pytest.raises(SystemExit) as ended:
        diagnosis_study.main(["null", "--seeds", "2", "--workers", "1"])
    assert ended.value.code == 2
    verdict_record = capsys.readouterr().err
    assert "cases.jsonl holds results of other code or packages: versions numpy is" in verdict_record
    assert "and 0.1 here. Delete or rename that file" in verdict_record
    assert short_study.read_text() == before
    diagnosis_study.main(["summary"])  # they are of one code, if not of this one
    assert "null: 1 campaigns" in capsys.readouterr().out


def test_results_of_unknown_code_are_not_gone_on_with(short_study):
    short_study.write_text('{"name": "null nothing none 0", "part": "null"}\n')
    with pytest.raises(diagnosis_study.OtherCodeError, match="code is unknown there"):
        diagnosis_study.run(["null"], 2, 1)


def test_results_of_different_code_in_one_file_are_not_summed_up(short_study, capsys):
    diagnosis_study.run(["null"], 2, 1)
    first, second = (json.loads(line) for line in short_study.read_text().splitlines())
    second["made"]["code"] = "another"
    short_study.write_text(f"{json.dumps(first)}\n{json.dumps(second)}\n")
    with pytest.raises(SystemExit) as ended:
        diagnosis_study.main(["summary"])
    assert ended.value.code == 2
    assert "none 0 and null nothing none 1: code is" in capsys.readouterr().err

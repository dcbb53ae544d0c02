"""Rounds after a proof: what is asked for is recorded, and the whole is diagnosed again."""

import zipfile
from io import BytesIO
from types import SimpleNamespace

import numpy as np
import pytest

from inkjet_env.experiments.execution.cluster import workers_of
from inkjet_env.experiments.execution.provenance import code_digest
from inkjet_env.experiments.proof import adaptive
from inkjet_env.experiments.proof.adaptive import MOST_REQUESTS, adapt, adapt_case, adaptive_score, gains
from inkjet_env.experiments.proof.campaign_files import ProofError
from inkjet_env.experiments.proof.concealment import conceal
from inkjet_env.experiments.proof.corpus import Draw
from inkjet_env.experiments.proof.printing import print_rounds
from inkjet_env.experiments.proof.report import page_html
from inkjet_env.experiments.proof.score import score
from inkjet_env.experiments.proof.sealing import JUDGE_SOURCES
from inkjet_env.storage import json_text, write_atomically

RIG = "experiments.concealed_rig"
DELAY = Draw(7, "effect", ("trigger_delay",), "strong", True, 3, "white")


def verdict(*candidates):
    """A verdict that names one, or leaves a set."""
    ids = list(candidates)
    return {
        "verdict": "named" if len(ids) == 1 else "set",
        "effects": [{"id": ids[0], "parameters": {}}],
        "candidates": [ids] if len(ids) > 1 else [],
        "fit": {"closure": None, "heldout": ["r002"]},
    }


def request(step_s, repeats=1, monitor=True):
    drive = np.zeros(400)
    drive[50:90] = 30.0
    return {
        "sentence": "Record a pulse.", "channel": "self_sensing", "initial_state": "periodic", "step_s": step_s,
        "repeats": repeats, "drive_monitor": monitor, "drive_V": drive.tolist(), "neighbour_V": None,
    }  # fmt: skip


def entry(name, said, requests=()):
    told = {"status": "diagnosed", "verdict": said, "requests": list(requests), "augmented": None, "base": None}
    run = {"seconds": 1.0, "cpu_seconds": 1.0, "seen": []}
    return {"format": "proof-answer/1", "name": name, "campaign": "digest", "answer": told, "run": run}


@pytest.fixture(scope="module")
def made():
    return conceal(DELAY, "head-0")


@pytest.fixture
def diagnoses(monkeypatch):
    """Campaigns that were diagnosed; the verdict after each is the next of a list, the last again and again."""
    seen, verdicts = [], []

    def stub(name, packed, digest, held_out):
        assert list(held_out) == ["r002"]
        with zipfile.ZipFile(BytesIO(packed)) as archive:
            seen.append([f for f in archive.namelist() if f.endswith(".csv")])
        said, requests = verdicts.pop(0) if len(verdicts) > 1 else verdicts[0]
        return entry(name, said, requests)

    monkeypatch.setattr(adaptive, "diagnose_blind", stub)
    return SimpleNamespace(seen=seen, verdicts=verdicts)


def adapted(made, first, way="designed"):
    case = {"draw": DELAY.as_json(), "attempt": made.attempt}
    return adapt_case("head-0", case, entry("head-0", *first)["answer"], None, way, RIG, code_digest(JUDGE_SOURCES))


def test_rounds_end_when_one_candidate_is_left(made, diagnoses, tmp_path):
    step_s = 5e-7
    undecided = (verdict("trigger_delay", "sensor_bandwidth"), [request(step_s, 2)])
    diagnoses.verdicts += [undecided, (verdict("trigger_delay"), [])]
    found = adapted(made, undecided)
    assert [one["requests"][0]["repeats"] for one in found["rounds"]] == [2, 2]
    assert "drive_V" not in found["rounds"][0]["requests"][0]
    assert [len(files) - 8 for files in diagnoses.seen] == [2, 4]  # what was recorded stays
    assert found["loop"] is None


def test_rounds_end_when_no_request_is_left(made, diagnoses):
    many = (verdict("trigger_delay", "sensor_bandwidth"), [request(5e-7), request(5e-7)])
    diagnoses.verdicts.append(many)
    found = adapted(made, many)
    assert [len(one["requests"]) for one in found["rounds"]] == [2, MOST_REQUESTS - 2]


def test_at_random_as_many_are_recorded_from_the_library(made, diagnoses, tmp_path):
    undecided = (verdict("trigger_delay", "sensor_bandwidth"), [request(5e-7, 3)])
    diagnoses.verdicts.append((verdict("trigger_delay"), []))
    (found,) = adapted(made, undecided, "random")["rounds"]
    assert len(found["requests"]) == 3
    assert len({one["drive"] for one in found["requests"]}) > 1
    again = adapted(made, undecided, "random")["rounds"][0]
    assert again["requests"] == found["requests"]


def test_a_worker_of_other_code_records_nothing(made):
    with pytest.raises(ProofError, match="the code was changed"):
        adapt_case("head-0", {}, {}, None, "designed", RIG, "other")


def case_of(name, said, requests=(), number=0, effects=("trigger_delay",)):
    draw = Draw(number, "effect", effects, "strong", False, 1).as_json()
    answer = entry(name, said, requests)["answer"]
    return {"name": name, "draw": draw, "attempt": 0, "truth": {}, "answer": answer, "judged": {"location": {}}}


def test_rounds_of_a_folder_are_kept_and_not_repeated(fakes, tmp_path):
    from fake_steps import adapt as fake_adapt

    cases = [
        case_of("head-a", verdict("trigger_delay", "sensor_bandwidth"), [request(1e-6)]),
        case_of("head-b", verdict("trigger_delay")),
    ]
    write_atomically(tmp_path / "proof.json", json_text({}))
    outcome = SimpleNamespace(cases=cases)
    with workers_of(None, 1) as client:
        found = adapt(tmp_path, outcome, client, fake_adapt)
        files = sorted(file.relative_to(tmp_path).as_posix() for file in tmp_path.glob("adaptive/*/*.json"))
        assert files == ["adaptive/designed/head-a.json", "adaptive/random/head-a.json"]
        stamps = [file.stat().st_mtime_ns for file in sorted(tmp_path.glob("adaptive/*/*.json"))]
        assert adapt(tmp_path, outcome, client, fake_adapt) == found
        assert [file.stat().st_mtime_ns for file in sorted(tmp_path.glob("adaptive/*/*.json"))] == stamps
    sets = {way: rows[0]["hits"] for way, rows in found["figures"]["lags"].items()}
    assert sets == {"before": 1, "designed": 0, "random": 1}  # as the fake answers


def test_answers_without_requests_are_refused(tmp_path):
    old = case_of("head-a", verdict("trigger_delay"))
    del old["answer"]["requests"]
    with pytest.raises(ProofError, match="an earlier version gave them"):
        adapt(tmp_path, SimpleNamespace(cases=[old]), None, None)


def test_the_figures_before_and_after():
    pair = verdict("trigger_delay", "sensor_bandwidth")
    cases = [case_of(f"head-{k}", pair, [request(1e-6)], k) for k in range(4)]
    rounds = [{"requests": [{"sentence": "", "repeats": 5}], "entry": entry("", verdict("trigger_delay"))}]
    wrong = [{"requests": [{"sentence": "", "repeats": 1}], "entry": entry("", verdict("creep"))}]
    done = {
        "designed/head-0": {"rounds": rounds, "loop": None},
        "designed/head-1": {"rounds": rounds, "loop": None},
        "designed/head-2": {"rounds": wrong, "loop": None},
    }
    found = adaptive_score(cases, done)["figures"]["lags"]
    value = {way: {row["name"]: row["value"] for row in rows} for way, rows in found.items()}
    assert value["before"]["left as a set"] == 1
    assert value["before"]["right name alone"] == 0
    assert value["designed"]["left as a set"] == 0.25
    assert value["designed"]["right name alone"] == 0.5
    assert value["designed"]["confidently wrong"] == 0.25
    assert value["designed"]["mean size of a set"] == pytest.approx(1.25)
    assert value["designed"]["recordings asked for, per case"] == pytest.approx(11 / 4)
    assert value["random"] == value["before"]


def test_gains_are_shares_of_what_the_oracle_gains_and_losses_are_counted():
    heads = [
        {"base": -10.0, "augmented": -15.0, "robust": -14.0, "loop": -15.0, "oracle": -15.0},
        {"base": -20.0, "augmented": -18.0, "robust": -20.0, "loop": -20.0, "oracle": -21.0},
    ]
    found = gains(heads)
    assert found["augmented"] == {"share": 0.5, "median": 0.5 * (1.0 - 2.0), "worse": 1, "worst": pytest.approx(0.1)}
    assert found["loop"]["share"] == pytest.approx(5 / 6)
    assert (found["loop"]["worse"], found["loop"]["worst"]) == (0, 0.0)


def test_the_page_and_the_terminal_tell_of_the_rounds(capsys):
    case = case_of("head-0", verdict("trigger_delay", "sensor_bandwidth"), [request(1e-6)])
    costs = {"base": -10.0, "augmented": -14.0, "robust": -14.5, "oracle": -15.0}
    case["judged"] |= {"reoptimised": costs, "closure": None, "parameters": []}
    case["run"] = {"cpu_seconds": 1.0}
    rounds = [{"requests": [{"sentence": "", "repeats": 5}], "entry": entry("", verdict("trigger_delay"))}]
    done = {"designed/head-0": {"rounds": rounds, "loop": {"cost": -14.8, "chosen": "robust"}}}
    found = adaptive_score([case], done)
    print_rounds(found)
    told = capsys.readouterr().out
    assert "waveforms of 1 heads" in told
    assert "96.0 %" in told  # 4.8 of 5 V
    manifest = {
        **dict.fromkeys(("version", "seed", "profile", "published", "code", "versions", "truth_sha256"), ""),
        "version": 2,
        "code": {"rig": "", "finder": ""},
        "versions": {},
    }
    outcome = SimpleNamespace(cases=[case], manifest=manifest, answers={"answers_sha256": ""}, judge=None)
    page = page_html(score(outcome) | {"adaptive": {name: found[name] for name in ("figures", "waveforms")}})
    assert "<h2>Requests answered</h2>" in page
    assert page.count("96.0 %") == 2  # all volts, and the median of one head

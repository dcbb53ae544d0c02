import json
import shutil
from dataclasses import replace

import pytest

from inkjet_env.experiments.proof import sealing
from inkjet_env.experiments.proof.campaign_files import ProofError, digest, pack, unpack
from inkjet_env.experiments.proof.sealing import (
    Settings,
    canonical,
    check_answer,
    commit_answers,
    commitment,
    open_folder,
    read_answer,
    read_json,
    salt_of,
    unseal,
    verified_manifest,
)

SETTINGS = Settings(1, "quick", "fake_rig")


@pytest.fixture
def proof(finished, tmp_path):
    """A finished proof that a test may spoil."""
    return shutil.copytree(finished[0], tmp_path / "proof")


def a_campaign(proof):
    return sorted((proof / "campaigns").iterdir())[0]


def changed(file, change):
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))


def test_a_finished_proof_passes_every_check(proof):
    open_folder(proof, SETTINGS)
    manifest = verified_manifest(proof)
    commit_answers(proof, manifest)
    assert len(unseal(proof, manifest)) == 60


def test_the_hash_is_printed_before_anything_is_diagnosed(finished):
    folder, _, err = finished
    said = err.index(read_json(folder / "manifest.json")["truth_sha256"])
    assert said < err.index("diagnose blind")
    assert err.index(read_json(folder / "answers.json")["answers_sha256"]) < err.index("Unsealed")


def test_the_commitment_is_a_plain_sha256_that_anyone_can_repeat(proof):
    from hashlib import sha256

    truth = read_json(proof / "sealed" / "truth.json")["cases"]
    text = (proof / "sealed" / "salt.txt").read_text().strip() + json.dumps(
        truth, sort_keys=True, separators=(",", ":")
    )
    assert sha256(text.encode()).hexdigest() == read_json(proof / "manifest.json")["truth_sha256"]


def test_the_salt_is_not_of_the_seed(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name / "sealed").mkdir(parents=True)
    assert salt_of(tmp_path / "a") != salt_of(tmp_path / "b")
    assert salt_of(tmp_path / "a") == salt_of(tmp_path / "a")


def test_a_campaign_changed_after_sealing_stops_the_run(proof):
    file = a_campaign(proof) / "r001.csv"
    file.write_text(file.read_text().replace("e-07", "e-06", 1))
    with pytest.raises(ProofError, match=r"head-.* was changed after it was sealed"):
        verified_manifest(proof)


def test_a_truth_file_inside_a_campaign_stops_the_run(proof):
    shutil.copy(proof / "sealed" / "truth.json", a_campaign(proof))
    with pytest.raises(ProofError, match=r"truth\.json is not a recording of that campaign"):
        verified_manifest(proof)


def test_a_descriptor_that_tells_stops_the_run(proof):
    changed(a_campaign(proof) / "datapackage.json", lambda d: d["resources"][0]["inkjet"].update(effects=["creep"]))
    with pytest.raises(ProofError, match="has the key 'effects'"):
        verified_manifest(proof)


def test_a_campaign_that_joined_after_sealing_stops_the_run(proof):
    shutil.copytree(a_campaign(proof), proof / "campaigns" / "head-0")
    with pytest.raises(ProofError, match="head-0 was not sealed"):
        verified_manifest(proof)


def test_a_truth_changed_after_sealing_stops_the_run(proof):
    name = a_campaign(proof).name
    changed(proof / "sealed" / "truth.json", lambda d: d["cases"][name]["truth"].update(effects=["creep"]))
    with pytest.raises(ProofError, match="is not the truth that was sealed"):
        unseal(proof, read_json(proof / "manifest.json"))


def test_a_salt_changed_after_sealing_stops_the_run(proof):
    (proof / "sealed" / "salt.txt").write_text("0" * 64)
    with pytest.raises(ProofError, match="is not the truth that was sealed"):
        unseal(proof, read_json(proof / "manifest.json"))


def test_an_answer_changed_after_it_was_committed_to_stops_the_run(proof):
    file = proof / "answers" / f"{a_campaign(proof).name}.json"
    changed(file, lambda d: d["answer"]["verdict"].update(verdict="unknown"))
    with pytest.raises(ProofError, match="was changed after all answers were committed to"):
        commit_answers(proof, read_json(proof / "manifest.json"))


@pytest.mark.parametrize(
    ("part", "value"), [("effects", [{"id": "gremlins", "parameters": {}}]), ("candidates", [["creep", "gremlins"]])]
)
def test_a_verdict_that_names_an_unknown_id_stops_the_run(proof, part, value):
    entry = read_answer(proof, a_campaign(proof).name)
    entry["answer"]["verdict"][part] = value
    with pytest.raises(ProofError, match="names 'gremlins', which is not an id of the catalogue"):
        check_answer(proof, entry, read_json(proof / "manifest.json"))


def test_an_answer_to_other_bytes_stops_the_run(proof):
    entry = read_answer(proof, a_campaign(proof).name) | {"campaign": "0" * 64}
    with pytest.raises(ProofError, match="does not belong to the campaign that was sealed"):
        check_answer(proof, entry, read_json(proof / "manifest.json"))


def test_a_diagnosis_that_looked_at_the_truth_stops_the_run(proof):
    entry = read_answer(proof, a_campaign(proof).name)
    entry["run"]["seen"] = [str((proof / "sealed" / "truth.json").resolve())]
    with pytest.raises(ProofError, match=r"opened .*truth\.json, which only the judge may see"):
        check_answer(proof, entry, read_json(proof / "manifest.json"))


@pytest.mark.parametrize(
    ("change", "told"), [({"seed": 2}, "seed is 1 there and 2 here"), ({"profile": "full"}, "full")]
)
def test_a_folder_of_another_corpus_is_refused(proof, change, told):
    with pytest.raises(ProofError, match=f"holds a proof with other settings: .*{told}"):
        open_folder(proof, replace(SETTINGS, **change))


@pytest.mark.parametrize("damaged", [{}, {"code": {}}, {"code": 1}])
@pytest.mark.parametrize("finished_too", [False, True])
def test_a_folder_whose_settings_are_damaged_is_refused(proof, damaged, finished_too):
    if not finished_too:
        (proof / "answers.json").unlink()
    changed(proof / "proof.json", lambda content: [content.pop(name) for name in ("code", "versions")])
    changed(proof / "proof.json", lambda content: content.update(damaged))
    with pytest.raises(ProofError, match="holds a proof with other settings"):
        open_folder(proof, SETTINGS)


def test_versions_are_not_mixed(proof, monkeypatch):
    monkeypatch.setattr(sealing, "VERSION", 3)
    with pytest.raises(ProofError, match="version is 2 there and 3 here"):
        open_folder(proof, SETTINGS)


def test_a_folder_of_an_earlier_version_tells_where_its_rig_is(proof):
    changed(proof / "proof.json", lambda settings: settings.update(version=1))
    with pytest.raises(ProofError, match="the rig of version 1 is at commit 0e17b70") as told:
        open_folder(proof, SETTINGS)
    assert "proof_tables" in str(told.value)


@pytest.mark.parametrize(
    ("probabilities", "sentence"),
    [
        ({"creep": 0.5, "gremlins": 0.5}, "a probability of 'gremlins'"),
        ({"creep": 0.6, "nothing": 0.5}, "exceed 1 together: 1.1"),
    ],
)
def test_probabilities_that_are_none_stop_the_run(proof, probabilities, sentence):
    entry = read_answer(proof, a_campaign(proof).name)
    entry["answer"]["verdict"]["probabilities"] = probabilities
    with pytest.raises(ProofError, match=sentence):
        check_answer(proof, entry, read_json(proof / "manifest.json"))


@pytest.mark.parametrize(
    "probabilities", [{"creep": 0.5, "nothing": 0.25, "none of these": 0.25}, {"none of these": 0.8, "nothing": 0.005}]
)
def test_probabilities_may_be_given_to_every_label_and_leave_some_over(proof, probabilities):
    entry = read_answer(proof, a_campaign(proof).name)
    entry["answer"]["verdict"]["probabilities"] = probabilities
    check_answer(proof, entry, read_json(proof / "manifest.json"))


@pytest.mark.parametrize("part", ["finder", "rig"])
def test_code_is_not_mixed(proof, monkeypatch, part):
    (proof / "answers.json").unlink()
    monkeypatch.setattr(sealing, "SOURCES", {**sealing.SOURCES, part: ("inkjet_env/storage.py",)})
    with pytest.raises(ProofError, match=f"code {part} is"):
        open_folder(proof, SETTINGS)


def test_answers_that_are_committed_to_may_be_judged_by_other_code_but_on_the_same_rig(proof, monkeypatch):
    kept = (proof / "proof.json").read_bytes()
    monkeypatch.setattr(sealing, "SOURCES", {**sealing.SOURCES, "finder": ("inkjet_env/storage.py",)})
    monkeypatch.setattr(sealing, "versions", lambda: {"python": "4.0"})
    open_folder(proof, SETTINGS)
    assert (proof / "proof.json").read_bytes() == kept
    monkeypatch.setattr(sealing, "SOURCES", {**sealing.SOURCES, "rig": ("inkjet_env/storage.py",)})
    with pytest.raises(ProofError, match="code rig is"):
        open_folder(proof, SETTINGS)


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ProofError, match="neither empty nor a proof's results folder"):
        open_folder(tmp_path, SETTINGS)
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


def test_a_damaged_file_is_named(proof):
    (proof / "manifest.json").write_text('{"format": ')
    with pytest.raises(ProofError, match=r"manifest\.json cannot be read"):
        verified_manifest(proof)


def test_a_packed_campaign_is_the_same_campaign(proof, tmp_path):
    campaign = a_campaign(proof)
    unpack(pack(campaign), tmp_path / "again")
    assert digest(tmp_path / "again") == digest(campaign)
    assert pack(tmp_path / "again") == pack(campaign)


def test_the_order_of_keys_does_not_change_a_commitment():
    assert canonical({"a": 1, "b": [2]}) == canonical({"b": [2], "a": 1})
    assert commitment("salt", {"a": 1}) != commitment("tlas", {"a": 1})

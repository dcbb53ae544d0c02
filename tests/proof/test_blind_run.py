import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from inkjet_env.experiments.execution.jobs import WorkLostError
from inkjet_env.experiments.proof import blind_run, sandbox
from inkjet_env.experiments.proof.blind_run import clean_environment, diagnose_blind
from inkjet_env.experiments.proof.campaign_files import ProofError, digest, pack


@pytest.fixture
def campaign(finished):
    return sorted((finished[0] / "campaigns").iterdir())[0]


def run_watched(scratch, code):
    """Python code in a process that is watched as a blind one; what it said, and what was noted."""
    begin = "from inkjet_env.experiments.proof.sandbox import watch, outside; from pathlib import Path\n"
    script = f"{begin}s = set(); watch(s)\n{code}\nimport json; print(json.dumps(outside(s, Path.cwd())))"
    return subprocess.run(
        [sys.executable, "-c", script], cwd=scratch, env=clean_environment(scratch), capture_output=True, text=True
    )


def test_a_campaign_that_the_command_refuses_is_an_answer_with_its_sentence(campaign):
    entry = diagnose_blind(campaign.name, pack(campaign), digest(campaign))
    assert entry["answer"]["status"] == "refused"
    assert entry["answer"]["verdict"] is None
    assert entry["answer"]["sentence"].endswith(".")
    assert "inkjet-blind" not in entry["answer"]["sentence"]


def test_requests_come_with_their_drives_and_recordings_are_held_out_as_asked(campaign, monkeypatch):
    asked = []

    def stub(scratch, seen, *arguments):
        asked.append(arguments)
        for name in ("base", "augmented"):
            (scratch / f"{name}.json").write_text("{}")
        wanted = {"channel": "self_sensing", "drive_csv": "next.csv"}
        (scratch / "next.csv").write_text("time_s,drive_V,neighbour_V\n0,0,1\n1e-6,5,2\n")
        further = [{"channel": None, "drive_csv": None}, {"channel": "self_sensing", "drive_csv": "next-3.csv"}]
        (scratch / "next-3.csv").write_text("time_s,drive_V\n0,0\n1e-6,-5\n")
        told = {"next_experiment": wanted, "further_experiments": further}
        (scratch / "verdict.json").write_text(json.dumps(told))
        return 0, ""

    monkeypatch.setattr(blind_run, "_inkjet", stub)
    entry = diagnose_blind(campaign.name, pack(campaign), digest(campaign), ["r002", "r005"])
    first, second = entry["answer"]["requests"]
    assert (first["drive_V"], first["neighbour_V"]) == ([0, 5], [1, 2])
    assert (second["drive_V"], second["neighbour_V"]) == ([0, -5], None)
    assert asked[1][-2:] == ("--hold-out", "r002,r005")
    diagnose_blind(campaign.name, pack(campaign), digest(campaign))
    assert "--hold-out" not in asked[3]


def test_nothing_of_the_proofs_folder_is_seen_by_a_blind_process(finished, campaign):
    entry = diagnose_blind(campaign.name, pack(campaign), digest(campaign))
    assert not [path for path in entry["run"]["seen"] if path.startswith(str(finished[0].parent))]


def test_another_campaign_than_the_sealed_one_is_not_diagnosed(campaign):
    with pytest.raises(ProofError, match="is not the campaign that was sealed"):
        diagnose_blind(campaign.name, pack(campaign), "0" * 64)


def test_a_blind_process_cannot_load_the_concealed_plant(tmp_path):
    done = run_watched(tmp_path, "import experiments.concealed_rig")
    assert "ImportError: experiments.concealed_rig is not available to a blind diagnosis" in done.stderr


def test_what_a_blind_process_opens_elsewhere_is_noted(tmp_path):
    elsewhere = tmp_path / "sealed"
    elsewhere.mkdir()
    (elsewhere / "truth.json").write_text("{}")
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    own = "open('own.txt', 'w').close()"
    done = run_watched(
        scratch, f"{own}; open({str(elsewhere / 'truth.json')!r}); import os; os.listdir({str(elsewhere)!r})"
    )
    assert {str(elsewhere), str(elsewhere / "truth.json")} <= set(json.loads(done.stdout))
    assert not [path for path in json.loads(done.stdout) if path.endswith("own.txt")]


def test_a_link_out_of_the_scratch_folder_is_noted_too(tmp_path):
    (tmp_path / "truth.json").write_text("{}")
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    (scratch / "innocent.csv").symlink_to(tmp_path / "truth.json")
    done = run_watched(scratch, "open('innocent.csv').close()")
    assert str(scratch / "innocent.csv") in json.loads(done.stdout)


def test_a_blind_process_is_told_nothing_but_where_programs_are(tmp_path, monkeypatch):
    monkeypatch.setenv("TRUTH", "creep")
    told = clean_environment(tmp_path)
    assert "TRUTH" not in told
    assert told["OPENBLAS_NUM_THREADS"] == told["OMP_NUM_THREADS"] == "1"
    assert told["HOME"] == told["TMPDIR"] == str(tmp_path)


def test_a_blind_process_that_is_killed_is_lost_work_and_no_answer(campaign, monkeypatch):
    monkeypatch.setattr(blind_run.sys, "executable", sys.executable)

    def killed(*arguments, **options):
        return subprocess.CompletedProcess(arguments, -9, b"", b"")

    monkeypatch.setattr(blind_run.subprocess, "run", killed)
    with pytest.raises(WorkLostError, match="killed by signal 9"):
        diagnose_blind(campaign.name, pack(campaign), digest(campaign))


def test_a_command_that_breaks_down_is_told_by_its_last_line(campaign, monkeypatch):
    def broken(*arguments, **options):
        return subprocess.CompletedProcess(arguments, 1, b"", b"Traceback\nKeyError: 'x'\n")

    monkeypatch.setattr(blind_run.subprocess, "run", broken)
    answer = diagnose_blind(campaign.name, pack(campaign), digest(campaign))["answer"]
    assert (answer["status"], answer["sentence"]) == ("failed", "KeyError: 'x'")


def test_a_watched_process_ends_with_the_one_that_started_it():
    imports = "import os, time; from inkjet_env.experiments.proof.sandbox import end_with_parent"
    code = f"{imports}; end_with_parent(os.getppid())"
    begin = f"subprocess.Popen([sys.executable, '-c', {f'{code}; time.sleep(60)'!r}], stdout=subprocess.DEVNULL)"
    script = f"import subprocess, sys, time; print({begin}.pid); time.sleep(1)"
    environment = os.environ | {"PYTHONPATH": str(Path(sandbox.__file__).parents[2])}
    done = subprocess.run(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, env=environment, timeout=30
    )
    end_s = time.monotonic() + 10
    while Path(f"/proc/{done.stdout.strip()}").exists():
        assert time.monotonic() < end_s
        time.sleep(0.1)

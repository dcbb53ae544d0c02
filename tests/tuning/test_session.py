"""A session goes on where it was, whatever stopped it, and never fires what the head likes less."""

import json
import shutil

import pytest

from inkjet_env.experiments.tuning import session as session_module
from inkjet_env.experiments.tuning.exchange import Exchange, WaitingError
from inkjet_env.experiments.tuning.session import Session, TuneSettings
from inkjet_env.printhead import DriverLimits, Waveform
from inkjet_env.rig import VirtualRig, record_campaign
from tests.tuning.two_rounds import BASE, TRUE, put_in_place

SETTINGS = TuneSettings(budget=60, searches=1, limits=DriverLimits(-80, 80, 20, 20, 0.1))


@pytest.fixture
def diagnoses(monkeypatch):
    return put_in_place(monkeypatch)


def begun(folder, rig=None, settings=SETTINGS):
    return Session(folder, settings, Exchange(folder, rig))


def without_seconds(tuned):
    return {key: value for key, value in tuned.as_json().items() if key != "seconds"}


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    """A session that nothing stopped: its folder, its result, and its diagnoses."""
    folder = tmp_path_factory.mktemp("session") / "ended"
    with pytest.MonkeyPatch.context() as patched:
        diagnoses = put_in_place(patched)
        return folder, begun(folder, VirtualRig(TRUE, 1)).run(), diagnoses


def test_from_nothing_to_a_waveform_that_was_checked_on_the_head(ended):
    folder, tuned, diagnoses = ended
    assert [one["verdict"] for one in tuned.rounds] == ["set", "named"]
    assert diagnoses.rounds == [38, 40]  # the request was to be recorded twice
    first, second = diagnoses.held_out
    assert first is None
    assert len(second) == 1  # what was held out stays held out, so that what was asked for is fitted
    names = [proposal.name for proposal in tuned.proposals]
    assert names[0] == "robust"
    assert names[-1] == "refined"  # near the best that was checked
    assert tuned.recordings == 40 + len(names)
    costs_V = [TRUE.respond(proposal.as_waveform).cost() for proposal in tuned.proposals]
    assert costs_V[tuned.best] == min(costs_V)
    for proposal, check in zip(tuned.proposals, tuned.checks, strict=True):
        assert SETTINGS.limits.excesses(*proposal.as_waveform.knots()) == []
        assert check.cost_V == pytest.approx(TRUE.respond(proposal.as_waveform).cost(), abs=max(4 * check.error_V, 0.3))
    written = json.loads((folder / "tune.json").read_text())
    assert written["waveform"] == list(tuned.proposals[tuned.best].waveform)
    log = (folder / "log.md").read_text()
    assert "A second mode or an echo." in log
    assert "Asked for: Record a pulse." in log
    assert "To fire: the best waveform of the" in log


def test_a_session_that_is_stopped_again_and_again_ends_as_one_that_is_not(ended, tmp_path, diagnoses, monkeypatch):
    """It is stopped among the first recordings, those that were asked for and the checks, and in each other step."""

    class Stopping(VirtualRig):
        left = 0

        def record(self, request, order):
            if self.left == 0:
                raise KeyboardInterrupt
            self.left -= 1
            return super().record(request, order)

    def stop(*_, **__):
        raise KeyboardInterrupt

    rig, rounds, recordings = Stopping(TRUE, 1), [], []
    for left, step in ((9, None), (30, None), (99, "identify"), (99, "proposals"), (1, None), (99, "measured")):
        rig.left = left
        with monkeypatch.context() as stopping:
            if step:
                stopping.setattr(session_module, step, stop)
            with pytest.raises(KeyboardInterrupt):
                begun(tmp_path, rig).run()
        rounds.append(len(diagnoses.rounds))
        recordings.append(len(Exchange(tmp_path).recorded))
    whole = without_seconds(ended[1])
    assert rounds == [0, 1, 2, 2, 2, 2]
    first = sum(one["name"] != "refined" for one in whole["tried"])
    assert recordings == [9, 39, 40, 40, 41, 40 + first]
    rig.left = len(whole["tried"]) - first  # what was done is not done again
    assert without_seconds(begun(tmp_path, rig).run()) == whole
    assert rig.left == 0
    assert diagnoses.rounds == [38, 40]


def test_without_a_rig_it_waits_for_the_battery(tmp_path, diagnoses):
    with pytest.raises(WaitingError) as waiting:
        begun(tmp_path).run()
    assert len(waiting.value.names) == 38
    assert len(list((tmp_path / "requests").glob("battery-*.csv"))) == 38


def test_a_correction_that_predicts_no_better_is_not_used(ended, tmp_path, diagnoses):
    shutil.copytree(ended[0], tmp_path, dirs_exist_ok=True)
    (tmp_path / "proposals.json").unlink()
    corrected = json.loads((tmp_path / "corrected-1.json").read_text())
    corrected["fit"] = {"base_heldout_rms_V": 0.1, "augmented_heldout_rms_V": 0.1}
    (tmp_path / "corrected-1.json").write_text(json.dumps(corrected))
    tuned = begun(tmp_path, VirtualRig(BASE, 1)).run()
    predicted_V = BASE.respond(Waveform.from_array(tuned.proposals[0].waveform)).cost()
    assert tuned.proposals[0].predicted_V == pytest.approx(predicted_V, abs=1e-6)
    assert diagnoses.rounds == []


def test_other_settings_are_not_mixed_with_a_session(tmp_path, diagnoses):
    begun(tmp_path)
    with pytest.raises(ValueError, match="a session with other settings"):
        begun(tmp_path, settings=TuneSettings(budget=61))


def test_another_campaign_is_not_mixed_with_a_session(tmp_path, diagnoses):
    one, other = (record_campaign(BASE, seed, snr_dB=40.0) for seed in (1, 2))
    Session(tmp_path, SETTINGS, Exchange(tmp_path), one)
    Session(tmp_path, SETTINGS, Exchange(tmp_path), one)
    with pytest.raises(ValueError, match="of another campaign"):
        Session(tmp_path, SETTINGS, Exchange(tmp_path), other)


def test_a_window_without_an_end_is_refused():
    with pytest.raises(ValueError, match="a finite window"):
        TuneSettings(window_s=float("inf"))


def test_a_damaged_step_is_named(ended, tmp_path, diagnoses):
    shutil.copytree(ended[0], tmp_path, dirs_exist_ok=True)
    (tmp_path / "round-0.json").write_text("{")
    with pytest.raises(ValueError, match=r"round-0\.json: is damaged"):
        begun(tmp_path, VirtualRig(TRUE, 1)).run()

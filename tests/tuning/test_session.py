"""A session goes on where it was, whatever stopped it, and never fires what the head likes less."""

import json

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


def test_from_nothing_to_a_waveform_that_was_checked_on_the_head(tmp_path, diagnoses):
    tuned = begun(tmp_path, VirtualRig(TRUE, 1)).run()
    assert [one["verdict"] for one in tuned.rounds] == ["set", "named"]
    assert diagnoses.rounds == [38, 40]  # the request was to be recorded twice
    first, second = diagnoses.held_out
    assert first is None
    assert len(second) == 1  # what was held out stays held out, so that what was asked for is fitted
    names = [proposal.name for proposal in tuned.proposals]
    assert names[0] == "robust"
    assert names[-1] == "base"
    assert tuned.recordings == 40 + len(names)
    costs_V = [TRUE.respond(proposal.as_waveform).cost() for proposal in tuned.proposals]
    assert costs_V[tuned.best] == min(costs_V)
    for proposal, check in zip(tuned.proposals, tuned.checks, strict=True):
        assert SETTINGS.limits.excesses(*proposal.as_waveform.knots()) == []
        assert check.cost_V == pytest.approx(TRUE.respond(proposal.as_waveform).cost(), abs=max(4 * check.error_V, 0.3))
    written = json.loads((tmp_path / "tune.json").read_text())
    assert written["waveform"] == list(tuned.proposals[tuned.best].waveform)
    log = (tmp_path / "log.md").read_text()
    assert "A second mode or an echo." in log
    assert "Asked for: Record a pulse." in log
    assert "To fire: the best waveform of the" in log


def test_a_session_that_is_stopped_at_any_recording_ends_as_one_that_is_not(tmp_path, diagnoses):
    whole = without_seconds(begun(tmp_path / "whole", VirtualRig(TRUE, 1)).run())

    class Stopping(VirtualRig):
        left = 0

        def record(self, request, order):
            if self.left == 0:
                raise KeyboardInterrupt
            self.left -= 1
            return super().record(request, order)

    rig, stops = Stopping(TRUE, 1), 0
    while True:
        rig.left = 9
        try:
            tuned = begun(tmp_path / "stopped", rig).run()
            break
        except KeyboardInterrupt:
            stops += 1
    assert stops >= 4
    assert without_seconds(tuned) == whole


@pytest.mark.parametrize("name", ["identify", "proposals", "measured"])
def test_a_session_that_is_stopped_in_any_step_ends_as_one_that_is_not(tmp_path, diagnoses, monkeypatch, name):
    whole = without_seconds(begun(tmp_path / "whole", VirtualRig(TRUE, 1)).run())
    with monkeypatch.context() as stopping:

        def stop(*_, **__):
            raise KeyboardInterrupt

        stopping.setattr(session_module, name, stop)
        with pytest.raises(KeyboardInterrupt):
            begun(tmp_path / "stopped", VirtualRig(TRUE, 1)).run()
    rounds = len(diagnoses.rounds)
    assert without_seconds(begun(tmp_path / "stopped", VirtualRig(TRUE, 1)).run()) == whole
    assert len(diagnoses.rounds) == rounds  # what was done is not done again


def test_without_a_rig_it_waits_for_the_battery(tmp_path, diagnoses):
    with pytest.raises(WaitingError) as waiting:
        begun(tmp_path).run()
    assert len(waiting.value.names) == 38
    assert len(list((tmp_path / "requests").glob("battery-*.csv"))) == 38


def test_a_correction_that_predicts_no_better_is_not_used(tmp_path, diagnoses):
    diagnoses.fit = {"base_heldout_rms_V": 0.1, "augmented_heldout_rms_V": 0.1}
    tuned = begun(tmp_path, VirtualRig(BASE, 1)).run()
    predicted_V = BASE.respond(Waveform.from_array(tuned.proposals[0].waveform)).cost()
    assert tuned.proposals[0].predicted_V == pytest.approx(predicted_V, abs=1e-6)


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


def test_a_damaged_step_is_named(tmp_path, diagnoses):
    begun(tmp_path, VirtualRig(TRUE, 1)).run()
    (tmp_path / "round-0.json").write_text("{")
    with pytest.raises(ValueError, match=r"round-0\.json: is damaged"):
        begun(tmp_path, VirtualRig(TRUE, 1)).run()

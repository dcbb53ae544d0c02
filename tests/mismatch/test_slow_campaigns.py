"""Campaigns of slow recordings alone: their effects are named, those of the resonator are said to be untestable."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.experiments.validation import synthetic_campaigns
from inkjet_env.experiments.validation.synthetic_campaigns import effect_named, record_synthetic, synthetic_values
from inkjet_env.mismatch import diagnose
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.effect import complete
from inkjet_env.plant.printhead_file import printhead_of
from inkjet_env.printhead import Printhead, QuasiStaticPrinthead, UnknownDynamicsError
from inkjet_env.reporting.diagnosis_report import diagnosis_html
from inkjet_env.rig.battery import strain_gauge_battery
from inkjet_env.storage import json_text
from tests.mismatch.diagnoses import ids

HEAD = Printhead.published()


def thinned(every):
    """The battery of the strain gauge, of every nth sample; what is recorded repeatedly, once more."""
    lines = [replace(r, drive_V=r.drive_V[::every], step_s=every * r.step_s) for r in strain_gauge_battery()]
    return [*lines, *(line for line in lines if line.repeats > 1)]


@pytest.fixture(scope="module")
def recorded_slowly():
    """A function: a campaign of the strain gauge with one effect on."""

    def recorded(name="", seed=0, every=4, **given):
        effects = []
        if name:
            effect = effect_named(name)
            values = complete(effect, **given) if given else synthetic_values(effect, 1.0, HEAD, 5.0)
            effects = [(effect, values)]
        with pytest.MonkeyPatch.context() as patch:  # there is no self-sensing whose noise could be scaled
            patch.setattr(synthetic_campaigns, "OFFSETS_V", {"strain_gauge": 0.05})
            return record_synthetic(HEAD, effects, seed, lines=thinned(every))

    return recorded


@pytest.fixture(scope="module")
def crept(recorded_slowly):
    return diagnose(recorded_slowly("creep"), workers=1)


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("rate_dependent_hysteresis", {}),
        ("asymmetric_hysteresis", {}),
        ("baseline_drift", {"every": 2}),
        ("mains_hum", {"frequency_Hz": 7.0, "multiples": 1.0, "amplitude": 2.0}),
        ("trigger_delay", {"delay_s": 0.02}),
    ],
)
def test_each_effect_that_slow_recordings_show_is_named(name, given, recorded_slowly):
    found = diagnose(recorded_slowly(name, **given), workers=1)
    assert (found.verdict, ids(found)) == ("named", [name])
    assert not found.closure < 0.9


def test_creep_is_named_with_its_size_and_closes_the_gap(crept):
    assert (crept.verdict, ids(crept)) == ("named", ["creep"])
    assert crept.effects[0].parameters["creep_per_decade"].value == pytest.approx(0.015, rel=0.1)
    assert crept.closure == pytest.approx(1.0, abs=0.05)
    assert crept.location.recordings


def test_nothing_is_found_where_nothing_is(recorded_slowly):
    found = diagnose(recorded_slowly(), workers=1)
    assert (found.verdict, found.effects) == ("none", ())


def test_what_needs_fast_recordings_is_untestable_and_the_others_are_not(crept):
    assert {"second_mode", "cubic_stiffness", "amplifier_bandwidth", "sensor_bandwidth"} <= crept.untestable.keys()
    assert all("fast" in why or "slow" in why or "column" in why or "drive" in why for why in crept.untestable.values())
    shown = {"creep", "rate_dependent_hysteresis", "asymmetric_hysteresis", "baseline_drift", "mains_hum"}
    assert not shown & crept.untestable.keys()


def test_no_number_of_the_dynamics_reaches_a_result(crept):
    assert isinstance(crept.printhead, QuasiStaticPrinthead)
    assert isinstance(crept.base_printhead, QuasiStaticPrinthead)
    assert all(math.isnan(estimate.value) for estimate in crept.dynamics.values())
    assert any(note.startswith("a0, a1 and b1 cannot be known") for note in crept.notes)
    assert set(crept.gains) == {"strain_gauge"}
    written = json.loads(json_text(crept.augmented_json()))
    assert [entry["value"] for entry in written["dynamics"].values()] == [None, None, None]
    back = printhead_of(written)
    assert isinstance(back, AugmentedPrinthead)
    assert isinstance(back.printhead, QuasiStaticPrinthead)
    with pytest.raises(UnknownDynamicsError):
        back.costs([[50, -50, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6]])


def test_no_result_depends_on_the_placeholder_of_the_resonator(crept, recorded_slowly, monkeypatch):
    placeholder = QuasiStaticPrinthead.with_placeholder
    monkeypatch.setattr(QuasiStaticPrinthead, "with_placeholder", lambda self, f=50e3: placeholder(self, 7 * f))
    again = diagnose(recorded_slowly("creep"), workers=1)
    assert again.printhead == crept.printhead
    assert [vars(e.parameters["creep_per_decade"]) for e in again.effects] == [
        vars(e.parameters["creep_per_decade"]) for e in crept.effects
    ]


def test_its_page_and_its_verdict_are_written(crept):
    page = diagnosis_html(crept)
    assert "creep" in page
    assert "hysteretic drive at full scale" in page
    assert json.loads(json_text(crept.as_json()))["fit"]["base_heldout_rms_V"] > 0


def test_candidates_of_a_slow_campaign_get_a_slow_next_experiment(crept, recorded_slowly):
    loop = [r for r in recorded_slowly("creep", seed=1).recordings if r.excitation in ("minor_loops", "zero")]
    campaign = replace(recorded_slowly("creep", seed=1), recordings=tuple(replace(r, repeat_of=None) for r in loop))
    found = diagnose(campaign, workers=1)
    assert found.verdict in ("named", "set")
    if found.next_experiment is not None and found.next_experiment.drive_V:
        assert found.next_experiment.channel == "strain_gauge"
        assert found.next_experiment.step_s == pytest.approx(campaign.recordings[0].step_s)


def test_a_slow_position_sensor_is_diagnosed_as_a_strain_gauge_is(crept, recorded_slowly):
    campaign = recorded_slowly("creep")
    moved = tuple(replace(r, channel="displacement", unit="um") for r in campaign.recordings)
    found = diagnose(replace(campaign, recordings=moved), workers=1)
    assert (found.verdict, ids(found)) == ("named", ["creep"])
    assert found.gains["displacement"] == pytest.approx(crept.gains["strain_gauge"], rel=1e-6)
    assert "second_mode" in found.untestable


def test_a_head_with_dynamics_keeps_them_and_one_without_needs_slow_recordings(crept, recorded_slowly, recorded):
    found = diagnose(recorded_slowly(), HEAD, [effect_named("creep")], workers=1)
    assert found.printhead.frequency_Hz == HEAD.frequency_Hz
    assert found.dynamics["a0"].high == math.inf
    again = diagnose(recorded_slowly("creep"), crept.printhead, [effect_named("creep")], workers=1)
    assert ids(again) == ["creep"]
    with pytest.raises(UnknownDynamicsError, match="identified from slow recordings alone"):
        diagnose(recorded(), crept.printhead, workers=1)


def test_a_still_fast_channel_shows_its_noise_and_no_gain(recorded_slowly):
    campaign = recorded_slowly()
    rest = np.random.default_rng(0).normal(0, 1e-3, 500)
    still = replace(
        campaign.recordings[0], name="rest", channel="self_sensing", time_s=1e-6 * np.arange(500),
        drive_V=np.zeros(500), sensor=rest, initial_state="free", repeat_of=None,
    )  # fmt: skip
    found = diagnose(replace(campaign, recordings=(*campaign.recordings, still)), workers=1)
    assert found.verdict == "none"
    assert set(found.gains) == {"strain_gauge"}
    assert isinstance(found.printhead, QuasiStaticPrinthead)

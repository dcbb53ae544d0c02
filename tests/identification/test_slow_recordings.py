"""Slow recordings alone: the hysteresis as from a full campaign, and nothing invented about the dynamics."""

import json
import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.identification import evaluate, identify
from inkjet_env.identification.outcome import QUANTILE_90
from inkjet_env.identification.quasi_static import may_ring
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.effects import catalogue
from inkjet_env.plant.printhead_file import read_printhead
from inkjet_env.printhead import Printhead, QuasiStaticPrinthead, UnknownDynamicsError, Waveform, respond_sampled
from inkjet_env.recordings import Campaign
from inkjet_env.rig import record_campaign, strain_gauge_battery

HEAD = Printhead.published()
X = np.linspace(0.0, 1.0, 201)
WAVEFORM = Waveform(100, -100, 1e-6, 10.481e-6, 13.769e-6, 9.613e-6, 20e-6)


def slow_half(campaign):
    return replace(campaign, recordings=campaign.select("strain_gauge"))


def recorded_by(*channels, factor=1.0):
    """The battery of the strain gauge, recorded by other slow sensors, ``factor`` times as fast."""
    lines = [replace(line, step_s=line.step_s / factor) for line in strain_gauge_battery()]
    return record_campaign(HEAD, 0, battery=[replace(line, channel=c) for c in channels for line in lines])


def law_error(found):
    """Largest error of the law, as a share of its swing."""
    law = HEAD.branch_law.Q(X)
    return float(np.abs(found.printhead.branch_law.Q(X) - law).max() / law[-1])


@pytest.fixture(scope="module")
def slow_found(published_campaign):
    return identify(slow_half(published_campaign))


def test_the_law_agrees_with_that_of_the_full_campaign_within_its_intervals(slow_found, published_found):
    powers = X[:, None] ** np.arange(1, len(slow_found.printhead.coefficients))
    variance = np.einsum("ij,jk,ik->i", powers, slow_found.coefficient_covariance, powers)
    spread = np.sqrt(np.maximum(variance, 0))  # the scale fixes Q(1) to rounding
    apart = slow_found.printhead.branch_law.Q(X) - published_found.printhead.branch_law.Q(X)
    assert (np.abs(apart) <= 4 * spread + 1e-9).all()
    assert np.mean(np.abs(apart) <= QUANTILE_90 * spread + 1e-9) > 0.5
    gain, full = (found.gains["strain_gauge"] for found in (slow_found, published_found))
    assert gain.low < full.value < gain.high
    assert slow_found.offsets["strain_gauge"] == pytest.approx(published_found.offsets["strain_gauge"], abs=1e-4)


@pytest.mark.parametrize("seed", [1, 2])
def test_the_law_is_as_exact_as_the_gauge_of_the_full_campaign_allows(seed):
    assert law_error(identify(slow_half(record_campaign(HEAD, seed)))) < 2e-4


def test_the_dynamics_are_unknown_and_said_to_be(slow_found):
    assert isinstance(slow_found.printhead, QuasiStaticPrinthead)
    assert all(math.isnan(estimate.value) for estimate in slow_found.dynamics.values())
    assert any(note.startswith("a0, a1 and b1 cannot be known from these recordings") for note in slow_found.notes)
    written = slow_found.as_json()
    assert written["dynamics"] == {
        "a0": {"value": None, "low": 0.0, "high": None},
        "a1": {"value": None, "low": 0.0, "high": None},
        "b1": {"value": None, "low": None, "high": None},
    }
    assert "Record pulses and a multisine" in written["dynamics_unknown"]
    assert written["fit"]["heldout_rms_V"] == pytest.approx(written["fit"]["noise_rms_V"], rel=0.05)


def test_its_file_is_read_back(slow_found, tmp_path):
    path = tmp_path / "slow.json"
    path.write_text(json.dumps(slow_found.as_json()))
    for back in (read_printhead(path), Printhead.from_json(path), pickle.loads(pickle.dumps(slow_found.printhead))):
        assert isinstance(back, QuasiStaticPrinthead)
        assert back == slow_found.printhead
        assert hash(back) == hash(slow_found.printhead)
    data = slow_found.as_json()
    data["dynamics"]["a0"]["value"] = 1e11
    with pytest.raises(ValueError, match=r"dynamics\.a1\.value must be a number; got None"):
        Printhead.from_data(data)


def test_whatever_needs_the_dynamics_is_refused_in_words(slow_found):
    head = slow_found.printhead
    for use in (
        lambda: head.respond(WAVEFORM),
        lambda: respond_sampled(head, [0.0, 1e-6, 2e-6], [0.0, 1.0, 0.0]),
        lambda: head.frequency_Hz,
        lambda: head.varied(gain=2.0),
        lambda: AugmentedPrinthead(head, ()).respond(WAVEFORM),
    ):
        with pytest.raises(UnknownDynamicsError, match=r"a0, a1 and b1 of this printhead are unknown.*Record pulses"):
            use()


def test_it_evaluates_slow_recordings_and_refuses_self_sensing(slow_found, published_campaign):
    gains = {"strain_gauge": slow_found.gains["strain_gauge"].value}
    evaluations, refitted = evaluate(slow_half(published_campaign), slow_found.printhead, gains)
    assert refitted == ()
    noise = next(iter(slow_found.noise.values())).rms
    assert all(e.rms == pytest.approx(noise, rel=0.15) for e in evaluations)
    creep = next(effect for effect in catalogue() if effect.id == "creep")
    crept = AugmentedPrinthead(slow_found.printhead, ((creep, {"creep_per_decade": 0.02, "onset_s": 0.1}),), gains)
    worse, _ = evaluate(slow_half(published_campaign), crept)
    assert max(e.rms for e in worse) > 2 * noise
    with pytest.raises(UnknownDynamicsError):
        evaluate(published_campaign, slow_found.printhead, gains)


@pytest.mark.parametrize("factor", [1.0, 20.0])
def test_a_slow_position_sensor_shows_the_law_as_a_strain_gauge_does(factor):
    found = identify(recorded_by("displacement", factor=factor))
    assert isinstance(found.printhead, QuasiStaticPrinthead)
    assert law_error(found) < 2e-4
    assert found.gains["displacement"].value == pytest.approx(2e-3, rel=2e-4)
    assert any("displacement was taken as a gain times the hysteretic drive" in note for note in found.notes)


def test_strain_gauge_and_slow_displacement_share_one_law():
    found = identify(recorded_by("strain_gauge", "displacement"))
    assert set(found.gains) == {"strain_gauge", "displacement"}
    assert found.hysteresis_channel == "strain_gauge"
    assert law_error(found) < 2e-4


def test_a_drive_and_its_sampling_tell_whether_a_resonance_can_show():
    sine = 90 * np.sin(2 * np.pi * np.arange(5000) / 5000)
    step = np.where(np.arange(500) < 20, 0.0, 90.0)
    assert not may_ring(sine, 1e-3, "periodic")  # 0.2 Hz, however finely sampled
    assert may_ring(sine, 1e-6, "periodic")
    assert may_ring(step, 1e-3, "demagnetised")
    assert not may_ring(step, 1e-2, "demagnetised")  # too few samples for 50 Hz
    assert not may_ring(np.full(100, 90.0), 1e-6, "demagnetised")


def test_a_fast_displacement_is_identified_with_its_resonance():
    pulses = np.interp(np.arange(1600), [20, 35, 70, 85], [0.0, 80.0, 80.0, 0.0])
    line = replace(strain_gauge_battery()[0], channel="displacement", step_s=2e-7, drive_V=pulses, repeats=2)
    found = identify(record_campaign(HEAD, 0, battery=[line]))
    assert found.printhead.frequency_Hz == pytest.approx(HEAD.frequency_Hz, rel=1e-3)


def test_an_unknown_start_is_doubted_in_slow_recordings_too(published_campaign):
    loop = published_campaign.select("strain_gauge", "sine")[0]
    found = identify(Campaign("lab", (replace(loop, initial_state="free", repeat_of=None),)))
    assert any("is unknown and was taken as demagnetised. A repeated drive explains" in note for note in found.notes)

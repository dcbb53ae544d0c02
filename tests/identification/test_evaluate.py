"""A head as it is, on recordings: what is refitted, and that nothing else is."""

from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.identification import evaluate
from inkjet_env.printhead import Printhead, respond_sampled
from inkjet_env.recordings import Campaign, Recording
from inkjet_env.rig import default_battery, displacement_battery, record_campaign


def test_an_identified_head_leaves_what_its_identification_says(published_campaign, published_found):
    gains = {channel: gain.value for channel, gain in published_found.gains.items()}
    evaluations, refitted = evaluate(published_campaign, published_found.printhead, gains)
    assert refitted == ()
    assert [e.recording.name for e in evaluations] == [r.name for r in published_campaign.recordings]
    told = {recording.name: recording for recording in published_found.recordings}
    for e in evaluations:
        # The offset is fitted to all recordings here, there to those that are not held out.
        assert e.rms == pytest.approx(told[e.recording.name].rms(), rel=2e-3)


def test_only_the_gain_that_a_printhead_does_not_have_is_fitted():
    head = Printhead.published()
    battery = (*default_battery(head.frequency_Hz), *displacement_battery(head.frequency_Hz))
    campaign = record_campaign(head, 0, battery=battery, snr_dB=60)
    evaluations, refitted = evaluate(campaign, head)
    assert refitted == ("displacement", "strain_gauge")
    loud = [e for e in evaluations if np.ptp(e.recording.drive_V) > 50]
    assert max(e.rms / e.output_rms for e in loud) < 0.1
    wrong = replace(head, b1=1.1 * head.b1)
    for e in evaluate(campaign, wrong)[0]:
        if e.recording.channel == "self_sensing" and np.ptp(e.recording.drive_V) > 50:
            assert e.rms > 0.09 * e.output_rms


def test_a_free_initial_state_is_fitted_and_no_other_is():
    head, step_s = Printhead.published(), 2e-7
    time_s = step_s * np.arange(2000)
    drive_V = np.interp(time_s, [0, 1e-4, 1.02e-4, 4e-4], [0, 0, 50, 50])
    ringing = np.exp(-head.a1 / 2 * time_s) * np.cos(np.sqrt(head.a0 - head.a1**2 / 4) * time_s + 1)
    signal = respond_sampled(head, time_s, drive_V, "demagnetised").sensor_V + 2 * ringing + 0.3

    def left(initial_state):
        recording = Recording("r", time_s, drive_V, signal, "V", "self_sensing", initial_state=initial_state)
        (found,), _ = evaluate(Campaign("c", (recording,)), head)
        return found

    assert left("free").rms < 1e-9
    assert left("free").offset == pytest.approx(0.3)
    assert left("demagnetised").rms > 0.3


def test_nanometres_are_told_in_nanometres():
    head = Printhead.published()
    campaign = record_campaign(head, 0, battery=displacement_battery(head.frequency_Hz), snr_dB=40)
    assert {r.unit for r in campaign.recordings} == {"um"}
    in_nm = tuple(replace(r, sensor=1e3 * r.sensor, unit="nm") for r in campaign.recordings)
    for gains in (None, {"displacement": 1e-3}):
        nm, _ = evaluate(Campaign("nm", in_nm), head, gains)
        um, _ = evaluate(campaign, head, gains)
        for a, b in zip(nm, um, strict=True):
            assert a.rms == pytest.approx(1e3 * b.rms)
            assert a.output_rms == pytest.approx(1e3 * b.output_rms)

"""A virtual campaign: the truth, plus the noise that was asked for."""

import math
import re

import numpy as np
import pytest

from inkjet_env.printhead import Printhead, respond_sampled
from inkjet_env.recordings import read_campaign, write_campaign
from inkjet_env.rig import (
    Converter,
    SelfInduction,
    StrainGauge,
    Vibrometer,
    default_battery,
    displacement_battery,
    record_campaign,
    strain_gauge_battery,
)
from inkjet_env.rig.answer import absolute_hysteretic_V, deflection_V

HEAD = Printhead.published()
IDEAL_GAUGE = StrainGauge(converter=Converter(0.0, 3.3, None))
IDEAL_SENSING = SelfInduction(bits=None)
SILENT = record_campaign(HEAD, 1, strain_gauge=IDEAL_GAUGE, self_induction=IDEAL_SENSING, snr_dB=math.inf)


def same(a, b):
    return len(a.recordings) == len(b.recordings) and all(
        (x.name, x.repeat_of, x.excitation) == (y.name, y.repeat_of, y.excitation)
        and np.array_equal(x.sensor, y.sensor)
        for x, y in zip(a.recordings, b.recordings, strict=True)
    )


def test_without_noise_self_sensing_is_the_heads_response():
    for recording in SILENT.select(channel="self_sensing"):
        ringing = "steady" if recording.initial_state == "periodic" else "rest"
        exact = respond_sampled(HEAD, recording.time_s, recording.drive_V, recording.initial_state, ringing=ringing)
        assert np.array_equal(recording.sensor, exact.sensor_V)


def test_without_noise_the_strain_gauge_is_gain_times_hysteretic_drive_plus_one_offset():
    for recording in SILENT.select(channel="strain_gauge"):
        hysteretic_V = absolute_hysteretic_V(HEAD, recording.drive_V, recording.initial_state)
        expected_V = IDEAL_GAUGE.gain * hysteretic_V + IDEAL_GAUGE.offset_V
        np.testing.assert_allclose(recording.sensor, expected_V, rtol=1e-14)


def test_a_campaign_says_that_it_is_simulated_and_what_the_strain_gauge_was_set_to():
    description = record_campaign(HEAD, 1).description
    assert description.startswith("Simulated")
    gain, offset_V = map(float, re.search(r"Strain gauge: (\S+) V a .*, offset (\S+) V", description).groups())
    loop = record_campaign(HEAD, 1, snr_dB=math.inf).select(excitation="minor_loops")[0]
    expected_V = gain * absolute_hysteretic_V(HEAD, loop.drive_V, "demagnetised") + offset_V
    np.testing.assert_allclose(loop.sensor, expected_V, atol=3.3 / 2**12)


def test_slow_loops_of_all_rates_are_the_same_closed_loop():
    loops = [recording.sensor for recording in SILENT.select(channel="strain_gauge", excitation="sine")]
    for loop in loops[1:]:
        np.testing.assert_allclose(loop, loops[0], atol=1e-12)
    step_V = np.abs(np.diff(loops[0])).max()
    assert abs(loops[0][0] - loops[0][-1]) <= step_V


def test_a_vibrometer_records_the_deflection_in_micrometres():
    battery = displacement_battery(HEAD.frequency_Hz)[:2]
    campaign = record_campaign(HEAD, 1, battery=battery, vibrometer=Vibrometer(bits=None), snr_dB=math.inf)
    for recording in campaign.recordings:
        deflection = deflection_V(HEAD, recording.drive_V, recording.step_s, recording.initial_state)
        assert (recording.unit, recording.channel) == ("um", "displacement")
        np.testing.assert_allclose(recording.sensor, 2e-3 * deflection + 0.01, atol=1e-12)


def test_a_mismatched_capacitor_is_heard_wherever_the_drive_moves():
    rig = SelfInduction(compensating_F=1.9e-9, bits=None)
    leaky = record_campaign(HEAD, 1, strain_gauge=IDEAL_GAUGE, self_induction=rig, snr_dB=math.inf)
    for heard, clean in zip(leaky.recordings, SILENT.recordings, strict=True):
        if clean.channel == "self_sensing":
            to_the_next = np.roll(clean.drive_V, -1) - clean.drive_V
            if clean.initial_state == "demagnetised":
                to_the_next[-1] = 0.0
            slope_V_per_s = (to_the_next + np.roll(to_the_next, 1)) / 2 / clean.step_s
            np.testing.assert_allclose(heard.sensor - clean.sensor, 1e3 * 0.1e-9 * slope_V_per_s, atol=1e-9)


def test_the_same_seed_gives_the_same_campaign_and_another_one_another():
    assert same(record_campaign(HEAD, 7), record_campaign(HEAD, 7))
    assert same(record_campaign(HEAD, 7), record_campaign(HEAD, np.random.default_rng(7)))
    assert not same(record_campaign(HEAD, 7), record_campaign(HEAD, 8))


def test_order_runs_through_the_campaign_and_is_random_within_a_channel():
    campaigns = [record_campaign(HEAD, seed) for seed in range(3)]
    for campaign in campaigns:
        assert [recording.order for recording in campaign.recordings] == list(range(1, len(campaign.recordings) + 1))
        channels = [recording.channel for recording in campaign.recordings]
        assert channels == sorted(channels, reverse=True)  # one rig after the other
    orders = {tuple(r.excitation for r in campaign.recordings) for campaign in campaigns}
    assert len(orders) == 3


def test_a_repeat_is_the_same_drive_taken_later_with_new_noise():
    campaign = record_campaign(HEAD, 3)
    wanted = sorted(line.repeats for line in default_battery() if line.repeats > 1)
    assert sorted(map(len, campaign.repeats().values())) == wanted
    for name, group in campaign.repeats().items():
        first, *others = sorted(group, key=lambda recording: recording.order)
        assert first.name == name
        for other in others:
            assert np.array_equal(first.drive_V, other.drive_V)
            assert not np.array_equal(first.sensor, other.sensor)
            assert (first.channel, first.initial_state) == (other.channel, other.initial_state)


@pytest.mark.parametrize("snr_dB", [20.0, 60.0])
def test_noise_is_so_many_decibels_below_the_largest_recording_of_its_channel(snr_dB):
    battery = [*default_battery(HEAD.frequency_Hz), *displacement_battery(HEAD.frequency_Hz)]
    ideal = {"strain_gauge": IDEAL_GAUGE, "self_induction": IDEAL_SENSING, "vibrometer": Vibrometer(bits=None)}
    if snr_dB == 20:
        ideal["strain_gauge"] = StrainGauge(stage_gain=5.0, converter=IDEAL_GAUGE.converter)  # room for the noise
    noisy, clean = (record_campaign(HEAD, 2, battery=battery, snr_dB=snr, **ideal) for snr in (snr_dB, math.inf))
    for channel in ("strain_gauge", "self_sensing", "displacement"):
        pairs = list(zip(noisy.select(channel=channel), clean.select(channel=channel), strict=True))
        largest = max(np.std(truth.sensor) for _, truth in pairs)
        rms = np.sqrt(np.mean([np.mean((heard.sensor - truth.sensor) ** 2) for heard, truth in pairs]))
        assert 20 * np.log10(largest / rms) == pytest.approx(snr_dB, abs=0.2)


def test_the_instruments_own_noise_is_what_the_zero_drive_shows():
    scope = SelfInduction(range_V=20.0)
    campaign = record_campaign(HEAD, 4, self_induction=scope)
    for recording in campaign.select(channel="self_sensing", excitation="zero"):
        assert np.std(recording.sensor) == pytest.approx(scope.noise.rms(4000, 5e6), rel=0.05)
    gauge = StrainGauge()
    campaign = record_campaign(HEAD, 4, strain_gauge=gauge)
    for recording in campaign.select(channel="strain_gauge", excitation="zero"):
        samples = len(recording.time_s)
        with_steps = math.hypot(gauge.noise.rms(samples, 100.0), gauge.converter.step / math.sqrt(12))
        assert np.std(recording.sensor) == pytest.approx(with_steps, rel=0.1)


def test_recordings_come_in_steps_of_the_converter():
    campaign = record_campaign(HEAD, 5)
    for channel, step_V in (("strain_gauge", 3.3 / 2**12), ("self_sensing", 2 * 20 / 2**16)):
        for recording in campaign.select(channel=channel):
            codes = recording.sensor / step_V
            np.testing.assert_allclose(codes, np.round(codes), atol=1e-6)


@pytest.mark.parametrize("varied", [{"gain": 30.0}, {"damping_ratio": 0.01}, {"hysteresis_strength": 3.0}])
@pytest.mark.parametrize(("snr_dB", "share"), [(None, 2e-3), (10.0, 2.0), (math.inf, 1e-4)])
def test_default_instruments_are_fitted_to_any_head(varied, snr_dB, share):
    head = HEAD.varied(**varied)
    heard = record_campaign(head, 6, snr_dB=snr_dB).select(channel="self_sensing")
    ideal = record_campaign(head, 6, self_induction=IDEAL_SENSING, snr_dB=math.inf).select(channel="self_sensing")
    largest_V = max(np.abs(truth.sensor).max() for truth in ideal)
    for recording, truth in zip(heard, ideal, strict=True):
        np.testing.assert_allclose(recording.sensor, truth.sensor, atol=share * largest_V)


def test_a_given_instrument_that_is_too_small_is_refused():
    with pytest.raises(ValueError, match="must stay within the converter's range of -2 to 2"):
        record_campaign(HEAD, 1, self_induction=SelfInduction(range_V=2.0))
    with pytest.raises(ValueError, match="Lower the gain"):
        record_campaign(HEAD, 1, strain_gauge=StrainGauge(stage_gain=30.0))


def test_times_follow_the_heads_own_resonance():
    campaign = record_campaign(HEAD.varied(frequency_Hz=20e3), 1)
    assert {round(r.sample_rate_Hz) for r in campaign.select(channel="self_sensing")} == {2_000_000}


def test_a_campaign_can_be_written_and_read(tmp_path):
    campaign = record_campaign(HEAD, 9, battery=strain_gauge_battery()[:2] + displacement_battery()[:1], name="head-9")
    write_campaign(tmp_path / "head-9", campaign)
    again = read_campaign(tmp_path / "head-9")
    assert again.name == "head-9"
    assert same(again, campaign)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"seed": None}, TypeError, "seed must be a whole number or a numpy Generator"),
        ({"seed": 1, "battery": []}, ValueError, "battery must hold at least one line"),
        ({"seed": 1, "snr_dB": math.nan}, ValueError, "snr_dB must be at least -40 dB, or infinity"),
        ({"seed": 1, "snr_dB": -math.inf}, ValueError, "snr_dB must be at least -40 dB, or infinity"),
    ],
)
def test_what_cannot_be_recorded_is_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        record_campaign(HEAD, **arguments)

"""A rig that is asked for single recordings, and heads with effects on the virtual bench."""

import numpy as np
import pytest

from inkjet_env.plant import Plant, catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import DriverLimits, Printhead, respond_sampled
from inkjet_env.rig import Request, VirtualRig, record_campaign, self_sensing_battery
from inkjet_env.rig.answer import answer_V, excitation_of

HEAD = Printhead.published()
EFFECTS = {effect.id: effect for effect in catalogue()}
LINES = {line.label: line for line in self_sensing_battery(HEAD.frequency_Hz)}
PULSE = LINES["trapezoid-60V"]


def with_effect(name):
    return AugmentedPrinthead(HEAD, ((EFFECTS[name], EFFECTS[name].example_values(HEAD)),))


def asked(line=PULSE, **options):
    return Request("q1", line.channel, line.initial_state, line.step_s, line.drive_V, **options)


@pytest.mark.parametrize("label", ["trapezoid-60V", "bipolar-full", "step"])
def test_a_head_whose_effects_are_off_is_recorded_as_one_without(label):
    line = LINES[label]
    exact_V, found_V = answer_V(HEAD, line), answer_V(AugmentedPrinthead(HEAD, ()), line)
    assert found_V == pytest.approx(exact_V, abs=2e-3 * np.abs(exact_V).max())


@pytest.mark.parametrize("channel", ["strain_gauge", "displacement"])
def test_slow_and_fast_sensors_of_a_head_with_effects_read_hysteretic_volts(channel):
    from inkjet_env.rig import displacement_battery, strain_gauge_battery

    battery = strain_gauge_battery() if channel == "strain_gauge" else displacement_battery(HEAD.frequency_Hz)
    line = battery[0]
    exact_V, found_V = answer_V(HEAD, line), answer_V(AugmentedPrinthead(HEAD, ()), line)
    assert found_V == pytest.approx(exact_V, abs=5e-3 * np.abs(exact_V).max())


def test_a_campaign_of_a_head_with_effects_shows_them():
    campaign = record_campaign(with_effect("second_mode"), 1, battery=[PULSE], snr_dB=60.0)
    signal_V = campaign.recordings[0].sensor
    plain_V, shown_V = answer_V(HEAD, PULSE), answer_V(with_effect("second_mode"), PULSE)
    assert np.std(signal_V - shown_V) < 0.01 * np.std(shown_V)
    assert np.std(signal_V - plain_V) > 10 * np.std(signal_V - shown_V)


def test_an_effect_that_grows_within_a_session_grows_from_recording_to_recording():
    head = with_effect("thermal_drift")
    campaign = record_campaign(head, 1, battery=[PULSE, LINES["trapezoid-80V"]] * 3, snr_dB=80.0)
    for recording in campaign.recordings:
        line = next(one for one in LINES.values() if np.array_equal(one.drive_V, recording.drive_V))
        there_V = answer_V(head, line, recording.order)
        assert np.std(recording.sensor - there_V) < 1e-3 * np.std(there_V)
    first, last = (answer_V(head, PULSE, order) for order in (1, 6))
    assert np.std(first - last) > 1e-3 * np.std(first)


def test_a_request_is_answered_with_signal_and_noise():
    rig = VirtualRig(HEAD, seed=3, snr_dB=50.0)
    recording = rig.record(asked(), 4)
    clean_V = respond_sampled(HEAD, PULSE.time_s, PULSE.drive_V, "periodic", ringing="steady").sensor_V
    largest_V = max(np.std(answer_V(HEAD, line)) for line in LINES.values())
    assert np.std(recording.sensor - clean_V) == pytest.approx(largest_V * 10 ** (-50 / 20), rel=0.1)
    assert (recording.name, recording.order, recording.channel) == ("q1", 4, "self_sensing")
    np.testing.assert_array_equal(recording.sensor, VirtualRig(HEAD, seed=3, snr_dB=50.0).record(asked(), 4).sensor)
    assert (recording.sensor != rig.record(asked(), 5).sensor).any()


def test_the_voltage_at_the_head_is_recorded_if_it_is_asked_for():
    slow = with_effect("amplifier_bandwidth")
    rig = VirtualRig(slow)
    assert rig.record(asked(), 1).drive_monitor_V is None
    monitor_V = rig.record(asked(drive_monitor=True), 1).drive_monitor_V
    excitation = excitation_of(slow, PULSE, 1)
    at_head_V = excitation.sampled(Plant(HEAD, effects=slow.effects).at_ceramic_V(excitation))
    assert np.std(monitor_V - at_head_V) == pytest.approx(5e-4 * np.abs(PULSE.drive_V).max(), rel=0.1)
    assert np.abs(at_head_V - PULSE.drive_V).max() > 0.05


def test_a_rig_says_what_its_driver_can_do():
    limits = DriverLimits(highest_V=48, lowest_V=0)
    assert VirtualRig(HEAD, limits=limits).limits() == limits


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"channel": "camera"}, "channel must be one of"),
        ({"initial_state": "free"}, "initial_state must be one of"),
        ({"drive_V": np.array([0.0, np.nan])}, "drive_V"),
    ],
)
def test_a_request_that_no_rig_can_answer_is_refused(change, said):
    usual = {"channel": "self_sensing", "initial_state": "periodic", "step_s": 1e-7, "drive_V": np.zeros(8)}
    with pytest.raises(ValueError, match=said):
        Request("q1", **(usual | change))

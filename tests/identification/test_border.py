"""What cannot be identified is refused in one sentence that names what is missing."""

from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.identification import UnidentifiableError, identify
from inkjet_env.printhead import Printhead, respond_sampled
from inkjet_env.recordings import Campaign, Recording
from inkjet_env.rig import record_campaign, strain_gauge_battery

HEAD = Printhead.published()
PULSE_V = np.interp(np.arange(400), [20, 35, 60, 75], [0, 80, 80, 0])


def campaign_of(*sensors, drive_V=PULSE_V, step_s=2e-7, channel="self_sensing", state="demagnetised"):
    time_s = step_s * np.arange(len(drive_V))
    recordings = [
        Recording(f"r{i}", time_s, drive_V, sensor, "V", channel, "arbitrary", state)
        for i, sensor in enumerate(sensors, start=1)
    ]
    return Campaign("lab", tuple(recordings))


def only(campaign, **labels):
    return replace(campaign, recordings=tuple(replace(r, repeat_of=None) for r in campaign.select(**labels)))


def test_what_never_moves_names_the_recording_needed_and_the_command_that_plans_it(published_campaign):
    with pytest.raises(UnidentifiableError, match=r"need a self_sensing or displacement .*inkjet record --plan FOLDER"):
        identify(only(published_campaign, excitation="zero"))


def test_drives_too_slow_to_ring_are_said_to_be():
    battery = [replace(line, channel="self_sensing") for line in strain_gauge_battery()]
    with pytest.raises(
        UnidentifiableError, match=r"these recordings show no ringing\. Record pulses .*inkjet record --plan FOLDER"
    ):
        identify(record_campaign(HEAD, 0, battery=battery))


def test_noise_alone_is_no_head():
    drive_V = 90 * np.sin(2 * np.pi * np.arange(1200) / 1200)
    rng = np.random.default_rng(0)
    noise = campaign_of(*rng.normal(0, 1e-3, (3, 1200)), drive_V=drive_V, step_s=1e-3, state="periodic")
    with pytest.raises(UnidentifiableError, match="these recordings show no ringing"):
        identify(noise)


def test_two_samples_are_refused_in_words():
    with pytest.raises(UnidentifiableError, match="has no recording to identify a0, a1 and b1 from"):
        identify(campaign_of([0.0, 1.0], drive_V=[0.0, 10.0]))


@pytest.mark.parametrize("state", ["demagnetised", "periodic", "free"])
@pytest.mark.parametrize("level_V", [0.0, 0.3])
def test_a_sensor_that_shows_one_value_is_taken_for_unconnected(level_V, state):
    with pytest.raises(UnidentifiableError, match="channel self_sensing is constant while the drive changes; is"):
        identify(campaign_of(np.full(400, level_V), state=state))


def test_a_strain_gauge_that_shows_one_value_is_named(published_campaign, changed):
    dead = changed(published_campaign, lambda r: 0 * r.sensor + 1.65 if r.channel == "strain_gauge" else r.sensor)
    with pytest.raises(ValueError, match="channel strain_gauge is constant while"):
        identify(dead)


def test_recordings_shorter_than_the_noise_remembers_are_left_out_and_said():
    rng, n = np.random.default_rng(0), 4000
    drive_V = np.interp(np.arange(n), [0, 20, 35, 60, 75], [0, 0, 80, 80, 0])

    def noise(samples):
        e = rng.normal(0, 1e-3, samples + 12)
        return sum(e[k : k + samples] for k in range(12))

    def recorded(name, drive_V):
        time_s = 2e-7 * np.arange(len(drive_V))
        sensor = respond_sampled(HEAD, time_s, drive_V, "demagnetised").sensor_V + noise(len(drive_V))
        return Recording(name, time_s, drive_V, sensor, "V", "self_sensing", initial_state="demagnetised")

    recordings = [recorded("a", drive_V), recorded("b", drive_V), recorded("brief", drive_V[15:23])]
    found = identify(Campaign("lab", tuple(recordings)), degree=2)
    assert next(iter(found.noise.values())).lost > 8
    assert any(note.startswith("brief: shorter than the memory of the noise") for note in found.notes)
    assert found.dynamics["a0"].value == pytest.approx(HEAD.a0, rel=1e-3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"degree": 0}, "degree must be 1 to 12; got 0"),
        ({"degree": 13}, "degree must be 1 to 12; got 13"),
        ({"full_scale_V": 0.0}, "full_scale_V must be a voltage of 1e-3 to 1e6 V; got 0.0"),
        ({"full_scale_V": float("nan")}, "full_scale_V must be a voltage"),
        ({"degree_rule": "flattenning"}, "degree_rule.*flattening"),
        ({"held_out": ["r999"]}, "held-out recording 'r999' is not in campaign"),
    ],
)
def test_options_out_of_range_are_refused(options, message, published_campaign):
    with pytest.raises(ValueError, match=message):
        identify(published_campaign, **options)

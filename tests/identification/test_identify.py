"""A head is found again from recordings of it, whatever instruments recorded it and however they were wired."""

import math
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.identification import identify, in_convention
from inkjet_env.identification.convention import conventional_swing
from inkjet_env.printhead import Printhead, respond_sampled
from inkjet_env.recordings import Campaign, Recording
from inkjet_env.rig import (
    Converter,
    SelfInduction,
    StrainGauge,
    Vibrometer,
    displacement_battery,
    record_campaign,
    self_sensing_battery,
    strain_gauge_battery,
)

PUBLISHED = Printhead.published()
X = np.linspace(0, 1, 201)


def at_scale(head, full_scale_V):
    """``b1`` and ``Q`` on `X` as by convention for another full scale than the head's own."""
    x = full_scale_V / head.full_scale_V
    factor = conventional_swing(full_scale_V) * x / float(head.branch_law.Q(x))
    return head.b1 / factor, factor * head.branch_law.Q(x * X) / x


def widths_off(estimate, value):
    """Distance of the truth from the estimate, in half widths of the 90 % interval."""
    return abs(estimate.value - value) / ((estimate.high - estimate.low) / 2)


def assert_found(found, head, largest=3.0, q_error=1e-3):
    b1, q = at_scale(head, found.printhead.full_scale_V)
    assert widths_off(found.dynamics["a0"], head.a0) < largest
    assert widths_off(found.dynamics["a1"], head.a1) < largest
    if "self_sensing" in found.gains:
        assert widths_off(found.dynamics["b1"], b1) < largest
    assert np.abs(found.printhead.branch_law.Q(X) - q).max() < q_error * q[-1]


def without(campaign, *channels):
    kept = tuple(replace(r, repeat_of=None) for r in campaign.recordings if r.channel not in channels)
    return replace(campaign, recordings=kept)


def same(a, b, rtol=1e-7):
    for name in ("a0", "a1"):
        assert a.dynamics[name].value == pytest.approx(b.dynamics[name].value, rel=rtol)
    np.testing.assert_allclose(a.printhead.branch_law.Q(X), b.printhead.branch_law.Q(X), atol=10 * rtol)


def few_lines(frequency_Hz):
    gauge = ("loop-1", "minor-loops", "zero")
    fast = ("trapezoid-60V", "bipolar-full", "bipolar-quiet", "multisine-50V-a", "pulse-pair-0.50T", "zero")
    battery = [line for line in strain_gauge_battery() if line.label in gauge]
    return battery + [line for line in self_sensing_battery(frequency_Hz) if line.label in fast]


@pytest.fixture(scope="module")
def few(other_head):
    """A few recordings of the other head: what shows in them shows in a whole campaign."""
    return record_campaign(other_head, 1, battery=few_lines(60e3), snr_dB=40)


@pytest.fixture(scope="module")
def few_found(few):
    return identify(few)


def test_the_published_head_is_found_with_its_degree(published_found):
    assert_found(published_found, PUBLISHED)
    assert published_found.printhead.full_scale_V == 180.0
    assert published_found.degree.by_flattening == len(published_found.printhead.coefficients) - 1 == 8
    assert any("p(r) is negative for x = |Δu|/180 V between 0.83" in note for note in published_found.notes)
    assert not any("the model is incomplete" in note for note in published_found.notes)


def test_another_head_is_found(other_found, other_head):
    assert_found(other_found, other_head)
    truth = in_convention(other_head)
    b1 = other_found.dynamics["b1"]
    assert abs(b1.value - truth.b1) < b1.high - b1.low  # two half-widths of a 90 % interval: 3.3 standard errors


def test_held_out_recordings_are_explained_to_their_noise(other_found):
    assert {r.channel for r in other_found.heldout} == {"strain_gauge", "self_sensing"}
    for recording in other_found.heldout:
        assert recording.rms() == pytest.approx(recording.noise_rms, rel=0.1)


def test_a_head_is_found_from_self_sensing_alone(other_campaign, other_head):
    found = identify(without(other_campaign, "strain_gauge"))
    assert_found(found, other_head, q_error=5e-3)
    assert any("Without a strain-gauge recording" in note for note in found.notes)


def test_displacement_alone_leaves_b1_to_convention_and_says_so(other_head):
    found = identify(record_campaign(other_head, 1, battery=displacement_battery(60e3), snr_dB=40))
    assert_found(found, other_head, q_error=3e-2)
    assert found.dynamics["b1"].value == math.sqrt(found.dynamics["a0"].value)
    assert any(note.startswith("b1, the gain of self-sensing, is not observable") for note in found.notes)
    assert found.unit("displacement") == "um"
    fit = found.fit_json()
    assert fit["channels"]["displacement"]["unit"] == "um"
    assert fit["noise_rms_V"] * found.gains["displacement"].value == fit["channels"]["displacement"]["noise_rms"]


def test_two_fast_channels_tell_more_than_either(other_head):
    both = record_campaign(
        other_head, 1, battery=self_sensing_battery(60e3)[:12] + displacement_battery(60e3), snr_dB=30
    )
    together = identify(both, degree=3)
    alone = [identify(without(both, channel), degree=3) for channel in ("self_sensing", "displacement")]
    for name in ("a0", "a1"):
        widths = [e.high - e.low for e in (each.dynamics[name] for each in (together, *alone))]
        assert widths[0] < min(widths[1:])
        assert widths_off(together.dynamics[name], getattr(other_head, name)) < 3


def test_gains_and_offsets_of_all_channels_are_found(other_head):
    gauge, vibrometer = StrainGauge(), Vibrometer(offset_um=0.023)
    battery = strain_gauge_battery() + self_sensing_battery(60e3)[:12] + displacement_battery(60e3)
    campaign = record_campaign(other_head, 2, battery=battery, strain_gauge=gauge, vibrometer=vibrometer, snr_dB=50)
    found = identify(campaign)
    assert_found(found, other_head)
    scale = other_head.b1 / in_convention(other_head).b1
    assert widths_off(found.gains["strain_gauge"], gauge.gain / scale) < 3
    assert widths_off(found.gains["displacement"], vibrometer.um_per_V / scale) < 3
    assert found.offsets["strain_gauge"] == pytest.approx(gauge.offset_V, abs=3e-4)
    assert found.offsets["displacement"] == pytest.approx(0.023, abs=3e-5)
    assert found.offsets["self_sensing"] == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize("channel", ["strain_gauge", "self_sensing"])
def test_a_sensor_wired_the_other_way_changes_the_sign_of_its_gain_alone(channel, few, few_found, changed):
    turned = changed(few, lambda r: -r.sensor if r.channel == channel else r.sensor)
    found = identify(turned)
    same(found, few_found)
    for each, gain in found.gains.items():
        sign = -1 if each == channel else 1
        assert gain.value == pytest.approx(sign * few_found.gains[each].value, rel=1e-7)
        assert gain.low < gain.value < gain.high


def test_a_thousandfold_signal_has_a_thousandfold_gain_and_nothing_else(few, few_found, changed):
    found = identify(changed(few, lambda r: 1000 * r.sensor))
    same(found, few_found)
    for channel, gain in found.gains.items():
        assert gain.value == pytest.approx(1000 * few_found.gains[channel].value, rel=1e-7)
        width = few_found.gains[channel].high - few_found.gains[channel].low
        assert gain.high - gain.low == pytest.approx(1000 * width, rel=1e-3)


def test_the_order_of_the_recordings_does_not_matter(few, few_found):
    found = identify(replace(few, recordings=few.recordings[::-1]))
    same(found, few_found)
    assert [r.name for r in found.heldout] == [r.name for r in few_found.heldout]
    assert found.misfit == pytest.approx(few_found.misfit, rel=1e-6)


def test_an_unknown_initial_state_is_fitted_along(other_head):
    rng = np.random.default_rng(0)
    recordings = []
    for i, level in enumerate((80, -60, 100, 40, -90, 70)):
        drive_V = np.interp(np.arange(1200), [50, 60, 100, 115, 160, 175], [0, level, level, -0.6 * level, 0, 0])
        time_s = 2e-7 * np.arange(1200)
        clean = respond_sampled(other_head, time_s, drive_V, "demagnetised").sensor_V
        ring = np.exp(-other_head.a1 / 2 * time_s) * np.cos(
            math.sqrt(other_head.a0 - other_head.a1**2 / 4) * time_s + rng.uniform(0, 6)
        )
        sensor = clean + rng.uniform(0.5, 2) * ring + rng.normal(0, 0.01, 1200)
        recordings.append(Recording(f"r{i}", time_s, drive_V, sensor, "V", "self_sensing", initial_state="free"))
    campaign = Campaign("free", tuple(recordings))
    found = identify(campaign, degree=4)
    assert_found(found, other_head, largest=3, q_error=2e-2)
    for recording in found.recordings:
        assert recording.rms() == pytest.approx(0.01, rel=0.15)
    resting = replace(campaign, recordings=tuple(replace(r, initial_state="demagnetised") for r in recordings))
    assert identify(resting, degree=4).heldout[0].rms() > 0.1


def test_a_campaign_without_noise_gives_the_head_to_many_digits():
    silent = record_campaign(
        PUBLISHED,
        1,
        battery=few_lines(PUBLISHED.frequency_Hz),
        strain_gauge=StrainGauge(converter=Converter(0.0, 3.3, None)),
        self_induction=SelfInduction(bits=None),
        snr_dB=math.inf,
    )
    found = identify(silent)
    assert found.degree.by_flattening == 8
    for name in ("a0", "a1", "b1"):
        assert found.dynamics[name].value == pytest.approx(getattr(PUBLISHED, name), rel=1e-6)
    np.testing.assert_allclose(found.printhead.branch_law.Q(X), PUBLISHED.branch_law.Q(X), atol=1e-6)


def test_a_shifted_drive_is_not_absorbed_but_said(few, changed):
    shifted = changed(few, lambda r: np.roll(r.sensor, 3) if r.channel == "self_sensing" else r.sensor)
    found = identify(shifted)
    assert found.misfit["self_sensing"] > 3
    assert any(note.startswith("self_sensing: the residual is") for note in found.notes)
    residual, noise = found.rms("self_sensing", held_out=True)
    assert residual > 3 * noise


def test_a_valid_density_is_kept_at_little_cost(few, few_found):
    found = identify(few, valid_density=True)
    law = found.printhead.branch_law
    assert law.curvature(np.linspace(0, 1, 2001)).min() > -1e-9
    assert law.slope(0.0) >= 0
    for channel, held_out in (("strain_gauge", False), ("self_sensing", True)):
        assert found.rms(channel, held_out)[0] < 1.05 * few_found.rms(channel, held_out)[0]


def test_the_given_degree_and_full_scale_are_used(few):
    found = identify(few, degree=6, full_scale_V=200.0)
    assert (len(found.printhead.coefficients) - 1, found.printhead.full_scale_V) == (6, 200.0)
    assert float(found.printhead.branch_law.Q(1.0)) == pytest.approx(conventional_swing(200.0))


def test_the_virgin_curve_alone_is_followed_to_its_end(other_head):
    # Half the full scale is the most that pulses of one sign ask of a demagnetised head: x = 2 u / F.
    rng = np.random.default_rng(0)
    recordings = []
    for i, level in enumerate((100, 60, 30, 80)):
        drive_V = np.interp(np.arange(1500), [20, 40, 80, 100], [0, level, level, 0])
        time_s = 2e-7 * np.arange(1500)
        clean = respond_sampled(other_head, time_s, drive_V, "demagnetised").sensor_V
        sensor = clean + rng.normal(0, 1e-3, 1500)
        recordings.append(
            Recording(f"r{i}", time_s, drive_V, sensor, "V", "self_sensing", initial_state="demagnetised")
        )
    found = identify(Campaign("pulses", tuple(recordings)), degree=8)
    assert found.printhead.full_scale_V == 200.0
    assert found.rms("self_sensing", held_out=False)[0] == pytest.approx(1e-3, rel=0.1)
    halved = identify(Campaign("pulses", tuple(recordings)), degree=8, full_scale_V=100.0)
    assert halved.rms("self_sensing", held_out=False)[0] > 2e-3


def test_in_convention_changes_no_answer(other_head):
    put = in_convention(Printhead(other_head.a0, other_head.a1, 3e4, (0.3, 0.2, 1.1, 0.0), 150.0))
    drive_V = np.random.default_rng(0).uniform(-80, 80, 50)
    before = respond_sampled(
        Printhead(other_head.a0, other_head.a1, 3e4, (0.3, 0.2, 1.1, 0.0), 150.0), 1e-6 * np.arange(50), drive_V
    )
    after = respond_sampled(put, 1e-6 * np.arange(50), drive_V)
    np.testing.assert_allclose(after.sensor_V, before.sensor_V, rtol=1e-10, atol=1e-12)
    assert float(put.branch_law.Q(1.0)) == pytest.approx(conventional_swing(150.0))
    again = in_convention(PUBLISHED)
    assert again.b1 == pytest.approx(PUBLISHED.b1, rel=1e-14)


def test_a_channel_that_was_only_recorded_at_rest_has_no_gain(few):
    kept = [r for r in few.recordings if r.channel == "self_sensing" or np.ptp(r.drive_V) == 0]
    found = identify(Campaign("at-rest", tuple(replace(r, repeat_of=None) for r in kept)))
    assert list(found.gains) == ["self_sensing"]


@pytest.mark.parametrize("truly", ["periodic", "demagnetised"])
def test_what_had_gone_before_recordings_of_unknown_state_is_asked(truly):
    """Drives of a kind whose answer tells whether they had been repeating: their hysteresis loop is closed or open."""
    rng, recordings, time_s = np.random.default_rng(1), [], 2e-7 * np.arange(1200)
    for i, (first, second) in enumerate(((80, -60), (-60, 0), (100, -100), (40, 0), (90, 90), (70, -20))):
        drive_V = np.interp(np.arange(1200), [50, 60, 100, 115, 160, 175], [0, first, first, second, second, 0])
        ringing = "steady" if truly == "periodic" else "rest"
        clean = respond_sampled(PUBLISHED, time_s, drive_V, truly, ringing=ringing).sensor_V
        sensor = clean + rng.normal(0, 0.002, 1200)
        recordings.append(Recording(f"r{i}", time_s, drive_V, sensor, "V", "self_sensing", initial_state="free"))
    (note,) = (n for n in identify(Campaign("free", tuple(recordings)), degree=8).notes if "initial state of" in n)
    assert ("set the initial state to periodic" in note) == (truly == "periodic"), note

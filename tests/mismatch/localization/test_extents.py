"""Every time and every frequency of a mismatch is told, the weak ones beside the strong, and none of noise."""

from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.mismatch import DiagnosisSettings
from inkjet_env.mismatch.fitting.base_parameters import Head
from inkjet_env.mismatch.fitting.campaign_noise import noise_seen
from inkjet_env.mismatch.fitting.dataset import observe
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.fitting.spikes import without_spikes
from inkjet_env.mismatch.localization.cells import Rows, background
from inkjet_env.mismatch.localization.extents import Extent, extents, merged
from inkjet_env.mismatch.localization.locate import locate
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign
from inkjet_env.rig.battery import self_sensing_battery
from inkjet_env.rig.record import record_campaign

SETTINGS = DiagnosisSettings()
HEAD = Printhead.published()
SAMPLES, CELLS = 1024, 64


def rows_of(residuals):
    """One recording of unit noise, which 10,000 samples have told."""
    ones = np.ones(residuals.size)
    zeros = np.zeros(residuals.size, np.intp)
    told = np.array([1e4])
    return Rows(
        residuals**2, ones, zeros, zeros, told, told, np.ones(1), False, np.ones(1), ones, SETTINGS.localization
    )


def told(residuals):
    edges = SAMPLES * np.arange(CELLS + 1) // CELLS
    return extents(rows_of(residuals), 0, edges, edges.astype(float))


def test_noise_has_no_extent():
    rng = np.random.default_rng(1)
    assert sum(bool(told(rng.standard_normal(SAMPLES))) for _ in range(200)) <= 16  # 5 %; more in 3 of 100 such tests


def test_a_short_and_a_weak_long_stretch_are_told_with_their_ends():
    noise = np.random.default_rng(2).standard_normal(SAMPLES)
    noise[64:80] *= 5
    noise[512:1024] *= 1.3  # no cell of 16 samples shows that by itself
    first, *others = told(noise)
    assert (first.low, first.high) == (64, 80)
    assert others[0].low == 512
    assert others[-1].high == 1024
    assert sum(one.high - one.low for one in others) > 0.8 * 512
    assert first.surplus == pytest.approx(16 * 24, rel=0.7)


def test_the_end_of_a_decay_is_left_out_below_a_tenth_of_its_amplitude():
    decay = 100 * np.exp(-np.arange(SAMPLES) / 100)
    (one,) = told(decay + np.random.default_rng(3).standard_normal(SAMPLES))
    assert one.low == 0
    assert one.high == pytest.approx(100 * np.log(10), abs=32)  # noise alone would show it for twice as long


def test_overlapping_stretches_become_one_and_the_largest_surplus_comes_first():
    found = merged([Extent(5.0, 6.0, 1.0), Extent(0.0, 2.0, 3.0), Extent(1.0, 3.0, 4.0), Extent(3.0, 4.0, 1.0)])
    assert found == [Extent(0.0, 4.0, 8.0), Extent(5.0, 6.0, 1.0)]


def test_a_spike_is_cut_down_and_what_lasts_is_not():
    noise = np.random.default_rng(4).standard_normal(SAMPLES)
    spiky, lasting = noise.copy(), noise.copy()
    spiky[500] = 40.0
    lasting[300:400] += 20 * np.sin(np.arange(100) / 3)
    assert np.abs(without_spikes(spiky)).max() < 8
    np.testing.assert_allclose(without_spikes(lasting)[310:390], lasting[310:390])


def test_the_background_of_a_spectrum_follows_its_shape_and_not_its_lines():
    rng = np.random.default_rng(5)
    red = 3 * np.convolve(rng.standard_normal(4096), np.ones(4) / 2, mode="same")
    tone = red + 20 * np.sin(2 * np.pi * 205 / 4096 * np.arange(4096))
    level = background(tone)
    assert np.all(level >= 1)
    assert level[20:100].mean() == pytest.approx(36, rel=0.4)
    assert level.mean() == pytest.approx(background(red).mean(), rel=0.1)  # the line has 400,000


@pytest.fixture(scope="module")
def found():
    """The location of two bursts in the drives of 60 V and more, one six times as large as the other."""
    battery = [line for line in self_sensing_battery(HEAD.frequency_Hz) if "multisine" not in line.label]
    plain = record_campaign(HEAD, 1, battery=battery, snr_dB=50.0)
    size = max(float(np.std(r.sensor)) for r in plain.recordings)

    def changed(r):
        if np.abs(r.drive_V).max() < 60:
            return r.sensor
        burst = np.zeros(r.sensor.size)
        for amplitude, frequency_Hz, low_s, high_s in ((0.06, 6e5, 8e-5, 1.4e-4), (0.01, 2.5e5, 2.2e-4, 2.8e-4)):
            inside = (r.time_s >= low_s) & (r.time_s < high_s)
            burst += amplitude * size * inside * np.sin(2 * np.pi * frequency_Hz * r.time_s)
        return r.sensor + burst

    head = Head(HEAD, {"self_sensing": HEAD.b1}, {"self_sensing": 0.0})
    before = observe(plain)
    residuals = {o.name: o.measured - head.plant().signal(o.excitation) for o in before}
    noise = noise_seen(before, residuals, {}, SETTINGS.fitting)
    after = observe(Campaign("bursts", tuple(replace(r, sensor=changed(r)) for r in plain.recordings)))
    joint = OutputErrorFit(after, noise, head, SETTINGS)
    return locate(joint.observed, joint.noise, joint.base, joint.basis[0], SETTINGS.localization)


def test_two_times_of_very_different_strength_are_both_told_strongest_first(found):
    assert found.time_s[0][0] == pytest.approx(8e-5, abs=1e-5)
    assert any(low <= 2.3e-4 and high >= 2.7e-4 for low, high in found.time_s)
    assert not any(low <= 1.9e-4 <= high for low, high in found.time_s)  # nothing differs between them
    assert sum(high - low for low, high in found.time_s) < 2e-4


def test_two_bands_of_very_different_strength_are_both_told_strongest_first(found):
    assert found.frequency_Hz[0][0] < 6e5 < found.frequency_Hz[0][1]
    assert any(low <= 2.5e5 <= high for low, high in found.frequency_Hz)
    assert not any(low <= 2e4 <= high for low, high in found.frequency_Hz)


def test_each_listed_recording_tells_its_own_times_and_bands(found):
    assert set(found.by_recording) <= set(found.recordings)
    assert len(found.by_recording) >= 3
    for times, bands in found.by_recording.values():
        assert any(low <= 9e-5 and high >= 1.1e-4 for low, high in times)
        assert any(low <= 6e5 <= high for low, high in bands)


def test_the_sentence_names_the_strongest_band_alone(found):
    assert "strongest at" in found.sentence
    assert len(found.sentence) < 250

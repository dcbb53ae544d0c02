"""Where what a model leaves is more than noise; mismatches are made by hand, not with the catalogue."""

import re
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.mismatch import DiagnosisSettings
from inkjet_env.mismatch.fitting.base_parameters import Head
from inkjet_env.mismatch.fitting.campaign_noise import Noise, noise_seen
from inkjet_env.mismatch.fitting.dataset import observe
from inkjet_env.mismatch.fitting.joint_fit import OutputErrorFit
from inkjet_env.mismatch.localization.cells import Cell, line_rows, sample_rows, surplus, taken_by_fit
from inkjet_env.mismatch.localization.drift import shifts
from inkjet_env.mismatch.localization.locate import _sentence, locate
from inkjet_env.mismatch.localization.views import phases, pulses
from inkjet_env.printhead import Printhead
from inkjet_env.recordings import Campaign
from inkjet_env.rig.battery import self_sensing_battery
from inkjet_env.rig.record import record_campaign

SETTINGS = DiagnosisSettings()

HEAD = Printhead.published()
NOTHING = "No residual exceeds the noise significantly."


def recorded(labels=None, printhead=HEAD, seed=1, snr_dB=50.0):
    battery = self_sensing_battery(HEAD.frequency_Hz)
    chosen = [line for line in battery if labels is None or line.label in labels]
    return record_campaign(printhead, seed, battery=chosen, snr_dB=snr_dB)


def fitted(campaign, noise=None):
    """The base model, begun at the true head, on a campaign."""
    observed = observe(campaign)
    head = Head(HEAD, {"self_sensing": HEAD.b1}, {"self_sensing": 0.0})
    if noise is None:
        for _ in range(2):
            residuals = {o.name: o.measured - head.plant().signal(o.excitation) for o in observed}
            noise = noise_seen(observed, residuals, {}, SETTINGS.fitting)
            head = OutputErrorFit(observed, noise, head, SETTINGS).base.head
    return OutputErrorFit(observed, noise, head, SETTINGS)


def located(campaign):
    joint = fitted(campaign)
    return locate(joint.observed, joint.noise, joint.base, joint.basis[0], SETTINGS.localization)


def with_sensor(campaign, changed):
    """The campaign with ``changed(recording)`` for the sensor's signals."""
    recordings = [replace(r, sensor=changed(r)) for r in campaign.recordings]
    return Campaign(campaign.name, tuple(recordings))


def level(campaign):
    return max(float(np.std(r.sensor)) for r in campaign.recordings)


@pytest.fixture(scope="module")
def campaign():
    return recorded()


@pytest.fixture(scope="module")
def small():
    """A joint fit of few short recordings, some held out."""
    labels = ("trapezoid-20V", "trapezoid-60V", "trapezoid-100V", "trapezoid-steep", "trapezoid-often", "bipolar-full",
              "pulse-pair-0.50T", "pulse-pair-3.25T", "step", "zero")  # fmt: skip
    joint = fitted(recorded(labels))
    assert {bool(o.fitted) for o in joint.observed} == {True, False}
    return joint


@pytest.fixture(scope="module")
def draw(small):
    """A function: what would be left of noise alone, of unit variance but for its own doubt, by an output-error fit."""
    columns = {o.name: small.noise.whitened(o, small.start.sensitivities(o)) for o in small.observed}
    seen = np.concatenate([columns[o.name][: o.fitted] for o in small.seen])
    size = np.linalg.norm(seen, axis=0)
    size[size == 0] = 1.0
    back = np.linalg.pinv(seen / size, rcond=1e-10)
    told = next(iter(small.noise.samples.values())) / 2

    def one(rng):
        noise = {}
        scale = np.sqrt(told / rng.chisquare(told))
        for o in small.observed:
            noise[o.name] = scale * rng.standard_normal(o.excitation.samples)
            noise[o.name][: small.noise.models[o.noise_key].lost] = 0.0
        step = back @ np.concatenate([noise[o.name][: o.fitted] for o in small.seen])
        return replace(small.base, residuals={n: noise[n] - (columns[n] / size) @ step for n in noise})

    return one


def test_what_all_recordings_show_together_and_none_alone_is_told_with_its_time(small):
    cell = Cell("time", "460 µs to 470 µs", 1.3, 4.2, (4.6e-4, 4.7e-4), "self_sensing")
    told = _sentence(small.observed, small.noise, small.base, [cell], [cell], [], [], [], SETTINGS.localization)
    assert told == (
        "The self-sensing signal differs from the model, but in no single recording significantly, "
        "460 to 470 µs after the start of the recordings."
    )


def test_noise_alone_is_pointed_at_in_five_of_a_hundred_campaigns_at_most(small, draw):
    rng = np.random.default_rng(1)
    found = [locate(small.observed, small.noise, draw(rng), small.basis[0], SETTINGS.localization) for _ in range(60)]
    assert sum(location.sentence != NOTHING for location in found) <= 6  # more in 3 of 100 such tests


def test_what_a_fit_takes_from_noise_and_adds_to_it_is_reckoned_with_exactly(small):
    columns = [small.noise.whitened(o, small.start.sensitivities(o)) for o in small.observed]
    taken = taken_by_fit(small.observed, small.noise, small.base, columns, small.basis[0])
    rows = sample_rows(small.observed, small.noise, small.base, taken, SETTINGS.localization)
    seen = np.concatenate([c[: o.fitted] for o, c in zip(small.observed, columns, strict=True)])
    size = np.linalg.norm(seen, axis=0)
    u, singular, vt = np.linalg.svd(seen / size, full_matrices=False)
    at = 0
    for i, (o, c) in enumerate(zip(small.observed, columns, strict=True)):
        error = (c / size) @ (vt.T / singular)  # of the fit, in orthonormal parts of the noise
        variance = 1.0 + np.sum(error**2, axis=1)
        if o.fitted:
            variance -= 2 * np.sum(error * u[at : at + o.fitted], axis=1)  # a sample has pulled the fit itself
        lost = small.noise.models[o.noise_key].lost
        np.testing.assert_allclose(rows.expected[rows.record == i][lost:], variance[lost:], atol=1e-9)
        at += o.fitted
    fitted_rows = np.isin(rows.record, [i for i, o in enumerate(small.observed) if o.fitted])
    assert rows.expected[fitted_rows].sum() < at - small.start.size + 1e-6


def test_lines_and_samples_reckon_alike(small):
    columns = [small.noise.whitened(o, small.start.sensitivities(o)) for o in small.observed]
    taken = taken_by_fit(small.observed, small.noise, small.base, columns, small.basis[0])
    samples = sample_rows(small.observed, small.noise, small.base, taken, SETTINGS.localization)
    lines = line_rows(small.observed, small.noise, small.base, taken, SETTINGS.localization)
    for i, o in enumerate(small.observed):
        mean = np.sum(small.base.residuals[o.name]) ** 2 / o.excitation.samples
        assert lines.power[lines.record == i].sum() == pytest.approx(samples.power[samples.record == i].sum() - mean)
        ends = [rows.expected[rows.record == i].sum() for rows in (lines, samples)]
        assert ends[0] == pytest.approx(ends[1] - 1, abs=1.0)  # the mean is no line


def test_surplus_is_fishers_distribution_on_a_normal_scale():
    from scipy.stats import f, norm

    for ratio, samples, told in ((1.3, 200, 5000), (1.05, 4000, 4000), (3.0, 12, 300), (0.8, 500, 1000)):
        assert surplus(ratio, samples, told) == pytest.approx(norm.isf(f.sf(ratio, samples, told)), abs=0.05)


def test_a_campaign_of_the_model_itself_is_pointed_at_nowhere(campaign):
    found = located(campaign)
    assert found.sentence == NOTHING
    assert (found.recordings, found.time_s, found.frequency_Hz, found.drive_V) == ((), (), (), ())
    assert {"recording", "time", "frequency", "amplitude", "slope", "sign", "pulse", "order", "distortion", "drift",
            "repeats", "time in the waveform"} == set(found.tables)  # fmt: skip


def test_a_foreign_ring_is_found_at_its_frequency_and_in_its_time(campaign):
    size = 0.03 * level(campaign)

    def changed(r):
        if r.excitation in ("zero", "multisine"):
            return r.sensor
        after = r.time_s - r.time_s[np.argmax(np.abs(r.drive_V) > 0)]
        ring = np.exp(-np.maximum(after, 0) / 3e-5) * np.sin(2 * np.pi * 170e3 * after)
        return r.sensor + size * np.abs(r.drive_V).max() / 100 * np.where(after > 0, ring, 0.0)

    found = located(with_sensor(campaign, changed))
    assert any(low <= 170e3 <= high for low, high in found.frequency_Hz)
    assert max(high for _, high in found.frequency_Hz) < 300e3
    assert found.time_s[0][0] < 1e-5
    assert max(high for _, high in found.time_s) < 1.1e-4  # a tenth of the amplitude after 70 µs
    assert "self-sensing" in found.sentence
    assert "with the drive" in found.sentence


def test_one_recording_that_is_scaled_is_found_alone(campaign):
    name = next(r.name for r in campaign.recordings if np.abs(r.drive_V).max() == 40)
    found = located(with_sensor(campaign, lambda r: r.sensor * (1.04 if r.name == name else 1.0)))
    assert found.recordings[0] == name
    assert len(found.recordings) <= 3
    assert found.drive_V == ((40.0, 40.0),)
    assert any(low < HEAD.frequency_Hz < high for low, high in found.frequency_Hz)


def test_even_distortion_is_found_on_even_lines(campaign):
    size = level(campaign)
    found = located(with_sensor(campaign, lambda r: r.sensor + 0.003 * r.sensor**2 / size))
    rows = {label: power for label, power, _ in found.tables["distortion"]}
    even, odd = rows["even multiples of the repetition rate"], rows["odd multiples of the repetition rate"]
    assert even > 2
    assert odd < 1.2
    assert "even multiples" in found.sentence
    assert found.drive_V[0][1] == 100


def test_what_comes_with_the_edges_is_found_on_them(campaign):
    size = 0.003 * level(campaign)
    found = located(with_sensor(campaign, lambda r: r.sensor + size * np.gradient(r.drive_V) / 5))
    rows = {label: power for label, power, _ in found.tables["time in the waveform"]}
    assert rows["on the edges"] - 1 > 10 * abs(rows["in the ring-down"] - 1)
    assert "on the edges" in found.sentence


def test_a_resonance_that_wanders_through_the_session_is_told_with_its_amount():
    plain = recorded(snr_dB=50.0)
    recordings = []
    for r in plain.recordings:
        share = (r.order - 1) / (len(plain.recordings) - 1)
        other = recorded(printhead=HEAD.varied(frequency_Hz=HEAD.frequency_Hz * (1 - 0.004 * share)))
        recordings.append(replace(r, sensor=next(s.sensor for s in other.recordings if s.name == r.name)))
    joint = fitted(Campaign(plain.name, tuple(recordings)))
    columns = [joint.noise.whitened(o, joint.base.head.sensitivities(o)) for o in joint.observed]
    moved = shifts(joint.observed, joint.noise, joint.base, columns)
    first, last = (moved[name][0] for name in (recordings[2].name, recordings[-3].name))
    away = last[0] - first[0]
    assert away == pytest.approx(-0.004 * (len(recordings) - 5) / (len(recordings) - 1), rel=0.25)
    found = locate(joint.observed, joint.noise, joint.base, joint.basis[0], SETTINGS.localization)
    told = re.search(r"as if the resonance frequency fell by (.*) % from the first to the last", found.sentence)
    assert float(told.group(1)) == pytest.approx(0.4, abs=0.03)


def test_unknown_noise_is_told_and_a_concentrated_mismatch_still_found(campaign):
    name = next(r.name for r in campaign.recordings if r.excitation == "bipolar")
    joint = fitted(with_sensor(campaign, lambda r: r.sensor * (1.1 if r.name == name else 1.0)))
    unknown = Noise(joint.noise.models, dict.fromkeys(joint.noise.samples, 0))
    found = locate(joint.observed, unknown, joint.base, joint.basis[0], SETTINGS.localization)
    assert found.recordings[0] == name
    assert "the noise is unknown" in found.sentence
    joint = fitted(campaign)
    unknown = Noise(joint.noise.models, dict.fromkeys(joint.noise.samples, 0))
    assert locate(joint.observed, unknown, joint.base, joint.basis[0], SETTINGS.localization).sentence == NOTHING


def test_a_basis_of_other_recordings_is_refused(small):
    with pytest.raises(ValueError, match="q must have a row for each fitted sample"):
        locate(small.observed, small.noise, small.base, small.basis[0][:-1], SETTINGS.localization)


def test_a_drive_is_cut_at_its_edges_and_pulses():
    campaign = recorded(("pulse-pair-3.25T", "multisine-25V-a", "zero"))
    by = {o.name: o for o in observe(campaign)}
    of = {r.excitation: by[r.name] for r in campaign.recordings}
    pair = of["pulse_pair"]
    drive = pair.excitation.drive_V
    assert np.array_equal(phases(pair, SETTINGS.localization) == 0, np.diff(drive, prepend=drive[-1]) != 0)
    assert np.all(drive[phases(pair, SETTINGS.localization) == 1] != 0)
    assert np.all(drive[phases(pair, SETTINGS.localization) == 2] == 0)
    assert set(pulses(pair, SETTINGS.localization)) == {-1, 0, 1}
    assert drive[pulses(pair, SETTINGS.localization) == 0].max() == 80
    assert drive[pulses(pair, SETTINGS.localization) == 1].max() == 60
    assert set(phases(of["multisine"], SETTINGS.localization)) == {3}
    assert set(phases(of["zero"], SETTINGS.localization)) == {4}

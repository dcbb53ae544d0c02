"""The mean error of a coarse converter."""

from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.experiments.validation.diagnosis_study import Case, recorded
from inkjet_env.mismatch import DiagnosisSettings, diagnose
from inkjet_env.mismatch.fitting.campaign_noise import noise_seen
from inkjet_env.mismatch.fitting.dataset import ObservedRecording, observe
from inkjet_env.mismatch.fitting.rounding import coarse_notes, rounding_error, without_rounding
from inkjet_env.plant import Excitation, catalogue

SETTINGS = DiagnosisSettings().fitting
SAMPLES = 4000


@pytest.mark.parametrize("sigma", [0.1, 0.2, 0.35])
def test_it_is_a_smoothed_sawtooth(sigma):
    step, origin, signal = 0.7, 0.3, np.linspace(-3, 3, 501)
    harmonics = np.arange(1, 60)[:, None]
    falls = (-1.0) ** harmonics * step / (np.pi * harmonics) * np.exp(-2 * (np.pi * harmonics * sigma) ** 2)
    series = np.sum(falls * np.sin(2 * np.pi * harmonics * (signal - origin) / step), axis=0)
    np.testing.assert_allclose(rounding_error(signal, step, origin, sigma * step), series, atol=1e-12)


def test_it_is_what_a_converter_does_on_average():
    rng, signal = np.random.default_rng(0), np.linspace(-1, 1, 41)
    noisy = signal + 0.2 * rng.standard_normal((20000, 41))
    np.testing.assert_allclose(rounding_error(signal, 1.0, 0.0, 0.2), np.round(noisy).mean(axis=0) - signal, atol=0.01)


def recordings(step, sigma=0.2, floor=False, coarser=()):
    """Two repeats of each of three slow sines and a recording at rest, with their true signals."""
    rng, observed, true = np.random.default_rng(1), [], {}
    for k in range(7):
        drive_V = np.zeros(SAMPLES) if k == 6 else 20.0 * np.sin(2 * np.pi * np.arange(SAMPLES) / SAMPLES)
        name, signal = f"r{k}", 0.31 + drive_V * (0.1, 0.05, 0.02, 0.0)[k // 2]
        step_here = step * (2 if k in coarser else 1)
        noisy = signal + sigma * rng.standard_normal(SAMPLES)
        told = step_here * (np.floor(noisy / step_here) if floor else np.round(noisy / step_here))
        excitation = Excitation("strain_gauge", "periodic", 1e-3, drive_V, k + 1)
        observed.append(ObservedRecording(name, "strain_gauge", "V", k // 2, excitation, told, SAMPLES))
        true[name] = signal - (step / 2 if floor else 0)
    residuals = {o.name: o.measured - true[o.name] for o in observed}
    return observed, true, noise_seen(observed, residuals, {}, SETTINGS)


@pytest.mark.parametrize("floor", [False, True])
def test_what_it_leaves_of_a_slow_signal_is_noise(floor):
    observed, true, noise = recordings(1.0, floor=floor)
    after = without_rounding(observed, true, noise, SETTINGS)
    means = [[np.mean((o.measured - true[o.name]).reshape(-1, 200), axis=1) for o in of] for of in (observed, after)]
    assert np.std(means[0]) > 1.8 * np.std(means[1])
    independent = np.sqrt(np.mean([np.var(o.measured - true[o.name]) for o in after]) / 200)
    # The floor leaves twice that: near the middle of its step, the noise before it is underrated, 0.14 for 0.2.
    assert np.std(means[1]) < (2.2 if floor else 1.1) * independent
    for o, was in zip(after, observed, strict=True):
        np.testing.assert_allclose(o.told, was.measured, atol=1e-12)
        assert np.mean((o.measured - true[o.name]) ** 2) < np.mean((was.measured - true[o.name]) ** 2)


def test_a_second_time_replaces_the_first():
    observed, true, noise = recordings(1.0)
    once = without_rounding(observed, {name: signal + 0.1 for name, signal in true.items()}, noise, SETTINGS)
    twice, direct = (without_rounding(of, true, noise, SETTINGS) for of in (once, observed))
    for one, other in zip(twice, direct, strict=True):
        np.testing.assert_allclose(one.measured, other.measured, atol=1e-12)


def test_where_noise_hides_the_steps_nothing_is_touched():
    observed, true, noise = recordings(0.3)
    assert without_rounding(observed, true, noise, SETTINGS) == tuple(observed)


def test_steps_that_leave_nothing_but_the_moments_of_their_change_are_told():
    (note,) = coarse_notes(*recordings(1.0, sigma=0.08)[::2], SETTINGS)
    assert note.startswith("strain_gauge: the converter's step is more than 7 times the noise before it.")
    assert coarse_notes(*recordings(1.0)[::2], SETTINGS) == ()


def test_a_recording_of_another_range_and_values_off_any_grid_are_left_alone():
    observed, true, noise = recordings(1.0, coarser=(0,))
    assert [o.rounding is None for o in without_rounding(observed, true, noise, SETTINGS)] == [True] + [False] * 6
    smooth = [replace(o, measured=true[o.name] + np.sin(np.arange(SAMPLES))) for o in observed]
    assert without_rounding(smooth, true, noise, SETTINGS) == tuple(smooth)


def test_slow_recordings_of_a_converter_of_five_noises_a_step_show_no_ageing():
    campaign, _ = recorded(Case("noise", (), "rounded", 122))  # without the correction: generator steps, or creep
    found = diagnose(campaign, effects=[e for e in catalogue() if e.id in ("creep", "generator_steps")], workers=1)
    assert (found.verdict, found.effects) == ("none", ()), found.headline
    for recording, told in zip(found.recordings, observe(campaign), strict=True):
        np.testing.assert_allclose(recording.measured, told.measured, atol=1e-9)

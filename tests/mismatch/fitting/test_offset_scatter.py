"""Offsets that scatter from recording to recording: found, weighed, and absent where the spectrum explains them."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from inkjet_env.mismatch import DiagnosisSettings
from inkjet_env.mismatch.fitting.campaign_noise import noise_seen
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.plant import Excitation

FITTING = DiagnosisSettings().fitting
STEP_S, SAMPLES, RMS = 0.01, 1000, 0.02


def campaign(rng, scatter, recordings=12, memory=0.0):
    """A slow channel: two recordings at rest, others driven, white noise or one with a memory, and offsets."""
    observed, residuals = [], {}
    for k in range(recordings):
        noise = RMS * rng.standard_normal(SAMPLES)
        for i in range(1, SAMPLES if memory else 0):
            noise[i] += memory * noise[i - 1]
        drive_V = np.zeros(SAMPLES) if k < 2 else 10.0 * k * np.sin(2 * np.pi * np.arange(SAMPLES) / SAMPLES)
        name = f"r{k}"
        residuals[name] = noise + scatter * rng.standard_normal()
        excitation = Excitation("strain_gauge", "demagnetised", STEP_S, drive_V, k + 1)
        observed.append(ObservedRecording(name, "strain_gauge", "V", k, excitation, residuals[name], SAMPLES))
    return observed, residuals, noise_seen(observed, residuals, {}, FITTING)


def test_the_scatter_of_offsets_is_found():
    found = [campaign(np.random.default_rng(seed), 0.01)[2].offsets["strain_gauge"] for seed in range(10)]
    assert np.mean(found) == pytest.approx(0.01, rel=0.15)


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_offsets_that_the_spectrum_explains_do_not_scatter(memory):
    """With a memory of ten samples, means scatter by ten times what the rms alone would give them: 6 mV."""
    found = [campaign(np.random.default_rng(seed), 0.0, memory=memory)[2].offsets for seed in range(10)]
    assert sum(bool(offsets) for offsets in found) <= 1


def test_whitening_and_likelihood_are_those_of_the_covariance():
    observed, residuals, noise = campaign(np.random.default_rng(1), 0.01)
    o = observed[5]
    model = noise.models[o.noise_key]
    assert (model.coefficients.size, model.bands) == (1, ())
    covariance = model.innovation**2 * np.eye(SAMPLES) + noise.offsets["strain_gauge"] ** 2
    white = noise.whitened(o, residuals[o.name])
    exact = multivariate_normal(np.zeros(SAMPLES), covariance).logpdf(residuals[o.name])
    here = -0.5 * white @ white - SAMPLES * (noise.log_scale(o) + 0.5 * np.log(2 * np.pi))
    assert here == pytest.approx(exact, rel=1e-9)
    table = np.column_stack([residuals[o.name], np.ones(SAMPLES)])
    np.testing.assert_allclose(noise.whitened(o, table)[:, 0], white, rtol=1e-12, atol=1e-12)


def test_a_shape_within_a_recording_is_not_touched():
    _, _, noise = campaign(np.random.default_rng(1), 0.01)
    observed, _, plain = campaign(np.random.default_rng(1), 0.0)
    shape = np.sin(2 * np.pi * np.arange(SAMPLES) / SAMPLES)
    now, before = (np.linalg.norm(n.whitened(observed[5], shape)) for n in (noise, plain))
    assert now == pytest.approx(before, rel=0.05)


def test_proposed_recordings_of_one_name_may_differ_in_length():
    """Proposals of a next experiment are all called "next"."""
    _, _, noise = campaign(np.random.default_rng(1), 0.01)
    for samples in (SAMPLES, SAMPLES // 3, SAMPLES):
        excitation = Excitation("strain_gauge", "demagnetised", STEP_S, np.zeros(samples), -1)
        o = ObservedRecording("next", "strain_gauge", "V", -1, excitation, np.zeros(samples), samples)
        constant = noise.whitened(o, np.ones(samples))
        variance = noise.models[o.noise_key].innovation ** 2 / samples + noise.offsets["strain_gauge"] ** 2
        assert constant @ constant == pytest.approx(1 / variance, rel=1e-6)

"""Evidence from recordings that no fit has seen: the exact likelihood, the parts, and noise alone."""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.stats import multivariate_normal

from inkjet_env.identification.noise import NoiseModel
from inkjet_env.identification.noise_bands import Band
from inkjet_env.mismatch import DiagnosisSettings
from inkjet_env.mismatch.fitting.campaign_noise import Noise
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.mismatch.selection.amplitude_likelihood import amplitudes_of, noise_alone_nll
from inkjet_env.mismatch.selection.random_effects import _without_trend
from inkjet_env.mismatch.selection.split_likelihood import ExactNoise, gain_on_unseen, halves, parts_of
from inkjet_env.plant import Excitation

SELECTION = DiagnosisSettings().selection
STEP_S = 1e-6


def recordings(count, samples):
    drives_V = [np.where(np.arange(samples) < 50, 10.0 * k, 0.0) for k in range(count)]
    return [
        ObservedRecording(
            f"r{k}", "self_sensing", "V", k, Excitation("self_sensing", "periodic", STEP_S, d, k + 1), d, samples
        )
        for k, d in enumerate(drives_V)
    ]


def memory(rng, samples, time):
    row = rng.standard_normal(samples)
    for k in range(1, samples):
        row[k] = np.exp(-1 / time) * row[k - 1] + np.sqrt(1 - np.exp(-2 / time)) * row[k]
    return row


def test_the_likelihood_is_that_of_the_covariance_written_out():
    (o,) = recordings(1, 120)
    model = NoiseModel(np.array([1.0, -0.4]), 0.5, 1.0, "a test", (Band(0.0, 40.0, 2.0), Band(0.2, 20.0, 1.0)))
    level = np.linspace(1, 2, 120)
    noise = ExactNoise({o.noise_key: model}, {o.noise_key: 120}, levels={o.name: level})
    residual = np.random.default_rng(0).standard_normal(120)
    covariance = np.outer(level, level) * toeplitz(model.autocovariance(120))
    expected = -multivariate_normal(np.zeros(120), covariance).logpdf(residual) - 60 * np.log(2 * np.pi)
    assert noise_alone_nll([o], {o.name: residual}, noise) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("walk", [0.0, 1.0])
def test_the_gain_of_random_amplitudes_is_that_of_the_covariance_written_out(walk, effects):
    """Of white noise: amplitudes of one variance."""
    (o,) = recordings(1, 60)
    effect, values = effects["baseline_drift"], {"amplitude": 1.0, "degree": 2.0, "walk": walk}
    noise = ExactNoise({o.noise_key: NoiseModel(np.ones(1), 1.0, 1.0, "a test")}, {o.noise_key: 60})
    columns = effect.random_effect_basis(values, o.excitation)
    residual = columns[:, :3] @ [3.0, -2.0, 1.0] + np.random.default_rng(2).standard_normal(60)
    found = amplitudes_of(effect, values, [o], {o.name: residual}, noise)
    for variance in (0.1, 1.0, found.variance):
        covariance = np.eye(60) + variance * columns @ columns.T
        gain = multivariate_normal(np.zeros(60), covariance).logpdf(residual)
        gain -= multivariate_normal(np.zeros(60), np.eye(60)).logpdf(residual)
        assert found.gain(variance) == pytest.approx(gain, rel=1e-6)
    assert found.gain(found.variance) >= max(found.gain(0.9 * found.variance), found.gain(1.1 * found.variance)) - 0.01


@pytest.mark.parametrize(
    ("count", "samples", "highest_Hz"), [(8, 2000, 0.0), (8, 2000, 1e5), (1, 2000, 1e5), (2, 300, 0.0)]
)
def test_parts_are_short_and_hold_all_samples(count, samples, highest_Hz):
    observed = recordings(count, samples)
    rng = np.random.default_rng(1)
    residuals = {o.name: rng.standard_normal(samples) for o in observed}
    noise = Noise({}, {}, levels={o.name: np.full(samples, 2.0) for o in observed})
    parts, own, theirs = parts_of(observed, residuals, noise, highest_Hz, SELECTION)
    assert len(parts) >= SELECTION.split_recordings
    assert max(o.excitation.samples for o in parts) <= SELECTION.longest_part
    for o in observed:
        mine = [p for p in parts if p.name.startswith(f"{o.name} ")]
        seconds = sum(p.excitation.samples * p.excitation.step_s for p in mine)
        assert seconds == pytest.approx(samples * STEP_S, rel=0.01)
        mean = np.mean(np.concatenate([own[p.name] for p in mine]))
        assert mean == pytest.approx(residuals[o.name].mean(), abs=1e-2)
        assert all(np.all(theirs.levels[p.name] == 2.0) for p in mine)


def test_halves_share_the_amplitudes():
    first, second = halves(recordings(8, 200))
    assert {o.name for o in first} & {o.name for o in second} == set()
    sizes = [np.mean([o.excitation.drive_V.max() for o in half]) for half in (first, second)]
    assert sizes[0] == pytest.approx(sizes[1], rel=0.35)


@pytest.mark.parametrize("time", [20.0, 60.0, 150.0])
@pytest.mark.parametrize(("name", "walk"), [("mains_hum", 0.0), ("baseline_drift", 0.0), ("baseline_drift", 1.0)])
def test_noise_with_a_memory_gains_nothing_from_a_hum_or_a_drift(name, walk, time, effects):
    """The smaller likelihood ratio of two halves is above 20 at most once in 20 campaigns: here, in none of 18.

    A tone is looked for in what a polynomial leaves, as in a diagnosis.
    """
    values = {
        "mains_hum": {"frequency_Hz": 4000.0, "multiples": 1.0, "amplitude": 1.0},
        "baseline_drift": {"amplitude": 1.0, "degree": 4.0, "walk": walk},
    }[name]
    for seed in range(3):
        rng = np.random.default_rng([seed, int(time)])
        observed = recordings(12, 1000)
        noisy = [0.7 * rng.standard_normal(1000) + 0.7 * memory(rng, 1000, time) for _ in observed]
        if name == "mains_hum":
            noisy = [_without_trend(row, SELECTION.hum_trend) for row in noisy]
        residuals = {o.name: row for o, row in zip(observed, noisy, strict=True)}
        highest_Hz = 4000.0 if name == "mains_hum" else 0.0
        parts, own, noise = parts_of(observed, residuals, Noise({}, {}), highest_Hz, SELECTION)
        first, second = halves(parts)
        gains = [gain_on_unseen(effects[name], values, a, b, own, noise, SELECTION)
                 for a, b in ((first, second), (second, first))]  # fmt: skip
        assert min(gains) < np.log(20)

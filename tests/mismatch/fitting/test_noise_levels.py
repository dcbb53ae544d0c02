"""Noise that is not equally loud everywhere, told from a mismatch."""

from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.mismatch import DiagnosisSettings
from inkjet_env.mismatch.fitting.campaign_noise import noise_seen
from inkjet_env.mismatch.fitting.dataset import ObservedRecording
from inkjet_env.plant import Excitation

FITTING = DiagnosisSettings().fitting
STEP_S, SAMPLES, RMS = 4e-7, 2000, 0.02
RINGING = 5 * np.exp(-np.arange(SAMPLES) / 300) * np.sin(2 * np.pi * np.arange(SAMPLES) / 50)


def campaign(noise, mismatch=0.0, recordings=10):
    """Two recordings at rest, and others that ring; the model is right but for a share of the signal."""
    observed, residuals = [], {}
    for k in range(recordings):
        rest = k < 2
        signal = np.zeros(SAMPLES) if rest else (0.4 + 0.1 * k) * RINGING
        left = noise(k, signal) + mismatch * signal
        drive_V = np.zeros(SAMPLES) if rest else 10.0 * k * (np.arange(SAMPLES) < 100)
        excitation = Excitation("self_sensing", "periodic", STEP_S, drive_V, k + 1)
        name = f"r{k}"
        observed.append(ObservedRecording(name, "self_sensing", "V", k, excitation, signal + left, SAMPLES))
        residuals[name] = left
    return observed, noise_seen(observed, residuals, {}, FITTING)


def white(rng, factor=1.0):
    return RMS * factor * rng.standard_normal(SAMPLES)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("mismatch", [0.0, 0.02, 0.1])
def test_a_mismatch_is_no_louder_noise(seed, mismatch):
    """Up to 25 times as loud as the noise where the signal is largest."""
    rng = np.random.default_rng(seed)
    _, noise = campaign(lambda k, signal: white(rng), mismatch)
    assert noise.levels == {}


def test_the_level_of_each_recording_is_found():
    rng = np.random.default_rng(10)
    factors = np.exp(0.5 * rng.standard_normal(10))
    observed, noise = campaign(lambda k, signal: white(rng, factors[k]))
    found = np.array([noise.rms(o) for o in observed]) / RMS
    np.testing.assert_allclose(found, factors, rtol=0.12)


def test_noise_that_grows_with_the_signal_is_found():
    rng = np.random.default_rng(11)

    def noise_of(k, signal):
        return white(rng) * np.sqrt(1 + 4 * (signal / 6) ** 2)

    observed, noise = campaign(noise_of)
    whitened = np.concatenate([noise.whitened(o, o.measured - modelled(o)) for o in observed[2:]])
    loud = np.concatenate([np.abs(modelled(o)) > 3 for o in observed[2:]])
    assert np.std(whitened[loud]) == pytest.approx(1.0, abs=0.15)
    assert np.std(whitened[~loud]) == pytest.approx(1.0, abs=0.1)


def modelled(o):
    k = o.condition
    return (0.4 + 0.1 * k) * RINGING


def test_noise_hidden_by_a_converter_at_rest_is_louder_otherwise():
    rng = np.random.default_rng(12)
    observed, noise = campaign(lambda k, signal: white(rng, 0.3 if k < 2 else 1.0))
    at_rest, otherwise = noise.rms(observed[0]), noise.rms(observed[5])
    assert otherwise / at_rest == pytest.approx(1 / 0.3, rel=0.1)


def test_heavy_tails_are_measured():
    rng = np.random.default_rng(13)
    _, plain = campaign(lambda k, signal: white(rng))
    _, heavy = campaign(lambda k, signal: RMS * rng.standard_t(5, SAMPLES))
    assert plain.tails["self_sensing"] == pytest.approx(1.0, abs=0.15)
    assert heavy.tails["self_sensing"] > 2


@pytest.mark.parametrize(("repeats", "rest"), [(2, 0), (4, 0), (2, 1), (5, 3)])
def test_the_doubt_of_the_level_is_that_of_what_it_was_estimated_from(repeats, rest):
    """The second way: the scatter, over campaigns, of the residuals' power relative to the estimated level."""
    excess, told = [], []
    for seed in range(60):
        rng, observed, residuals = np.random.default_rng([20, seed]), [], {}
        for k in range(repeats + rest + 6):
            signal = np.zeros(SAMPLES) if k < rest else RINGING
            drive_V = 10.0 * (k >= rest) * (np.arange(SAMPLES) < 100)
            residuals[f"r{k}"] = white(rng)
            excitation = Excitation("self_sensing", "periodic", STEP_S, drive_V, k + 1)
            condition = k if k < rest else rest if k < rest + repeats else k
            measured = signal + residuals[f"r{k}"]
            observed.append(ObservedRecording(f"r{k}", "self_sensing", "V", condition, excitation, measured, SAMPLES))
        noise = noise_seen(observed, residuals, {}, FITTING)
        assert noise.samples["self_sensing", STEP_S] == SAMPLES * (repeats - 1 + rest)
        others = [o for o in observed if o.condition > rest]
        power = sum(float(np.sum(noise.whitened(o, residuals[o.name]) ** 2)) for o in others)
        excess.append(power - SAMPLES * len(others))
        told.append(noise.doubt(others))
    assert np.std(excess) == pytest.approx(np.mean(told), rel=0.3)


def test_a_borrowed_model_brings_no_samples_of_its_own():
    rng = np.random.default_rng(21)
    (o, *_), noise = campaign(lambda k, signal: white(rng))
    (key,) = noise.models
    lent = (key[0], 2 * key[1])
    other = replace(o, excitation=replace(o.excitation, step_s=lent[1], cache={}))
    borrowing = replace(
        noise,
        models=dict(noise.models) | {lent: noise.models[key]},
        samples=dict(noise.samples) | {lent: noise.samples[key]},
        borrowed={lent: key},
    )
    assert other.noise_key == lent
    assert borrowing.doubt([o, other]) == noise.doubt([o, o])

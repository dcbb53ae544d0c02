"""Noise with a memory: its spectrum, its autocovariance, and its power found again."""

import numpy as np
import pytest

from inkjet_env.experiments.validation.noise_zoo import exponential_memory
from inkjet_env.identification.noise import NoiseModel, channel_noise
from inkjet_env.identification.noise_bands import Band, band_powers, band_shape

BANDS = [Band(0.0, 30.0, 1.0), Band(0.1, 80.0, 2.0)]


@pytest.mark.parametrize("band", BANDS)
def test_the_shape_of_a_band_has_unit_variance(band):
    cycles = np.fft.fftfreq(100_000)
    assert band_shape(cycles, band).mean() == pytest.approx(1.0, rel=1e-6)


def test_a_band_at_zero_frequency_is_an_autoregression_of_the_first_order():
    cycles, keep = np.linspace(0, 0.5, 50), np.exp(-1 / 30.0)
    first_order = (1 - keep**2) / np.abs(1 - keep * np.exp(-2j * np.pi * cycles)) ** 2
    np.testing.assert_allclose(band_shape(cycles, BANDS[0]), first_order, rtol=1e-12)


def test_autocovariance_and_spectrum_are_each_others_transform():
    model = NoiseModel(np.array([1.0, -0.5, 0.2]), 0.3, 1.0, "a test", tuple(BANDS))
    n = 4096
    covariance = model.autocovariance(n)
    both_sides = np.concatenate([covariance, covariance[-2:0:-1]])
    power = np.fft.fft(both_sides).real
    cycles = np.abs(np.fft.fftfreq(both_sides.size))[1:n]
    np.testing.assert_allclose(power[1:n], model.spectrum(cycles, 1.0) / 2, rtol=1e-4)


def test_the_autocovariance_of_a_first_order_autoregression_is_its_closed_form():
    model = NoiseModel(np.array([1.0, -0.9]), 2.0, 1.0, "a test")
    np.testing.assert_allclose(model.autocovariance(50), 4.0 / (1 - 0.81) * 0.9 ** np.arange(50), rtol=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_a_memory_is_found_at_its_power(seed):
    """White noise and one memory: on the lowest lines, the model has the power of a hundred other stretches."""
    law = exponential_memory(np.random.default_rng(seed))
    rng = np.random.default_rng([seed, 1])

    def stretch():
        return law.row(rng, np.zeros(2000), 1.0)

    (model,) = channel_noise({1e-6: [stretch() for _ in range(6)]}, {1e-6: "a test"}, 1e-9).values()
    power = np.mean([np.abs(np.fft.rfft(stretch())) ** 2 / 2000 for _ in range(100)], axis=0)
    modelled = model.innovation**2 * model.levels(2000)[:1001] / model.passed(2000)[:1001]
    for lines in (slice(1, 4), slice(4, 12), slice(12, 50), slice(50, 1000)):
        assert 0.5 < modelled[lines].mean() / power[lines].mean() < 2
    assert modelled[1:].mean() == pytest.approx(power[1:].mean(), rel=0.15)


def test_at_another_step_a_memory_lasts_as_many_seconds():
    model = NoiseModel(np.ones(1), 1.0, 1.0, "a test", (Band(0.05, 40.0, 3.0),))
    (band,) = model.at_step(4.0).bands
    assert (band.frequency, band.memory, band.power) == (0.2, 10.0, 3.0)


def test_a_channel_that_is_silent_at_one_of_its_rates_has_finite_powers():
    rng = np.random.default_rng(2)
    loud, silent = rng.standard_normal((4, 256)), np.zeros((4, 128))

    def flat(samples):
        return np.ones(samples // 2 + 1)

    whitened = [*((1e-6, row, 1.0, flat) for row in loud), *((1e-3, row, 1.0, flat) for row in silent)]
    atoms = [(0.0, 1e-5), (0.0, 1e-2)]
    with np.errstate(all="raise", under="ignore"):
        white, powers = band_powers(whitened, atoms, np.zeros(2))
    assert np.isfinite(powers).all()
    assert white[1e-3] < 1e-3 < 0.1 < white[1e-6] < 2

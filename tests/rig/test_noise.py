"""Noise and converter: what is stated is what comes out."""

import math

import numpy as np
import pytest

from inkjet_env.rig import Converter, Noise
from inkjet_env.rig.noise import thermal_density

RATE_Hz = 200.0


def power(noise: Noise, samples: int, draws: int) -> np.ndarray:
    """Mean one-sided periodogram."""
    rng = np.random.default_rng(5)
    periodograms = [np.abs(np.fft.rfft(noise.draw(rng, samples, RATE_Hz))) ** 2 for _ in range(draws)]
    return np.mean(periodograms, axis=0) * 2 / (RATE_Hz * samples)


def test_a_350_ohm_bridge_makes_2_4_nanovolts():
    assert thermal_density(350, 298) == pytest.approx(2.4e-9, rel=0.01)


@pytest.mark.parametrize("samples", [999, 1000])
@pytest.mark.parametrize("corner_Hz", [0.0, 30.0])
def test_noise_has_the_stated_rms(samples, corner_Hz):
    noise = Noise(0.3, 50.0, corner_Hz)
    rng = np.random.default_rng(1)
    drawn = np.array([noise.draw(rng, samples, RATE_Hz) for _ in range(400)])
    assert np.sqrt(np.mean(drawn**2)) == pytest.approx(noise.rms(samples, RATE_Hz), rel=0.01)


def test_white_noise_has_all_that_its_bandwidth_lets_through_at_any_sampling_rate():
    noise = Noise(2e-3, 500.0)
    for rate_Hz in (10.0, 1e3, 1e6):
        assert noise.rms(1000, rate_Hz) == pytest.approx(2e-3 * math.sqrt(500.0), rel=1e-12)


def test_the_spectrum_falls_as_one_over_f_to_the_white_level():
    noise = Noise(1.0, RATE_Hz / 2, corner_Hz=5.0)
    measured = power(noise, 2000, 500)
    frequency_Hz = np.fft.rfftfreq(2000, 1 / RATE_Hz)
    for low, high in ((0.1, 0.3), (1, 2), (4, 6), (60, 90)):
        band = (frequency_Hz >= low) & (frequency_Hz <= high)
        assert measured[band].mean() == pytest.approx((1 + 5.0 / frequency_Hz[band]).mean(), rel=0.08)


def test_another_rms_keeps_the_spectrum():
    noise = Noise(1.0, 50.0, 5.0)
    scaled = noise.scaled_to(1e-3, 1000, RATE_Hz)
    assert scaled.rms(1000, RATE_Hz) == pytest.approx(1e-3, rel=1e-12)
    ratio = scaled.power_per_bin(1000, RATE_Hz) / noise.power_per_bin(1000, RATE_Hz)
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-12)


def test_silence_can_be_given_a_noise_and_noise_silenced():
    assert Noise(0.0, 0.0).scaled_to(0.2, 10, RATE_Hz).rms(10, RATE_Hz) == pytest.approx(0.2)
    assert not Noise(1.0, 50.0, 5.0).scaled_to(0.0, 10, RATE_Hz).draw(np.random.default_rng(0), 10, RATE_Hz).any()


@pytest.mark.parametrize("field", ["density", "bandwidth_Hz", "corner_Hz"])
@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_noise_that_cannot_be_is_refused(field, value):
    with pytest.raises(ValueError, match=f"noise {field} must be finite and at least 0; got {value}"):
        Noise(**{"density": 1.0, "bandwidth_Hz": 1.0, "corner_Hz": 1.0, field: value})


def test_codes_are_one_step_apart_and_the_error_at_most_half_of_one():
    converter = Converter(-1.0, 2.0, 8)
    assert converter.step == 3 / 256
    values = np.random.default_rng(2).uniform(-1, 2 - converter.step, 10_000)
    told = converter.quantised(values)
    codes = (told + 1) / converter.step
    np.testing.assert_allclose(codes, np.round(codes), atol=1e-9)
    assert np.abs(told - values).max() <= converter.step / 2 * (1 + 1e-9)
    assert np.std(told - values) == pytest.approx(converter.step / math.sqrt(12), rel=0.03)


def test_an_ideal_converter_changes_nothing():
    values = np.random.default_rng(3).uniform(-1, 1, 100)
    assert np.array_equal(Converter(-1, 1, None).quantised(values), values)


def test_there_is_no_code_above_the_highest():
    assert Converter(0, 4, 2).quantised([4.0]) == [3.0]


@pytest.mark.parametrize("value", [-1.01, 1.01, math.nan])
def test_a_signal_out_of_range_is_refused_not_clipped(value):
    with pytest.raises(ValueError, match=r"range of -1 to 1; it goes from .* Lower the gain or widen the range"):
        Converter(-1, 1, 12).quantised([0.0, value])


@pytest.mark.parametrize(
    ("low", "high", "bits", "message"),
    [(1, 1, 8, "low below high"), (0, math.inf, 8, "finite"), (0, 1, 0, "bits must be"), (0, 1, 1.5, "bits must be")],
)
def test_a_converter_that_cannot_be_is_refused(low, high, bits, message):
    with pytest.raises(ValueError, match=message):
        Converter(low, high, bits)

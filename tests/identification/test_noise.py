"""Noise of a channel: found again where it is known."""

import numpy as np
import pytest

from inkjet_env.identification.measurements import least_noise, measurements, noise_of
from inkjet_env.identification.noise import NoiseModel, channel_noise, noise_model, repeat_deviations
from inkjet_env.recordings import Campaign, Recording

AR2 = np.array([1.0, -1.4, 0.6])


def autoregression(rng, coefficients, innovation, samples):
    """Settled noise of an autoregression."""
    e = innovation * rng.standard_normal(samples + 500)
    noise = np.zeros(e.size)
    for t in range(len(coefficients) - 1, e.size):
        noise[t] = e[t] - sum(a * noise[t - lag] for lag, a in enumerate(coefficients[1:], start=1))
    return noise[500:]


@pytest.fixture(scope="module")
def coloured():
    return autoregression(np.random.default_rng(0), AR2, 0.02, 40_000)


def test_an_autoregression_is_found_again(coloured):
    model = noise_model([coloured], "a test", 0.0)
    assert model.lost == 2
    np.testing.assert_allclose(model.coefficients, AR2, atol=0.02)
    assert model.innovation == pytest.approx(0.02, rel=0.02)
    assert model.rms == pytest.approx(coloured.std(), rel=0.01)


def test_white_noise_needs_no_filter():
    orders = [noise_model([np.random.default_rng(s).normal(0, 3e-3, 4000)], "a test", 0.0).lost for s in range(20)]
    assert orders == [0] * 20


def test_the_spectrum_integrates_to_the_variance(coloured):
    step_s = 2e-7
    model = noise_model([coloured], "a test", 0.0)
    frequency_Hz = (np.arange(20_000) + 0.5) * 0.5 / step_s / 20_000
    power = np.mean(model.spectrum(frequency_Hz, step_s)) * 0.5 / step_s
    assert power == pytest.approx(model.rms**2, rel=0.01)


def test_whitened_noise_is_white_with_unit_variance(coloured):
    model = noise_model([coloured[:20_000]], "a test", 0.0)
    white = model.whitened(coloured[20_000:, None])[:, 0]
    assert white.size == 20_000 - model.lost
    assert white.std() == pytest.approx(1.0, abs=4 / np.sqrt(2 * white.size))
    correlation = np.array([white[lag:] @ white[:-lag] for lag in range(1, 30)]) / white.size
    assert np.abs(correlation).max() < 4 / np.sqrt(white.size)


def test_an_autoregression_from_many_short_stretches_is_that_of_a_long_one(coloured):
    model = noise_model(list(coloured.reshape(100, 400)), "a test", 0.0)
    np.testing.assert_allclose(model.coefficients, AR2, atol=0.03)


def flicker(rng, samples):
    """1/f noise, a stretch of a record eight times as long; its power at ν cycles a sample is 1/ν."""
    long = 8 * samples
    lines = np.sqrt(0.5 * long / np.arange(1, long // 2 + 1) * long) * (
        rng.standard_normal(long // 2) + 1j * rng.standard_normal(long // 2)
    )
    return np.fft.irfft(np.append(0, lines), long)[:samples]


def with_flicker(rng, coefficients, strength):
    """An autoregression of innovation 1, and 1/f noise whose power at ν cycles a sample is strength/ν."""
    return autoregression(rng, coefficients, 1.0, 2000) + np.sqrt(strength) * flicker(rng, 2000)


def least_deviation(coefficients, strength, stretches):
    """Cramér and Rao's of the logarithm of the 1/f noise's strength, by Whittle's likelihood: none estimates it better.

    Innovation and coefficients are estimated too.
    """
    lines = np.arange(1, 1000) / 2000
    delays = np.exp(-2j * np.pi * np.outer(lines, np.arange(len(coefficients))))

    def log_power(changes):
        passed = np.abs(delays @ (coefficients + np.append(0, changes[2:]))) ** 2
        return np.log(np.exp(changes[1]) / passed + strength * np.exp(changes[0]) / lines)

    steps = 1e-5 * np.eye(len(coefficients) + 1)
    slopes = np.column_stack([(log_power(step) - log_power(-step)) / 2e-5 for step in steps])
    return np.sqrt(np.linalg.inv(stretches * slopes.T @ slopes)[0, 0])


LINES = np.arange(3, 25)
"""Lines of 2,000 samples at which the 1/f noise below stands out."""
COEFFICIENTS = pytest.mark.parametrize("coefficients", [[1.0], [1.0, 0.8, 0.25], [1.0, -0.5]])


@COEFFICIENTS
def test_the_strength_of_1_over_f_noise_is_found_about_as_well_as_three_stretches_can_tell_it(coefficients):
    """Of 12 records: the mean within three standard errors of the truth, the spread within three times the least.

    The model may be any sum of relaxations: that it falls as 1/f is for the stretches to say.
    """
    strength, found = 0.02, []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        stretches = [with_flicker(rng, coefficients, strength) for _ in range(3)]
        (model,) = channel_noise({1.0: stretches}, {1.0: "a test"}, 1e-9).values()
        memory = (model.levels(2000) - 1)[LINES] * model.innovation**2 / model.passed(2000)[LINES]
        found.append(float(np.mean(memory * LINES / 2000)) / strength)
    least = least_deviation(coefficients, strength, 3)
    assert np.mean(found) == pytest.approx(1.0, abs=3 * least / np.sqrt(12))
    assert np.std(found) < 3 * least


@COEFFICIENTS
def test_an_autoregression_and_1_over_f_noise_are_told_apart_down_to_the_lowest_lines(coefficients):
    """Three stretches tell it; on thirty others each line of the whitened noise has the same power."""
    rng = np.random.default_rng(1)

    def stretch():
        return with_flicker(rng, coefficients, 0.02)

    (model,) = channel_noise({1.0: [stretch() for _ in range(3)]}, {1.0: "a test"}, 1e-9).values()
    assert model.lost == len(coefficients) - 1
    power = np.zeros(1001)
    for _ in range(30):
        white = model.whitened(stretch()[:, None])[:, 0]
        lines = np.abs(np.fft.rfft(white, 2000)) ** 2 / white.size
        power += lines / model.levels(2000)[:1001] / 30
    for band in (slice(1, 5), slice(5, 20), slice(20, 100), slice(100, 1000)):
        assert 0.6 < power[band].mean() < 1.6
    assert power[100:].mean() == pytest.approx(1.0, rel=0.05)


def test_white_noise_and_an_autoregression_alone_have_hardly_any_memory(coloured):
    for stretches in ([np.random.default_rng(2).standard_normal(4000)], [coloured[:20_000]]):
        (model,) = channel_noise({1.0: stretches}, {1.0: "a test"}, 1e-9).values()
        assert model.levels(stretches[0].size).max() < 1.5


def test_whitening_leaves_nothing_of_columns_shorter_than_the_filter():
    model = NoiseModel(np.append(1.0, np.full(24, 0.01)), 1.0, 1.0, "a test")
    for rows in (2, 10, 20, 24):
        assert model.whitened(np.ones((rows, 3))).shape == (0, 3)


@pytest.mark.parametrize("repeats", [2, 3, 7])
def test_deviations_of_repeats_have_the_variance_of_one_recording(repeats):
    signals = np.random.default_rng(repeats).normal(5.0, 0.1, (repeats, 20_000))
    deviations = np.concatenate(repeat_deviations(signals))
    assert deviations.std() == pytest.approx(0.1, rel=0.02)
    assert repeat_deviations(signals[:1]) == []


def recording(name, sensor, drive_V=None, **labels):
    n = len(sensor)
    drive_V = np.interp(np.arange(n), [0, n / 4, n / 3, n / 2], [0, 0, 60, 0]) if drive_V is None else drive_V
    labels = {"channel": "self_sensing", "initial_state": "demagnetised", **labels}
    return Recording(name, 1e-6 * np.arange(n), drive_V, sensor, "V", **labels)


def test_repeats_that_show_only_the_converters_step_have_its_noise():
    step_V = 0.01
    signal = step_V * np.round(np.sin(np.arange(600) / 20) / step_V)
    gathered = measurements(Campaign("c", tuple(recording(name, signal) for name in "ab")))
    assert least_noise(gathered)["self_sensing"] == pytest.approx(step_V / np.sqrt(12))
    (model,) = noise_of(gathered).values()
    assert model.lost == 0
    assert model.rms == model.innovation == pytest.approx(step_V / np.sqrt(12))
    assert "show none" in model.source


def test_noise_is_seen_in_repeats_at_rest_or_before_the_drive():
    rng = np.random.default_rng(4)
    signal = np.sin(np.arange(2000) / 20)
    noisy = [signal + rng.normal(0, 0.02, 2000) for _ in range(2)]
    still = rng.normal(0.3, 0.02, 2000)
    late = signal * (np.arange(2000) >= 500) + rng.normal(0.3, 0.02, 2000)
    for recordings, source in (
        ([recording("a", noisy[0]), recording("b", noisy[1])], "repeats"),
        ([recording("a", noisy[0]), recording("z", still, np.zeros(2000))], "recordings at rest"),
        ([recording("a", late)], "samples before the drive"),
    ):
        (model,) = noise_of(measurements(Campaign("c", tuple(recordings)))).values()
        assert model.source == source
        assert model.rms == pytest.approx(0.02, rel=0.15)


def test_where_nothing_tells_the_noise_there_is_no_model():
    drive_V = 50 * np.sin(np.arange(600) / 30)
    alone = recording("a", np.cos(np.arange(600) / 30), drive_V, initial_state="periodic")
    assert noise_of(measurements(Campaign("c", (alone,)))) == {}

"""Sensing stage: what is added to the signal, and what is taken from it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import TransferFunction, lsim

from experiments.concealed_rig.converter import Converter, converted
from experiments.concealed_rig.effects.chance import BaselineDrift, MainsHum
from experiments.concealed_rig.effects.outside_sensing import (
    ClockJitter,
    GainWander,
    SensitivityByVoltage,
)
from experiments.concealed_rig.effects.sensing import Crosstalk, Feedthrough, SensorBandwidth, SensorSaturation
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.measurement import Measurement

GRID = Grid(1000, 1e-7, 1, True)
TIME_S = np.arange(1001) * 1e-7
DRIVE_V = np.interp(np.arange(2001) * 5e-8, [1e-5, 1.2e-5, 4e-5, 4.5e-5], [0, 80, 80, 0])
ROW = Measurement("self_sensing", "trapezoid", "periodic", 1e-7, DRIVE_V[:2000:2])
SIGNAL = 3 * np.exp(-TIME_S / 2e-5) * np.sin(2 * np.pi * 5e4 * TIME_S)
SLOPE = np.gradient(SIGNAL, 1e-7)
GAUGE = replace(ROW, channel="strain_gauge")


def test_feedthrough_is_on_the_edges_only_and_as_high_as_they_are_steep():
    effect = Feedthrough(0.1, variant="capacitive", largest_V=5.0, steepest_V_per_s=4e7)
    added = effect.on_sensor(SIGNAL, DRIVE_V, ROW, GRID) - SIGNAL
    assert added[110] == pytest.approx(0.5)
    assert added[425] == pytest.approx(-0.5 * 1.6e7 / 4e7)
    np.testing.assert_allclose(added[np.abs(np.gradient(DRIVE_V[::2])) < 1e-9], 0, rtol=0, atol=1e-9)
    assert np.max(np.abs(added[460:])) < 1e-12


def test_the_loss_tangent_is_the_share_in_phase_with_the_voltage():
    """The slope over two half steps is sin(ωδ)/ωδ of the true one, 7e-4 less: left is rounding."""
    omega = 2 * np.pi * 20 / 1e-4
    tone = np.sin(omega * np.arange(2001) * 5e-8)
    effect = Feedthrough(
        0.1, variant="with_loss", largest_V=5.0, steepest_V_per_s=4e7, loss=0.03, angular_rad_per_s=omega
    )
    added = (effect.on_sensor(SIGNAL, tone, ROW, GRID) - SIGNAL)[:-1]
    wave = np.exp(-1j * omega * TIME_S[:-1])
    line = np.mean(added * wave) / np.mean(tone[:-2:2] * wave)
    assert line.real / line.imag == pytest.approx(0.03 / np.sinc(omega * 5e-8 / np.pi), rel=1e-11)


def test_a_high_pass_is_a_derivative_that_settles_within_its_time():
    effect = Feedthrough(0.1, variant="high_pass", largest_V=5.0, steepest_V_per_s=4e7, time_s=2e-8)
    added = effect.on_sensor(SIGNAL, DRIVE_V, ROW, GRID) - SIGNAL
    late = TIME_S[101:121] - 1e-5
    np.testing.assert_allclose(added[101:121], 0.5 * (1 - np.exp(-late / 2e-8)), rtol=0, atol=1e-11)


@pytest.mark.parametrize("variant", ["first_order", "second_order"])
def test_the_sensing_amplifier_passes_an_offset(variant):
    for periodic in (True, False):
        grid = replace(GRID, periodic=periodic, samples=1000 if periodic else 1001)
        out = SensorBandwidth(0.5, variant=variant, resonance_Hz=5e4).on_sensor(np.full(1001, 0.7), DRIVE_V, ROW, grid)
        np.testing.assert_allclose(out, 0.7, rtol=1e-13)


def test_saturation_keeps_to_its_level_and_leaves_small_signals():
    for variant in ("clip", "tanh"):
        effect = SensorSaturation(2.0, variant=variant, largest_V=3.0)
        out = effect.on_sensor(SIGNAL, DRIVE_V, ROW, GRID)
        assert np.max(np.abs(out)) <= 1.5
        small = effect.on_sensor(1e-3 * SIGNAL, DRIVE_V, ROW, GRID)
        bent = (1e-3 * SIGNAL) ** 3 / 3 / 1.5**2 if variant == "tanh" else 0.0  # left: the fifth power, 2e-15 V
        np.testing.assert_allclose(small, 1e-3 * SIGNAL - bent, rtol=0, atol=1e-14)
    one = SensorSaturation(2.0, variant="one_sided", largest_V=3.0, side=1.0).on_sensor(SIGNAL, DRIVE_V, ROW, GRID)
    np.testing.assert_array_equal(one[SIGNAL < 0], SIGNAL[SIGNAL < 0])
    assert np.all(one[SIGNAL > 0.1] < SIGNAL[SIGNAL > 0.1])


def test_hum_is_a_tone_of_its_amplitude_whose_phase_no_repeat_keeps():
    hum = MainsHum(2.0, variant="switching", frequency_Hz=3e4, harmonic_share=0.0, sigma=(("self_sensing", 0.01),))
    first, second = (hum.added(SIGNAL[:-1], SIGNAL[:-1], ROW, np.random.default_rng([1, order])) for order in (1, 2))
    assert np.sqrt(np.mean(first**2)) == pytest.approx(0.02 / np.sqrt(2), rel=1e-13)  # three whole periods
    assert np.argmax(np.abs(np.fft.rfft(first))) == 3
    assert np.max(np.abs(first - second)) > 1e-3
    np.testing.assert_array_equal(hum.added(SIGNAL, SIGNAL, GAUGE, np.random.default_rng(0)), 0)


class OneDraw:
    """Stands for a generator: of all the normal numbers it gives in a row, one is 1 and the others are 0.

    What is linear in independent normal numbers has the variance Σ (answer to each)², without chance.
    """

    def __init__(self, which):
        self.left = which

    def standard_normal(self, size):
        row = np.zeros(size)
        if 0 <= self.left < size:
            row[self.left] = 1.0
        self.left -= size
        return row


@pytest.mark.parametrize(("variant", "draws", "ends"), [("polynomial", 3, 2 / 1001), ("random_walk", 1001, 1 / 1001)])
def test_drifts_rms_is_their_strength_on_average(variant, draws, ends):
    """A row of n points holds both ends in full, 2/n or 1/n of the power; left: 1/n²."""
    drift = BaselineDrift(3.0, variant=variant, degree=2, sigma=(("self_sensing", 0.01),))
    rows = [drift.added(SIGNAL, SIGNAL, ROW, OneDraw(k)) for k in range(draws)]
    assert sum(np.mean(row**2) for row in rows) == pytest.approx(0.03**2 * (1 + ends), rel=4e-6)


def test_a_resonant_neighbour_is_heard_through_its_own_resonance_and_a_silent_one_not_at_all():
    effect = Crosstalk(0.1, variant="resonant", frequency_Hz=6e4, damping_ratio=0.08, gain_V_per_V=0.05)
    np.testing.assert_array_equal(effect.on_sensor(SIGNAL, DRIVE_V, ROW, GRID), SIGNAL)
    grid = replace(GRID, periodic=False, samples=1001)
    neighbour = DRIVE_V[::2]
    row = Measurement("self_sensing", "trapezoid", "demagnetised", 1e-7, neighbour, neighbour_V=neighbour)
    heard = effect.on_sensor(SIGNAL, DRIVE_V, row, grid) - SIGNAL
    w = 2 * np.pi * 6e4
    _, y, _ = lsim(TransferFunction([1.0, 0.0], [1.0, 0.16, 1.0]), neighbour, TIME_S * w)
    np.testing.assert_allclose(heard, 0.005 * y, rtol=0, atol=1e-5 * np.max(np.abs(heard)))


def test_gain_follows_the_voltage_or_the_recording_and_never_the_offset():
    follows = SensitivityByVoltage(0.1, variant="linear", offset_V=0.5)
    out = follows.on_sensor(SIGNAL + 0.5, DRIVE_V, ROW, GRID)
    np.testing.assert_allclose(out - 0.5, SIGNAL * (1 + 0.1 * DRIVE_V[::2] / 100), rtol=0, atol=1e-12)
    wanders = GainWander(0.1, variant="per_recording", course=(1.0, -2.0), offset_V=0.5)
    for order, gain in ((1, 1.1), (2, 0.8), (3, 0.8)):
        out = wanders.on_sensor(SIGNAL + 0.5, DRIVE_V, replace(ROW, order=order), GRID)
        np.testing.assert_allclose(out - 0.5, gain * SIGNAL, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(wanders.on_sensor(SIGNAL, DRIVE_V, GAUGE, GRID), SIGNAL)


def test_jitter_is_the_slope_times_the_time():
    for variant, memory in (("white", 0.0), ("wandering", 0.995)):
        jitter = ClockJitter(0.2, variant=variant, memory=memory)
        late = [jitter.added(SIGNAL[:401], SLOPE[:401], ROW, OneDraw(k)) for k in range(401)]
        # The wandering phase starts on time.
        grown = np.sqrt(1 - memory ** (2 * np.arange(1, 402)))
        np.testing.assert_allclose(np.sqrt(np.sum(np.square(late), axis=0)), 2e-8 * np.abs(SLOPE[:401]) * grown)


def test_a_converter_rounds_and_ends_at_its_range():
    converter = Converter(2.0, 12)
    assert converted(np.array([5.0]), converter)[0] == pytest.approx(2.0 - converter.step)
    assert abs(converted(np.array([0.1234]), converter)[0] - 0.1234) <= converter.step / 2

"""Variants by another equation than the simplest, each against a closed form or its limit."""

import numpy as np
import pytest

from experiments.concealed_rig.effects.chance import SAWTOOTH_HARMONICS, BaselineDrift, MainsHum
from experiments.concealed_rig.effects.course import AirBubble
from experiments.concealed_rig.effects.drive import SlewLimit
from experiments.concealed_rig.effects.hysteresis import AsymmetricHysteresis, Creep, RateDependentHysteresis
from experiments.concealed_rig.effects.sensing import Crosstalk, Feedthrough, SensorSaturation
from experiments.concealed_rig.effects.spring import CubicStiffness
from experiments.concealed_rig.effects.wave import WaveEcho
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.head import LARGEST_DRIVE_V, drawn_head
from experiments.concealed_rig.measurement import Measurement
from experiments.concealed_rig.plant import Plant, noise_free
from experiments.concealed_rig.resonator import Resonator

GRID = Grid(1000, 1e-7, 1, True)
TIME_S = GRID.step_times_s
ROW = Measurement("self_sensing", "sine", "periodic", 1e-7, np.ones(1000))
REST = np.zeros(2001)
HEAD = drawn_head(np.random.default_rng(2))


def test_a_push_pull_stage_falls_at_its_own_rate():
    t = np.arange(2001) * 5e-8
    drive = np.interp(t, [1e-6, 1.1e-6, 3e-5, 3.01e-5], [0, 80, 80, 0])
    slow = SlewLimit(40.0, variant="unequal", steepest_V_per_s=8e8, fall_ratio=0.5)
    out = slow.on_drive(drive, Grid(1001, 1e-7, 1, False))
    assert np.max(np.diff(out)) / 5e-8 == pytest.approx(2e7, rel=1e-6)
    assert np.min(np.diff(out)) / 5e-8 == pytest.approx(-1e7, rel=1e-6)
    assert slow.parameters()["fall_V_per_s"] == pytest.approx(1e7)


def test_one_rail_clips_one_side_and_unequal_rails_each_at_its_own_level():
    signal = 5 * np.sin(np.linspace(0, 2 * np.pi, 1001))
    for side in (1.0, -1.0):
        one = SensorSaturation(2.0, variant="clip_one_side", largest_V=4.0, side=side, other_rail=1e3)
        out = one.on_sensor(signal, REST, ROW, GRID) * side
        assert (out.max(), out.min()) == (pytest.approx(2.0), pytest.approx(-5.0))
    two = SensorSaturation(2.0, variant="unequal_rails", largest_V=4.0, other_rail=1.5)
    out = two.on_sensor(signal, REST, ROW, GRID)
    assert (out.max(), out.min()) == (pytest.approx(2.0), pytest.approx(-3.0))


def test_a_fractional_creep_grows_with_a_power_of_time():
    """A step of 1: log–log slope α over two decades; left: the ends of the spectrum, and its spacing."""
    for power in (0.15, 0.3):
        times = np.geomspace(1e-4, 1e4, 49)
        weights = times**power / np.sum(times**power)
        creep = Creep(0.2, variant="fractional", times_s=tuple(times), weights=tuple(weights), power=power)
        step = np.ones(200001)
        step[0] = 0.0
        grown = creep.on_hysteretic(step, Grid(100001, 2e-3, 1, False)) - step
        early, late = grown[100], grown[10000]
        assert np.log10(late / early) / 2 == pytest.approx(power, abs=0.06)


def test_thresholds_that_grow_with_a_power_of_the_rate_open_the_loop_by_it():
    """A triangle's rate is constant, so growth·rateᵖ is the same for all plays: openings of two rates are as said."""

    def opening(frequency_Hz, strength):
        step = 1 / frequency_Hz / 800
        drive = 80 * np.interp(np.arange(800) / 800, [0, 0.25, 0.75, 1], [0, 1, -1, 0])
        effect = RateDependentHysteresis(strength, variant="power_law", power=0.2, rate_V_per_s=100.0, rate_time_s=1e-9)
        row = Measurement("strain_gauge", "arbitrary", "periodic", step, drive)
        loop = noise_free(Plant(HEAD, (effect,)), row)
        return abs(loop[0] - loop[400])

    base = opening(1.0, 0.0)
    widening = [opening(f, 1e-4) - base for f in (1.0, 32.0)]
    assert abs(widening[0]) > 1e-6
    assert widening[1] / widening[0] == pytest.approx(2.0, rel=1e-3)  # 32^0.2


def test_an_exponential_input_begins_as_the_parabola_and_plays_of_one_polarity_leave_the_other():
    drive = np.linspace(-1, 1, 201)
    bends = [
        AsymmetricHysteresis(0.1, variant=variant).on_hysteresis_input(drive, GRID)
        for variant in ("bent_input", "exponential_input")
    ]
    np.testing.assert_allclose(*bends, rtol=0, atol=1e-6)
    one = AsymmetricHysteresis(0.1, variant="one_polarity", thresholds_V=(5.0,), weights=(1.0,), side=1.0)
    h = np.concatenate((np.linspace(0, -60, 50), np.linspace(-60, 0, 50)))
    np.testing.assert_array_equal(one.on_hysteretic(h, Grid(50, 1.0, 1, False)), h)
    grown = one.on_hysteretic(-h, Grid(50, 1.0, 1, False)) + h
    assert grown[49] == pytest.approx(0.1 * 55)


def test_a_rectifiers_ripple_has_even_harmonics_of_the_mains_and_a_sawtooth_falls_with_its_order():
    row = Measurement("strain_gauge", "zero", "demagnetised", 1e-4, np.zeros(2000))
    lines = (
        2
        * np.abs(
            np.fft.rfft(
                MainsHum(1.0, variant="rectified", frequency_Hz=100.0, sigma=(("strain_gauge", 1.0),)).added(
                    np.zeros(2000), np.zeros(2000), row, np.random.default_rng(0)
                )
            )
        )
        / 2000
    )
    # |sin| = 2/π − (4/π) Σ cos(2nx)/(4n² − 1); lines of 5 Hz. Left: aliases of the kinks.
    for n in (1, 2, 3):
        assert lines[20 * n] == pytest.approx(1.5 * 4 / np.pi / (4 * n**2 - 1), rel=2e-2)
    assert lines[10] < 1e-3
    fast = MainsHum(1.0, variant="sawtooth", frequency_Hz=4e4, sigma=(("self_sensing", 1.0),))
    tone = fast.added(np.zeros(1000), np.zeros(1000), ROW, np.random.default_rng(0))
    lines = 2 * np.abs(np.fft.rfft(tone)) / 1000
    orders = np.arange(1, SAWTOOTH_HARMONICS + 1)
    np.testing.assert_allclose(lines[4 * orders], 1 / orders, rtol=1e-9)


def test_what_settles_is_an_exponential_of_its_rms_around_its_mean():
    drift = BaselineDrift(3.0, variant="settling", time=0.3, sigma=(("self_sensing", 0.01),))
    rows = [drift.added(np.zeros(1000), np.zeros(1000), ROW, np.random.default_rng(k)) for k in range(300)]
    assert np.sqrt(np.mean(np.square(rows))) == pytest.approx(0.03, rel=0.1)
    row = rows[0]
    assert (row[200] - row[300]) / (row[300] - row[400]) == pytest.approx(np.exp(0.1 / 0.3), rel=1e-9)


def test_a_late_part_of_the_capacitance_has_its_whole_charge_in_the_end():
    """Σ added·dt over an edge: capacitance times voltage, whether it charges at once or late."""
    drive = np.interp(np.arange(2001) * 5e-8, [1e-6, 2e-6, 8e-5, 8.1e-5], [0, 80, 80, 0])
    charges = []
    for late in (0.0, 0.5):
        effect = Feedthrough(0.1, variant="relaxing", largest_V=5.0, steepest_V_per_s=4e7, late=late, late_s=1e-6)
        added = effect.on_sensor(np.zeros(1001), drive, ROW, GRID)
        charges.append(np.sum(added[:790]) * 1e-7)
    assert charges[0] == pytest.approx(0.1 * 5.0 / 4e7 * 80, rel=1e-9)
    assert charges[1] == pytest.approx(charges[0], rel=2e-3)


def test_an_acoustic_neighbour_is_the_resonant_one_later():
    neighbour = np.interp(np.arange(1000) * 1e-7, [1e-5, 1.2e-5, 2e-5, 2.2e-5], [0, 60, 60, 0])
    row = Measurement("self_sensing", "trapezoid", "demagnetised", 1e-7, neighbour, neighbour_V=neighbour)
    grid = Grid(1000, 1e-7, 1, False)

    def heard(variant, delay):
        crosstalk = Crosstalk(0.1, variant=variant, frequency_Hz=6e4, damping_ratio=0.05, delay_s=delay)
        return crosstalk.on_sensor(np.zeros(1000), np.zeros(1999), row, grid)

    np.testing.assert_allclose(heard("acoustic", 4e-6)[40:], heard("resonant", 0.0)[:-40], rtol=0, atol=1e-12)


def test_a_lossy_return_is_the_single_one_through_its_loss():
    w = 2 * np.pi * 5e4
    wave = np.sin(w * TIME_S)
    echo = WaveEcho(1.0, variant="lossy_return", nozzle_s=3e-5, loss_s=1e-6, nozzle_reflection=-0.5)
    line = 2j * np.mean(echo._echo(wave, GRID)[:-1] * np.exp(-1j * w * TIME_S[:-1]))
    assert line == pytest.approx(-np.exp(-3e-5j * w) / (1 + 1e-6j * w), rel=1e-3)


def test_a_growing_bubble_couples_more_and_rings_lower_from_recording_to_recording():
    bubble = AirBubble(0.2, variant="growing", resonance_Hz=5e4, frequency_Hz=3e4, onset=4, growth=3.0)
    plain = Resonator(3e5, 0.05)
    assert bubble.on_resonator(plain, 3) == plain
    grown = [bubble.on_resonator(plain, order) for order in (4, 6, 60)]
    assert grown[0].mass_ratio < grown[1].mass_ratio < grown[2].mass_ratio == pytest.approx(0.2, rel=1e-6)
    assert grown[0].second_ratio > grown[1].second_ratio > grown[2].second_ratio == pytest.approx(0.6, rel=1e-6)


def test_a_bounded_spring_has_its_share_at_the_largest_deflection():
    for bound in (0.0, 0.7):
        spring = CubicStiffness(0.1, variant="bounded", sign=1.0, largest_V=90.0, bound=bound)
        resonator = spring.on_resonator(Resonator(3e5, 0.05), 1)
        force = resonator.cubic_per_V2 * 90.0**3 / (1 + resonator.cubic_bound_per_V2 * 90.0**2)
        assert force == pytest.approx(0.1 * 90.0, rel=1e-12)


def test_half_of_the_heads_have_a_smooth_random_density_and_all_densities_are_positive():
    heads = [drawn_head(np.random.default_rng(k)) for k in range(120)]
    threshold = np.linspace(0, LARGEST_DRIVE_V, 500)
    kinds = [head.density for head in heads]
    assert 0.35 < kinds.count("smooth") / len(kinds) < 0.65
    assert set(kinds) == {"smooth", "exponential", "polynomial"}
    for head in heads:
        density = head.density_per_V(threshold)
        assert np.all(density > 0)
        if head.density == "smooth":  # no finer than its sixth cosine
            assert np.sum(np.diff(np.sign(np.diff(density))) != 0) <= 6

"""Families outside the catalogue: a limit and a closed form for each that is no term of the equation of motion."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.concealed_rig.effects.unlisted_motion import DomainJumps, VolterraProduct
from experiments.concealed_rig.effects.unlisted_sensing import (
    AutomaticGain,
    DopplerDelay,
    GainFlicker,
    LockedInterference,
    MissedAcquisition,
    NonlinearEcho,
    RectifiedPickup,
    SensorHysteresis,
)
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.measurement import Measurement
from experiments.concealed_rig.resonator import Motion, Resonator

GRID = Grid(2000, 1e-7, 1, True)
T = GRID.step_times_s
ROW = Measurement("self_sensing", "sine", "periodic", 1e-7, np.ones(2000))
REST = np.zeros(4001)
TONE = np.sin(2 * np.pi * 5e4 * T)


def test_a_small_signal_does_not_move_the_sensors_plays_and_a_large_one_opens_a_loop():
    sensor = SensorHysteresis(0.3, variant="plays", thresholds_V=(0.2,), weights=(1.0,))
    np.testing.assert_allclose(sensor.on_sensor(0.1 * TONE, REST, ROW, GRID), 0.07 * TONE, rtol=0, atol=1e-12)
    out = sensor.on_sensor(TONE, REST, ROW, GRID)
    up, down = np.interp([0.0], TONE[:50], out[:50])[0], out[100]  # at zero on the way up and down
    assert abs(up) == pytest.approx(0.3 * 0.2, abs=1e-6)
    assert down == pytest.approx(0.3 * 0.2, abs=1e-6)


def test_gain_flicker_has_its_rms_and_its_memory_and_leaves_the_offset():
    flicker = GainFlicker(0.02, variant="relaxing", memory_s=2e-5, offset_V=0.5)
    steady = np.full(2000, 3.5)
    rows = np.array([flicker.added(steady, steady, ROW, np.random.default_rng(k)) / 3.0 for k in range(200)])
    assert np.sqrt(np.mean(rows**2)) == pytest.approx(0.02, rel=0.05)
    assert np.mean(rows[:, 200:] * rows[:, :-200]) / 0.02**2 == pytest.approx(np.exp(-1), abs=0.05)
    np.testing.assert_array_equal(flicker.added(np.full(9, 0.5), steady[:9], ROW, np.random.default_rng(0)), 0)


def test_a_sample_that_is_not_settled_keeps_a_part_of_the_one_before():
    missed = MissedAcquisition(0.25, variant="kept_charge", share=0.1, back=2)
    signal = np.arange(2000.0)
    added = missed.added(signal, signal, ROW, np.random.default_rng(0))
    hit = added != 0
    assert np.mean(hit) == pytest.approx(0.1, abs=0.02)
    np.testing.assert_allclose(added[hit][5:], -0.25 * 2)


def test_a_delay_that_follows_the_signal_adds_its_own_second_harmonic():
    """y − D y y'/Y + …: a sine gets −D ω sin(2ωt)/2; left: the next term, (ωD)²/2."""
    doppler = DopplerDelay(0.001, variant="level", period_s=2e-5, largest_V=1.0)
    added = doppler.on_sensor(TONE, REST, ROW, GRID) - TONE
    w, delay = 2 * np.pi * 5e4, 2e-8
    np.testing.assert_allclose(added, -w * delay * np.sin(2 * w * T) / 2, rtol=0, atol=2 * (w * delay) ** 2)


def test_rectified_edges_are_of_one_sign_whichever_way_they_go():
    drive = np.interp(np.arange(4001) * 5e-8, [1e-5, 2e-5, 1e-4, 1.1e-4], [0, 80, 80, 0])
    pickup = RectifiedPickup(0.5, variant="smoothed", gain_s=1e-7, time_s=1e-6)
    heard = pickup.on_sensor(np.zeros(2001), drive, ROW, GRID)
    assert heard[195] == pytest.approx(heard[1095], rel=1e-3)
    assert heard[195] == pytest.approx(0.5 * 1e-7 * 8e6 * (1 - np.exp(-9.5)), rel=1e-3)
    assert np.min(heard) > -1e-12


def test_an_echo_of_the_square_is_four_times_as_large_for_twice_the_wave():
    echo = NonlinearEcho(0.2, variant="square", delay_s=3e-5, largest_V=2.0)

    def returned(size):
        motion = Motion(size * TONE, size * TONE)
        return echo.on_motion(motion, REST, Resonator(3e5, 0.05), GRID, 1).speed_V - size * TONE

    np.testing.assert_allclose(returned(2.0), 4 * returned(1.0), rtol=0, atol=1e-12)
    late = np.sin(2 * np.pi * 5e4 * (T - 3e-5))
    np.testing.assert_allclose(returned(1.0), 0.1 * late * np.abs(late), rtol=0, atol=1e-6)


def test_a_locked_burst_is_there_without_a_drive_and_the_same_in_every_recording():
    burst = LockedInterference(0.1, variant="ringing", start_share=0.05, frequency_Hz=1e5, decay_s=2e-5, largest_V=5.0)
    alone = burst.on_sensor(np.zeros(2001), REST, ROW, GRID)
    again = burst.on_sensor(TONE, REST, replace(ROW, order=9), GRID) - TONE
    np.testing.assert_allclose(alone, again, rtol=0, atol=1e-12)
    assert np.all(alone[:400] == 0)
    assert alone[425] == pytest.approx(0.5 * np.exp(-2.5e-6 / 2e-5), rel=1e-6)  # a quarter of a period later


def test_automatic_gain_settles_at_its_compression():
    gain = AutomaticGain(1.0, variant="feed_forward", time_s=1e-6, largest_V=2.0, offset_V=0.1)
    level = np.full(2001, 2.1)
    np.testing.assert_allclose(gain.on_sensor(level, REST, ROW, GRID), 0.1 + 2.0 / 2, rtol=1e-9)
    assert gain.on_sensor(np.full(2001, 0.1), REST, ROW, GRID)[-1] == pytest.approx(0.1)


def test_domains_jump_at_their_voltages_and_stay_between_them():
    grid = Grid(6, 1.0, 1, False)
    drive = np.array([0.0, 10, 29, 31, 60, 20, 0, -10, -19, -21, 0])
    jumps = DomainJumps(0.05, variant="relays", up_V=(30.0,), down_V=(-20.0,))
    out = jumps.on_poled(np.zeros(11), drive, grid, 1)
    np.testing.assert_allclose(out, [0, 0, 0, 5, 5, 5, 5, 5, 5, 0, 0])


def test_a_product_with_the_past_is_there_only_where_both_are():
    drive = np.zeros(4001)
    drive[100:200] = 50.0
    product = VolterraProduct(0.1, variant="second_order", delay_s=5e-6)  # a hundred points
    np.testing.assert_array_equal(product.on_drive(drive, GRID), drive)
    drive[100:300] = 50.0
    added = product.on_drive(drive, GRID) - drive
    np.testing.assert_allclose(added[201:299], 0.1 * 50 * 50 / 100, rtol=1e-9)
    assert np.all(added[:199] == 0)

"""Generator, amplifier, cable, capacitance, poling and digitiser against closed forms and SciPy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from experiments.concealed_rig.effects.digitiser import SensorHighpass, TimebaseError
from experiments.concealed_rig.effects.electronics import (
    DriveResonance,
    GeneratorSteps,
    NonlinearCapacitance,
    SupplyDroop,
)
from experiments.concealed_rig.effects.poling import Backlash, Depolarisation, VoltageDependentGain
from experiments.concealed_rig.grid import Grid
from experiments.concealed_rig.measurement import Measurement

GRID = Grid(2000, 1e-7, 1, True)
HALF_S = GRID.half_s
TIME_S = np.arange(4001) * HALF_S
ROW = Measurement("self_sensing", "sine", "periodic", 1e-7, np.ones(2000))


def gain_at(out, frequency_Hz):
    """Complex amplitude of a sine's response."""
    return 2j * np.mean(out[:-1] * np.exp(-2j * np.pi * frequency_Hz * TIME_S[:-1]))


@pytest.mark.parametrize("variant", ["series", "ladder", "ferrite", "line"])
def test_a_cable_and_a_head_answer_a_tone_as_their_circuit_does(variant):
    """Left: straight lines between the points, (ω·half step)²/12 of the tone and of each delay, 2e-4."""
    f, ring = 1e5, 4e5
    effect = DriveResonance(5e4 / ring, variant=variant, resonance_Hz=5e4, damping_ratio=0.15, reflection=-0.5)
    assert effect.ringing_Hz == pytest.approx(ring)
    out = effect.on_drive(np.sin(2 * np.pi * f * TIME_S), GRID)
    s, w = 2j * np.pi * f, 2 * np.pi * ring

    def section(p):
        return 1 / ((s / p) ** 2 + 0.3 * s / p + 1)

    travel = np.exp(-s / (4 * ring))
    expected = {
        "series": section(w),
        "ladder": section(w) * section(1.7 * w),
        "ferrite": (1 + 0.3 * s / w) * section(w),
        "line": 1.5 * travel / (1 + 0.5 * travel**2),
    }[variant]
    assert gain_at(out, f) == pytest.approx(expected, rel=1e-3)


def test_a_supply_sags_with_an_edge_and_recovers_with_its_time():
    """An edge of 100 V that is short against the recovery: the state is 1, and falls as exp(−t/T); left: the edge."""
    grid = Grid(2000, 1e-7, 1, False)
    drive = np.interp(TIME_S[:3999], [1e-6, 1.1e-6, 1e-4], [0, 100, 100])
    for variant, reserve in (("common", 0.0), ("split", 0.0), ("foldback", 0.4)):
        droop = SupplyDroop(0.2, variant=variant, recovery_s=1e-4, reserve=reserve)
        sag = (1 - droop.on_drive(drive, grid)[100:2000] / 100) / 0.2
        expected = np.maximum(np.exp(-(TIME_S[100:2000] - 1.05e-6) / 1e-4) - reserve, 0)
        np.testing.assert_allclose(sag, expected, rtol=0, atol=1e-6)
    # The negative supply of a split one rests.
    down = -drive
    lifted = SupplyDroop(0.2, variant="split", recovery_s=1e-4).on_drive(down, grid)
    np.testing.assert_allclose(lifted, -SupplyDroop(0.2, variant="split", recovery_s=1e-4).on_drive(drive, grid))


def test_a_generator_holds_the_middle_of_its_interval_and_rounds_to_its_step():
    ramp = np.interp(np.arange(3999), [0, 3998], [0.0, 90.0])
    grid = Grid(2000, 1e-7, 1, False)
    held = GeneratorSteps(0.1, variant="hold", period_s=2e-5).on_drive(ramp, grid)  # 2 µs: forty points
    inside = np.abs((np.arange(3999) % 40) - 20) < 19
    middle = ramp[np.minimum(np.arange(3999) // 40 * 40 + 20, 3998)]
    np.testing.assert_allclose(held[inside][:3000], middle[inside][:3000], rtol=0, atol=1e-9)
    assert np.mean(held[400:3600] - ramp[400:3600]) == pytest.approx(0, abs=0.02)  # no mean delay
    coarse = GeneratorSteps(0.05, variant="bits").on_drive(ramp, grid)
    np.testing.assert_allclose(coarse / 5, np.round(ramp / 5), rtol=0, atol=1e-12)
    few = GeneratorSteps(0.4, variant="memory")
    assert few.parameters() == {"points_per_recording": pytest.approx(100)}


@pytest.mark.parametrize("variant", ["growing", "butterfly"])
def test_a_capacitance_that_follows_its_voltage_charges_as_solve_ivp_says(variant):
    """Left: steps of 50 ns against a time of 2 µs, 1e-4 V of 90 V."""
    corners = [0, 5e-6, 8e-6, 4e-5, 5e-5, 1.9e-4], [0, 0, 90, 90, -60, 0]
    drive = np.interp(TIME_S[:3999], *corners)
    effect = NonlinearCapacitance(0.6, variant=variant, angular_rad_per_s=3e5, bend=0.8)
    out = effect.on_drive(drive, Grid(2000, 1e-7, 1, False))

    def change(t, v):
        bend = 0.8 * (v / 100) ** 2
        if variant == "butterfly":
            way = 1.0 if 5e-6 < t < 8e-6 or t > 5e-5 else -1.0 if 4e-5 < t < 5e-5 else 0.0
            bend = 0.8 * v / 100 * way
        return (np.interp(t, *corners) - v) / (2e-6 * (1 + bend))

    run = solve_ivp(change, (0, TIME_S[3998]), [0.0], max_step=2e-7, rtol=1e-9, atol=1e-9, t_eval=TIME_S[:3999])
    np.testing.assert_allclose(out, run.y[0], rtol=0, atol=0.02)
    lag = NonlinearCapacitance(0.6, variant="growing", angular_rad_per_s=3e5, bend=0.0)
    ramp = np.interp(TIME_S[:3999], [0, 2e-4], [0, 80])
    late = ramp - lag.on_drive(ramp, Grid(2000, 1e-7, 1, False))
    np.testing.assert_allclose(late[-100:], 80 / 2e-4 * 2e-6, rtol=1e-9)


def test_an_unbalanced_bridge_is_silent_at_zero_and_passes_the_charge_of_the_curve():
    """∫ b(v/100)² dv over a rise to V is b V³/3/100²: the charge."""
    drive = np.interp(TIME_S, [1e-5, 3e-5, 1e-4, 1.2e-4], [0, 90, 90, 0])
    bridge = NonlinearCapacitance(0.5, variant="self_sensing", bend=2.0, gain_s=4e-8)
    added = bridge.on_sensor(np.zeros(2001), drive, ROW, GRID)
    charge = np.sum(added[:500]) * GRID.step_s
    assert charge == pytest.approx(0.5 * 4e-8 * 2.0 * 90**3 / 3 / 1e4, rel=1e-4)
    assert np.sum(added) == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_array_equal(bridge.on_drive(drive, GRID), drive)


def test_nothing_passes_a_gap_and_a_share_passes_glue():
    h = np.linspace(-60, 60, 1201)
    gap = Backlash(0.5, variant="gap").on_hysteretic(h, GRID)
    np.testing.assert_allclose(gap[np.abs(h) < 10], 0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(gap[np.abs(h) > 10], (h - 10 * np.sign(h))[np.abs(h) > 10], rtol=0, atol=1e-12)
    glue = Backlash(0.4, variant="glue", half_width_V=8.0).on_hysteretic(h, GRID)
    slope = np.gradient(glue, h)
    assert slope[600] == pytest.approx(0.6, abs=1e-3)
    assert slope[-2] == pytest.approx(1.0, abs=1e-3)


def test_a_gain_follows_the_voltage():
    h, u = np.full(5, 30.0), np.array([-100.0, -50.0, 0.0, 50.0, 100.0])
    for variant, expected in (
        ("bias", [0.8, 0.9, 1.0, 1.1, 1.2]),
        ("even", [1.2, 1.05, 1.0, 1.05, 1.2]),
        ("saturating", [1 / 1.2, 1 / 1.1, 1.0, 1 / 1.1, 1 / 1.2]),
    ):
        out = VoltageDependentGain(0.2, variant=variant).on_poled(h, u, GRID, 1)
        np.testing.assert_allclose(out / 30, expected, rtol=1e-12)


def test_poling_is_lost_under_reverse_voltage_and_comes_back_under_forward_voltage():
    """At constant voltages the state is exponential; left: the edge."""
    drive = np.where(TIME_S[:3999] < 1e-4, -60.0, 50.0)
    lost = Depolarisation(1.0, variant="reverse_field", threshold_V=30.0, time_s=1e-4)
    out = 1 - lost.on_poled(np.ones(3999), drive, Grid(2000, 1e-7, 1, False), 1)
    at = np.array([400, 1200, 1990])
    np.testing.assert_allclose(out[at], 1 - np.exp(-TIME_S[at] / 1e-4), rtol=1e-9)
    later = np.array([2500, 3900])
    np.testing.assert_allclose(out[later] / out[2010], np.exp(-(TIME_S[later] - TIME_S[2010]) / 2e-4), rtol=1e-9)


def test_the_steady_poling_of_a_repeated_drive_is_where_many_periods_end():
    drive = np.where(TIME_S < 8e-5, -70.0, 40.0)
    drive[-1] = drive[0]
    lost = Depolarisation(1.0, variant="reverse_field", threshold_V=30.0, time_s=3e-4)
    steady = lost.on_poled(np.ones(4001), drive, GRID, 1)
    many = np.concatenate((np.tile(drive[:-1], 40), drive[:1]))
    run = lost.on_poled(np.ones(many.size), many, Grid(80000, 1e-7, 1, False), 1)
    np.testing.assert_allclose(steady, run[-4001:], rtol=0, atol=1e-8)


def test_a_ratchet_only_loses_and_what_was_not_beyond_the_threshold_costs_nothing():
    course = (0.0, 0.2, 0.2, 0.5, 0.5)
    lost = Depolarisation(0.3, variant="ratchet", course=course)
    gains = [lost.on_poled(np.ones(3), np.zeros(3), GRID, order)[0] for order in range(1, 8)]
    np.testing.assert_allclose(gains[:5], 1 - 0.3 * np.array(course))
    assert gains[4:] == [gains[4]] * 3


@pytest.mark.parametrize("variant", ["first_order", "two_stages", "servo"])
def test_a_coupled_sensor_answers_a_tone_as_its_circuit_does_and_keeps_the_offset(variant):
    tone = np.sin(2 * np.pi * 2e4 * GRID.step_times_s)
    effect = SensorHighpass(0.2, variant=variant, resonance_Hz=5e4, damping_ratio=0.6, offset_V=0.3)
    out = effect.on_sensor(tone + 0.3, np.zeros(4001), ROW, GRID) - 0.3
    s, w = 2j * np.pi * 2e4, 2 * np.pi * 1e4
    zeta = 0.6
    expected = s / (s + w) if variant == "first_order" else s**2 / (s**2 + 2 * zeta * w * s + w**2)
    line = 2j * np.mean(out[:-1] * np.exp(-2j * np.pi * 2e4 * GRID.step_times_s[:-1]))
    assert line == pytest.approx(expected, rel=1e-4)


def test_a_digitiser_that_counts_faster_hears_a_higher_tone():
    tone = np.sin(2 * np.pi * 5e4 * GRID.step_times_s)
    t = GRID.step_times_s
    fast = TimebaseError(1e-3, variant="constant").on_sensor(tone, np.zeros(4001), ROW, GRID)
    np.testing.assert_allclose(fast, np.sin(2 * np.pi * 5e4 * 1.001 * t), rtol=0, atol=1e-7)
    warm = TimebaseError(1e-3, variant="warming", sign=-1.0).on_sensor(tone, np.zeros(4001), ROW, GRID)
    np.testing.assert_allclose(warm, np.sin(2 * np.pi * 5e4 * t * (1 - 1e-3 * t / t[-1])), rtol=0, atol=1e-7)
    settles = TimebaseError(1e-3, variant="session", recordings=3.0)
    assert settles.error(4) == pytest.approx(settles.error(1) * np.exp(-1))

"""Cable, supply, generator and nonlinear capacitance, and unequal slew, against ways that share no code with them."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim, step

from inkjet_env.plant import Excitation, Plant, SimulationError, catalogue
from inkjet_env.plant.effect import complete
from inkjet_env.plant.effects.drive_resonance import overshoot_of_a_jump
from inkjet_env.plant.effects.generator_steps import staircase_means
from inkjet_env.plant.effects.nonlinear_capacitance import charged_V
from inkjet_env.plant.effects.slew_limit import slew_limited
from inkjet_env.printhead import Printhead

HEAD = Printhead.published()
PERIOD_S = 1 / HEAD.frequency_Hz
STEP_S = PERIOD_S / 100
EFFECTS = {effect.id: effect for effect in catalogue() if effect.stage == "drive"}
PULSE = np.interp(np.arange(600), [20, 35, 70, 85, 130, 150], [0, 80, 80, -50, -50, 0.0])
ZIGZAG = np.random.default_rng(1).normal(0, 30, 60)


def shot_of(drive_V=PULSE, initial_state="demagnetised", **kwargs):
    return Excitation("self_sensing", initial_state, STEP_S, drive_V, **kwargs)


def plant(effect_id, **values):
    return Plant(HEAD, effects=((EFFECTS[effect_id], complete(EFFECTS[effect_id], **values)),))


def at_ceramic(effect_id, excitation, **values):
    return plant(effect_id, **values).at_ceramic_V(excitation)


def orders_in_nodes(effect_id, drive_V=PULSE, **values):
    """Orders with which the signal converges as nodes are added, and its error at 2 nodes a sample."""
    signals = [plant(effect_id, **values).signal(shot_of(drive_V, substeps=n)) for n in (2, 4, 8, 64)]
    errors = [np.linalg.norm(signal - signals[-1]) / np.linalg.norm(signals[-1]) for signal in signals[:-1]]
    return np.log2(np.array(errors[:-1]) / errors[1:]), errors[0]


def steady(effect_id, lap, laps, **values):
    """Voltage in steady state, and that of the last of many laps from rest."""
    periodic = at_ceramic(effect_id, shot_of(lap, "periodic"), **values)
    last = at_ceramic(effect_id, shot_of(np.tile(lap, laps)), **values)[1 - periodic.size :]
    return periodic[:-1], last


# resonance of cable and head


@pytest.mark.parametrize("damping_ratio", [0.02, 0.2])
@pytest.mark.parametrize("ratio", [0.5, 6.0, 60.0])
def test_cable_and_head_are_a_low_pass_of_second_order(ratio, damping_ratio):
    excitation = shot_of()
    w = 2 * np.pi * ratio * HEAD.frequency_Hz
    exact = lsim(([w**2], [1, 2 * damping_ratio * w, w**2]), excitation.drive_at_nodes_V, excitation.time_s)[1]
    values = {"frequency_Hz": ratio * HEAD.frequency_Hz, "damping_ratio": damping_ratio}
    assert at_ceramic("drive_resonance", excitation, **values) == pytest.approx(exact, abs=1e-8)


def test_losses_in_the_core_of_an_inductor_are_those_of_its_circuit():
    """An inductance L parallel to R, in series with r, before a capacitance C: nodal equations instead of ω, ζ, κ."""
    w = 2 * np.pi * 6 * HEAD.frequency_Hz
    L, C, R, r = 1.0 / w, 1.0 / w, 3.0, 0.2  # H, F and Ω of a circuit scaled to 1 Ω
    i_L, u_C = np.array([1.0, 0.0]), np.array([0.0, 1.0])  # voltage of the inductor = (u - u_C - r i_L) R / (R + r)
    share = R / (R + r)
    own = np.array([-share * (u_C + r * i_L) / L, (i_L + share * (-u_C - r * i_L) / R) / C])
    forcing = np.array([[share / L], [share / (R * C)]])
    excitation = shot_of()
    exact = lsim((own, forcing, u_C[None], [[0.0]]), excitation.drive_at_nodes_V, excitation.time_s)[1]
    found = at_ceramic(
        "drive_resonance",
        excitation,
        frequency_Hz=1 / (2 * np.pi * math.sqrt(L * C * (1 + r / R))),
        damping_ratio=0.5 * (L / R + r * C) / math.sqrt(L * C * (1 + r / R)),
        core_loss_share=(L / R) / (L / R + r * C),
    )
    assert found == pytest.approx(exact, abs=1e-8)


@pytest.mark.parametrize("damping_ratio", [0.03, 0.1, 0.45])
@pytest.mark.parametrize("core_loss_share", [0.0, 0.4, 1.0])
def test_the_overshoot_that_is_told_is_that_of_a_jump(damping_ratio, core_loss_share):
    lead = 2 * core_loss_share * damping_ratio
    _, voltage = step((np.trim_zeros([lead, 1.0]), [1.0, 2 * damping_ratio, 1.0]), T=np.linspace(0, 10, 20001))
    assert overshoot_of_a_jump(damping_ratio, core_loss_share) == pytest.approx(voltage.max() - 1, abs=1e-6)


def test_a_damping_ratio_of_a_half_is_an_amplifier_of_two_poles():
    f = 7 * HEAD.frequency_Hz
    half_power_Hz = f * math.sqrt((1 + math.sqrt(5)) / 2)  # of 1 / (1 + i x - x²)
    other = at_ceramic("amplifier_bandwidth", shot_of(), bandwidth_Hz=half_power_Hz, second_order=1.0)
    found = at_ceramic("drive_resonance", shot_of(), frequency_Hz=f, damping_ratio=0.5)
    assert found == pytest.approx(other, abs=1e-9)


def test_a_resonance_beyond_all_frequencies_leaves_the_drive():
    for frequency_Hz in (1e12, 1e15, 1e300, math.inf):
        found = at_ceramic("drive_resonance", shot_of(), frequency_Hz=frequency_Hz, damping_ratio=0.1)
        assert found == pytest.approx(shot_of().drive_at_nodes_V, abs=1e-4)


def test_a_ringing_cable_repeats_in_steady_state():
    lap = PULSE[10:200]
    found, last = steady("drive_resonance", lap, 12, frequency_Hz=2 * HEAD.frequency_Hz, damping_ratio=0.1)
    assert found == pytest.approx(last, abs=1e-6)


def test_signal_behind_a_ringing_cable_converges_with_the_nodes():
    """The voltage turns between nodes, and the hysteresis with it."""
    orders, error = orders_in_nodes("drive_resonance", frequency_Hz=4.3 * HEAD.frequency_Hz, damping_ratio=0.1)
    assert orders.mean() > 1
    assert error < 1e-4


# droop of the supply


def drooped_by_brute_force(drive_V, droop, recovery, share=0.0, parts=800):
    """Charge in small explicit steps, ``recovery`` in nodes."""
    fine = np.interp(np.arange((drive_V.size - 1) * parts + 1) / parts, np.arange(drive_V.size), drive_V)
    charge, found = 0.0, [drive_V[0]]
    for before, after in pairwise(fine):
        rise_V = abs(after) - abs(before)
        charge += -charge / (recovery * parts) + (max(rise_V, 0.0) + share * max(-rise_V, 0.0)) / 100
        found.append(after * (1 - droop * charge))
    return np.array(found)[::parts]


@pytest.mark.parametrize("share", [0.0, 1.0])
@pytest.mark.parametrize("recovery", [0.7, 20.0, 5000.0])
def test_the_supply_follows_its_equation_across_zero_too(recovery, share):
    excitation = shot_of(ZIGZAG)
    found = at_ceramic(
        "supply_droop", excitation, droop=0.05, recovery_s=recovery * excitation.node_step_s, discharge_share=share
    )
    exact = drooped_by_brute_force(excitation.drive_at_nodes_V, 0.05, recovery, share)
    assert found == pytest.approx(exact, abs=0.01)


def test_equal_pulses_of_a_burst_are_smaller_by_a_geometric_series():
    pulse = np.interp(np.arange(200), [10, 30, 60, 80], [0, 60.0, 60.0, 0])
    recovery_s = 500 * STEP_S
    found = at_ceramic("supply_droop", shot_of(np.tile(pulse, 5)), droop=0.05, recovery_s=recovery_s)[::2]
    tops = 1 - found.reshape(5, 200)[:, 45] / 60
    keep = math.exp(-200 / 500)
    assert tops[1:] == pytest.approx([tops[0] * sum(keep**k for k in range(n + 1)) for n in range(1, 5)], rel=1e-9)


def test_the_supply_repeats_in_steady_state_and_may_collapse():
    found, last = steady("supply_droop", PULSE[10:200], 60, droop=0.05, recovery_s=700 * STEP_S)
    assert found == pytest.approx(last, abs=1e-3)
    with pytest.raises(SimulationError, match="collapses"):
        at_ceramic("supply_droop", shot_of(), droop=0.9, recovery_s=1.0)


def test_signal_of_a_drooping_supply_converges_with_the_second_power_of_the_nodes():
    orders, error = orders_in_nodes("supply_droop", droop=0.05, recovery_s=100.7 * STEP_S)
    assert orders.min() > 1.8
    assert error < 1e-4


# steps of the generator


@pytest.mark.parametrize("resolution_V", [0.0, 3.0])
def test_a_staircase_is_that_of_the_held_and_rounded_drive_between_nodes(resolution_V):
    """Where the staircase is flat for a node on either side and so is the drive, it is seen as it is."""
    excitation = shot_of(ZIGZAG)
    drive_V, n = excitation.drive_at_nodes_V, excitation.nodes
    found = at_ceramic("generator_steps", excitation, update_s=5 * excitation.node_step_s, resolution_V=resolution_V)
    held = np.interp(5 * (np.arange(n) // 5), np.arange(n), drive_V)
    if resolution_V:
        held = resolution_V * np.round(held / resolution_V)
    correction = drive_V - np.interp(np.arange(n) + 0.25 * np.array([[-1], [1]]), np.arange(n), drive_V).mean(axis=0)
    inner = np.isin(np.arange(n) % 5, (1, 2, 3))
    assert found[inner] == pytest.approx((held + correction)[inner], abs=1e-9)


def test_a_hold_has_the_mean_of_its_staircase_over_each_node_step():
    excitation, update = shot_of(), 3.37
    drive_V, n, parts = excitation.drive_at_nodes_V, excitation.nodes, 2001
    places = np.arange(n)[:, None] + (np.arange(parts) + 0.5) / parts - 0.5
    asked = np.interp(places, np.arange(n), drive_V)
    held = np.interp(update * np.floor(np.maximum(places, 0) / update), np.arange(n), drive_V)
    expected = drive_V + (held - asked).mean(axis=1)
    found = at_ceramic("generator_steps", excitation, update_s=update * excitation.node_step_s)
    assert found == pytest.approx(expected, abs=0.01)


def test_a_memory_of_so_many_points_holds_longer_in_longer_recordings():
    for samples in (40, 60):
        excitation = shot_of(ZIGZAG[:samples])
        update_s = (samples - 1) * excitation.step_s / 20
        found = at_ceramic("generator_steps", excitation, update_share=1 / 20)
        assert found == pytest.approx(at_ceramic("generator_steps", excitation, update_s=update_s), abs=1e-9)


def test_values_held_from_the_middle_of_an_interval_are_not_late_on_average():
    nodes = np.arange(500)
    ramp = 0.3 * nodes
    inner = slice(50, 450)
    for ahead, late in ((0.0, 3.5), (0.5, 0.0), (1.0, -3.5)):
        found = staircase_means(ramp, 7.0, 0.0, False, ahead)
        assert np.mean((ramp - found)[inner][:399]) == pytest.approx(0.3 * late, abs=0.02)


def test_rounding_alone_has_the_mean_of_the_rounded_drive_over_each_node_step():
    excitation, step_V = shot_of(ZIGZAG), 2.3
    drive_V, n, parts = excitation.drive_at_nodes_V, excitation.nodes, 4001
    places = np.arange(n)[:, None] + (np.arange(parts) + 0.5) / parts - 0.5
    asked = np.interp(places, np.arange(n), drive_V)
    expected = drive_V + (step_V * np.round(asked / step_V) - asked).mean(axis=1)
    found = at_ceramic("generator_steps", excitation, resolution_V=step_V)
    assert found == pytest.approx(expected, abs=0.01)


def test_fast_updates_are_a_delay_by_half_an_interval_and_small_steps_are_none():
    excitation = shot_of()
    for nodes in (0.01, 0.061, 0.064):
        late = at_ceramic("trigger_delay", excitation, delay_s=0.5 * nodes * excitation.node_step_s)
        found = at_ceramic("generator_steps", excitation, update_s=nodes * excitation.node_step_s)
        assert found == pytest.approx(late, abs=1e-3 * 80)
    found = at_ceramic("generator_steps", excitation, resolution_V=1e-6)
    assert found == pytest.approx(excitation.drive_at_nodes_V, abs=1e-6)


def test_a_repeated_staircase_is_that_of_the_last_of_two_laps():
    found, last = steady("generator_steps", PULSE[15:195], 2, update_s=7.5 * STEP_S, resolution_V=1.3)
    assert found == pytest.approx(last, abs=1e-9)


def test_signal_of_a_staircase_converges_with_the_nodes():
    """Jumps fall between nodes, so the order is the first at worst; the error is small from the beginning."""
    orders, error = orders_in_nodes("generator_steps", update_s=7.9 * STEP_S)
    assert orders.mean() > 0.9
    assert error < 2e-3


def test_a_generator_may_round_the_drives_points_only():
    for initial_state in ("demagnetised", "periodic"):
        excitation = shot_of(initial_state=initial_state)
        found = at_ceramic("generator_steps", excitation, resolution_V=1.3, points_share=1.0)
        points_V = 1.3 * np.round(excitation.drive_V / 1.3)
        exact = replace(excitation, drive_V=points_V, cache={}).drive_at_nodes_V
        assert found == pytest.approx(exact, abs=1e-10)
        output = at_ceramic("generator_steps", excitation, resolution_V=1.3)
        half = at_ceramic("generator_steps", excitation, resolution_V=1.3, points_share=0.5)
        assert half == pytest.approx(0.5 * (found + output), abs=1e-10)


# nonlinear capacitance


@pytest.mark.parametrize("lag", [0.3, 4.0, 40.0])
def test_a_nonlinear_capacitance_solves_its_equation_in_second_order(lag):
    nodes = np.arange(ZIGZAG.size)
    slope, curvature = -2e-3, 1e-4

    def rate(time, value):
        return (np.interp(time, nodes, ZIGZAG) - value) / (lag * (1 + slope * value + curvature * value**2))

    exact = [ZIGZAG[0]]
    for node in nodes[:-1]:
        exact.append(solve_ivp(rate, (node, node + 1), exact[-1:], "Radau", rtol=1e-9, atol=1e-10).y[0, -1])
    errors = []
    for finer in (4, 8, 16):
        places = np.arange((nodes.size - 1) * finer + 1) / finer
        found = charged_V(np.interp(places, nodes, ZIGZAG), lag * finer, slope, 0.0, curvature, periodic=False)[::finer]
        errors.append(np.abs(found - exact).max())
    assert errors[0] < 0.4
    assert errors[1] / errors[2] > 2**1.8


def test_a_constant_capacitance_is_an_amplifier_of_one_pole():
    lag_s = 0.03 * PERIOD_S
    found = at_ceramic("nonlinear_capacitance", shot_of(), lag_s=lag_s, curvature=0.0)
    one_pole = at_ceramic("amplifier_bandwidth", shot_of(), bandwidth_Hz=1 / (2 * math.pi * lag_s))
    assert found == pytest.approx(one_pole, abs=1e-9)


def test_small_steps_on_a_bias_see_the_capacitance_there():
    bias_V, lag = 60.0, 12.0
    ripple = bias_V + 0.01 * (np.arange(200) > 10)
    found = charged_V(ripple, lag, 1e-3, 0.0, 2e-4, periodic=False) - bias_V
    there = lag * (1 + 1e-3 * bias_V + 2e-4 * bias_V**2)
    exact = lsim(([1], [there, 1]), ripple - bias_V, np.arange(200.0))[1]
    assert found == pytest.approx(exact, abs=1e-6)


def test_on_a_butterfly_the_capacitance_rises_with_a_rising_voltage_as_much_as_it_falls_with_a_falling_one():
    rise_V = np.interp(np.arange(200), [10, 60, 150], [0.0, 70.0, 90.0])
    rising = charged_V(rise_V, 9.0, 0.0, 3e-3, 1e-5, periodic=False)
    assert rising == pytest.approx(charged_V(rise_V, 9.0, 3e-3, 0.0, 1e-5, periodic=False), abs=1e-12)
    falling = charged_V(rise_V[::-1], 9.0, 0.0, 3e-3, 1e-5, periodic=False)
    assert falling == pytest.approx(charged_V(rise_V[::-1], 9.0, -3e-3, 0.0, 1e-5, periodic=False), abs=1e-12)
    assert np.abs(falling - charged_V(rise_V[::-1], 9.0, 3e-3, 0.0, 1e-5, periodic=False)).max() > 1


@pytest.mark.parametrize("initial_state", ["demagnetised", "periodic"])
def test_a_bridge_shows_the_current_of_a_capacitance_that_it_does_not_balance(initial_state):
    """A current in proportion to c(u) u': between two samples it sums to the charge's change, ∫ c du."""
    excitation = shot_of(initial_state=initial_state)
    values = complete(EFFECTS["nonlinear_capacitance"], curvature=0.7, bridge_s=3e-8, tilted_bridge_s=-1e-8)
    found = EFFECTS["nonlinear_capacitance"].sensing(
        values, np.zeros(excitation.samples), excitation.drive_at_nodes_V, HEAD, excitation
    )
    drive_V = np.append(excitation.drive_at_nodes_V, excitation.drive_V[:1] if initial_state == "periodic" else [])
    fine_V = np.interp(np.arange((drive_V.size - 1) * 40 + 1) / 40, np.arange(drive_V.size), drive_V)
    w, step_s = 0.5 * (fine_V[1:] + fine_V[:-1]) / 100, excitation.node_step_s / 40
    currents = (3e-8 * w**2 - 1e-8 * w) * np.diff(fine_V) / step_s
    for k in range(1, 590):
        node = k * excitation.substeps * 40
        assert found[k] == pytest.approx(currents[node - 40 : node + 40].mean(), abs=1e-4 * np.abs(currents).max())
    monitor = replace(excitation, channel="displacement", cache={})
    untouched = EFFECTS["nonlinear_capacitance"].sensing(
        values, np.ones(excitation.samples), excitation.drive_at_nodes_V, HEAD, monitor
    )
    assert (untouched == 1).all()


def test_a_nonlinear_capacitance_repeats_in_steady_state_or_is_no_capacitance():
    found, last = steady("nonlinear_capacitance", PULSE[10:200], 30, lag_s=60 * STEP_S, curvature=2.0, slope=0.3)
    assert found == pytest.approx(last, abs=1e-6)
    with pytest.raises(SimulationError, match="not positive"):
        at_ceramic("nonlinear_capacitance", shot_of(1.5 * PULSE), lag_s=STEP_S, curvature=-0.9)


def test_signal_behind_a_nonlinear_capacitance_converges_with_the_second_power_of_the_nodes():
    orders, error = orders_in_nodes("nonlinear_capacitance", lag_s=2.7 * STEP_S, curvature=0.8, slope=-0.2)
    assert orders.min() > 1.7
    assert error < 1e-3


# unequal slew


def unequal_by_brute_force(drive_V, most, lag, fall_ratio, parts):
    fine = np.interp(np.arange((drive_V.size - 1) * parts + 1) / parts, np.arange(drive_V.size), drive_V)
    value, found = drive_V[0], []
    for u in fine:
        limit = most if u > value else fall_ratio * most
        step = limit / parts
        value += np.clip(u - value, -step, step) if lag == 0 else step * math.tanh((u - value) / (limit * lag))
        found.append(value)
    return np.array(found)[::parts]


@pytest.mark.parametrize("fall_ratio", [0.3, 4.0])
@pytest.mark.parametrize("lag", [0.0, 0.4, 6.0])
def test_falls_may_be_limited_more_or_less_than_rises(lag, fall_ratio):
    found = slew_limited(ZIGZAG, 12.0, False, lag, fall_ratio)
    errors = [np.abs(unequal_by_brute_force(ZIGZAG, 12.0, lag, fall_ratio, n) - found).max() for n in (50, 200)]
    assert errors[1] < 0.2
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize("lag", [0.0, 5.0])
@pytest.mark.parametrize("most", [0.3, 3.0])
def test_unequal_slew_repeats_in_steady_state(most, lag):
    lap = np.where(np.arange(60) < 9, 100.0, 0.0) + np.linspace(0, 5, 60)
    found = slew_limited(lap, most, True, lag, 0.4)
    laps = slew_limited(np.tile(lap, 60), most, False, lag, 0.4)[-60:]
    assert found == pytest.approx(laps, abs=1e-5)


def test_equal_slew_is_a_ratio_of_one_to_the_last_bit():
    for lag in (0.0, 3.0):
        assert (slew_limited(ZIGZAG, 20.0, True, lag) == slew_limited(ZIGZAG, 20.0, True, lag, 1.0)).all()
    assert complete(EFFECTS["slew_limit"], slew_rate_V_s=1e7)["fall_ratio"] == 1.0

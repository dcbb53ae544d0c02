"""Electrostriction, depolarisation and backlash against ways of computing them that share no code with them."""

import math

import numpy as np
import pytest

from inkjet_env.plant import Excitation, Plant, SimulationError, catalogue
from inkjet_env.plant.effect import complete
from inkjet_env.plant.effects.depolarisation import reversed_share
from inkjet_env.printhead import Printhead

HEAD = Printhead.published()
STEP_S = 1 / (100 * HEAD.frequency_Hz)
EFFECTS = {effect.id: effect for effect in catalogue() if effect.stage == "hysteresis"}
PULSE = np.interp(np.arange(600), [20, 35, 70, 85, 130, 150], [0, 80, 80, -50, -50, 0.0])
SINE = 60 * np.sin(2 * np.pi * np.arange(400) / 200)


def shot_of(drive_V=PULSE, initial_state="demagnetised", channel="self_sensing", **kwargs):
    return Excitation(channel, initial_state, STEP_S, drive_V, **kwargs)


def plant(effect_id, **values):
    return Plant(HEAD, effects=((EFFECTS[effect_id], complete(EFFECTS[effect_id], **values)),))


def hysteretic_V(plant_, excitation):
    return plant_.hysteretic_V(excitation.drive_at_nodes_V, excitation)


def orders_in_nodes(effect_id, **values):
    """Orders with which the signal converges as nodes are added, and its error at 2 nodes a sample."""
    signals = [plant(effect_id, **values).signal(shot_of(substeps=n)) for n in (2, 4, 8, 64)]
    errors = [np.linalg.norm(signal - signals[-1]) / np.linalg.norm(signals[-1]) for signal in signals[:-1]]
    return np.log2(np.array(errors[:-1]) / errors[1:]), errors[0]


# electrostriction


def test_electrostriction_adds_a_second_and_a_third_harmonic_of_the_drive_and_no_other():
    excitation = shot_of(SINE, "periodic")
    values = {"electrostriction": 0.05, "stiffening": -0.02}
    change = hysteretic_V(plant("voltage_dependent_gain", **values), excitation) - hysteretic_V(Plant(HEAD), excitation)
    lines = 2 * np.fft.rfft(change) / change.size
    half_V = HEAD.full_scale_V / 2
    second, third = 0.05 * 60**2 / half_V, -0.02 * 60**3 / half_V**2
    expected = np.zeros(lines.size, dtype=complex)
    # sin² = (1 - cos 2ωt) / 2 and sin³ = (3 sin ωt - sin 3ωt) / 4, two periods in all
    expected[0], expected[4], expected[2], expected[6] = second, -second / 2, -0.75j * third, 0.25j * third
    assert np.abs(lines - expected).max() < 2e-3 * second  # the sine is linear between its samples


def test_the_loop_of_an_electrostrictive_head_is_as_wide_as_that_of_the_base_model():
    excitation = shot_of(SINE, "periodic")
    widths = []
    for one in (Plant(HEAD), plant("voltage_dependent_gain", electrostriction=0.1)):
        v = hysteretic_V(one, excitation)[:400]
        widths.append(v[1:100] - v[199:100:-1])
    assert widths[1] == pytest.approx(widths[0], rel=1e-12)  # at equal voltages, rising and falling


def test_a_gain_set_by_the_bias_scales_small_loops_in_proportion_to_it():
    small_V = 2 * np.sin(2 * np.pi * np.arange(400) / 200)
    excitations = [shot_of(small_V + bias_V, "periodic") for bias_V in (0.0, 60.0)]
    swings = [
        [np.ptp(hysteretic_V(one, excitation)) for excitation in excitations]
        for one in (Plant(HEAD), plant("voltage_dependent_gain", electrostriction=0.05, remanent=1.0))
    ]
    rest, biased = np.array(swings[1]) / swings[0]
    half_V = HEAD.full_scale_V / 2
    level_V = np.mean(hysteretic_V(Plant(HEAD), excitations[1]))
    slope = swings[0][1] / 4  # d(v u) = u dv + v du
    assert rest == pytest.approx(1.0, abs=2e-3)
    assert biased - 1 == pytest.approx(0.05 * (60 + level_V / slope) / half_V, rel=0.02)


# depolarisation


@pytest.mark.parametrize("initial_state", ["demagnetised", "periodic"])
@pytest.mark.parametrize("recovery_nodes", [8.0, 150.0, 1e5])
def test_lost_gain_is_the_largest_faded_excess_so_far(recovery_nodes, initial_state):
    excitation = shot_of(initial_state=initial_state)
    values = {"loss": 0.4, "coercive_V": 20.0, "recovery_s": recovery_nodes * excitation.node_step_s}
    base = hysteretic_V(Plant(HEAD), excitation)
    drive_V = excitation.drive_at_nodes_V
    n, laps = drive_V.size, 3 if initial_state == "periodic" else 1
    excess = np.tile(np.maximum(-drive_V - 20.0, 0.0) / 100, laps)
    faded = [
        max(excess[: i + 1] * np.exp((np.arange(i + 1) - i) / recovery_nodes)) for i in range((laps - 1) * n, laps * n)
    ]
    for permanent in (0.0, 0.3):
        most = np.maximum.accumulate(excess)[-n:]
        expected = base * (1 - 0.4 * (permanent * most + (1 - permanent) * np.array(faded)))
        found = hysteretic_V(plant("depolarisation", permanent=permanent, **values), excitation)
        assert found == pytest.approx(expected, abs=1e-10)


def test_drives_above_the_coercive_voltage_lose_nothing():
    values = {"loss": 1.0, "coercive_V": 50.1, "recovery_s": 1e-3}
    assert (plant("depolarisation", **values).signal(shot_of()) == Plant(HEAD).signal(shot_of())).all()
    reason = EFFECTS["depolarisation"].untestable([shot_of(np.abs(PULSE))])
    assert reason == "no recording has a negative drive or another order"
    assert EFFECTS["depolarisation"].untestable([shot_of(np.abs(PULSE)), shot_of(np.abs(PULSE), order=2)]) is None


def test_an_aged_head_loses_the_same_share_of_its_gain_in_every_decade_of_recordings():
    base = hysteretic_V(Plant(HEAD), shot_of())
    values = {"loss": 0.4, "coercive_V": 20.0, "recovery_s": 1e-3}
    aged = complete(EFFECTS["depolarisation"], **values | {"loss": 0.0, "ageing": 0.03})
    for order, left in ((1, 1.0), (10, 0.97), (1000, 0.91)):
        found = hysteretic_V(Plant(HEAD).with_effects([(EFFECTS["depolarisation"], aged)]), shot_of(order=order))
        assert found == pytest.approx(base * left, abs=1e-12)
    both = plant("depolarisation", **values, ageing=0.03)
    lost = hysteretic_V(plant("depolarisation", **values), shot_of(order=10))
    assert hysteretic_V(both, shot_of(order=10)) == pytest.approx(lost - 0.03 * base, abs=1e-12)


def test_reversed_domains_follow_their_equation_and_repeat_in_steady_state():
    drive_V, recovery_s = PULSE, 120 * STEP_S
    base = hysteretic_V(Plant(HEAD), shot_of())
    found = hysteretic_V(plant("depolarisation", coercive_V=30.0, recovery_s=recovery_s, reversal=0.2), shot_of())
    times, share = shot_of().time_s, np.zeros(base.size)
    rising, falling = (np.interp(times, STEP_S * np.arange(600), sign * drive_V) > 30.0 for sign in (-1, 1))
    for k in range(base.size - 1):  # explicit Euler, a hundredth of a step at a time
        value, step = share[k], (times[1] - times[0]) / 100 / recovery_s
        for _ in range(100):
            value += step * (rising[k] * (1 - value) - falling[k] * value)
        share[k + 1] = value
    assert found == pytest.approx(base * (1 - 0.2 * share), abs=2e-4 * 80)
    laps = reversed_share(np.tile(drive_V, 200), 30.0, 0.99, False)
    assert reversed_share(drive_V, 30.0, 0.99, True) == pytest.approx(laps[-drive_V.size :], abs=1e-9)


def test_a_gain_that_is_lost_altogether_is_refused():
    with pytest.raises(SimulationError, match="nothing is left"):
        hysteretic_V(plant("depolarisation", loss=5.0, coercive_V=10.0, recovery_s=1e-3), shot_of())


def test_signal_of_a_depolarised_head_converges_with_the_second_power_of_the_nodes():
    orders, error = orders_in_nodes("depolarisation", loss=0.4, coercive_V=21.7, recovery_s=90 * STEP_S)
    assert orders.mean() > 1.8
    assert error < 2e-4


# backlash


def test_play_loses_its_gap_at_each_reversal():
    """Of a triangle, once the play is taken up: the base model's loop, behind by the gap in either direction."""
    triangle = np.interp(np.arange(401) % 200, [0, 50, 150, 200], [0.0, 80.0, -80.0, 0.0])[:-1]
    excitation = shot_of(triangle, "periodic")
    base, found = hysteretic_V(Plant(HEAD), excitation), hysteretic_V(plant("backlash", gap_V=2.0), excitation)
    far = np.abs(excitation.drive_at_nodes_V) < 70  # from the reversals
    rising = np.gradient(excitation.drive_at_nodes_V) > 0
    assert found[far & rising] == pytest.approx(base[far & rising] - 2.0, abs=1e-10)
    assert found[far & ~rising] == pytest.approx(base[far & ~rising] + 2.0, abs=1e-10)


def test_play_and_dead_zone_node_by_node():
    excitation = shot_of()
    base = hysteretic_V(Plant(HEAD), excitation)
    w, expected = 0.0, []
    for v in base:
        inside = 0.0 if abs(v) < 3.0 else v - math.copysign(3.0, v)
        w = max(inside - 1.5, min(inside + 1.5, w))
        expected.append(w)
    assert hysteretic_V(plant("backlash", gap_V=1.5, dead_zone_V=3.0), excitation) == pytest.approx(expected, abs=1e-12)


def test_a_glue_loses_a_share_of_small_travels_and_no_more_of_large_ones():
    """Slope 1 - lost around rest, lost · dead_zone_V behind far from it, half-way where v = dead_zone_V if h = 1."""
    excitation = shot_of()
    base = hysteretic_V(Plant(HEAD), excitation)
    for hardness in (1.0, 2.3, 12.0):
        found = hysteretic_V(plant("backlash", dead_zone_V=1e-3, lost=0.2, hardness=hardness), excitation)
        large = np.abs(base) > 10
        assert found[large] == pytest.approx(base[large] - 0.2e-3 * np.sign(base[large]), abs=1e-7)
        found = hysteretic_V(plant("backlash", dead_zone_V=1e3, lost=0.2, hardness=hardness), excitation)
        assert found == pytest.approx(0.8 * base, abs=0.2 * 80 * (80 / 1e3) ** hardness)
    half = hysteretic_V(plant("backlash", dead_zone_V=7.0, lost=1.0, hardness=1.0), excitation)
    assert half == pytest.approx(base * np.abs(base) / (np.abs(base) + 7.0), abs=1e-12)
    hard = hysteretic_V(plant("backlash", dead_zone_V=7.0, lost=0.3, hardness=90.0), excitation)
    assert hard == pytest.approx(base - 0.3 * np.clip(base, -7.0, 7.0), abs=0.3 * 7.0 * math.log(2) / 90)


def test_nothing_moves_within_the_play_and_small_gaps_change_little():
    small = shot_of(0.01 * PULSE)
    for name in ("gap_V", "dead_zone_V"):
        assert not hysteretic_V(plant("backlash", **{name: 5.0}), small).any()
        found = hysteretic_V(plant("backlash", **{name: 1e-7}), shot_of())
        assert found == pytest.approx(hysteretic_V(Plant(HEAD), shot_of()), abs=2.1e-7)


def test_play_in_steady_state_is_that_of_the_last_of_three_laps():
    lap = PULSE[10:200] + 5.0
    steady = hysteretic_V(plant("backlash", gap_V=4.0), shot_of(lap, "periodic"))
    laps = hysteretic_V(plant("backlash", gap_V=4.0), shot_of(np.tile(lap, 3)))[1 - steady.size :]
    assert steady[:-1] == pytest.approx(laps, abs=1e-9)


def test_signal_behind_play_converges_with_the_nodes():
    orders, error = orders_in_nodes("backlash", gap_V=2.3)
    assert orders.mean() > 1.5
    assert error < 5e-4


def test_a_soft_zone_loses_a_share_of_the_travel_within_it_and_none_beyond():
    base = hysteretic_V(Plant(HEAD), shot_of())
    found = hysteretic_V(plant("backlash", dead_zone_V=20.0, lost=0.3), shot_of())
    inside = np.abs(base) < 20
    assert 0.1 < inside.mean() < 0.9
    assert found[inside] == pytest.approx(0.7 * base[inside], abs=1e-12)
    assert found[~inside] == pytest.approx((base - 6 * np.sign(base))[~inside], abs=1e-12)

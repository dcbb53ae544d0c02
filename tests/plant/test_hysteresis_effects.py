"""What hysteresis effects do to the hysteretic drive, against ways of computing it that share no code with them."""

import math
from itertools import pairwise

import numpy as np
import pytest

from inkjet_env.plant import Excitation, Plant, catalogue
from inkjet_env.plant.effect import complete, coordinates, values_at
from inkjet_env.plant.effects.asymmetric_hysteresis import leaning_plays_V
from inkjet_env.plant.effects.rate_dependent_hysteresis import plays_V, rate_measure
from inkjet_env.printhead import Printhead
from inkjet_env.printhead.hysteresis import BranchLaw, PlayOperators

HEAD = Printhead.published()
LAW = HEAD.branch_law
STEP_S = 1 / (100 * HEAD.frequency_Hz)
EFFECTS = {effect.id: effect for effect in catalogue() if effect.stage == "hysteresis"}
PULSE = np.interp(np.arange(600), [20, 35, 70, 85, 130, 150], [0, 80, 80, -50, -50, 0.0])
CORNERS = (0, 90, -90, 60, -70, 40, 90, -90, 0)
ZIGZAG = np.interp(np.linspace(0, 8, 801), range(9), CORNERS)  # of one rate within each leg only


def shot_of(drive_V=PULSE, initial_state="demagnetised", step_s=STEP_S, channel="self_sensing", **kwargs):
    return Excitation(channel, initial_state, step_s, drive_V, **kwargs)


def plant(effect_id, **values):
    return Plant(HEAD, effects=((EFFECTS[effect_id], complete(EFFECTS[effect_id], **values)),))


def hysteretic_V(plant_, excitation):
    return plant_.hysteretic_V(excitation.drive_at_nodes_V, excitation)


# rate-dependent hysteresis


def brute_force_plays(drive_V, rates, growth, rate_V_s, operators):
    """Play after play, node after node, with the mean logarithm of the rates before and after; at rest at first."""
    law = PlayOperators.of_branch_law(LAW, operators)
    states = np.zeros(operators + 1)
    output = np.zeros(drive_V.size)
    logs = [math.log(1 + rate / rate_V_s) for rate in rates]
    for i, u in enumerate(drive_V):
        measure = (logs[i - 1] + logs[min(i, rates.size - 1)]) / 2 if i else 0.0
        r = law.thresholds_V * max(0.0, 1 + growth * measure)
        states = np.minimum(np.maximum(states, u - r), u + r)
        output[i] = law.weights @ states
    return output


@pytest.mark.parametrize(("growth", "rate_V_s"), [(0.1, 1e4), (0.5, 1e7), (-0.2, 1e6), (-0.5, 1.0)])
def test_thresholds_grow_with_the_logarithm_of_the_rate(growth, rate_V_s):
    drive_V = 80 * np.sin(np.arange(400) ** 1.5 / 300)
    excitation = shot_of(drive_V)
    asked_V = excitation.drive_at_nodes_V
    rates = np.abs(np.diff(asked_V)) / excitation.node_step_s
    change = hysteretic_V(plant("rate_dependent_hysteresis", growth=growth, rate_V_s=rate_V_s), excitation)
    change = change - hysteretic_V(Plant(HEAD), excitation)
    expected = brute_force_plays(asked_V, rates, growth, rate_V_s, 32)
    expected -= brute_force_plays(asked_V, rates, 0.0, rate_V_s, 32)
    assert np.abs(expected).max() > 0.5
    assert change == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("factor", [0.7, 1.2, 1.6])
def test_thresholds_all_wider_by_one_factor_stretch_the_law(factor):
    """``v_s(u) = s PI(u / s)``, which the plays approach with the square of their number."""
    begun = 100  # the first leg's beginning has plays that have not moved yet
    exact = factor * LAW.hysteretic_V(ZIGZAG / factor, "demagnetised") - LAW.hysteretic_V(ZIGZAG, "demagnetised")
    widths = np.full(ZIGZAG.size, factor - 1)
    errors = []
    for plays in (16, 32, 64, 128):
        wider = plays_V(ZIGZAG, widths, LAW, False, growth=1.0, plays=plays)
        change = wider - plays_V(ZIGZAG, widths, LAW, False, plays=plays)
        errors.append(np.abs(change - exact)[begun:].max())
    assert errors[1] < 0.1  # volts, at drives of 90 V
    assert np.log2(errors[0] / errors[-1]) / 3 == pytest.approx(2, abs=0.4)


def test_plays_of_one_rate_in_the_plant_are_the_stretched_law():
    legs = np.abs(np.diff(CORNERS))
    drive_V = np.interp(np.arange(legs.sum() + 1), np.append(0, np.cumsum(legs)), CORNERS)  # 1 V a sample
    excitation = shot_of(drive_V, channel="strain_gauge", step_s=0.01)
    factor = 1 + 0.05 * math.log(1 + 100 / 3.0)
    found = plant("rate_dependent_hysteresis", growth=0.05, rate_V_s=3.0).signal(excitation)
    exact = factor * LAW.hysteretic_V(drive_V / factor, "demagnetised")
    assert found[90:] == pytest.approx(exact[90:], abs=0.1)


def test_the_loop_is_wider_at_the_higher_rate_and_unchanged_far_below():
    loop = 80 * np.sin(2 * np.pi * np.arange(400) / 400)
    on = plant("rate_dependent_hysteresis", growth=0.03, rate_V_s=1e3)
    areas = []
    for step_s in (1e3, 1e-3, 1e-4, 1e-5):
        excitation = shot_of(loop, "periodic", step_s, "strain_gauge")
        areas.append(np.sum(on.signal(excitation) * np.gradient(loop)))
    base = np.sum(Plant(HEAD).signal(excitation) * np.gradient(loop))
    assert areas[0] == pytest.approx(base, rel=1e-4)
    assert np.all(np.diff(np.abs(areas)) > 0.015 * abs(base))


def test_wider_plays_in_steady_state_are_the_last_of_many_laps():
    lap = PULSE[10:210] + np.linspace(0, 30, 200)
    on = plant("rate_dependent_hysteresis", growth=0.2, rate_V_s=1e5)
    steady = hysteretic_V(on, shot_of(lap, "periodic"))
    laps = hysteretic_V(on, shot_of(np.append(np.tile(lap, 5), lap[0])))
    assert laps[-401:-1] == pytest.approx(steady, abs=1e-10)


def test_what_is_kept_of_the_plays_follows_the_law():
    on, excitation = plant("rate_dependent_hysteresis", growth=0.2, rate_V_s=1e5), shot_of()
    on.signal(excitation)
    other = HEAD.varied(hysteresis_strength=1.4)
    fresh, again = (Plant(other, effects=on.effects).signal(s) for s in (shot_of(), excitation))
    assert np.array_equal(fresh, again)


def test_signal_of_widening_loops_converges_with_the_nodes():
    on = plant("rate_dependent_hysteresis", growth=0.05, rate_V_s=1e4)
    signals = {substeps: on.signal(shot_of(substeps=substeps)) for substeps in (2, 4, 8, 128)}
    exact = signals.pop(128)
    errors = np.array([np.linalg.norm(s - exact) / np.linalg.norm(exact) for s in signals.values()])
    assert errors[0] < 5e-5
    assert np.log2(errors[0] / errors[-1]) / 2 > 0.9


def relaxing_by_brute_force(drive_V, relaxation, substeps=200):
    """Every play goes to its branch with a time constant, in steps that are short beside it."""
    law = PlayOperators.of_branch_law(LAW, 32)
    r, weights = law.thresholds_V[1:], law.weights[1:]
    states, output = np.zeros(r.size), [0.0]
    for before, after in pairwise(drive_V):
        for part in (np.arange(substeps) + 0.5) / substeps:
            u = before + part * (after - before)
            states += (np.clip(states, u - r, u + r) - states) * -np.expm1(-1 / (relaxation * substeps))
        output.append(weights @ states)
    return np.array(output)


@pytest.mark.parametrize("relaxation", [0.7, 5.0, 40.0])
def test_plays_that_relax_lag_behind_their_branches(relaxation):
    drive_V = PULSE[10:170]
    found = plays_V(drive_V, np.zeros(160), LAW, False, relaxation=relaxation)
    expected = relaxing_by_brute_force(drive_V, relaxation)
    assert found == pytest.approx(expected, abs=1e-4 * np.abs(expected).max())


def test_plays_that_relax_at_once_are_plays():
    excitation = shot_of()
    quick = hysteretic_V(plant("rate_dependent_hysteresis", relaxation_s=1e-4 * excitation.node_step_s), excitation)
    assert quick == pytest.approx(hysteretic_V(Plant(HEAD), excitation), abs=2e-3)


@pytest.mark.parametrize("settling", [0.3, 4.0, 50.0])
@pytest.mark.parametrize("periodic", [False, True])
def test_the_measure_of_a_rate_lags_behind_it(settling, periodic):
    ends_V = PULSE[:200]
    logs = np.log1p(np.abs(np.diff(ends_V)) / 0.1)
    found = rate_measure(ends_V, 0.1, settling, 1.0, periodic)
    laps = np.tile(logs, 20 if periodic else 1)
    values = [0.0]
    for log in laps:
        values.append(log + (values[-1] - log) * math.exp(-1 / settling))
    assert found == pytest.approx(values[-200:], abs=1e-6)


def test_weights_that_grow_make_the_plays_part_larger():
    excitation = shot_of(80 * np.sin(np.arange(400) / 30))
    on = hysteretic_V(plant("rate_dependent_hysteresis", gain=0.1, rate_V_s=1e5), excitation)
    measure = rate_measure(excitation.drive_at_nodes_V, 1e5, 0.0, excitation.node_step_s, False)
    plays = plays_V(excitation.drive_at_nodes_V, 0 * measure, LAW, False)
    assert on - hysteretic_V(Plant(HEAD), excitation) == pytest.approx(0.1 * measure * plays, abs=1e-9)


# asymmetric hysteresis


def test_asymmetry_is_even_in_the_hysteretic_drive():
    excitation, mirrored = shot_of(channel="strain_gauge"), shot_of(-PULSE, channel="strain_gauge")
    base = Plant(HEAD).signal(excitation)
    on = plant("asymmetric_hysteresis", asymmetry=0.1, bending=-0.05)
    even = 0.1 * np.abs(base) - 0.05 * base**2 / 90
    assert on.signal(excitation) == pytest.approx(base + even, abs=1e-12)
    assert on.signal(mirrored) == pytest.approx(-base + even, abs=1e-12)


def test_asymmetry_alone_gives_even_harmonics_of_an_odd_drive():
    drive_V = 70 * np.sin(2 * np.pi * np.arange(200) / 200)
    excitation = shot_of(drive_V, "periodic", channel="displacement")
    odd = np.abs(np.fft.rfft(Plant(HEAD).signal(excitation)))
    both = np.abs(np.fft.rfft(plant("asymmetric_hysteresis", asymmetry=0.02, bending=0.01).signal(excitation)))
    assert odd[2:12:2].max() < 1e-9 * odd[1]
    assert both[2] > 1e-3 * both[1]


def test_a_knee_leaves_small_signals_alone():
    excitation = shot_of(channel="strain_gauge")
    base = Plant(HEAD).signal(excitation)
    on = plant("asymmetric_hysteresis", asymmetry=0.1, knee_V=20.0).signal(excitation)
    assert on - base == pytest.approx(0.1 * np.maximum(np.abs(base) - 20.0, 0.0), abs=1e-12)


def test_beyond_its_knee_the_law_may_be_steeper_on_one_side_alone():
    excitation = shot_of(channel="strain_gauge")
    base = Plant(HEAD).signal(excitation)
    on = plant("asymmetric_hysteresis", asymmetry=0.05, bowing=0.05, knee_V=20.0)
    assert on.signal(excitation) - base == pytest.approx(0.1 * np.maximum(base - 20.0, 0.0), abs=1e-12)
    (effect, values), *_ = on.effects
    assert (
        effect.description(values)
        == "Above 20 V, the head moves 10 % further per volt at positive than at negative drive."
    )


@pytest.mark.parametrize(
    ("asymmetry", "bending", "told"),
    [
        (0.0, 0.03, "positive drives of half the full scale move the head 6 % further."),
        (0.03, 0.0, "positive drives move the head 6 % further."),
        (0.03, -0.03, "small positive drives move the head 6 % further, and those of half the full scale as far."),
        (
            -0.02,
            0.05,
            "small positive drives move the head 4 % less far, and those of half the full scale 6 % further.",
        ),
    ],
)
def test_what_positive_drives_do_beside_negative_ones_is_told_without_a_zero(asymmetry, bending, told):
    ((effect, values),) = plant("asymmetric_hysteresis", asymmetry=asymmetry, bending=bending).effects
    assert effect.description(values) == f"Compared with negative drives, {told}"


def test_arching_bends_the_drive_before_the_hysteresis():
    excitation = shot_of(channel="strain_gauge")
    bent = shot_of(PULSE + 0.04 * PULSE**2 / 90, channel="strain_gauge")
    on = plant("asymmetric_hysteresis", arching=0.04).signal(excitation)
    assert on == pytest.approx(Plant(HEAD).signal(bent), abs=5e-3)  # linear between samples, or between nodes


def test_tilting_plays_are_leaning_plays_threshold_by_threshold():
    drive_V = ZIGZAG[:300]
    operators = PlayOperators.of_branch_law(LAW, 32)
    expected = np.zeros(drive_V.size)
    for r, weight in zip(operators.thresholds_V[1:], operators.weights[1:], strict=True):
        state = 0.0
        for i, u in enumerate(drive_V):
            below, above = (1 + 2e-3 * r) * u - r, (1 - 2e-3 * r) * u + r
            state = u if below > above else max(below, min(above, state))
            expected[i] += weight * state
    assert leaning_plays_V(drive_V, 0.0, 2e-3, LAW, False, 32) == pytest.approx(expected, abs=1e-9)


def brute_force_leaning_plays(drive_V, lean, plays):
    operators = PlayOperators.of_branch_law(LAW, plays)
    total = np.zeros(drive_V.size)
    for r, weight in zip(operators.thresholds_V[1:], operators.weights[1:], strict=True):
        state = 0.0
        for i, u in enumerate(drive_V):
            below, above = (1 + lean) * u - r, (1 - lean) * u + r
            state = u if below > above else max(below, min(above, state))
            total[i] += weight * state
    return total


def test_leaning_plays_go_between_branches_of_two_slopes():
    excitation = shot_of()
    asked_V = excitation.drive_at_nodes_V
    on = plant("asymmetric_hysteresis", lean=0.08)
    change = hysteretic_V(on, excitation) - hysteretic_V(Plant(HEAD), excitation)
    expected = brute_force_leaning_plays(asked_V, 0.08, 32) - brute_force_leaning_plays(asked_V, 0.0, 32)
    assert np.abs(expected).max() > 0.5
    assert change == pytest.approx(expected, abs=1e-9)


def test_what_leans_turns_over_with_the_drive():
    """Upside down, rising is falling."""
    one, other = (plant("asymmetric_hysteresis", lean=lean) for lean in (0.1, -0.1))
    assert hysteretic_V(one, shot_of(-PULSE)) == pytest.approx(-hysteretic_V(other, shot_of()), abs=1e-12)


def test_the_leaning_loop_is_wider_at_one_end_of_the_drive():
    loop = 80 * np.sin(2 * np.pi * np.arange(400) / 400)
    excitation = shot_of(loop, "periodic", channel="strain_gauge", step_s=0.01)
    widths = {}
    for lean in (0.0, 0.1):
        v = plant("asymmetric_hysteresis", lean=lean).signal(excitation)
        rising, falling = v[300:].tolist() + v[:100].tolist(), v[100:300][::-1]
        widths[lean] = np.abs(np.array(falling) - np.array(rising))
    change = widths[0.1] - widths[0.0]
    assert change[40:160:].argmin() > 60 > change[40:160].argmax()  # narrower above, wider below


def test_leaning_plays_approach_their_limit_with_the_square_of_their_number():
    changes = [
        leaning_plays_V(ZIGZAG, 0.05, 0.0, LAW, False, n) - leaning_plays_V(ZIGZAG, 0.0, 0.0, LAW, False, n)
        for n in (16, 32, 64, 512)
    ]
    errors = [np.abs(change - changes[-1])[100:].max() for change in changes[:-1]]
    assert errors[1] < 0.1  # volts, at drives of 90 V
    assert np.log2(errors[0] / errors[-1]) / 2 > 1.3


# fits


SHAPES = {"creep": {"onset_s": 1.0}}
TRUTHS = {
    "creep": [
        {"creep_per_decade": 0.015, "onset_s": 0.1},
        {"creep_per_decade": -0.005, "onset_s": 0.02},
        {"creep_per_decade": 0.06, "onset_s": 2.0},
    ],
    "rate_dependent_hysteresis": [
        {"growth": 0.06, "rate_V_s": 100.0, "settling_s": 3e-7},
        {"growth": -0.03, "rate_V_s": 3e3, "settling_s": 3e-7},
        {"widening_V": 0.5, "rate_V_s": 1e3, "settling_s": 2e-6},
        {"gain": 0.02, "rate_V_s": 200.0, "settling_s": 1e-6},
        {"relaxation_s": 5e-7},
    ],
    "asymmetric_hysteresis": [
        {"asymmetry": 0.03, "bending": 0.02},
        {"asymmetry": -0.1, "bending": 0.2},
        {"asymmetry": 0.08, "knee_V": 25.0},
        {"arching": -0.05},
        {"lean": -0.08},
        {"tilt": 0.3},
        {"asymmetry": 0.02, "bending": -0.01, "lean": 0.05},
    ],
}


@pytest.mark.parametrize(("name", "truth"), [(name, truth) for name, truths in TRUTHS.items() for truth in truths])
def test_the_best_of_the_fits_from_the_starts_finds_the_truth(name, truth, damped_least_squares):
    effect = EFFECTS[name]
    loop = 80 * np.sin(2 * np.pi * np.arange(400) / 400)
    stairs = np.interp(np.arange(800), [10, 20, 200, 210, 600, 620], [0, 60, 60, 90, 90, -50.0])
    excitations = [shot_of(), shot_of(-PULSE, "periodic"), shot_of(stairs, step_s=0.02, channel="strain_gauge")]
    excitations += [shot_of(loop, "periodic", step_s, "strain_gauge") for step_s in (0.003, 0.03)]

    def signals(values):
        own = Plant(HEAD, effects=((effect, values),))
        return np.concatenate([own.signal(s) / (30 if s.fast else 1) for s in excitations])

    shown, off = signals(complete(effect, **truth)), signals(complete(effect, **SHAPES.get(name, {})))
    bounds = np.array([p.bounds for p in effect.parameters]).T
    # thresholds that grow alike or in proportion nearly do the same: the last part of that way is flat
    allowed, best = 0.03 if "widening_V" in truth else 0.01, np.inf
    for start in effect.starts(HEAD, excitations):
        begin = np.clip(coordinates(effect, start), *bounds)
        left = damped_least_squares(lambda z: signals(values_at(effect, z)) - shown, begin, bounds)
        best = min(best, left / np.linalg.norm(shown - off))
        if best < allowed:
            break
    assert best < allowed


def test_the_law_of_a_linear_head_has_nothing_to_widen():
    linear = BranchLaw((1.0, 0.0), 180.0)
    assert not plays_V(ZIGZAG, np.full(ZIGZAG.size, 1.5), linear, False, growth=1.0).any()

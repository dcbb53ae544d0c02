"""Every effect: nothing at strength 0, and as strong as is asked where it is planted."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.concealed_rig import Case, build
from experiments.concealed_rig.battery import measuring_plan
from experiments.concealed_rig.concealed import rms
from experiments.concealed_rig.effects.catalogue import CATALOGUE, DEVELOPMENT, OUTSIDE
from experiments.concealed_rig.effects.effect import Situation
from experiments.concealed_rig.head import drawn_head
from experiments.concealed_rig.plant import Hysteresis, Plant, noise_free, trace
from experiments.concealed_rig.strength import solved_strength
from experiments.concealed_rig.tangent import base_tangent

ALL = {**CATALOGUE, **OUTSIDE, **DEVELOPMENT}
HEAD = drawn_head(np.random.default_rng(21))
PLAN = measuring_plan(HEAD, np.random.default_rng(22), neighbour=True)
SIGMA = {"self_sensing": 0.01, "strain_gauge": 0.01, "displacement": 1.0}
SOLVED = 0.01  # strengths are solved to 1 % of the mismatch
LOWEST_V = tuple(float(row.drive_V.min()) for row in PLAN)
IN_FULL = ("creep", "sensor_bandwidth", "cubic_stiffness")
"""Effects whose whole campaign is recorded: of all others eight recordings, to be quick."""
SITUATION = Situation(HEAD, len(PLAN), False, SIGMA, 8.0, 150.0, 150.0, 8e7, LOWEST_V, (100.0,) * len(PLAN))


def test_the_catalogue_is_the_contracts():
    named = """amplifier_bandwidth slew_limit trigger_delay creep rate_dependent_hysteresis asymmetric_hysteresis
    cubic_stiffness quadratic_damping ferroelastic_softening second_mode wave_echo air_bubble meniscus_refill
    thermal_drift feedthrough sensor_bandwidth sensor_saturation mains_hum baseline_drift crosstalk
    structural_damping coulomb_friction backlash voltage_dependent_gain depolarisation drive_resonance supply_droop
    generator_steps nonlinear_capacitance sensor_highpass timebase_error self_heating"""
    assert sorted(CATALOGUE) == sorted(named.split())
    assert len(OUTSIDE) >= 12
    assert set(OUTSIDE).isdisjoint(DEVELOPMENT)
    assert set(CATALOGUE).isdisjoint({**OUTSIDE, **DEVELOPMENT})
    assert {kind.stage for kind in ALL.values()} == {"drive", "hysteresis", "resonator", "sensing"}


@pytest.mark.parametrize("name", ALL)
def test_at_strength_zero_every_variant_is_the_base_plant(name):
    rows = [
        next(r for r in PLAN if r.channel == channel and r.neighbour_V is not None) for channel in ("self_sensing",)
    ]
    rows += [next(r for r in PLAN if r.channel == "strain_gauge"), PLAN[-1]]
    variants = {}
    for k in range(40):
        effect = ALL[name].drawn(SITUATION, np.random.default_rng(k))
        variants[effect.variant] = effect
    for effect in variants.values():
        assert effect.strength == 0
        for row in rows:
            base = noise_free(Plant(HEAD), row)
            concealed = trace(Plant(HEAD, (effect,)), row)
            np.testing.assert_allclose(concealed.signal, base, rtol=0, atol=1e-11 * max(1.0, np.max(np.abs(base))))
            added = effect.added(base, concealed.slope, row, np.random.default_rng(0))
            np.testing.assert_array_equal(added, 0)
            np.testing.assert_array_equal(effect.on_recorded(base, row), base)


@pytest.mark.parametrize("name", CATALOGUE)
def test_an_effect_is_as_strong_as_is_asked_and_its_truth_says_so(name):
    built = build(Case(1, 40, "effect", (name,), "medium", meagre=name not in IN_FULL))
    truth = built.truth()
    assert truth["rho"] == pytest.approx(0.5, rel=SOLVED)
    assert truth["detectability"] == pytest.approx(truth["rho"] * np.sqrt(truth["samples"]), rel=1e-13)
    (effect,) = truth["effects"]
    assert effect["id"] == name
    assert effect["parameters"]
    assert len(truth["location"]["rms_over_noise"]) == len(built.setup.rows)
    whole = np.sqrt(np.mean(np.square(list(truth["location"]["rms_over_noise"].values()))))
    assert whole == pytest.approx(truth["rho"], rel=1e-13)  # all recordings are of one length


@pytest.mark.parametrize("name", [*OUTSIDE, *DEVELOPMENT])
def test_a_family_outside_is_as_strong_as_is_asked_even_with_few_recordings(name):
    built = build(Case(2, 41, "outside", (name,), "strong", meagre=True))
    assert rms(built.setup.mismatches(built.plant)) == pytest.approx(2.0, rel=SOLVED)
    assert {row.channel for row in built.setup.rows} == {"self_sensing"}
    assert len(built.setup.rows) == 8


@pytest.mark.parametrize(
    "name", ["slew_limit", "rate_dependent_hysteresis", "ferroelastic_softening", "wave_echo", "sensor_bandwidth"]
)
def test_the_steps_error_is_below_a_thousandth_of_the_mismatch(name):
    built = build(Case(2, 44, "effect", (name,), "strong", meagre=True))
    sigma = built.setup.instruments.sigma["self_sensing"]
    rows = built.setup.rows
    coarse, fine = ([noise_free(replace(built.plant, steps_per_period=n), r) for r in rows] for n in (160, 640))
    assert (
        rms([a - b for a, b in zip(coarse, fine, strict=True)]) / sigma < 0.001 * 2.0
    )  # the slew limit is largest, 9e-4


def test_effects_of_a_pair_are_each_as_strong_as_is_asked():
    built = build(Case(0, 42, "pair", ("creep", "mains_hum"), "medium"))
    assert built.alone == pytest.approx((0.5, 0.5), rel=SOLVED)
    # Together: what is left of the creep, and the same hum as alone. Chance lets them correlate.
    setup, plant = built.setup, built.plant
    creep = setup.mismatches(replace(plant, effects=plant.effects[:1]))
    hum = [setup.by_chance(plant, row, trace(plant, row)) / setup.instruments.sigma[row.channel] for row in setup.rows]
    assert rms(hum) == pytest.approx(built.alone[1], rel=1e-9)
    assert built.truth()["rho"] == pytest.approx(rms([a + b for a, b in zip(creep, hum, strict=True)]), rel=1e-12)


def test_a_base_law_of_its_own_shows_in_full_or_as_much_as_is_asked():
    whole = build(Case(0, 43, "base", ("preisach",)))
    assert whole.plant.hysteresis.share == 1.0
    part = build(Case(0, 43, "base", ("preisach",), 0.1))
    assert 0 < part.plant.hysteresis.share < 1
    assert part.truth()["rho"] == pytest.approx(0.1, rel=SOLVED)
    assert part.plant.hysteresis != Hysteresis()


def test_what_the_base_absorbs_is_no_mismatch():
    """Another gain, another offset, a resonance a little lower, another density: nothing is left of them.

    Left: rounding; of the plays the directions that Gram and Schmidt drop, 2e-5; of the vibration the tangent's
    grid, 2e-5, and the square of a change of 1e-6.
    """
    rows = measuring_plan(HEAD, np.random.default_rng(5), displacement=True)
    tangent = base_tangent(HEAD, rows, SIGMA)

    def left(other):
        raw = [(noise_free(Plant(other), r) - noise_free(Plant(HEAD), r)) / SIGMA[r.channel] for r in rows]
        mismatch = np.concatenate(raw)
        return np.linalg.norm(tangent.unexplained(mismatch)) / np.linalg.norm(mismatch)

    small = 1 + 1e-6
    for other, most in (
        (replace(HEAD, gauge_gain_V_per_V=1.1 * HEAD.gauge_gain_V_per_V), 1e-12),
        (replace(HEAD, gauge_offset_V=0.3, self_sensing_offset_V=-0.2, displacement_offset_nm=4.0), 1e-12),
        (replace(HEAD, b1_per_s=1.1 * HEAD.b1_per_s), 8e-6),
        (replace(HEAD, loop_V=1.1 * HEAD.loop_V, reversible=0.98 * HEAD.reversible), 6e-5),
        (replace(HEAD, damping_ratio=small * HEAD.damping_ratio), 6e-5),
        (replace(HEAD, resonance_Hz=small * HEAD.resonance_Hz), 6e-5),
    ):
        assert left(other) < most


def test_a_strength_that_cannot_be_is_refused_by_name():
    with pytest.raises(ValueError, match=r"second_mode .* does not reach rho 2"):
        solved_strength(lambda s: s, 2.0, 0.1, 1e-3, 1.0, "second_mode (parallel)")
    with pytest.raises(ValueError, match=r"cannot be as faint"):
        solved_strength(lambda s: 1 + s, 0.5, 0.1, 1e-3, 1.0, "x")
    with pytest.raises(ValueError, match="jumps"):
        solved_strength(lambda s: 0.1 if s < 0.3 else 1.0, 0.5, 0.1, 1e-3, 1.0, "x")


def test_the_secant_finds_what_a_power_law_or_a_threshold_asks():
    """To 1 % of the mismatch that is asked for."""
    found = solved_strength(lambda s: 40 * s**2.5, 0.7, 0.1, 1e-9, 10.0, "x")
    assert 40 * found**2.5 == pytest.approx(0.7, rel=SOLVED)
    found = solved_strength(lambda s: max(s - 1, 0.0), 0.05, 1.5, 1e-3, 10.0, "x")
    assert found - 1 == pytest.approx(0.05, rel=SOLVED)

    def breaks(s):
        if s > 0.5:
            raise FloatingPointError("no printhead")
        return s

    assert solved_strength(breaks, 0.3, 2.0, 1e-6, 10.0, "x") == pytest.approx(0.3, rel=SOLVED)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("unheard",), "family must be one of"),
        (("effect", ("creep", "slew_limit"), "strong"), "conceals 1"),
        (("effect", ("gain_wander",), "strong"), "not of the family"),
        (("pair", ("slew_limit", "trigger_delay"), "strong"), "different stages"),
        (("effect", ("creep",)), "strength must be given"),
        (("effect", ("creep",), "enormous"), "strength must be strong"),
        (("null", (), "strong"), "strength must be None"),
    ],
)
def test_a_case_that_cannot_be_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Case(0, 0, *arguments)

"""The catalogue: every effect is there, says what it is, does nothing when off, and begins within its bounds."""

import re
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.plant import Effect, Excitation, Parameter, Plant, catalogue
from inkjet_env.plant.effect import SCALES, complete, coordinates, switched_off, values_at
from inkjet_env.printhead import Printhead

STAGES = {
    "drive": ["amplifier_bandwidth", "slew_limit", "trigger_delay"],
    "hysteresis": ["asymmetric_hysteresis", "creep", "rate_dependent_hysteresis"],
    "resonator": [
        "air_bubble",
        "cubic_stiffness",
        "ferroelastic_softening",
        "meniscus_refill",
        "quadratic_damping",
        "second_mode",
        "thermal_drift",
        "wave_echo",
    ],
    "sensing": [
        "baseline_drift",
        "crosstalk",
        "feedthrough",
        "mains_hum",
        "sensor_bandwidth",
        "sensor_saturation",
    ],
}
BY_CHANCE = {"baseline_drift", "mains_hum"}
HEAD = Printhead.published()
EFFECTS = catalogue()


def shots_of(head):
    """Fast and slow recordings of a head, in every channel and initial state, two of them with a neighbour."""
    step_s = 1 / (100 * head.frequency_Hz)
    steps = np.arange(900)
    bipolar = np.interp(steps, [0, 20, 70, 100, 160, 190, 900], [0, 90, 90, -60, -60, 0, 0])
    loops = 70 * np.sin(2 * np.pi * np.arange(200) / 80) * np.linspace(0.2, 1, 200)
    tones = 50 * np.sin(2 * np.pi * steps / 450) + 20 * np.cos(2 * np.pi * steps / 90) - 20
    return [
        Excitation("self_sensing", "demagnetised", step_s, bipolar, 1, np.roll(bipolar, 300)),
        Excitation("self_sensing", "periodic", step_s, tones, 2),
        Excitation("self_sensing", "free", step_s, -bipolar, 3, start=(3.0, -2.0)),
        Excitation("displacement", "periodic", step_s, bipolar, 4, np.roll(bipolar, 300)),
        Excitation("displacement", "demagnetised", step_s, -tones, 5, substeps=4),
        Excitation("strain_gauge", "demagnetised", 1000 * step_s, loops, 6),
        Excitation("strain_gauge", "periodic", 1000 * step_s, loops[120:], 7),
    ]


@pytest.fixture(params=EFFECTS, ids=lambda effect: effect.id)
def effect(request):
    return request.param


@pytest.mark.parametrize("stage", STAGES)
def test_every_effect_is_in_the_catalogue_in_its_stage(stage):
    assert [effect.id for effect in EFFECTS if effect.stage == stage] == STAGES[stage]


def test_an_effect_says_what_it_is(effect):
    for text in (effect.sentence, effect.equation, effect.source, effect.signature, effect.shown_by):
        assert len(text) > 5, text
    assert effect.sentence.endswith(".")
    assert set(effect.confusable_with) <= {id_ for ids in STAGES.values() for id_ in ids} - {effect.id}


def test_parameters_have_bounds_units_and_meanings(effect):
    assert effect.strengths
    assert set(effect.strengths) <= {p.name for p in effect.parameters}
    for parameter in effect.parameters:
        assert parameter.scale in SCALES
        assert parameter.unit
        assert parameter.meaning
        low, high = parameter.bounds
        assert np.isfinite([low, high]).all()
        assert low < high
        if parameter.name in effect.strengths:  # off must be within the bounds
            assert low <= 0 <= high


@pytest.mark.parametrize("frequency_Hz", [50.0, 1.7e3, 51.7e3])
def test_starts_are_complete_and_within_the_bounds_for_any_head(effect, frequency_Hz):
    head = HEAD.varied(frequency_Hz=frequency_Hz)
    starts = effect.starts(head, shots_of(head))
    assert 0 < len(starts) <= 48
    for start in starts:
        assert start.keys() == {p.name for p in effect.parameters}
        assert values_at(effect, coordinates(effect, start)) == pytest.approx(start)
        for parameter in effect.parameters:
            low, high = parameter.bounds
            assert low <= parameter.coordinate(start[parameter.name]) <= high, (parameter.name, start)


def test_an_effect_that_is_off_leaves_the_base_model(effect):
    base = Plant(HEAD, {"displacement": 0.02}, {"self_sensing": 0.1})
    excitations = shots_of(HEAD)
    for start in effect.starts(HEAD, excitations):
        off = switched_off(effect, start)
        for excitation in excitations:
            expected = base.signal(excitation)
            assert base.with_effects([(effect, off)]).signal(excitation) == pytest.approx(
                expected, abs=1e-12 * np.abs(expected).max()
            )
            assert effect.random_effect_basis(off, excitation) is None


def test_an_effect_that_is_on_changes_a_recording_or_else_explains_its_chance(effect):
    excitations = shots_of(HEAD)
    base = Plant(HEAD)
    for start in effect.starts(HEAD, excitations):
        changed = [np.abs(base.with_effects([(effect, start)]).signal(s) - base.signal(s)).max() for s in excitations]
        explains = [effect.random_effect_basis(start, excitation) is not None for excitation in excitations]
        if effect.id in BY_CHANCE:
            assert all(explains), start
            assert max(changed) == 0
        else:
            assert max(changed) > 1e-6, start
            assert not any(explains)


def test_what_is_told_is_a_sentence_with_numbers(effect):
    for start in effect.starts(HEAD, shots_of(HEAD)):
        told = effect.description(start)
        assert told.endswith(".")
        assert any(character.isdigit() for character in told), told


SHOWN_BY_A_SLOW_SENSOR_AT_REST = {
    "trigger_delay", "asymmetric_hysteresis", "creep", "rate_dependent_hysteresis", "baseline_drift", "mains_hum"
}  # fmt: skip
"""As far as the kind of the recordings tells; whether they show it is seen in the fit."""


def test_an_effect_can_be_tested_where_every_channel_is_recorded(effect):
    assert effect.untestable(shots_of(HEAD)) is None


def test_why_an_effect_cannot_be_tested_ends_a_sentence(effect):
    reason = effect.untestable([Excitation("strain_gauge", "demagnetised", 0.01, np.zeros(50))])
    if effect.id in SHOWN_BY_A_SLOW_SENSOR_AT_REST:
        assert reason is None
    else:
        assert re.fullmatch(r"(every|no) recording .*[^.]", reason)


class Inverted(Effect):
    """A user's own effect: part of the signal comes through twice inverted."""

    id = "inverted"
    stage = "sensing"
    parameters = (Parameter("part", "1", -1.0, 1.0),)
    strengths = ("part",)

    def sensing(self, values, signal, drive_V, printhead, excitation):
        return (1 - 2 * values["part"]) * signal


def test_an_effect_of_ones_own_works_in_the_plant_and_is_not_in_the_catalogue():
    excitation = shots_of(HEAD)[0]
    base = Plant(HEAD)
    own = base.with_effects([(Inverted(), {"part": 0.25})])
    assert own.signal(excitation) == pytest.approx(0.5 * base.signal(excitation))
    assert replace(own, effects=()).signal(excitation) == pytest.approx(base.signal(excitation))
    assert "inverted" not in {effect.id for effect in EFFECTS}


def changed_by(effect, excitation):
    """How much the effect at full strength changes a recording, offset apart: RMS over the recording's own."""
    plain = Plant(HEAD).signal(excitation)
    values = complete(effect, **effect.example_values(HEAD, largest=float(np.abs(plain).max())))
    change = Plant(HEAD, effects=((effect, values),)).signal(excitation) - plain
    return np.std(change) / np.std(plain)


def test_example_values_are_within_bounds_and_change_a_recording_by_some_per_cent(effect):
    values = complete(effect, **effect.example_values(HEAD))
    for parameter in effect.parameters:
        assert parameter.low <= values[parameter.name] <= parameter.high
    pulse = replace(shots_of(HEAD)[0], order=20)
    held = Excitation("strain_gauge", "demagnetised", 0.05, np.repeat([0.0, 90.0], [20, 380]), 20)
    if effect.random:
        assert np.ptp(effect.random_effect_basis(values, pulse)) > 0
    else:
        assert 4e-3 < max(changed_by(effect, excitation) for excitation in (pulse, held)) < 0.25


def test_a_random_effect_has_columns_to_fit_and_no_other_has(effect):
    values = complete(effect, **effect.example_values(HEAD))
    assert (
        any(effect.random_effect_basis(values, excitation) is not None for excitation in shots_of(HEAD))
        == effect.random
    )


def test_an_effect_that_declares_it_changes_with_the_order_and_no_other_does(effect):
    excitation = shots_of(HEAD)[0]
    early, late = (changed_by(effect, replace(excitation, order=order)) for order in (2, 20))
    assert (early != late) == effect.depends_on_order


def test_an_effect_that_declares_it_needs_a_neighbour_and_no_other_hears_one(effect):
    excitation = replace(shots_of(HEAD)[0], order=20)
    alone, beside = changed_by(effect, replace(excitation, neighbour_V=None, cache={})), changed_by(effect, excitation)
    assert (alone != beside) == effect.needs_neighbour
    if effect.needs_neighbour:
        assert alone == 0


def test_what_a_fresh_drive_cannot_show_is_not_predictable():
    unpredictable = {effect.id for effect in EFFECTS if not effect.predictable}
    assert unpredictable == {"mains_hum", "baseline_drift", "crosstalk"}

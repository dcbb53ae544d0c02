"""The catalogue: every effect is there, says what it is, does nothing when off, and begins within its bounds."""

import re
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.plant import Effect, Excitation, Parameter, Plant, catalogue
from inkjet_env.printhead import Printhead
from inkjet_env.testing import EffectTests, excitations_of

STAGES = {
    "drive": [
        "amplifier_bandwidth",
        "drive_resonance",
        "generator_steps",
        "nonlinear_capacitance",
        "slew_limit",
        "supply_droop",
        "trigger_delay",
    ],
    "hysteresis": [
        "asymmetric_hysteresis",
        "backlash",
        "creep",
        "depolarisation",
        "rate_dependent_hysteresis",
        "voltage_dependent_gain",
    ],
    "resonator": [
        "air_bubble",
        "coulomb_friction",
        "cubic_stiffness",
        "ferroelastic_softening",
        "meniscus_refill",
        "quadratic_damping",
        "second_mode",
        "self_heating",
        "structural_damping",
        "thermal_drift",
        "wave_echo",
    ],
    "sensing": [
        "baseline_drift",
        "crosstalk",
        "feedthrough",
        "mains_hum",
        "sensor_bandwidth",
        "sensor_highpass",
        "sensor_saturation",
        "timebase_error",
    ],
}
HEAD = Printhead.published()
EFFECTS = catalogue()


@pytest.fixture(params=EFFECTS, ids=lambda effect: effect.id)
def effect(request):
    return request.param


class TestRulesOfAnEffect(EffectTests):
    """Every effect passes the tests that one of a user's own must pass."""

    @pytest.fixture(autouse=True)
    def _one_after_another(self, effect):
        self.effect = effect


def test_parameters_have_meanings(effect):
    assert all(parameter.meaning for parameter in effect.parameters)


@pytest.mark.parametrize("stage", STAGES)
def test_every_effect_is_in_the_catalogue_in_its_stage(stage):
    assert [effect.id for effect in EFFECTS if effect.stage == stage] == STAGES[stage]


def test_an_effect_says_what_it_is(effect):
    for text in (effect.sentence, effect.equation, effect.source, effect.signature, effect.shown_by):
        assert len(text) > 5, text
    assert effect.sentence.endswith(".")
    assert set(effect.confusable_with) <= {id_ for ids in STAGES.values() for id_ in ids} - {effect.id}


def test_what_is_told_is_a_sentence_with_numbers(effect):
    for start in effect.starts(HEAD, excitations_of(HEAD)):
        told = effect.description(start)
        assert told.endswith(".")
        assert any(character.isdigit() for character in told), told


SHOWN_BY_A_SLOW_SENSOR_AT_REST = {
    "trigger_delay", "asymmetric_hysteresis", "creep", "rate_dependent_hysteresis", "voltage_dependent_gain",
    "baseline_drift", "mains_hum",
}  # fmt: skip
"""As far as the kind of the recordings tells; whether they show it is seen in the fit."""


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
    excitation = excitations_of(HEAD)[0]
    base = Plant(HEAD)
    own = base.with_effects([(Inverted(), {"part": 0.25})])
    assert own.signal(excitation) == pytest.approx(0.5 * base.signal(excitation))
    assert replace(own, effects=()).signal(excitation) == pytest.approx(base.signal(excitation))
    assert "inverted" not in {effect.id for effect in EFFECTS}


def test_what_a_fresh_drive_cannot_show_is_not_predictable():
    unpredictable = {effect.id for effect in EFFECTS if not effect.predictable}
    assert unpredictable == {"mains_hum", "baseline_drift", "crosstalk"}

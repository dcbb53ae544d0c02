from types import SimpleNamespace

import numpy as np
import pytest

from inkjet_env.experiments.proof.corpus import STAGES, corpus
from inkjet_env.experiments.proof.fresh_drive_error import LEAST_CLOSURE, UNPREDICTABLE, Model, closure, model_of
from inkjet_env.experiments.proof.judge import located, parameters, questions
from inkjet_env.plant import Excitation, Plant, catalogue
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.printhead import Printhead
from inkjet_env.storage import json_text

HEAD = Printhead.published()
STEP_S = 4e-7


def effect(name):
    return next(e for e in catalogue() if e.id == name)


class Double:
    """A concealed plant that is the published head with a cubic spring, by the project's own equations."""

    effects = ((effect("cubic_stiffness"), {"stiffening_per_V2": 2e-6}),)

    def fresh_drives(self, rng):
        pulses = [np.repeat([0.0, volts, 0.0], (20, 30, 750)) for volts in (40.0, 90.0, 0.0)]
        how = {"step_s": STEP_S, "channel": "self_sensing", "initial_state": "demagnetised"}
        return [SimpleNamespace(drive_V=pulse, **how) for pulse in pulses]

    def response(self, drive_V, step_s, channel, initial_state):
        return 0.3 + Plant(HEAD, effects=self.effects).signal(
            Excitation(channel, initial_state, step_s, drive_V, substeps=16)
        )


def model(*effects):
    if effects:
        return model_of(AugmentedPrinthead(HEAD, effects).as_json())
    return model_of(HEAD.as_json())


def test_the_true_model_closes_everything_and_the_base_model_nothing():
    assert closure(model(), model(*Double.effects), Double(), 0)["closure"] == pytest.approx(1, abs=1e-4)
    assert closure(model(), model(), Double(), 0)["closure"] == 0


def test_half_the_effect_closes_three_quarters_of_the_squared_error():
    half = ((effect("cubic_stiffness"), {"stiffening_per_V2": 1e-6}),)
    assert closure(model(), model(*half), Double(), 0)["closure"] == pytest.approx(0.75, abs=0.05)


def test_a_model_that_makes_it_worse_has_a_negative_closure():
    other_way = ((effect("cubic_stiffness"), {"stiffening_per_V2": -2e-6}),)
    assert closure(model(), model(*other_way), Double(), 0)["closure"] < -1


def test_an_offset_and_a_drive_that_stands_still_do_not_count():
    found = closure(model(), model(*Double.effects), Double(), 0)
    assert found["drives"] == 2
    assert found["augmented_rms"] < 1e-3


class Still(Double):
    """A concealed plant whose fresh drives show nothing of the resonator."""

    def fresh_drives(self, rng):
        return [drive for drive in super().fresh_drives(rng) if not drive.drive_V.any()]


class Slow(Double):
    """A concealed plant whose fresh drives are of a channel whose gain nobody measured."""

    def fresh_drives(self, rng):
        return [SimpleNamespace(**vars(drive) | {"channel": "strain_gauge"}) for drive in super().fresh_drives(rng)]


@pytest.mark.parametrize("plant", [Still(), Slow()])
@pytest.mark.filterwarnings("error")
def test_without_a_usable_fresh_drive_there_is_no_closure_but_a_reason(plant):
    assert closure(model(), model(*Double.effects), plant, 0) == {
        "closure": None,
        "drives": 0,
        "base_rms": None,
        "augmented_rms": None,
        "reason": "no fresh drive moves the head on a channel whose gain both models know",
    }


class Unbounded(Model):
    """A model whose motion grows without bound under large drives."""

    def signal(self, drive_V, *how):
        if np.max(drive_V) > 50:
            raise FloatingPointError("the motion grows without bound.")
        return super().signal(drive_V, *how)


def unbounded(of):
    return Unbounded(of.head, of.plant, of.order, of.channels)


def test_without_a_bounded_answer_of_the_base_model_there_is_no_closure_but_a_reason():
    found = closure(unbounded(model()), model(*Double.effects), Double(), 0)
    assert (found["closure"], found["drives"], found["base_rms"]) == (None, 2, None)
    assert found["reason"] == "the base model has no bounded answer to a fresh drive"
    assert found["augmented_rms"] < 1e-3
    json_text(found)


def test_without_an_error_of_the_base_model_there_is_no_closure_but_a_reason():
    class Base(Double):
        effects = ()

        def response(self, drive_V, step_s, channel, initial_state):
            return model().signal(drive_V, step_s, channel, initial_state)

    found = closure(model(), model(*Double.effects), Base(), 0)
    assert (found["closure"], found["reason"]) == (None, "the base model leaves no error on fresh drives")


def test_an_augmented_model_without_a_bounded_answer_comes_to_the_least_closure():
    found = closure(model(), unbounded(model(*Double.effects)), Double(), 0)
    assert (found["closure"], found["augmented_rms"]) == (LEAST_CLOSURE, None)
    assert "reason" not in found


def test_a_model_knows_the_gains_of_its_channels():
    data = HEAD.as_json(fit={"channels": {"strain_gauge": {"gain": {"value": 0.02}}}})
    found = model_of(data)
    assert isinstance(found, Model)
    assert found.channels == {"self_sensing", "strain_gauge"}
    slow = np.repeat([0.0, 50.0, 0.0], 100)
    gauge, fast = (found.signal(slow, 1e-3, channel, "demagnetised") for channel in ("strain_gauge", "self_sensing"))
    hysteretic_V = Plant(HEAD).hysteretic_V(slow, Excitation("strain_gauge", "demagnetised", 1e-3, slow))
    assert gauge.max() == pytest.approx(0.02 * hysteretic_V.max(), rel=0.05)
    assert fast.shape == slow.shape


def test_parameters_are_compared_where_both_mean_the_same():
    def estimate(value):
        return {"value": value, "low": 0.9 * value, "high": 1.1 * value, "unit": "Hz"}

    verdict = {
        "effects": [
            {"id": "amplifier_bandwidth", "parameters": {"bandwidth_Hz": estimate(2e5)}},
            {"id": "cubic_stiffness", "parameters": {"stiffening_per_V2": estimate(1e-6)}},
            {"id": "second_mode", "parameters": {"frequency_Hz": estimate(9e4)}},
        ]
    }

    def truth(variant):
        concealed = {"id": "amplifier_bandwidth", "variant": variant, "parameters": {"bandwidth_Hz": 2.1e5}}
        spring = {"id": "cubic_stiffness", "variant": "duffing", "parameters": {"k3": 1e-6}}
        return {"effects": [concealed, spring]}

    (row,) = parameters(verdict, truth("first_order"))
    assert (row["effect"], row["truth"], row["value"]) == ("amplifier_bandwidth", 2.1e5, 2e5)
    assert parameters(verdict, truth("second_order")) == []


def test_a_parameter_that_means_something_else_beside_another_is_not_compared():
    def bubble(**others):
        estimates = {"bubble_frequency_Hz": 6.5e4} | others
        there = {name: {"value": v, "low": v, "high": v, "unit": "Hz"} for name, v in estimates.items()}
        return {"effects": [{"id": "air_bubble", "parameters": there}]}

    truth = {"effects": [{"id": "air_bubble", "variant": "compliant", "parameters": {"frequency_Hz": 6.4e4}}]}
    assert [row["parameter"] for row in parameters(bubble(), truth)] == ["bubble_frequency_Hz"]
    assert parameters(bubble(mass_ratio=0.8), truth) == []


def where(recordings=(), time_s=(), frequency_Hz=(), drive_V=()):
    return {"location": {"recordings": recordings, "time_s": time_s, "frequency_Hz": frequency_Hz, "drive_V": drive_V}}


TRUE = {
    "location": {
        "details": [
            {
                "recording": name,
                "time_s": [1e-5, 3e-5],
                "frequency_Hz": [4e4, 6e4],
                "recording_drive_V": [-90.0, 60.0],
            }
            for name in ("r003", "r007")
        ]
    }
}


def test_what_was_told_of_the_place_hits_where_it_holds_half_of_the_true_one():
    told = where(["r007", "r001"], [[2e-5, 9e-5]], [[4e4, 5e4]], [[80, 95]])
    assert located(told, TRUE) == {"recordings": True, "time": True, "frequency": True, "drive": True}


def test_what_was_told_of_the_place_misses_elsewhere():
    told = where(["r001"], [[2.5e-5, 9e-5]], [[6e4, 9e4]], [[10, 80]])
    assert located(told, TRUE) == {"recordings": False, "time": False, "frequency": False, "drive": False}
    assert not any(located(where(), TRUE).values())


def test_stretches_that_overlap_are_not_counted_twice():
    told = where(time_s=[[1e-5, 1.4e-5], [1.1e-5, 1.4e-5], [1.2e-5, 1.4e-5]])
    assert not located(told, TRUE)["time"]


def test_where_nothing_is_to_be_seen_nothing_is_asked():
    assert located(where(["r001"]), {"location": {"details": []}}) == {}


def test_heads_to_optimise_are_taken_from_all_effects_in_turn():
    draws = corpus(1, "full", ("friction",), ("bouc_wen",))
    asked = questions(draws, 34, 3)
    chosen = [d for d in draws if asked[d.number]["reoptimise"]]
    assert len(chosen) == 34
    assert {d.strength for d in chosen} == {"strong"}
    shown = [name for name in STAGES if name not in UNPREDICTABLE]
    assert len({d.effects for d in chosen}) == min(len(shown), 34)
    assert sum(q["baselines"] for q in asked.values()) == 3

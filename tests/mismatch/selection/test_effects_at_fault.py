"""A fault in an effect's code is told; values that cannot be simulated are a failed trial, which a fit leaves."""

import importlib
import math
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.mismatch import diagnose
from inkjet_env.mismatch.fitting.dataset import observe
from inkjet_env.mismatch.selection.hypotheses import settled
from inkjet_env.mismatch.selection.stepwise import _only, without_idle
from inkjet_env.plant import EffectError, Parameter, SimulationError
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.plant.effect import coordinates
from inkjet_env.recordings import Campaign
from tests.mismatch.leak import Leak


def faulty(method, error):
    """The effect with a fault in one of its methods."""

    def fails(self, *_):
        raise error

    return type("Faulty", (Leak,), {"id": "faulty", method: fails})()


METHODS = ("starts", "superposed", "bounds", "untestable", "changes", "description", "sensing", "random_effect_basis")


@pytest.mark.parametrize("workers", [1, 2])
def test_a_value_error_of_an_effect_is_no_effect_that_does_not_explain(workers, recorded, head, effects):
    looked_for = [effects["feedthrough"], faulty("sensing", ValueError("no such thing."))]
    with pytest.raises(
        EffectError, match=r"'faulty': its sensing\(\) raised ValueError: no such thing\. Correct"
    ) as told:
        diagnose(recorded(), head, looked_for, workers=workers)
    assert "no such thing" in str(told.value.__cause__)  # of another process, its traceback


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("error", [ValueError("wrong"), KeyError("wrong"), ZeroDivisionError("wrong")])
def test_the_effect_and_its_method_are_named_and_the_error_is_chained(method, error):
    effect = faulty(method, error)
    call = getattr(effect, method)
    with pytest.raises(EffectError, match=rf"'faulty': its {method}\(\) raised {type(error).__name__}") as told:
        call(*range(call.__wrapped__.__code__.co_argcount - 1))
    assert told.value.__cause__ is error


@pytest.mark.parametrize("error", [SimulationError("no steady state"), OverflowError("math range error")])
def test_values_that_cannot_be_simulated_are_no_fault(error):
    with pytest.raises(type(error)) as told:
        faulty("sensing", error).sensing()
    assert told.value is error


def test_a_method_that_comes_from_beside_the_effect_is_named_too():
    class Beside:
        def drive(self, values, drive_V, excitation):
            return values["missing"]

    class Mixed(Beside, Leak):
        id = "mixed"

    with pytest.raises(EffectError, match=r"'mixed': its drive\(\) raised KeyError: 'missing'"):
        Mixed().drive({}, None, None)


@pytest.mark.parametrize("stage", ["sensing", "drive", "hysteresis"])
@pytest.mark.parametrize("result", [None, np.zeros(3)])
def test_a_signal_of_another_length_is_told(stage, result, fitted, recorded):
    effect = type("Short", (Leak,), {"id": "short", "stage": stage, stage: lambda self, *_: result})()
    joint = fitted(recorded())
    with pytest.raises(EffectError, match=rf"'short': its {stage}\(\) must return an array of shape \(\d+,\)"):
        joint.base.head.plant([(effect, {"leak_per_s": 1.0})]).signal(joint.seen[-1].excitation)


def test_a_resonator_that_is_none_is_told(fitted, recorded):
    effect = type("Lost", (Leak,), {"id": "lost", "stage": "resonator", "resonator": lambda self, *_: None})()
    joint = fitted(recorded())
    excitation = next(o.excitation for o in joint.seen if o.excitation.fast)
    with pytest.raises(EffectError, match=r"its resonator\(\) must return a Resonance; got NoneType"):
        joint.base.head.plant([(effect, {"leak_per_s": 1.0})]).signal(excitation)


@pytest.mark.parametrize("start", [{}, {"leak_per_s": 0.0}])
def test_values_that_the_parameters_cannot_have_are_told(start):
    scaled = {"parameters": (Parameter("leak_per_s", "1/s", 1.0, 1e6, "log"),)}
    with pytest.raises(EffectError, match=r"'leak': values .* of its parameters raised"):
        coordinates(type("Logarithmic", (Leak,), scaled)(), start)


def test_an_effect_that_cannot_be_simulated_in_places_is_fitted_elsewhere(recorded, head, fitted):
    class Narrow(Leak):
        id = "narrow"

        def sensing(self, values, signal, drive_V, printhead, excitation):
            if values["leak_per_s"] > 2.2e3:
                raise SimulationError("more than it can hold")
            return super().sensing(values, signal, drive_V, printhead, excitation)

    joint = fitted(recorded())
    plant = joint.base.head.plant([(Leak(), {"leak_per_s": 2e3})])
    joint = joint.anew(observed=[replace(o, measured=plant.signal(o.excitation)) for o in joint.observed])
    found = settled(joint, joint.fit(ActiveEffects((Narrow(),), np.array([1.0]))))
    assert found.fit.active.theta[0] == pytest.approx(2e3, rel=1e-3)


class Stiff(Leak):
    """Has no answer but on this very head."""

    id, stage = "stiff", "resonator"

    def resonator(self, values, resonance, excitation):
        if resonance.a0 != self.a0:
            raise SimulationError("no steady state")
        return resonance


def test_sensitivities_that_cannot_be_taken_with_an_effect_on_are_those_without(recorded, fitted):
    joint = fitted(recorded())
    effect = Stiff()
    effect.a0 = joint.base.head.printhead.a0
    fit = joint.base.moved(active=ActiveEffects((effect,), np.array([1.0])))
    plain = joint.anew(head=joint.base.head, base=joint.base)
    with pytest.raises(SimulationError):
        fit.head.sensitivities(next(o for o in joint.seen if o.excitation.fast), fit.active.pairs)
    np.testing.assert_allclose(np.abs(joint.near(fit).basis[1]), np.abs(plain.basis[1]), rtol=1e-3, atol=1e-3)


def test_a_step_to_what_is_no_printhead_is_a_failed_trial(true_head, recorded):
    head = true_head(recorded())
    for far in (800.0, 50.0, -50.0):  # beyond all numbers; beyond what rings
        step = np.zeros(head.size)
        step[head.degree + 1] = far
        with pytest.raises(SimulationError):
            head.moved(step)


def test_effects_that_cannot_be_simulated_without_one_of_them_keep_it(recorded, fitted, effects, values, monkeypatch):
    joint = fitted(recorded("feedthrough", "quadratic_damping"))
    two = [effects["feedthrough"], effects["quadratic_damping"]]
    chosen = settled(joint, joint.fit(ActiveEffects.of((e, values(e.id)) for e in two)))

    def unanswered(self, *_, **__):
        raise SimulationError("no steady state under the repeated drive.")

    monkeypatch.setattr(type(joint), "fit", unanswered)
    assert _only(joint, chosen, chosen.fit.active.minus(two[1])) is None
    assert without_idle(joint, chosen, {}) is chosen


def test_what_cannot_be_fitted_to_the_end_stays_where_it_was_as_not_converged(recorded, head, effects, monkeypatch):
    module = importlib.import_module("inkjet_env.mismatch.diagnose")

    def unanswered(*_):
        raise SimulationError("no steady state under the repeated drive.")

    monkeypatch.setattr(module, "settled", unanswered)
    found = diagnose(recorded("quadratic_damping"), head, [effects["quadratic_damping"]], workers=1)
    assert (found.verdict, [n.effect.id for n in found.effects]) == ("named", ["quadratic_damping"])
    assert {e.high for e in found.effects[0].parameters.values()} == {math.inf}
    assert any("quadratic damping did not converge" in note for note in found.notes)


def test_finer_nodes_without_an_answer_are_said_and_not_gone_to(recorded, head, true_head):
    class Coarse(Leak):
        id = "coarse"

        def sensing(self, values, signal, drive_V, printhead, excitation):
            if excitation.substeps > 2 and values["leak_per_s"]:
                raise SimulationError("no steady state")
            return super().sensing(values, signal, drive_V, printhead, excitation)

    campaign = recorded()
    plant = true_head(campaign).plant()
    leaking = plant.with_effects([(Leak(), {"leak_per_s": 2e3})])
    leaked = [leaking.signal(o.excitation) - plant.signal(o.excitation) for o in observe(campaign)]
    recordings = [replace(r, sensor=r.sensor + more) for r, more in zip(campaign.recordings, leaked, strict=True)]
    found = diagnose(Campaign("leaking", tuple(recordings)), head, [Coarse()], workers=1)
    assert [n.effect.id for n in found.effects] == ["coarse"]
    assert any("2 nodes per sample" in note and "cannot be simulated" in note for note in found.notes)

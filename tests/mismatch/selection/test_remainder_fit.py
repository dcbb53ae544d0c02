"""The remainder beside a hypothesis: where it predicts unseen drives, and where it stays away."""

from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.experiments.validation.synthetic_campaigns import record_synthetic
from inkjet_env.mismatch.selection import remainder_fit
from inkjet_env.mismatch.selection.hypotheses import Hypothesis, base_hypothesis
from inkjet_env.mismatch.selection.remainder_fit import fit_remainder
from inkjet_env.plant import Effect, Excitation, Parameter, Plant
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.rig.battery import default_battery

STEP_S = 2e-7
LINES = ("trapezoid-20V", "trapezoid-60V", "trapezoid-80V", "trapezoid-100V", "trapezoid-minus100V", "bipolar-full",
         "bipolar-quiet", "bipolar-uneven", "pulse-pair-0.50T", "pulse-pair-1.50T", "zero", "loop-1")  # fmt: skip


class PiezoBend(Effect):
    """A law outside the catalogue: the ceramic pushes with a share of the product of drive and hysteretic drive."""

    id = "piezo_bend"
    stage = "hysteresis"
    sentence = "The ceramic bends."
    parameters = (Parameter("bend_per_V", "1/V", -1e-2, 1e-2),)
    strengths = ("bend_per_V",)

    def starts(self, printhead, excitations):
        return [{"bend_per_V": 1e-3}]

    def hysteresis(self, values, hysteretic_V, drive_V, printhead, excitation):
        return hysteretic_V + values["bend_per_V"] * drive_V * np.abs(drive_V)


@pytest.fixture(scope="module")
def campaign(head):
    def recorded(effects):
        lines = [line for line in default_battery(head.frequency_Hz) if line.label in LINES]
        fast = [replace(line, drive_V=line.drive_V[:600]) for line in lines if line.channel == "self_sensing"]
        loop = next(line for line in lines if line.label == "loop-1")
        loop = replace(loop, drive_V=loop.drive_V[::4], step_s=4 * loop.step_s)
        return record_synthetic(head, effects, 3, 50.0, False, [loop, *fast, fast[0]], "white")

    return recorded


BEND = (PiezoBend(), {"bend_per_V": 3e-3})


@pytest.fixture(scope="module")
def bent(campaign, fitted):
    joint = fitted(campaign([BEND]))
    return joint, fit_remainder(base_hypothesis(joint))


def fresh_errors(head, remainder, truth, drives):
    """RMS error on drives that no recording has, without and with the remainder, relative to the signal's."""
    errors = []
    for state in ("demagnetised", "periodic"):
        for drive_V in drives:
            shot = Excitation("self_sensing", state, STEP_S, drive_V)
            true, plain = truth.signal(shot), head.plant().signal(shot)
            corrected = replace(head.plant(), remainder=remainder).signal(shot)
            errors.append([np.std(true - one) / np.std(true) for one in (plain, corrected)])
    return np.array(errors)


def test_what_no_effect_explains_is_predicted_on_drives_that_nobody_recorded(bent, head):
    joint, found = bent
    assert found is not None
    assert found.carrier == ()
    assert found.gain > 2 * found.gain_error
    assert found.share > 0.9
    assert found.remainder.size < 20
    truth = Plant(head, effects=(BEND,))
    times_s = STEP_S * np.arange(800)
    drives = [
        np.interp(times_s, [0, 5e-6, 13e-6, 20e-6, 31e-6, 35e-6], [0, 70, 70, -45, -45, 0]),
        np.interp(times_s, [0, 3e-6, 12e-6, 16e-6], [0, -75, -75, 0]),
    ]
    errors = fresh_errors(joint.base.head, found.remainder, truth, drives)
    assert np.all(errors[:, 1] < 0.3 * errors[:, 0])


def test_the_figures_of_a_remainder_are_those_of_a_simulation(bent):
    """A second way: its share from the signals that a plant with the remainder gives for the held-out recordings."""
    joint, found = bent
    plant = replace(joint.base.head.plant(), remainder=found.remainder)
    before = after = 0.0
    for o in joint.observed:
        if o.fitted or o.channel != "self_sensing":
            continue
        signal = plant.signal(o.excitation)
        assert found.modelled[o.name] == pytest.approx(signal, abs=1e-12)
        before += float(np.sum(joint.base.residuals[o.name] ** 2))
        after += float(np.sum(joint.whitened(o, o.measured - signal) ** 2))
    assert found.share == pytest.approx(1 - after / before)


def test_there_is_none_where_the_base_model_explains_the_recordings(campaign, fitted):
    assert fit_remainder(base_hypothesis(fitted(campaign([])))) is None


def test_there_is_none_beside_the_effect_that_explains_the_recordings(campaign, fitted):
    joint = fitted(campaign([BEND]))
    fit = joint.fit(ActiveEffects.of([BEND]))
    assert fit_remainder(Hypothesis(fit, joint.near(fit))) is None


def test_there_is_none_without_held_out_recordings(campaign, fitted):
    assert fit_remainder(base_hypothesis(fitted(campaign([BEND]), held_out=[]))) is None


@pytest.mark.parametrize(("left", "kept"), [((1.0, 0.5), 1), ((1.0, 0.999), 0), ((0.5, 1.0), 0)])
def test_a_minor_effect_gives_way_to_a_remainder_that_predicts_clearly_better(bent, monkeypatch, left, kept):
    joint, fitted = bent
    with_minor, without = base_hypothesis(joint), base_hypothesis(joint)
    of = dict(zip((with_minor, without), left, strict=True))

    def remainder(hypothesis):
        modelled = {o.name: o.measured + of[hypothesis] * joint.noise.rms(o) for o in joint.observed}
        return replace(fitted, modelled=modelled)

    monkeypatch.setattr(remainder_fit, "fit_remainder", remainder)
    hypothesis, found = remainder_fit.best_beside([with_minor, without])
    assert hypothesis is (with_minor, without)[kept]
    assert found.modelled.keys() == fitted.modelled.keys()

"""Which terms of an effect's law a fit keeps: the rest is let in where it is needed, and sent away where it is not."""

import math
from dataclasses import replace

import numpy as np
import pytest

from inkjet_env.mismatch.evidence import named_effects
from inkjet_env.mismatch.fitting.fit_context import FitContext
from inkjet_env.mismatch.fitting.process_pool import ProcessPool
from inkjet_env.mismatch.selection import hypotheses
from inkjet_env.mismatch.selection.hypotheses import attribute, base_hypothesis, completed, settled, shaped, simplest
from inkjet_env.mismatch.selection.rugged_strengths import scanned, widely_scanned
from inkjet_env.mismatch.selection.score_test import signatures
from inkjet_env.mismatch.selection.stepwise import Selection
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.plant.effect import complete, coordinates

STANDARD_ERRORS = 4.0
"""By so many an estimate may be off: of normal errors one in 16,000 is."""
SURE = 5.0
"""Standard errors, or standard deviations of a sum of squares, that nobody would take for noise."""
SEVERAL = {
    "feedthrough": {"capacitive_s": 5e-9, "lossy": 1e-3, "lag_s": 1e-6},
    "ferroelastic_softening": {"softening_per_V": 5e-5, "loss_ratio": 0.5, "rayleigh_per_V": 1e-4},
    "asymmetric_hysteresis": {"asymmetry": 0.03, "lean": 0.05},  # bending and arching would be too alike
    "creep": {"creep_per_decade": 0.01, "onset_s": 0.05, "retarded_1": 0.02, "time_1_s": 0.1},
}
"""Recorded laws of several terms."""
BEGUN = {
    "feedthrough": {"capacitive_s": 2e-9},
    "ferroelastic_softening": {"softening_per_V": 1e-4, "loss_ratio": 1.0},
    "asymmetric_hysteresis": {"lean": 0.1},
    "creep": {"creep_per_decade": 0.02, "onset_s": 0.1},
}
"""Where the fit of the simplest law begins."""
PLAIN = {
    "feedthrough": {"capacitive_s": 5e-9},
    "ferroelastic_softening": {"softening_per_V": 5e-5, "loss_ratio": 0.5},
    "rate_dependent_hysteresis": {"growth": 0.06, "rate_V_s": 100.0},
    "sensor_bandwidth": {"bandwidth_Hz": 3e5},
    "asymmetric_hysteresis": {"asymmetry": 0.03},
}
"""Recorded laws of one part."""
TOO_MUCH = {
    "feedthrough": {"capacitive_s": 2e-9, "lossy": 2e-3, "lag_s": 3e-6},
    "ferroelastic_softening": {"softening_per_V": 3e-5, "loss_ratio": 1.0, "rayleigh_per_V": 3e-5, "power": 0.3},
    "rate_dependent_hysteresis": {"growth": 0.03, "rate_V_s": 100.0, "gain": 0.01, "widening_V": 0.3},
    "sensor_bandwidth": {"bandwidth_Hz": 4e5, "second_order": 0.2},
    "asymmetric_hysteresis": {"asymmetry": 0.05, "bending": 0.01, "arching": 0.01, "lean": 0.02},
}
"""Where a fit begins that has the whole law on."""
OF_NO_PART = {"loss_ratio", "onset_s"}
"""Shapes that are fitted with whatever is on."""


@pytest.fixture(scope="module")
def at(effects, recorded_as, fitted):
    """A function: a joint fit of a recorded law, and a fit of a law begun somewhere, parts that are off left off."""

    def begun(name, recorded, begin):
        joint, effect = fitted(recorded_as(name, **recorded)), effects[name]
        return joint, joint.fit(ActiveEffects.of([(effect, complete(effect, **begin))]))

    return begun


def on(hypothesis):
    """Parts of the last effect's law that are on."""
    return hypothesis.fit.active.terms(hypothesis.fit.active.last)[0]


def errors_off(hypothesis, truth):
    """By how many standard errors each parameter that was fitted misses the truth, base parameters free too."""
    fit, q = hypothesis.fit, hypothesis.joint.basis[0]
    jacobian = fit.jacobian[:, ~fit.idle]
    own = jacobian - q @ (q.T @ jacobian)
    errors = np.sqrt(np.diag(np.linalg.inv(own.T @ own)))
    (effect,) = fit.active.effects
    return (fit.active.theta - coordinates(effect, complete(effect, **truth)))[~fit.idle] / errors


def noise_of_excess(hypothesis):
    return math.sqrt(2 * hypothesis.residuals.size)


def scores_without(hypothesis, terms):
    """The score with each of these parts of the last effect's law off and everything else fitted again."""
    fit, scores = hypothesis.fit, {}
    for term in terms:
        without = fit.active.without_term(fit.active.last, term)
        scores[term] = settled(hypothesis.joint, hypothesis.joint.fit(without, fit.head)).score
    return scores


@pytest.mark.parametrize("name", SEVERAL)
def test_the_whole_law_comes_on_where_several_parts_of_it_were_recorded(name, at):
    joint, begun = at(name, SEVERAL[name], BEGUN[name])
    plain = simplest(joint, begun)
    assert len(on(plain)) == 1
    assert plain.lacks_terms
    whole = shaped(joint, plain.fit, base_hypothesis(joint))
    assert {n for term in on(whole) for n in term} >= set(SEVERAL[name]) - OF_NO_PART
    assert whole.score > plain.score
    assert plain.excess - whole.excess > SURE**2 * (whole.free - plain.free)
    assert abs(whole.excess) < SURE * noise_of_excess(whole)
    assert np.abs(errors_off(whole, SEVERAL[name])).max() < STANDARD_ERRORS


def test_a_start_that_looks_bad_after_one_step_is_continued_where_its_score_promises_the_most(
    recorded_as, fitted, effects, monkeypatch
):
    """A limiter's start that clips too much leaves a large misfit at first."""
    joint, effect = fitted(recorded_as("sensor_saturation", limit=20.0, hardness=50.0)), effects["sensor_saturation"]
    settings, really, context = joint.settings.selection, hypotheses.tried_from, FitContext(ProcessPool(1))
    found = signatures(joint, [effect], context)
    starts = [start for _, start in found.ranked(effect, base_hypothesis(joint).residuals, settings.same_start)]
    screened, continued = [], []

    def seen(joint, active, begin, steps=None, *options, **named):
        fit = really(joint, active, begin, steps, *options, **named)
        if steps == settings.screening_steps:
            nll = fit.nll if active.pairs[0][1] != pytest.approx(starts[0]) else 1e9
            screened.append(replace(fit, nll=nll, converged=False))
            return screened[-1]
        continued.append(begin.nll)
        return fit

    monkeypatch.setattr(hypotheses, "tried_from", seen)
    attribute(joint, base_hypothesis(joint), [effect], found, context)
    assert len(screened) == settings.starts > settings.screened_starts
    assert 1e9 in continued


def test_a_single_effect_gets_what_its_law_lacks_even_where_the_simple_law_leaves_little(at):
    recorded = {"droop": 0.02, "recovery_s": 5e-5, "discharge_share": 1.0}
    joint, begun = at("supply_droop", recorded, {"droop": 0.04, "recovery_s": 5e-5})
    plain = simplest(joint, begun)
    whole = completed(joint, plain)
    assert whole.score > plain.score
    assert "discharge_share" in {n for term in on(whole) for n in term}
    droop = [h.fit.active.pairs[0][1]["droop"] / recorded["droop"] for h in (plain, whole)]
    assert abs(droop[0] - 1) > 0.2
    assert abs(droop[1] - 1) < 0.1


@pytest.mark.parametrize("name", PLAIN)
def test_what_no_part_is_worth_stays_as_it_is(name, at):
    joint, begun = at(name, PLAIN[name], PLAIN[name])
    plain = simplest(joint, begun)
    assert completed(joint, plain).fit.active.pairs == plain.fit.active.pairs


@pytest.mark.parametrize("name", PLAIN)
def test_parts_that_were_not_recorded_are_sent_away_and_the_others_come_out_right(name, at):
    joint, begun = at(name, PLAIN[name], TOO_MUCH[name])
    everything, plain = settled(joint, begun), simplest(joint, begun)
    assert {n for term in on(everything) for n in term} > set(PLAIN[name]) - OF_NO_PART
    assert {n for term in on(plain) for n in term} == set(PLAIN[name]) - OF_NO_PART
    assert plain.free == len(PLAIN[name]) < everything.free
    assert plain.score > everything.score
    assert np.abs(errors_off(plain, PLAIN[name])).max() < STANDARD_ERRORS


def test_parts_that_a_law_hardly_wants_stay_off(at):
    """A logarithm that begins or ends is no chain of elements, though it leaves more than noise."""
    joint, begun = at("creep", {"creep_per_decade": 0.05, "onset_s": 0.05, "retarded_1": 0.02, "time_1_s": 0.1},
                      BEGUN["creep"])  # fmt: skip
    plain = simplest(joint, begun)
    assert plain.leaves_much
    assert not plain.lacks_terms


def test_what_does_nothing_has_a_value_and_no_interval(at):
    """Of slipping elements alone, the loss ratio of the part that is off."""
    joint, begun = at("ferroelastic_softening", {"rayleigh_per_V": 1e-4, "loss_ratio": 1.0},
                      {"rayleigh_per_V": 2e-4, "loss_ratio": 10.0})  # fmt: skip
    chosen = settled(joint, begun)
    assert not chosen.degenerate
    (named,) = named_effects(joint, chosen, Selection(chosen, {}, (chosen,), {}, 1.0, 1.0))
    assert set(named.parameters) == {"rayleigh_per_V"}
    assert set(named.values) == {p.name for p in named.effect.parameters}
    assert named.values["loss_ratio"] == pytest.approx(10.0)


@pytest.mark.parametrize("name", PLAIN)
def test_what_is_plain_stays_plain_where_the_whole_law_is_let_in(name, at):
    joint, begun = at(name, PLAIN[name], PLAIN[name])
    plain = settled(joint, begun)
    again = shaped(joint, plain.fit, base_hypothesis(joint))
    assert on(again) == on(plain)
    assert again.score == plain.score


def test_the_law_that_an_effect_is_attributed_with_has_all_the_parts_it_needs(effects, recorded_as, fitted):
    """No start has both strengths on."""
    joint, effect = fitted(recorded_as("feedthrough", **SEVERAL["feedthrough"])), effects["feedthrough"]
    found = signatures(joint, [effect], FitContext(ProcessPool(1)))
    (best,) = attribute(joint, base_hypothesis(joint), [effect], found, FitContext(ProcessPool(1)))
    assert on(best) == [("capacitive_s",), ("lossy",), ("lag_s",)]
    assert abs(best.excess) < SURE * noise_of_excess(best)


def test_a_rival_that_comes_close_is_not_ruled_out_by_its_simple_law(effects, recorded_as, fitted, monkeypatch):
    """A delay explains two poles of the amplifier better than one pole does, and what it leaves passes as noise."""
    monkeypatch.setattr(hypotheses.Hypothesis, "leaves_much", property(lambda _: False))
    joint = fitted(recorded_as("amplifier_bandwidth", bandwidth_Hz=5e5, second_order=0.5))
    chosen = [effects["trigger_delay"], effects["amplifier_bandwidth"]]
    found, context = signatures(joint, chosen, FitContext(ProcessPool(1))), FitContext(ProcessPool(1))
    by_name = {h.ids[0]: h for h in attribute(joint, base_hypothesis(joint), chosen, found, context)}
    delay, amplifier = by_name["trigger_delay"], by_name["amplifier_bandwidth"]
    assert ("second_order",) in on(amplifier)
    assert amplifier.score > delay.score
    single = simplest(joint, joint.fit(amplifier.fit.active.without_term(chosen[1], ("second_order",)), joint.start))
    assert single.score < delay.score < amplifier.score


@pytest.mark.parametrize("name", ["feedthrough", "sensor_bandwidth"])
def test_an_idle_part_is_the_one_without_which_the_score_is_best(name, at):
    joint, begun = at(name, PLAIN[name], TOO_MUCH[name])
    everything = settled(joint, begun)
    scores = scores_without(everything, on(everything))
    idle = everything.idle_term()
    assert scores[idle] == max(scores.values()) > everything.score


def test_a_part_is_idle_that_the_base_model_could_stand_in_for(at):
    """Thresholds that grow, beside weights that do, are mostly another branch law."""
    truth = {"gain": 0.02, "rate_V_s": 100.0}
    joint, begun = at("rate_dependent_hysteresis", truth, {**truth, "growth": 0.01})
    everything = settled(joint, begun)
    assert everything.idle_term() == ("growth",)
    assert scores_without(everything, [("growth",)])["growth",] > everything.score


def test_an_idle_part_is_of_the_last_effect(effects, values, recorded, fitted):
    joint = fitted(recorded("feedthrough", "quadratic_damping"))
    both = [effects["quadratic_damping"], effects["feedthrough"]]
    planted = [coordinates(effect, values(effect.id)) for effect in both]
    planted[1][2] = 1e-6  # a lag that was not recorded
    everything = settled(joint, joint.fit(ActiveEffects(tuple(both), np.concatenate(planted))))
    scores = scores_without(everything, on(everything))
    assert everything.idle_term() == max(scores, key=scores.get) == ("lag_s",)


@pytest.mark.parametrize(("curvature", "another"), [(0.6, False), (0.0, True)])
def test_an_effect_that_needs_nothing_of_what_makes_it_that_effect_has_become_another(curvature, another, at):
    """A source behind a resistance whose capacitance is constant is an amplifier of one pole."""
    recorded = {"lag_s": 2e-7, "curvature": curvature}
    joint, begun = at("nonlinear_capacitance", recorded, {"lag_s": 1.5e-7, "curvature": 0.3})
    found = settled(joint, begun)
    assert found.gain > 100
    assert found.degenerate == another


def test_no_part_is_idle_where_every_one_is_worth_its_parameters(at):
    joint, begun = at("feedthrough", SEVERAL["feedthrough"], SEVERAL["feedthrough"])
    everything = settled(joint, begun)
    assert max(scores_without(everything, on(everything)).values()) < everything.score
    assert everything.idle_term() is None


def test_an_effects_only_strength_is_never_idle(effects, recorded, fitted):
    """Else nothing of the effect would be left, which is for the selection to say."""
    joint, effect = fitted(recorded()), effects["feedthrough"]
    alone = settled(joint, joint.fit(ActiveEffects.of([(effect, complete(effect, capacitive_s=5e-9))])))
    assert alone.score < base_hypothesis(joint).score
    assert alone.idle_term() is None


def test_a_strength_of_many_minima_is_scanned_around_where_a_fit_ended(at):
    """Updates 1 % too slow: in between lie other minima."""
    joint, begun = at("generator_steps", {"update_s": 1.7e-6}, {"update_s": 1.717e-6})
    alone = settled(joint, begun)
    found = settled(joint, scanned(joint, alone.fit))
    right = settled(joint, at("generator_steps", {"update_s": 1.7e-6}, {"update_s": 1.7e-6})[1])
    assert found.fit.nll == pytest.approx(right.fit.nll, abs=1)
    assert alone.fit.nll > right.fit.nll + 20
    assert found.fit.active.theta[0] == pytest.approx(1.7e-6, rel=1e-3)


def test_many_updates_are_scanned_until_the_last_jump_coincides(at):
    """311 points in a recording: jumps at its end are off by 311 times the error of an interval."""
    truth = {"update_share": 1 / 311.3, "ahead": 0.5}
    joint, begun = at("generator_steps", truth, truth | {"update_share": 1.004 / 311.3})
    found = scanned(joint, begun)
    (values,) = (values for _, values in found.active.pairs)
    assert values["update_share"] == pytest.approx(truth["update_share"], rel=1e-4)


def test_a_strength_of_many_minima_is_found_in_its_whole_range(effects, recorded_as, fitted):
    truth = {"update_share": 1 / 57.3, "ahead": 0.5}
    joint = fitted(recorded_as("generator_steps", **truth))
    found = simplest(joint, widely_scanned(joint, effects["generator_steps"], joint.base))
    (values,) = (values for _, values in found.fit.active.pairs)
    assert values["update_share"] == pytest.approx(truth["update_share"], rel=2e-3)
    right = settled(joint, joint.fit(ActiveEffects.of([(effects["generator_steps"], values | truth)])))
    assert found.fit.nll == pytest.approx(right.fit.nll, abs=2)


def test_late_steps_are_found_beside_the_best_other_explanation(effects, recorded_as, fitted):
    """Updates delay the drive by half of themselves, which the base parameters cannot follow: those of a delay can."""
    truth = 4.7e-6
    joint = fitted(recorded_as("generator_steps", update_s=truth))
    steps, delay = effects["generator_steps"], effects["trigger_delay"]
    delayed = settled(joint, joint.fit(ActiveEffects.of([(delay, {"delay_s": 0.4 * truth})])))
    found = widely_scanned(joint, steps, delayed.fit)
    assert found.nll < delayed.fit.nll
    assert found.active.pairs[0][1]["update_s"] == pytest.approx(truth, rel=3e-3)


def test_an_effect_without_such_a_strength_is_not_scanned(at):
    joint, begun = at("feedthrough", PLAIN["feedthrough"], BEGUN["feedthrough"])
    assert scanned(joint, begun) is begun
    assert widely_scanned(joint, begun.active.last, begun) is None

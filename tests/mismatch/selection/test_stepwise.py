"""Which hypothesis recordings support: starts fitted, effects added, idle ones dropped, equals told."""

import importlib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from inkjet_env.mismatch import DiagnosisSettings
from inkjet_env.mismatch.fitting.fit_context import FitContext
from inkjet_env.mismatch.fitting.process_pool import ProcessPool
from inkjet_env.mismatch.selection.hypotheses import attribute, base_hypothesis, conditions, settled
from inkjet_env.mismatch.selection.score_test import ScoreTest, signatures
from inkjet_env.mismatch.selection.stepwise import (
    cosine,
    leans,
    leaves_too_much,
    select,
    supported,
    weights,
    worth_adding,
)
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.plant.effect import complete, coordinates

select_module = importlib.import_module("inkjet_env.mismatch.selection.stepwise")
LOOKED_FOR = ("quadratic_damping", "cubic_stiffness", "feedthrough", "sensor_bandwidth", "amplifier_bandwidth")


def silent(_):
    """No progress is shown."""


@pytest.fixture(scope="module")
def looked(recorded, fitted, effects):
    """A function: a joint fit of a planted campaign, the effects looked for, and their signatures; each made once."""
    made = {}

    def at(*names, looked_for=LOOKED_FOR):
        if (names, looked_for) not in made:
            joint, chosen = fitted(recorded(*names)), [effects[name] for name in looked_for]
            made[names, looked_for] = joint, chosen, signatures(joint, chosen, FitContext(ProcessPool(1)))
        return made[names, looked_for]

    return at


@pytest.fixture(scope="module")
def selected(looked):
    """A function: what is selected of `LOOKED_FOR` in a planted campaign; each made once."""
    made = {}

    def at(*names):
        if names not in made:
            joint, chosen, found = looked(*names)
            made[names] = select(joint, chosen, found, FitContext(ProcessPool(1)))
        return made[names]

    return at


def test_conditions_hold_every_fitted_row_once(looked):
    joint, _, _ = looked()
    rows = conditions(joint)
    np.testing.assert_array_equal(np.sort(np.concatenate(rows)), np.arange(joint.ends[-1]))
    assert len(rows) == len({o.condition for o in joint.seen})


def test_every_effect_is_attributed_once_the_best_first_and_fitted_to_the_end(looked, values):
    joint, chosen, found = looked("quadratic_damping")
    base = base_hypothesis(joint)
    hypotheses = attribute(joint, base, chosen, found, FitContext(ProcessPool(1)))
    assert {h.ids for h in hypotheses} == {(name,) for name in LOOKED_FOR}
    scores = [h.score for h in hypotheses]
    assert scores == sorted(scores, reverse=True)
    best = hypotheses[0]
    assert best.ids == ("quadratic_damping",)
    assert best.fit.active.theta[0] == pytest.approx(values("quadratic_damping")["damping_per_V"], rel=0.02)
    assert best.gain == pytest.approx(joint.base.nll - best.fit.nll)
    assert best.score < best.gain
    rows = best.residuals.size
    assert abs(best.excess) < 6 * np.sqrt(2 * rows)
    assert base.excess > 10 * abs(best.excess)


def test_fits_on_two_processes_are_those_on_one(looked):
    joint, chosen, found = looked("quadratic_damping")
    base = base_hypothesis(joint)
    one, two = (attribute(joint, base, chosen[:2], found, FitContext(ProcessPool(n))) for n in (1, 2))
    assert [(h.ids, h.fit.nll) for h in one] == [(h.ids, h.fit.nll) for h in two]
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a.fit.active.theta, b.fit.active.theta)


@pytest.mark.parametrize(
    ("excess", "sure_excess", "too_much"),
    [(-300.0, 0.0, False), (0.0, 0.0, False), (900.0, 90.0, False), (900.0, 110.0, True)],
)
def test_too_much_is_left_only_where_it_is_beyond_the_noise(excess, sure_excess, too_much):
    joint = SimpleNamespace(settings=DiagnosisSettings())
    assert leaves_too_much(SimpleNamespace(excess=excess, sure_excess=sure_excess, gain=50.0, joint=joint)) == too_much


def test_an_effect_is_added_beside_those_that_are_on(looked, effects, values):
    joint, chosen, found = looked("feedthrough", "quadratic_damping")
    damping = effects["quadratic_damping"]
    beside = settled(joint, joint.fit(ActiveEffects.of([(damping, values("quadratic_damping"))])))
    best = attribute(joint, beside, chosen, found.beside(beside.columns), FitContext(ProcessPool(1)))[0]
    assert best.ids == ("quadratic_damping", "feedthrough")
    assert best.fit.nll < beside.fit.nll


def test_a_fit_that_settles_is_no_worse_than_where_it_came_from(looked, effects):
    joint, _, _ = looked("quadratic_damping")
    effect = effects["quadratic_damping"]
    begin = joint.fit(ActiveEffects((effect,), np.array([1e-6])), most_steps=1)
    end = settled(joint, begin)
    assert end.fit.nll < begin.nll
    again = settled(end.joint, end.fit)
    assert again.fit.nll == pytest.approx(end.fit.nll, abs=0.6)


def test_an_effect_with_a_shape_at_its_bound_has_become_another(looked, effects):
    joint, _, _ = looked("quadratic_damping")
    mode = effects["second_mode"]
    low, high = joint.limits([mode])
    inside = coordinates(mode, complete(mode, frequency_Hz=1e5, damping_ratio=0.05, strength=0.02))
    jacobian = np.ones((int(joint.ends[-1]), inside.size))
    fit = replace(joint.base.moved(active=ActiveEffects((mode,), inside)), jacobian=jacobian)
    hypothesis = replace(base_hypothesis(joint), fit=fit)
    assert not hypothesis.degenerate
    for k, degenerate in ((0, True), (1, True), (2, False)):  # a strength may be anything
        for end in (low, high):
            theta = inside.copy()
            theta[k] = end[k]
            at_bound = replace(hypothesis, fit=fit.moved(active=fit.active.at(theta)))
            assert at_bound.degenerate == degenerate
            slopes_without = np.where(np.arange(inside.size) == k, 0.0, jacobian)
            assert not replace(at_bound, fit=replace(at_bound.fit, jacobian=slopes_without)).degenerate  # does nothing


def test_nothing_is_selected_from_noise(selected):
    found = selected()
    assert found.chosen.ids == ()
    assert found.alternatives == {}
    assert found.compared == ()
    assert found.p_values == {}


@pytest.mark.parametrize("names", [("quadratic_damping",), ("feedthrough", "quadratic_damping")])
def test_what_was_planted_is_selected_and_nothing_else_would_do(names, selected):
    found = selected(*names)
    assert set(found.chosen.ids) == set(names)
    assert found.alternatives == dict.fromkeys(found.chosen.ids, ())
    assert found.p_values.keys() == set(names)
    assert max(found.p_values.values()) < 1e-6
    scores = [h.score for h in found.compared]
    assert scores == sorted(scores, reverse=True)
    assert frozenset(names) in {frozenset(h.ids) for h in found.compared}


def test_an_equal_is_told_beside_the_chosen_one(selected):
    found = selected("sensor_bandwidth")
    (chosen,) = found.chosen.ids
    (other,) = found.alternatives[chosen]
    assert {chosen, other} == {"sensor_bandwidth", "amplifier_bandwidth"}
    by_ids = {h.ids: h for h in found.compared}
    base = base_hypothesis(found.chosen.joint)
    assert cosine(base, by_ids[chosen,], by_ids[other,]) > 0.999
    assert abs(cosine(base, by_ids[chosen,], by_ids["feedthrough",])) < 0.9


def test_what_does_not_show_is_not_added_and_what_idles_is_dropped(looked, effects, values):
    joint, _, _ = looked("quadratic_damping")
    damping, feedthrough = effects["quadratic_damping"], effects["feedthrough"]
    base = base_hypothesis(joint)
    alone = settled(joint, joint.fit(ActiveEffects.of([(damping, values("quadratic_damping"))])))
    assert supported(base, alone)
    assert worth_adding(base, alone)
    assert alone.noise_known
    both = settled(
        joint,
        joint.fit(
            ActiveEffects((damping, feedthrough), np.append(alone.fit.active.theta, [1e-12, 1e-8, 0.0])), alone.fit.head
        ),
    )
    assert both.gain >= alone.gain - 0.5
    assert not (supported(alone, both) and worth_adding(alone, both))
    assert not supported(alone, base)


def test_support_asks_for_conditions_left_out_and_not_for_the_fit_alone(looked):
    """A hypothesis that does well on one condition by failing on the others is not supported."""
    joint, chosen, found = looked("quadratic_damping")
    base = base_hypothesis(joint)
    best = attribute(joint, base, chosen[:1], found, FitContext(ProcessPool(1)))[0]
    assert supported(base, best)
    lucky = replace(best)
    worse = replace(best.predicted, residuals=best.predicted.residuals + 20.0)
    vars(lucky)["predicted"] = worse  # as if each condition left out had been foretold badly
    assert lucky.score == best.score
    assert not supported(base, lucky)


def test_each_p_value_is_of_the_test_that_added_the_effect_whichever_parent_won(looked, monkeypatch):
    """The first choice leads nowhere; what is chosen in the end grew from another member of the beam."""
    joint, chosen, found = looked(
        "feedthrough", "quadratic_damping", looked_for=("feedthrough", "quadratic_damping", "cubic_stiffness")
    )
    base = base_hypothesis(joint)
    parents = {}

    def first_choice_is_a_dead_end(joint, beside, effects, *rest, **options):
        hypotheses = attribute(joint, beside, effects, *rest, **options)
        if beside.ids == ("cubic_stiffness",):
            return []
        if not beside.ids:
            best = min(h.fit.nll for h in hypotheses)
            parents.update({h.ids: h for h in hypotheses})
            hypotheses = [
                replace(h, fit=replace(h.fit, nll=best - 1)) if h.ids == ("cubic_stiffness",) else h for h in hypotheses
            ]
        return sorted(hypotheses, key=lambda h: -h.score)

    monkeypatch.setattr(select_module, "attribute", first_choice_is_a_dead_end)
    monkeypatch.setattr(ScoreTest, "p_value", lambda self, score, rng, draws: 1e-3 / max(score, 1.0))
    found_at_last = select(joint, chosen, found, FitContext(ProcessPool(1)))
    assert set(found_at_last.chosen.ids) == {"feedthrough", "quadratic_damping"}
    first, second = found_at_last.chosen.ids

    def p_value(parent):
        beside = found.beside(parent.columns)
        return beside.p_value(max(beside.best(parent.residuals).values()), None, 2000)

    assert found_at_last.p_values == {first: p_value(base), second: p_value(parents[first,])}


def test_what_the_truth_leaves_leans_to_no_rival_and_what_a_rival_leaves_leans_to_the_truth():
    rng = np.random.default_rng(0)
    noise, shape = rng.standard_normal((200, 5000)), np.sin(np.arange(5000) / 40)
    truth = [SimpleNamespace(residuals=one) for one in noise]
    rival = [SimpleNamespace(residuals=one + 0.2 * shape) for one in noise]
    assert sum(leans(one, other, 3.0) for one, other in zip(truth, rival, strict=True)) <= 3  # 0.13 % each
    assert all(leans(other, one, 3.0) for one, other in zip(truth, rival, strict=True))


def test_the_second_best_start_is_refined_too_where_the_first_leaves_much(looked, effects, monkeypatch):
    """A mode begun an octave too high looks best after a few steps and ends in another minimum."""
    joint, _, found = looked("second_mode", looked_for=("second_mode",))
    mode = effects["second_mode"]
    begun = [
        joint.fit(
            ActiveEffects.of([(mode, complete(mode, frequency_Hz=f, damping_ratio=0.1, strength=0.02))]), most_steps=1
        )
        for f in (1.6e5, 3e4)
    ]
    ends = sorted((settled(joint, fit) for fit in begun), key=lambda h: h.fit.nll)
    assert ends[1].fit.nll - ends[0].fit.nll > 100
    worse = next(fit for fit in begun if settled(joint, fit).fit.nll == ends[1].fit.nll)
    other = next(fit for fit in begun if fit is not worse)
    given = [replace(worse, nll=other.nll - 1), other]
    hypotheses = importlib.import_module("inkjet_env.mismatch.selection.hypotheses")
    monkeypatch.setattr(hypotheses, "_begun", lambda *_: given)
    (best,) = attribute(joint, base_hypothesis(joint), [mode], found, FitContext(ProcessPool(1)))
    assert best.fit.nll <= ends[0].fit.nll + 1


def test_a_law_that_agrees_to_a_ten_thousandth_of_the_gain_is_not_ruled_out():
    """Twenty nats tell effects apart where they are a good part of the gain, not where laws are that approximate."""
    joint = SimpleNamespace(settings=DiagnosisSettings())

    def explaining(name, score):
        return SimpleNamespace(
            ids=(name,), score=score, gain=score, sure_excess=0.0, degenerate=False, joint=joint, residuals=np.zeros(1)
        )

    for gain, apart in ((1e3, 0.15), (1e6, 0.96)):
        chosen, other = explaining("trigger_delay", gain), explaining("amplifier_bandwidth", gain - 20)
        found = weights(SimpleNamespace(chosen=chosen, compared=(chosen, other)), "trigger_delay")
        assert found == {"trigger_delay": 1.0, "amplifier_bandwidth": pytest.approx(apart, abs=0.02)}

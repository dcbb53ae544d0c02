"""Effects that are on together: one vector, and where each effect stands in it."""

import numpy as np
import pytest

from inkjet_env.plant import catalogue
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.plant.effect import complete
from inkjet_env.printhead import Printhead

EFFECTS = {effect.id: effect for effect in catalogue()}
MODE, CUBIC = EFFECTS["second_mode"], EFFECTS["cubic_stiffness"]
MODE_VALUES = complete(MODE, frequency_Hz=80e3, damping_ratio=0.04, strength=0.02)
CUBIC_VALUES = complete(CUBIC, stiffening_per_V2=1e-6)
BOTH = ActiveEffects.of([(MODE, MODE_VALUES), (CUBIC, CUBIC_VALUES)])


def test_values_come_back_from_the_vector():
    for (effect, values), given in zip(BOTH.pairs, (MODE_VALUES, CUBIC_VALUES), strict=True):
        assert values == pytest.approx(given), effect.id


def test_slices_cover_the_vector_once_in_the_order_of_the_effects():
    places = np.concatenate([np.arange(BOTH.theta.size)[BOTH.slices[name]] for name in BOTH.ids])
    assert places.tolist() == list(range(BOTH.theta.size))
    assert [parameter.name for _, parameter in BOTH.parameters[BOTH.slices[CUBIC.id]]] == [
        p.name for p in CUBIC.parameters
    ]


def test_one_more_and_one_less_is_the_same_again():
    one = ActiveEffects.of([(MODE, MODE_VALUES)])
    assert one.plus(CUBIC, CUBIC_VALUES).theta.tolist() == BOTH.theta.tolist()
    less = BOTH.minus(CUBIC)
    assert less.ids == (MODE.id,)
    assert less.theta == pytest.approx(one.theta, rel=1e-15)


@pytest.mark.parametrize("effect", catalogue(), ids=lambda effect: effect.id)
def test_terms_that_are_switched_off_are_told_as_off(effect):
    values = complete(effect, **{p.name: p.low if p.plain is None else p.plain for p in effect.parameters})
    active = ActiveEffects.of([(effect, values)])
    on, _ = active.terms(effect)
    for term in on:
        switched = active.without_term(effect, term)
        assert term in switched.terms(effect)[1]
        names = {effect.parameters[k].name for k in np.flatnonzero(switched.off)}
        assert set(term) <= names


def test_a_step_moves_one_coordinate_and_leaves_the_original():
    before = BOTH.theta.copy()
    moved = BOTH.stepped(1, 0.5)
    assert np.flatnonzero(moved.theta != before).tolist() == [1]
    assert BOTH.theta.tolist() == before.tolist()


def test_bounds_are_those_of_each_effect_one_after_another():
    low, high = BOTH.bounds(Printhead.published(), [])
    assert low.shape == high.shape == BOTH.theta.shape
    assert (low <= BOTH.theta).all()
    assert (BOTH.theta <= high).all()


@pytest.mark.parametrize(
    ("effects", "theta"), [((MODE,), np.zeros(1)), ((CUBIC, CUBIC), np.zeros(2 * len(CUBIC.parameters)))]
)
def test_what_does_not_fit_together_is_refused(effects, theta):
    with pytest.raises(ValueError, match=r"theta must have shape|once only"):
        ActiveEffects(effects, theta)

"""Effects that are on together: one vector, and where each effect stands in it."""

import numpy as np
import pytest

from inkjet_env.plant import catalogue
from inkjet_env.plant.active_effects import ActiveEffects
from inkjet_env.plant.effect import complete

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


def test_other_values_of_one_effect_leave_those_of_the_others():
    other = BOTH.with_values(CUBIC, complete(CUBIC, stiffening_per_V2=3e-6))
    assert other.theta_of(MODE).tolist() == BOTH.theta_of(MODE).tolist()
    assert dict(other.pairs)[CUBIC]["stiffening_per_V2"] == 3e-6


def test_a_logarithm_has_scale_one_and_a_linear_coordinate_its_own_size():
    frequency, strength = (next(k for k, (_, p) in enumerate(BOTH.parameters) if p.name == name)
                           for name in ("frequency_Hz", "strength"))  # fmt: skip
    assert BOTH.scale(frequency) == 1.0
    assert BOTH.scale(strength) == 0.02
    low, high = BOTH.parameters[strength][1].bounds
    assert BOTH.stepped(strength, -0.02).scale(strength) == 1e-6 * (high - low)


@pytest.mark.parametrize(
    ("effects", "theta"), [((MODE,), np.zeros(1)), ((CUBIC, CUBIC), np.zeros(2 * len(CUBIC.parameters)))]
)
def test_what_does_not_fit_together_is_refused(effects, theta):
    with pytest.raises(ValueError, match=r"theta must have shape|active only once"):
        ActiveEffects(effects, theta)

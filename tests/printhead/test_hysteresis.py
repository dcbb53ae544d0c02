"""Branch law with turning-point memory against the play operators, and the limits both must keep."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from inkjet_env.printhead import BranchLaw, PlayOperators, Printhead

LAW = Printhead.published().branch_law
DRIVES = st.lists(st.floats(-100, 100).map(lambda u: round(u, 3)), min_size=2, max_size=25)


def rms_difference(operators: int) -> float:
    """Between Q and that many play operators, in volts, over minor loops of many drives from the demagnetised state."""
    plays = PlayOperators.of_branch_law(LAW, operators)
    drives_V = np.random.default_rng(3).uniform(-90, 90, (200, 6))
    differences = [LAW.hysteretic_V(u, "demagnetised") - plays.hysteretic_V(u, "demagnetised") for u in drives_V]
    return float(np.sqrt(np.mean(np.square(differences))))


def test_play_operators_approach_the_branch_law_with_the_square_of_their_number():
    errors = np.array([rms_difference(n) for n in (50, 100, 200, 400, 800)])
    np.testing.assert_allclose(np.log2(errors[:-1] / errors[1:]), 2.0, atol=0.2)
    assert errors[-1] < 1e-4


@given(DRIVES)
@settings(max_examples=60, deadline=None)
def test_full_memory_equals_play_operators_on_any_drive(drive_V):
    plays = PlayOperators.of_branch_law(LAW, 400)
    for state in ("demagnetised", "periodic"):
        ours, theirs = LAW.hysteretic_V(drive_V, state), plays.hysteretic_V(drive_V, state)
        np.testing.assert_allclose(ours - ours[0], theirs - theirs[0], atol=1.5e-2)


def test_without_curvature_there_is_no_hysteresis():
    law = BranchLaw((0.8, 0.0), 180.0)
    drive_V = np.random.default_rng(0).uniform(-90, 90, 50)
    np.testing.assert_allclose(law.hysteretic_V(drive_V, "demagnetised"), 0.8 * drive_V, atol=1e-12)


def test_the_virgin_curve_is_half_the_branch_at_twice_the_drive():
    u = np.linspace(0, 90, 19)
    np.testing.assert_allclose(
        LAW.hysteretic_V(u, "demagnetised"), 180 * LAW.Q(2 * u / 180) / 2, rtol=1e-13, atol=1e-13
    )


def test_a_closed_minor_loop_is_wiped_out():
    with_loop = LAW.hysteretic_V([0, 80, -10, 40, -80], "demagnetised")
    without = LAW.hysteretic_V([0, 80, -80], "demagnetised")
    assert with_loop[-1] == pytest.approx(without[-1], abs=1e-12)


def test_a_minor_loop_returns_to_where_it_began():
    values = LAW.hysteretic_V([0, 80, -10, 40, -10], "demagnetised")
    assert values[4] == pytest.approx(values[2], abs=1e-12)


def test_congruency_loops_between_the_same_drives_are_equal_wherever_they_hang():
    rising = LAW.hysteretic_V([-90, 40, -10, 40], "demagnetised")
    falling = LAW.hysteretic_V([90, -10, 40, -10], "demagnetised")
    assert rising[1] - rising[2] == pytest.approx(falling[2] - falling[1], abs=1e-12)


@given(DRIVES)
@settings(max_examples=60, deadline=None)
def test_hysteresis_is_odd(drive_V):
    flipped = LAW.hysteretic_V([-u for u in drive_V], "demagnetised")
    np.testing.assert_allclose(flipped, -LAW.hysteretic_V(drive_V, "demagnetised"), atol=1e-10)


@given(DRIVES, st.integers(2, 6))
@settings(max_examples=60, deadline=None)
def test_hysteresis_is_rate_independent(drive_V, parts):
    """More samples on the way do not change where it ends."""
    knots = np.arange(len(drive_V))
    fine = np.interp(np.linspace(0, knots[-1], knots[-1] * parts + 1), knots, drive_V)
    np.testing.assert_allclose(
        LAW.hysteretic_V(fine, "demagnetised")[::parts], LAW.hysteretic_V(drive_V, "demagnetised"), atol=1e-9
    )


@given(DRIVES)
@settings(max_examples=60, deadline=None)
def test_a_periodic_drive_closes_its_loop(drive_V):
    around = [*drive_V, drive_V[0]]
    values = LAW.hysteretic_V(around, "periodic")
    assert values[-1] == pytest.approx(values[0], abs=1e-9)


def test_the_tangent_continues_the_branch_beyond_what_was_identified():
    assert float(LAW.Q(1.0)) == pytest.approx(0.99763, abs=5e-6)
    assert float(LAW.Q(200 / 180)) == pytest.approx(1.139, abs=5e-4)
    h = 1e-6
    assert float(LAW.Q(1 + h) - LAW.Q(1)) / h == pytest.approx(float(LAW.Q(1) - LAW.Q(1 - h)) / h, rel=1e-4)
    assert float(LAW.curvature(1.05)) == 0.0


def test_the_published_density_is_negative_only_on_a_short_stretch():
    x = np.linspace(0, 1, 100_001)
    negative = x[LAW.curvature(x) < 0]
    assert negative.min() == pytest.approx(0.8355, abs=2e-4)
    assert negative.max() == pytest.approx(0.8860, abs=2e-4)
    assert LAW.curvature(x).min() == pytest.approx(-0.054, abs=1e-3)
    np.testing.assert_allclose(LAW.density(x / 2), 2 * LAW.curvature(x))


def test_the_branch_law_is_the_integral_of_the_play_density():
    """Q(Δ) = Q'(0) Δ + 2 ∫₀^{Δ/2} p(r) (Δ/2 - r) dr, by quadrature."""
    from scipy.integrate import quad

    for x in (0.1, 0.45, 0.99):
        integral, _ = quad(lambda r, x=x: float(LAW.density(r)) * (x / 2 - r), 0, x / 2)
        assert float(LAW.Q(x)) == pytest.approx(float(LAW.slope(0.0)) * x + 2 * integral, rel=1e-10)


def test_strength_scales_the_density_and_leaves_the_linear_part():
    strong = LAW.strengthened(1.4)
    r = np.linspace(0, 0.5, 20)
    np.testing.assert_allclose(strong.density(r), 1.4 * LAW.density(r), atol=1e-11)
    assert float(strong.slope(0.0)) == float(LAW.slope(0.0))


@pytest.mark.parametrize(
    ("coefficients", "message"),
    [
        ((1.0,), "2 to 17 numbers"),
        ((1.0, np.nan, 0.0), "must be finite"),
        ((1.0, 0.5), "last hysteresis coefficient must be 0"),
    ],
)
def test_a_law_that_cannot_be_is_refused(coefficients, message):
    with pytest.raises(ValueError, match=message):
        BranchLaw(coefficients, 180.0)


def test_unknown_initial_state_suggests_the_nearest():
    with pytest.raises(ValueError, match=r"initial_state must be one of .*Did you mean 'demagnetised'"):
        LAW.hysteretic_V([0, 1], "demagnetized")

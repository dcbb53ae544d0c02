"""Least squares under inequalities against another solver, and what the inequalities of a density let through."""

import numpy as np
import pytest
from scipy.optimize import minimize

from inkjet_env.identification.constrained import density_constraints, least_squares_above_zero
from inkjet_env.printhead import BranchLaw

GRID = np.linspace(0, 1, 2001)


def law(ascending):
    return BranchLaw((*ascending[::-1], 0.0), 180.0)


def problem(seed, variables=5, rows=8):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(30, variables)), rng.normal(size=30), rng.normal(size=(rows, variables))


@pytest.mark.parametrize("seed", range(12))
def test_the_constrained_minimum_is_that_of_another_solver(seed):
    matrix, target, constraints = problem(seed)
    z, _ = least_squares_above_zero(matrix, target, constraints)
    other = minimize(
        lambda z: 0.5 * np.sum((matrix @ z - target) ** 2),
        np.zeros(z.size),
        jac=lambda z: matrix.T @ (matrix @ z - target),
        constraints={"type": "ineq", "fun": lambda z: constraints @ z, "jac": lambda z: constraints},
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    assert (constraints @ z).min() > -1e-12
    np.testing.assert_allclose(z, other.x, atol=1e-6)


@pytest.mark.parametrize("seed", range(12))
def test_at_the_minimum_only_the_active_constraints_push_and_they_push_inwards(seed):
    matrix, target, constraints = problem(seed)
    z, active = least_squares_above_zero(matrix, target, constraints)
    gradient = matrix.T @ (matrix @ z - target)
    pushes = np.linalg.lstsq(constraints[active].T, gradient, rcond=None)[0]
    np.testing.assert_allclose(constraints[active].T @ pushes, gradient, atol=1e-10)
    assert (pushes > 0).all()
    np.testing.assert_allclose(constraints[active] @ z, 0, atol=1e-12)


def test_constraints_that_hold_anyway_change_nothing():
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(30, 4))
    target = matrix @ np.array([1.0, 2.0, 3.0, 4.0]) + 0.01 * rng.normal(size=30)
    z, active = least_squares_above_zero(matrix, target, np.eye(4))
    np.testing.assert_allclose(z, np.linalg.lstsq(matrix, target, rcond=None)[0], rtol=1e-12)
    assert not active.any()


def test_the_units_of_the_variables_do_not_matter():
    matrix, target, constraints = problem(3)
    units = np.array([1e-6, 1.0, 1e3, 1e8, 1e-2])
    z, _ = least_squares_above_zero(matrix, target, constraints)
    scaled, _ = least_squares_above_zero(matrix * units, target, constraints * units)
    np.testing.assert_allclose(scaled * units, z, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("degree", range(1, 13))
def test_every_law_that_is_let_through_has_a_density(degree):
    rng = np.random.default_rng(degree)
    constraints = density_constraints(degree)
    for _ in range(5):
        # The nearest law to a random one that is let through lies on the edge of what is.
        coefficients, _ = least_squares_above_zero(np.eye(degree), rng.normal(0, 3, degree), constraints)
        found = law(coefficients)
        size = max(1.0, np.abs(coefficients).max())
        assert found.curvature(GRID).min() > -1e-9 * size
        assert found.slope(0.0) > -1e-12 * size


def test_a_law_with_a_dip_in_its_density_is_not_let_through():
    constraints = density_constraints(4)
    for dip in (-0.01, -0.1):
        # Q'' = 4 (x - 1/2)² + dip
        coefficients = np.array([0.7, (1 + dip) / 2, -4 / 6, 4 / 12])
        assert law(coefficients).curvature(GRID).min() == pytest.approx(dip)
        assert (constraints @ coefficients).min() < 0


def test_laws_well_inside_are_let_through():
    # Q'' = 4 (x - 1/2)² + 0.1: the elevated coefficients lie up to 4/60 below the polynomial.
    assert (density_constraints(4) @ np.array([0.7, 1.1 / 2, -4 / 6, 4 / 12])).min() >= 0

"""Linear least squares under linear inequalities, and the inequalities that make the density of a branch law valid."""

from __future__ import annotations

from math import comb

import numpy as np

from inkjet_env.typing import Real

ELEVATED_DEGREE = 60
"""Degree of the Bernstein form in which ``Q''`` must be non-negative."""


def density_constraints(degree: int) -> Real:
    """Rows ``G`` such that ``G c ≥ 0`` makes ``Q(x) = Σ c_j x^j`` a Prandtl–Ishlinskii law: shape (m, degree).

    The conditions are ``Q'(0) ≥ 0`` and ``Q''(x) ≥ 0`` on 0 … 1, since ``p(r) = 2 Q''(2r)``, Eq. (4) of
    docs/explanation/model.md. The second is imposed as non-negative Bernstein coefficients after elevation to degree
    `ELEVATED_DEGREE`: this is sufficient everywhere, and stricter than necessary by at most a share 1/60 of the
    polynomial's bend.
    """
    slope = np.zeros((1, degree))
    slope[0, 0] = 1.0
    if degree < 2:
        return slope
    curvature = np.zeros((ELEVATED_DEGREE + 1, degree))
    for j in range(2, degree + 1):
        # The Bernstein coefficients of x^i in degree N are C(k, i) / C(N, i).
        i = j - 2
        for k in range(i, ELEVATED_DEGREE + 1):
            curvature[k, j - 1] = j * (j - 1) * comb(k, i) / comb(ELEVATED_DEGREE, i)
    return np.vstack([slope, curvature])


def least_squares_above_zero(matrix: Real, target: Real, constraints: Real) -> tuple[Real, Real]:
    """``z`` that minimises ``|matrix z - target|`` subject to ``constraints z ≥ 0``, and the active constraints.

    Lawson and Hanson's least-distance programming by non-negative least squares (Solving Least Squares Problems,
    chapter 23): exact and finite.

    Parameters
    ----------
    matrix : ndarray, shape (m, n)
        Matrix of full column rank.
    target : ndarray, shape (m,)
        Values to approximate.
    constraints : ndarray, shape (k, n)
        One row per inequality.

    Returns
    -------
    z : ndarray, shape (n,)
        The minimiser.
    active : ndarray of bool, shape (k,)
        Whether each inequality holds with equality.
    """
    from scipy.optimize import nnls

    scale = np.linalg.norm(matrix, axis=0)
    q, r = np.linalg.qr(matrix / scale)
    free = np.linalg.solve(r, q.T @ target)
    scaled = constraints / scale
    scaled = scaled / np.linalg.norm(scaled, axis=1, keepdims=True)
    if (scaled @ free >= 0).all():
        return free / scale, np.zeros(len(constraints), dtype=bool)
    reach = scaled @ np.linalg.inv(r)
    size = np.linalg.norm(reach, axis=1, keepdims=True)
    reach, least = reach / size, -(scaled @ free) / size[:, 0]
    unit = np.linalg.norm(least)
    system = np.vstack([reach.T, least[None, :] / unit])
    multipliers, _ = nnls(system, np.append(np.zeros(reach.shape[1]), 1.0), maxiter=50 * system.shape[1])
    residual = system @ multipliers
    residual[-1] -= 1.0
    step = -unit * residual[:-1] / residual[-1]
    return (free + np.linalg.solve(r, step)) / scale, multipliers > 0

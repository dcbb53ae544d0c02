"""Linear least squares under linear inequalities, and the inequalities that make a branch law a valid density."""

from __future__ import annotations

from math import comb

import numpy as np

from inkjet_env.typing import Real

ELEVATED_DEGREE = 60


def density_constraints(degree: int) -> Real:
    """Rows ``G`` such that ``G c ≥ 0`` makes ``Q(x) = Σ c_j x^j`` a Prandtl–Ishlinskii law: shape (m, degree).

    ``Q'(0) ≥ 0`` and ``Q''(x) ≥ 0`` on 0 … 1, since ``p(r) = 2 Q''(2r)``. The second asks for non-negative Bernstein
    coefficients after elevation to degree `ELEVATED_DEGREE`: sufficient everywhere, and short of necessary by no more
    than a share 1/60 of the polynomial's bend.
    """
    slope = np.zeros((1, degree))
    slope[0, 0] = 1.0
    if degree < 2:
        return slope
    curvature = np.zeros((ELEVATED_DEGREE + 1, degree))
    for j in range(2, degree + 1):
        # Bernstein coefficients of x^i in degree N are C(k, i) / C(N, i).
        i = j - 2
        for k in range(i, ELEVATED_DEGREE + 1):
            curvature[k, j - 1] = j * (j - 1) * comb(k, i) / comb(ELEVATED_DEGREE, i)
    return np.vstack([slope, curvature])


def least_squares_above_zero(matrix: Real, target: Real, constraints: Real) -> tuple[Real, Real]:
    """``z`` that minimises ``|matrix z - target|`` with ``constraints z ≥ 0``, and which constraints hold it.

    Lawson and Hanson's least-distance programming by non-negative least squares (Solving Least Squares Problems,
    chapter 23): exact and finite.

    Parameters
    ----------
    matrix : ndarray, shape (m, n)
        Of full column rank.
    target : ndarray, shape (m,)
    constraints : ndarray, shape (k, n)

    Returns
    -------
    z : ndarray, shape (n,)
    active : ndarray of bool, shape (k,)
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

"""Standard errors that hold when a model is slightly wrong: residuals of one condition count as one observation.

Cluster-robust ("sandwich") covariance by condition, with each condition's residuals predicted without it (CR3 of Bell &
McCaffrey 2002, i.e. the jackknife over conditions): Eq. (4) of docs/explanation/diagnosis.md,

    Cov(θ̂) = Σ_c w_c r̃_c r̃_cᵀ w_cᵀ,    r̃_c = (I − H_cc)⁻¹ r_c,                                                  (4)

with ``w = (JᵀJ)⁻¹Jᵀ`` and ``H`` the hat matrix. The classical error assumes that residuals are noise; the larger of the
two is reported, since a misfit of a few per cent of the noise, which no test sees, moves a parameter by its error.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2
from scipy.stats import t as student

from inkjet_env.identification.outcome import QUANTILE_90
from inkjet_env.mismatch.selection.cross_validation import LeaveOutResiduals
from inkjet_env.mismatch.settings import SelectionSettings
from inkjet_env.typing import Real


def robust_errors(
    classical: Real, weights: Real, basis: Real, left_out: LeaveOutResiduals, settings: SelectionSettings
) -> Real:
    """The larger of the classical standard errors and those of Eq. (4), shape (k,).

    Multiplied by the normal quantile, they give the intervals: where conditions scatter by significantly more than
    noise, errors are widened by the ratio of Student's quantile to it for the effective number of conditions.

    Parameters
    ----------
    classical : ndarray, shape (k,)
        Standard errors if residuals are noise.
    weights : ndarray, shape (k, p)
        Parameters as combinations of the coordinates of ``basis``: ``w = weights @ basis.T``.
    basis : ndarray, shape (rows, p)
        Orthonormal columns.
    left_out : LeaveOutResiduals
        Residuals ``r̃`` with each condition left out.
    settings : SelectionSettings
        When the scatter counts.
    """
    errors, conditions = clustered_errors(weights, basis, left_out)
    freedom = np.maximum(conditions - 1, 1.0)
    more = (errors / np.maximum(classical, 1e-300)) ** 2 > chi2.ppf(settings.conditions_significance, freedom) / freedom
    widened = np.where(more, student.ppf(0.95, freedom) / QUANTILE_90, 1.0) * errors
    return np.where(conditions >= settings.least_conditions, np.maximum(widened, classical), classical)


def clustered_errors(weights: Real, basis: Real, left_out: LeaveOutResiduals) -> tuple[Real, Real]:
    """Standard errors by Eq. (4), and the effective number of conditions that determine each parameter, (k,) each.

    Parameters are those of `robust_errors`.
    """
    change, information = [], []
    for rows in left_out.groups:
        change.append(weights @ (basis[rows].T @ left_out.residuals[rows]))
        information.append(np.sum((weights @ basis[rows].T) ** 2, axis=1))
    share = np.array(information) / np.maximum(np.sum(information, axis=0), 1e-300)
    conditions = 1 / np.maximum(np.sum(share**2, axis=0), 1e-300)
    return np.sqrt(np.sum(np.square(change), axis=0)), conditions  # Eq. (4)


def scatter_p_value(size: float, direction: Real, left_out: LeaveOutResiduals) -> float:
    """Probability that something in the residuals is nothing, by how much its size scatters between conditions.

    One-sided, by Student's distribution for the effective number of conditions. Residuals need not be independent
    within a condition.

    Parameters
    ----------
    size : float
        Its size, in standard deviations of independent noise.
    direction : ndarray, shape (rows,)
        Its unit vector.
    left_out : LeaveOutResiduals
        Residuals without it, with each condition left out.
    """
    errors, conditions = clustered_errors(np.ones((1, 1)), direction[:, None], left_out)
    return float(student.sf(abs(size) / max(float(errors[0]), 1e-300), max(float(conditions[0]) - 1, 1.0)))

"""Standard errors that hold when a model is slightly wrong: residuals of one condition count as one observation.

Cluster-robust ("sandwich") covariance by condition, with each condition's residuals predicted without it (CR3 of Bell &
McCaffrey 2002, i.e. the jackknife over conditions): Eq. (3) of docs/explanation/diagnosis.md,

    Cov(θ̂) = Σ_c w_c r̃_c r̃_cᵀ w_cᵀ,    r̃_c = (I − H_cc)⁻¹ r_c,                                                  (3)

with ``w = (JᵀJ)⁻¹Jᵀ`` and ``H`` the hat matrix. The classical error assumes that residuals are noise; the larger of the
two is reported.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import t as student

from inkjet_env.identification.outcome import QUANTILE_90
from inkjet_env.mismatch.selection.cross_validation import LeaveOutResiduals
from inkjet_env.typing import Real

LEAST_CONDITIONS = 3.0
"""Effective number of conditions that determine a parameter, below which their scatter says nothing about its error."""


def clustered_errors(weights: Real, basis: Real, left_out: LeaveOutResiduals) -> Real:
    """Standard errors of parameters by Eq. (3), as multiples of which normal quantiles give the interval, shape (k,).

    Parameters
    ----------
    weights : ndarray, shape (k, p)
        Parameters as combinations of the coordinates of ``basis``: ``w = weights @ basis.T``.
    basis : ndarray, shape (rows, p)
        Orthonormal columns.
    left_out : LeaveOutResiduals
        Residuals ``r̃`` with each condition left out.

    Returns
    -------
    ndarray, shape (k,)
        Widened by the ratio of Student's to the normal quantile for the effective number of conditions; 0 for a
        parameter that fewer than `LEAST_CONDITIONS` determine.
    """
    change, information = [], []
    for rows in left_out.groups:
        change.append(weights @ (basis[rows].T @ left_out.residuals[rows]))
        information.append(np.sum((weights @ basis[rows].T) ** 2, axis=1))
    share = np.array(information) / np.maximum(np.sum(information, axis=0), 1e-300)
    conditions = 1 / np.maximum(np.sum(share**2, axis=0), 1e-300)
    errors = np.sqrt(np.sum(np.square(change), axis=0) * (1 - 1 / np.maximum(conditions, 1.0)))  # Eq. (3)
    wider = student.ppf(0.95, np.maximum(conditions - 1, 1.0)) / QUANTILE_90
    return np.where(conditions >= LEAST_CONDITIONS, wider * errors, 0.0)

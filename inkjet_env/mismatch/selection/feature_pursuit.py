"""Few features out of many: orthogonal matching pursuit beside base parameters, its length by cross-validation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkjet_env.mismatch.settings import RemainderSettings
from inkjet_env.typing import Real

SINGULAR = 1e-6
"""Share of a column that the columns used before cannot represent, below which it is not used."""


@dataclass(frozen=True, eq=False)
class FeaturePursuit:
    """Ridge regression on the fewest columns that predict left-out rows nearly best.

    Parameters
    ----------
    columns : ndarray, shape (rows, k)
        Those of the base parameters, orthonormal, then those of the features, of unit norm where the former are
        projected out of them.
    target : ndarray, shape (rows,)
        What is regressed.
    fixed : int
        Number of columns of base parameters: they are always used.
    settings : RemainderSettings
        Penalties and limits.
    """

    columns: Real
    target: Real
    fixed: int
    settings: RemainderSettings

    def selected(self, folds: Sequence[NDArray[np.intp]], scored: NDArray[np.bool_]) -> tuple[NDArray[np.intp], float]:
        """Places of the columns that are used, and the penalty of those of features.

        Parameters
        ----------
        folds : sequence of ndarray of int
            Rows that are left out together.
        scored : ndarray of bool, shape (rows,)
            Rows whose prediction counts.
        """
        settings = self.settings
        order, fixed = self._order(settings.most_features), list(range(self.fixed))
        gram, moment = self.columns.T @ self.columns, self.columns.T @ self.target
        errors = np.zeros((order.size + 1, len(settings.ridge_penalties)))
        for rows in folds:
            out, mine = self.columns[rows], self.columns[rows[scored[rows]]]
            wanted = self.target[rows[scored[rows]]]
            rest, toward = gram - out.T @ out, moment - out.T @ self.target[rows]
            square, image, power = mine.T @ mine, mine.T @ wanted, float(wanted @ wanted)
            for count in range(order.size + 1):
                used = np.array([*fixed, *order[:count]], dtype=np.intp)
                for k, ridge in enumerate(settings.ridge_penalties):
                    solution = self._solution(rest, toward, used, ridge)
                    errors[count, k] += power + float(solution @ (square @ solution - 2 * image))
        good = errors <= settings.nearly_best * errors.min()
        count = int(np.flatnonzero(good.any(axis=1))[0])
        place = int(np.argmin(errors[count]))
        return np.array([*fixed, *order[:count]], dtype=np.intp), settings.ridge_penalties[place]

    def _order(self, most: int) -> NDArray[np.intp]:
        """Columns in the order of orthogonal matching pursuit, at most ``most``, those without influence left out."""
        q = self.columns[:, : self.fixed]
        own = self.columns[:, self.fixed :]
        own = own - q @ (q.T @ own)
        left = self.target - q @ (q.T @ self.target)
        gram, moment = own.T @ own, own.T @ left
        places: list[int] = []
        for _ in range(min(most, own.shape[1])):
            # Gains of the remaining columns, those that are used projected out of them.
            chosen = np.linalg.lstsq(
                gram[np.ix_(places, places)], np.column_stack([gram[places], moment[places]]), rcond=1e-12
            )[0]
            size = np.diag(gram) - np.einsum("ij,ij->j", gram[places], chosen[:, :-1])
            toward = moment - gram[:, places] @ chosen[:, -1]
            size[places] = 0.0
            gains = np.where(size > SINGULAR, toward**2 / np.maximum(size, SINGULAR), 0.0)
            best = int(np.argmax(gains))
            if gains[best] <= 0:
                break
            places.append(best)
        return self.fixed + np.array(places, dtype=np.intp)

    def solved(self, used: NDArray[np.intp], ridge: float) -> Real:
        """Coefficients of all columns, shape (k,); 0 for those that are not used."""
        return self._solution(self.columns.T @ self.columns, self.columns.T @ self.target, used, ridge)

    def _solution(self, gram: Real, moment: Real, used: NDArray[np.intp], ridge: float) -> Real:
        penalty = np.where(used < self.fixed, self.settings.base_ridge, ridge)
        solution = np.zeros(moment.size)
        solution[used] = np.linalg.solve(gram[np.ix_(used, used)] + np.diag(penalty), moment[used])
        return solution

"""A problem as a plain function of seven numbers, for SciPy and for whatever takes a function and its bounds."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import Bounds

from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.experiments.benchmark.suite import problem as problem_of
from inkjet_env.typing import Real

DIMENSION = 7


class Objective:
    """A problem as a function to be minimised, in volts.

    Parameters
    ----------
    problem : str or Problem
        A problem, or the name of one, as `inkjet_env.experiments.benchmark.suite.problem` takes it.
    seed : int
        Seed of the reading errors of a problem that has them: the k-th evaluation of a seed has the same error.
    physical : bool
        Whether points are waveforms, ``U1 U2`` in volts and ``t1 … t5`` in seconds, instead of points in ``[-1, 1]⁷``,
        in which the search box is equally wide in all directions.

    Attributes
    ----------
    lower, upper : ndarray, shape (7,)
        Ends of the search box. A point outside counts as the nearest one inside.
    evaluations : int
        Number of points evaluated so far.

    Raises
    ------
    ValueError
        There is no such problem; or waveforms are asked for where the driver's limits decide them.

    Examples
    --------
    >>> from scipy.optimize import minimize
    >>> f = Objective("nominal")
    >>> round(f([1, -1, -1, 0, 0, 0, 1]), 3)
    15.302
    >>> found = minimize(f.with_gradient, [0.9, -0.9, -0.9, 0, 0.3, 0, 0.9], jac=True, bounds=f.bounds)
    >>> f.best_known_V <= found.fun < -20
    True
    """

    def __init__(self, problem: str | Problem, seed: int = 0, physical: bool = False) -> None:
        self.problem = problem_of(problem) if isinstance(problem, str) else problem
        if physical and self.problem.bounds.limits is not None:
            raise ValueError(
                f"{self.problem.name}: within a driver's limits several points are one waveform. Use physical=False."
            )
        self.name, self.seed, self.physical = self.problem.name, seed, physical
        bounds = self.problem.bounds
        self.lower = np.array(bounds.lower) if physical else np.full(DIMENSION, -1.0)
        self.upper = np.array(bounds.upper) if physical else np.full(DIMENSION, 1.0)
        self.evaluations = 0

    @property
    def bounds(self) -> Bounds:
        """The search box for `scipy.optimize`."""
        return Bounds(self.lower, self.upper)

    @property
    def best_known_V(self) -> float | None:
        """Cost in volts of the best known waveform, free of reading errors; None if none is known."""
        known = self.problem.best_known
        return None if known is None else known.cost

    @property
    def best_known_point(self) -> Real | None:
        """The best known waveform as a point of the search box, shape (7,); None if none is known."""
        known = self.problem.best_known
        return None if known is None else self._point(np.array(known.waveform))

    def __call__(self, point: ArrayLike) -> float:
        """Cost in volts of one point, shape (7,); with reading errors, if the problem has them."""
        (cost_V,) = self.batch(point)
        return float(cost_V)

    def batch(self, points: ArrayLike) -> Real:
        """Costs in volts, shape (n,), of points, shape (n, 7): far less time for each than one by one."""
        unit = self._unit(points)
        costs = self.problem.read(unit, self.seed, self.evaluations)
        self.evaluations += len(unit)
        return costs

    def with_gradient(self, point: ArrayLike) -> tuple[float, Real]:
        """Cost in volts of one point, and its exact gradient, shape (7,); ``ValueError`` if the problem has none."""
        unit = self._unit(point)
        costs, gradients = self.problem.evaluate_with_gradient(unit)
        self.evaluations += 1
        slope = 1.0 / self.problem.bounds.half_width if self.physical else 1.0
        return float(costs[0]), gradients[0] * slope

    def waveform(self, point: ArrayLike) -> Real:
        """The waveform at a point, ``U1 U2`` in volts and ``t1 … t5`` in seconds, shape (7,)."""
        return self.problem.bounds.from_unit(self._unit(point)[0])

    def _unit(self, points: ArrayLike) -> Real:
        given = np.atleast_2d(np.asarray(points, dtype=np.float64))
        if given.shape[1] != DIMENSION:
            raise ValueError(f"{self.name}: a point has {DIMENSION} coordinates, U1 U2 t1 … t5; got {given.shape[1]}.")
        return self.problem.bounds.to_unit(given) if self.physical else given

    def _point(self, waveform: Real) -> Real:
        return waveform if self.physical else self.problem.bounds.to_unit(waveform)

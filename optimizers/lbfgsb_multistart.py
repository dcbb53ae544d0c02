"""Gradient descent from many starts."""

from __future__ import annotations

from scipy import optimize

from inkjet_env.optimizers.callback import CallbackOptimizer
from inkjet_env.typing import Real


class LbfgsbMultistart(CallbackOptimizer):
    """L-BFGS-B with the exact gradient from uniform random starts, one after another, until the budget is spent.

    Implementation: `scipy.optimize.minimize`; Byrd, Lu, Nocedal & Zhu, SIAM J. Sci. Comput. 16 (1995) 1190. An
    evaluation returns the cost together with its gradient and counts as one.
    """

    name = "lbfgsb-multistart"
    uses_gradient = True

    def search(self) -> None:
        """One descent from a random start."""
        start = self.rng.uniform(-1.0, 1.0, self.dimension)
        optimize.minimize(self._cost_and_gradient, start, jac=True, method="L-BFGS-B", bounds=[(-1, 1)] * start.size)

    def _cost_and_gradient(self, point: Real) -> tuple[float, Real]:
        costs, gradients = self.evaluate(point[None, :])
        return float(costs[0]), gradients[0]

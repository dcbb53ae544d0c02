"""Figures of merit of arrays of waveforms, compiled: for searches that weigh several of them against each other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.jetting.figures_of_merit import SETTLED
from inkjet_env.printhead import PeakCost, Printhead, batch
from inkjet_env.printhead.window import DEFAULT_WINDOW_S
from inkjet_env.typing import Real


class JettingBatch(NamedTuple):
    """Figures of merit of n waveforms, shape (n,) each, as in `Jetting`; NaN where there is no effective peak."""

    effective_V: Real
    residual_V: Real
    settling_s: Real
    highest_Hz: Real

    @property
    def residual(self) -> Real:
        """Largest later peak as a fraction of the effective peak."""
        return self.residual_V / self.effective_V


def jetting_batch(
    waveforms: ArrayLike,
    heads: Printhead | Real,
    cost: PeakCost | None = None,
    initial_state: str = "periodic",
    window_s: float = DEFAULT_WINDOW_S,
    hysteresis: str = "full_memory",
) -> JettingBatch:
    """Figures of merit of many waveforms: the same numbers as `jetting` of each response, compiled.

    Parameters
    ----------
    waveforms : array_like, shape (n, 7)
        Waveform parameters ``U1 U2 t1 … t5``, in volts and seconds.
    heads : Printhead or ndarray, shape (1 or n, columns)
        As in `inkjet_env.printhead.batch.costs`.
    cost : PeakCost, optional
        Determines which peak is effective; the default is ``PeakCost()``.
    initial_state, window_s, hysteresis
        As in `inkjet_env.printhead.Printhead.respond`.

    Returns
    -------
    JettingBatch
        Effective peak and largest peak after it in volts, settling time in seconds, highest jetting frequency in hertz.

    Examples
    --------
    >>> found = jetting_batch([[100, -100, 1e-6, 10.481e-6, 13.769e-6, 9.613e-6, 20e-6]], Printhead.published())
    >>> found.effective_V.round(2), (found.settling_s * 1e6).round(1)
    (array([6.94]), array([52.1]))
    """
    from inkjet_env.jetting.compiled_figures import batch_figures

    arguments, capacity, _ = batch.prepare(waveforms, heads, cost, initial_state, window_s, hysteresis)
    rows, table, warm_up_periods, one_point, window_s, _, _, A, B, rule, threshold, _ = arguments
    figures = np.empty((len(rows), 4))
    while not batch_figures(
        rows, table, warm_up_periods, one_point, window_s, A, B, rule, threshold, SETTLED, capacity, figures
    ):
        capacity *= 2
    return JettingBatch(*figures.T)

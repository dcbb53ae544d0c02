"""The tuner ``tune``: robust waveforms for the heads that remain possible, and what they cost on the head decides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkjet_env.envs.given_heads import HeadsOption
from inkjet_env.envs.task import WaveformTask
from inkjet_env.envs.tune_waveform import NOISE_V, PEAKS
from inkjet_env.envs.waveform_tuning_task import COST_SCALE_V, PEAK_SCALE_V, TIME_SCALE_S, WaveformTuningTask
from inkjet_env.experiments.learning.possible_heads import DrawnHeads, ListedHeads, PossibleHeads, Try
from inkjet_env.experiments.tuning.proposals import searched
from inkjet_env.naming import check_name
from inkjet_env.plant.head_ensemble import HeadEnsemble
from inkjet_env.typing import Real

HEADS, HEADS_AT_FIRST = 16, 200
"""Largest numbers of heads on which a waveform is judged: after tries, and before the first, once for all heads."""
BUDGET = 1000
"""Evaluations of each search for a waveform."""
PLAIN = 0.01
"""Weight of the plain mean cost, which shows the way where a waveform would be kept on no head."""


@dataclass(frozen=True, eq=False)
class ExpectedKept:
    """Objective: the mean over the heads of the cost that is kept once a waveform has been fired.

    Parameters
    ----------
    ensemble : HeadEnsemble
        The heads that remain possible.
    task : WaveformTask
        Cost, search box and window.
    kept_V : float
        Cost of the waveform that is kept now, as it was read, in volts.
    """

    ensemble: HeadEnsemble
    task: WaveformTask
    kept_V: float

    def evaluate(self, points: Real) -> Real:
        """Its values in volts, shape (n,), at points in ``[-1, 1]``, shape (n, 7)."""
        waveforms = self.task.bounds.from_unit(np.atleast_2d(points))
        costs = self.ensemble.costs(waveforms, self.task.cost, self.task.initial_state, self.task.window_s)
        kept = self.ensemble.risk(np.minimum(costs, self.kept_V), "mean")
        return np.asarray((1 - PLAIN) * kept + PLAIN * self.ensemble.risk(costs, "mean"))


class ModelBasedTuner:
    """Tunes each head by a model of it, of which it knows only what the environment lets it observe.

    Before each try it searches the waveform after which the kept cost is lowest on average over the heads that remain
    possible; after it, these are weighed anew by how well they predict the peaks that were read. The rig keeps the
    waveform with the lowest reading, so that a wrong model costs tries and not the waveform.

    Parameters
    ----------
    seed : int
        Seed of all random numbers.
    heads
        What is possible before the first try, as the environment's option of this name; by default, heads drawn around
        a base model as the environment draws them.
    peaks, noise
        As those of the environment.
    budget : int
        Evaluations of each search for a waveform. Heads with effects are some hundred times slower.
    **options
        Further options of the environment; of ``hysteresis``, full memory only.
    """

    def __init__(
        self,
        seed: int,
        heads: HeadsOption | None = None,
        peaks: int = PEAKS,
        noise: float = NOISE_V,
        budget: int = BUDGET,
        **options: Any,
    ) -> None:
        self.model = WaveformTuningTask(1, 1, peaks, heads=heads, **options)
        check_name("hysteresis of a model-based tuner", self.model.task.hysteresis, ("full_memory",))
        self.seed, self.noise_V, self.budget = seed, noise, budget
        self.possible: list[PossibleHeads] = []

    def _anything(self) -> PossibleHeads:
        """What is possible before the first try: the same for every head."""
        if self.model.given is not None:
            return ListedHeads(self.model.given, self.noise_V)
        return DrawnHeads(self.model.task, self.noise_V, np.random.default_rng(self.seed))

    def fire(self, observations: NDArray[np.float32]) -> Real:
        """The waveform to check next on each head, shape (n, 7); zero tries made mean that all heads are new."""
        seen = np.asarray(observations, dtype=np.float64)
        made, kept_V, fired, kept, heights, times = np.split(seen, [1, 2, 9, 16, 16 + self.model.peaks], axis=1)
        if not made.any():
            self.possible = [self._anything() for _ in seen]
            return np.tile(self._proposed(self.possible[0].heads(HEADS_AT_FIRST), [], 0.0), (len(seen), 1))
        proposed = np.empty((len(seen), 7))
        for k, possible in enumerate(self.possible):
            waveform = self.model.task.waveforms(fired[k], (7,))[0]
            possible.observe(Try(waveform, heights[k] * PEAK_SCALE_V, times[k] * TIME_SCALE_S))
            proposed[k] = self._proposed(possible.heads(HEADS), [fired[k], kept[k]], float(kept_V[k, 0]) * COST_SCALE_V)
        return proposed

    def tell(self, readings: Real) -> None:
        """Do nothing: the readings are part of the next observation."""

    def _proposed(self, ensemble: HeadEnsemble, known: list[Real], kept_V: float) -> Real:
        """The waveform after which the kept cost is lowest on average, in ``[-1, 1]``, shape (7,)."""
        objective = ExpectedKept(ensemble, self.model.task, kept_V)
        return searched(objective, known, self.budget, 1, self.seed)

"""The benches on which all tuners are tested: as the environment has them, and as nobody is told."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from inkjet_env.envs.tune_waveform import NOISE_V, TuneWaveformVectorEnv
from inkjet_env.experiments.benchmark.problem import Problem
from inkjet_env.experiments.learning.few_shot_tuners import TuningStrategy, kept_costs_V
from inkjet_env.experiments.learning.heads import TEST_SEED, Heads, heads_with_effects
from inkjet_env.experiments.learning.repeated_training import Arrays, best_costs_V, kept_arrays
from inkjet_env.experiments.tuning.proposals import ends_of_searches, refined
from inkjet_env.plant.head_ensemble import HeadEnsemble
from inkjet_env.progress import shown_progress
from inkjet_env.typing import Real

EFFECTS = 100
"""Number of heads with effects from which each head on their bench is drawn."""
SEARCHES, BUDGET = 2, 1500
"""Searches for the best waveform of each of them, and evaluations of a search."""


@dataclass(frozen=True)
class Bench:
    """Heads, and how they are read.

    Attributes
    ----------
    spread : float
        How far the heads lie from the middle of their ranges, as a multiple of what the environment draws.
    noise : float
        Errors of reading, as a multiple of the environment's.
    effects : bool
        Whether each head has an effect beyond the base model.
    """

    spread: float = 1.0
    noise: float = 1.0
    effects: bool = False

    def kept_costs_V(self, tuner: TuningStrategy, count: int, tries: int, seed: int) -> Real:
        """See `few_shot_tuners.kept_costs_V`."""
        options: dict[str, Any] = {"heads": _heads_with_effects()} if self.effects else {}
        return kept_costs_V(tuner, count, tries, seed, self.spread, noise=self.noise * NOISE_V, **options)

    def best_costs_V(self, folder: Path, count: int, starts: int, seed: int, test_seed: int) -> Real:
        """Best known cost in volts of each head, shape (count,), by searches that know it; stored in the folder."""
        folder.mkdir(exist_ok=True)
        if not self.effects:
            return best_costs_V(folder, heads_on_the_bench(count, test_seed, self.spread), starts, seed)
        envs = TuneWaveformVectorEnv(count, heads=_heads_with_effects())
        envs.reset(seed=test_seed)

        def make() -> Arrays:
            best_V = np.zeros(EFFECTS)
            drawn = np.unique(envs.tuning.numbers)
            with shown_progress("best known with effects", len(drawn)) as progress:
                for done, number in enumerate(drawn, start=1):
                    one = Problem("head", printhead=_heads_with_effects().heads[number])
                    best = refined(one, ends_of_searches(one, BUDGET, SEARCHES, seed))[0]
                    best_V[number] = one.evaluate(best[None, :])[0]
                    progress(done)
            return {"best_V": best_V}

        asked = {"searches": SEARCHES, "budget": BUDGET, "seed": seed, "heads": count, "of": EFFECTS, "on": test_seed}
        return kept_arrays(folder / "best-known.npz", asked, make)["best_V"][envs.tuning.numbers]


AS_EXPECTED = "as expected"
BENCHES = {
    AS_EXPECTED: Bench(),
    "noise × 3": Bench(noise=3.0),
    "heads beyond": Bench(spread=1.5),
    "effects": Bench(effects=True),
}


def heads_on_the_bench(heads: int, seed: int, spread: float = 1.0) -> Heads:
    """The heads that the environment draws with that seed, so many times as far from the middle of their ranges."""
    envs = TuneWaveformVectorEnv(heads)
    envs.reset(seed=seed)
    return Heads((spread * envs.tuning.contexts).astype(np.float32))


@functools.cache
def _heads_with_effects() -> HeadEnsemble:
    return heads_with_effects(EFFECTS, TEST_SEED)[0]

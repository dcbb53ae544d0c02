"""Heads that recordings leave possible, each with a weight: the uncertainty of a diagnosis, for a robust waveform."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inkjet_env.naming import check_name
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.printhead_file import printhead_of
from inkjet_env.plant.registry import UnregisteredEffectError
from inkjet_env.printhead import PeakCost, Printhead, batch
from inkjet_env.printhead.printhead_json import printhead_data
from inkjet_env.printhead.window import DEFAULT_WINDOW_S
from inkjet_env.typing import Real

RISKS = ("mean", "cvar", "worst")
"""Mean over the heads, mean over the worst `TAIL` of them (conditional value at risk), or the worst of them."""
TAIL = 0.2
"""Share of the weights that the conditional value at risk averages over."""


@dataclass(frozen=True, eq=False)
class HeadEnsemble:
    """Heads that recordings leave possible.

    Parameters
    ----------
    heads : tuple of Printhead or AugmentedPrinthead
        The heads, at least one.
    weights : tuple of float
        Weight of each, positive; they are scaled to a sum of 1.
    """

    heads: tuple[Printhead | AugmentedPrinthead, ...]
    weights: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.heads or len(self.heads) != len(self.weights):
            raise ValueError(
                f"an ensemble needs a weight for each of its heads, and a head; got {len(self.heads)} heads and "
                f"{len(self.weights)} weights."
            )
        total = math.fsum(self.weights)
        if not (min(self.weights) > 0 and math.isfinite(total)):
            raise ValueError("the weights of an ensemble must be positive numbers.")
        object.__setattr__(self, "weights", tuple(float(w) / total for w in self.weights))

    @cached_property
    def _table(self) -> Real:
        """The heads without effects in the form of the compiled simulator."""
        return batch.head_table([head for head in self.heads if isinstance(head, Printhead)])

    def costs(
        self,
        waveforms: ArrayLike,
        cost: PeakCost | None = None,
        initial_state: str = "periodic",
        window_s: float = DEFAULT_WINDOW_S,
    ) -> Real:
        """Peak costs in volts of waveforms (n, 7) on every head, shape (heads, n)."""
        rows = np.atleast_2d(np.asarray(waveforms, dtype=np.float64))
        found = np.empty((len(self.heads), len(rows)))
        plain = [k for k, head in enumerate(self.heads) if isinstance(head, Printhead)]
        if plain:  # in one call, whose overhead dominates a search that asks for one waveform at a time
            table = np.repeat(self._table, len(rows), axis=0)
            costs = batch.costs(np.tile(rows, (len(plain), 1)), table, cost, initial_state, window_s)
            found[plain] = costs.reshape(len(plain), -1)
        for k, head in enumerate(self.heads):
            if isinstance(head, AugmentedPrinthead):
                found[k] = head.costs(rows, cost, initial_state, window_s)
        return found

    def risk(self, costs: Real, kind: str) -> Real:
        """Risk in volts of waveforms, shape (n,), from their costs on every head, shape (heads, n).

        Parameters
        ----------
        costs : ndarray, shape (heads, n)
            Costs in volts.
        kind : {"mean", "cvar", "worst"}
            See `RISKS`.
        """
        check_name("risk", kind, RISKS)
        if kind == "worst":
            return np.asarray(costs.max(axis=0))
        order = np.argsort(-costs, axis=0, kind="stable")
        sorted_V, weights = np.take_along_axis(costs, order, axis=0), np.array(self.weights)[order]
        share = 1.0 if kind == "mean" else TAIL
        before = np.cumsum(weights, axis=0) - weights
        counted = np.clip(share - before, 0.0, weights)
        return np.asarray(np.cumsum(counted * sorted_V, axis=0)[-1] / share)

    def quantile(self, costs: Real, share: float) -> float:
        """The cost in volts, of those of one waveform, shape (heads,), that a share of the weights does not exceed."""
        order = np.argsort(costs, kind="stable")
        reached = np.cumsum(np.array(self.weights)[order])
        return float(costs[order[min(int(np.searchsorted(reached, share - 1e-12)), costs.size - 1)]])

    def without_remainder(self) -> HeadEnsemble:
        """The ensemble without the heads whose remainder is on; the same if no other is left."""
        kept = [
            (head, weight)
            for head, weight in zip(self.heads, self.weights, strict=True)
            if not (isinstance(head, AugmentedPrinthead) and head.remainder is not None)
        ]
        return HeadEnsemble(*zip(*kept, strict=True)) if kept else self

    def as_json(self) -> list[dict[str, Any]]:
        """The entry "ensemble" of a ``printhead/1``."""
        return [
            {"weight": weight, "printhead": head.as_json()}
            for head, weight in zip(self.heads, self.weights, strict=True)
        ]


def ensemble_of(data: Mapping[str, Any]) -> HeadEnsemble | None:
    """The ensemble in the content of a ``printhead/1`` file, None if it has none; ``ValueError`` names the rule."""
    entries = data.get("ensemble")
    if entries is None:
        return None
    if not isinstance(entries, list) or not all(
        isinstance(e, dict) and isinstance(e.get("printhead"), dict) for e in entries
    ):
        raise ValueError('ensemble must be a list of {"weight", "printhead"}.')
    weights = [entry.get("weight") for entry in entries]
    if any(isinstance(w, bool) or not isinstance(w, (int, float)) or not math.isfinite(w) for w in weights):
        raise ValueError("each weight of the ensemble must be a finite number.")
    heads = tuple(printhead_of(entry["printhead"]) for entry in entries)
    return HeadEnsemble(heads, tuple(float(w) for w in weights))


def read_ensemble(path: str | os.PathLike[str]) -> HeadEnsemble | None:
    """The ensemble of a ``printhead/1`` file, None if it has none; errors are those of `read_printhead`."""
    data = printhead_data(path)
    try:
        return ensemble_of(data)
    except UnregisteredEffectError as error:
        raise UnregisteredEffectError(f"{path}: {error}") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None

"""Heads that are given to be tuned: one, several, or those that a diagnosis leaves possible, drawn by their weights."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkjet_env.envs.task import Readings, make_task
from inkjet_env.plant.augmented import AugmentedPrinthead
from inkjet_env.plant.head_ensemble import HeadEnsemble, read_ensemble
from inkjet_env.plant.printhead_file import read_printhead
from inkjet_env.printhead import Printhead
from inkjet_env.typing import Real

AnyHead = Printhead | AugmentedPrinthead
HeadFile = str | os.PathLike[str]
HeadsOption = HeadEnsemble | AnyHead | HeadFile | Sequence[AnyHead | HeadFile]


def ensemble_of_heads(heads: HeadsOption) -> HeadEnsemble:
    """Heads with weights, from what a user gives.

    Parameters
    ----------
    heads : HeadEnsemble, Printhead, AugmentedPrinthead, path, or sequence
        An ensemble; one head; the path of a ``printhead.json``, which stands for the heads that it says remain possible
        or, if it says nothing of that, for its head; or a sequence of heads and of paths of single heads, of equal
        weights.

    Raises
    ------
    ValueError
        Something else is given, nothing is, or a file cannot be read; the message names it.
    """
    if isinstance(heads, HeadEnsemble):
        return heads
    if isinstance(heads, (str, os.PathLike)):
        found = read_ensemble(heads)
        if found is not None:
            return found
        heads = [heads]
    if isinstance(heads, AnyHead):
        heads = [heads]
    if not (
        isinstance(heads, Sequence)
        and heads
        and all(isinstance(head, (Printhead, AugmentedPrinthead, str, os.PathLike)) for head in heads)
    ):
        raise ValueError(
            "heads must be a head, the path of a printhead.json, a sequence of these, or a HeadEnsemble; got "
            f"{heads!r:.80}."
        )
    each = tuple(head if isinstance(head, AnyHead) else read_printhead(head) for head in heads)
    return HeadEnsemble(each, (1.0,) * len(each))


class GivenHeads:
    """Heads of which one at a time is on the bench, each with a task of its own.

    Parameters
    ----------
    heads
        See `ensemble_of_heads`.
    **options
        Options of the tasks; see `inkjet_env.envs.task.make_task`. ``printhead`` cannot be given.

    Attributes
    ----------
    ensemble : HeadEnsemble
        The heads with their weights.
    tasks : tuple of WaveformTask
        The task of each head.
    """

    def __init__(self, heads: HeadsOption, **options: Any) -> None:
        from inkjet_env.printhead import batch

        if options.pop("printhead", None) is not None:
            raise ValueError("printhead cannot be given beside heads: a drawn head is one of heads. Give one of them.")
        self.ensemble = ensemble_of_heads(heads)
        first = make_task(self.ensemble.heads[0], **options)
        self.tasks = tuple(replace(first, printhead=head) for head in self.ensemble.heads)
        self._up_to = np.cumsum(self.ensemble.weights)
        self._with_effects = np.array([isinstance(head, AugmentedPrinthead) for head in self.ensemble.heads])
        self._table = batch.head_table(
            [head.printhead if isinstance(head, AugmentedPrinthead) else head for head in self.ensemble.heads]
        )

    def drawn(self, generators: Sequence[np.random.Generator]) -> NDArray[np.int64]:
        """Number of a head drawn by each generator, shape (n,)."""
        shares = np.array([generator.random() for generator in generators])
        return np.minimum(np.searchsorted(self._up_to, shares, side="right"), len(self.tasks) - 1)

    def read(
        self,
        numbers: NDArray[np.int64],
        waveforms: Real,
        generators: Sequence[np.random.Generator],
        threads: int | None = 1,
    ) -> Readings:
        """Fire waveforms (n, 7), each on the head of its number, and read every peak; see `WaveformTask.read`.

        Heads without effects are simulated in one call, those with effects one waveform at a time.
        """
        group = np.where(self._with_effects[numbers], numbers, -1)
        parts = []
        for number in np.unique(group):
            rows = np.flatnonzero(group == number)
            own = [generators[row] for row in rows] if len(generators) else ()
            task = self.tasks[numbers[rows[0]]]
            parts.append((rows, task.read(waveforms[rows], self._table[numbers[rows]], own, threads)))
        if len(parts) == 1:
            return parts[0][1]
        n, width = len(numbers), max(part.heights_V.shape[1] for _, part in parts)
        times_s, heights_V = np.zeros((2, n, width))
        counts, (read_V, costs_V) = np.zeros(n, dtype=np.int64), np.zeros((2, n))
        for rows, part in parts:
            columns = part.heights_V.shape[1]
            times_s[rows, :columns], heights_V[rows, :columns] = part.times_s, part.heights_V
            counts[rows], read_V[rows], costs_V[rows] = part.counts, part.read_V, part.costs_V
        return Readings(times_s, heights_V, counts, read_V, costs_V)

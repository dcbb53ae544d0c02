"""Whether the probabilities of verdicts are right as often as they say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from inkjet_env.experiments.proof.sealing import NONE_OF_THESE, NOTHING

BINS = 10


def true_labels(draw: Mapping[str, Any]) -> frozenset[str]:
    """Labels of which any is right; none for a base law of another form, where nothing is concealed and yet differs."""
    if draw["family"] == "null":
        return frozenset([NOTHING])
    if draw["family"] == "outside":
        return frozenset([NONE_OF_THESE])
    return frozenset(draw["effects"]) if draw["family"] in ("effect", "pair") else frozenset()


def calibration_rows(cases: Sequence[Mapping[str, Any]]) -> list[tuple[float, bool]]:
    """Of each case whose verdict has probabilities, the largest one and whether its label is true.

    Parameters
    ----------
    cases : sequence of dict
        With draw and answer. Of equal probabilities the first label in alphabetical order counts.
    """
    rows = []
    for case in cases:
        probabilities = (case["answer"]["verdict"] or {}).get("probabilities")
        if not probabilities or case["draw"]["family"] == "base":
            continue
        label = max(sorted(probabilities), key=lambda name: probabilities[name])
        rows.append((float(probabilities[label]), label in true_labels(case["draw"])))
    return rows


def reliability(rows: Sequence[tuple[float, bool]]) -> list[dict[str, float]]:
    """Mean probability, fraction that is right and number of cases in each of `BINS` equal bins that holds any."""
    sure, right = np.asarray(rows, dtype=float).reshape(-1, 2).T
    place = np.minimum((sure * BINS).astype(int), BINS - 1)
    bins = [place == k for k in np.flatnonzero(np.bincount(place, minlength=BINS))]
    return [{"mean": float(sure[one].mean()), "right": float(right[one].mean()), "of": int(one.sum())} for one in bins]


def calibration_error(rows: Sequence[tuple[float, bool]]) -> float:
    """Expected calibration error: mean distance of a bin's probability from its fraction right, weighted by its cases.

    Source: C. Guo et al., On Calibration of Modern Neural Networks, ICML 2017.

    Examples
    --------
    >>> calibration_error([(0.75, True), (0.75, True), (0.75, True), (0.75, False)])
    0.0
    >>> round(calibration_error([(0.95, False), (0.55, True)]), 3)
    0.7
    """
    return float(sum(one["of"] * abs(one["mean"] - one["right"]) for one in reliability(rows)) / len(rows))

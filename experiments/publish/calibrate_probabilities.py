"""Fit the coefficients of the probabilities in a verdict to the answers of a proof.

``python -m inkjet_env.experiments.publish.calibrate_probabilities FOLDER [--now-known FAMILY ...] [--out FILE]``

FOLDER is a judged proof, as `inkjet prove --out FOLDER` leaves it or as an archive of docs/proof unpacks, or answers of
`inkjet_env.experiments.proof.development`. Its families outside the catalogue must not be those of the proof by which
the probabilities are judged. ``--now-known`` names families that were outside the catalogue when the answers were
given, and are not any more. The shares of heads without a mismatch stay as they are unless these are a proof's answers.
Prints the coefficients of Eq. (3) of docs/explanation/diagnosis.md, with their expected calibration error under
ten-fold cross-validation; ``--out inkjet_env/mismatch/calibration.json`` makes them those of the package.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from inkjet_env.experiments.proof.calibration import calibration_error, reliability
from inkjet_env.experiments.proof.development import read_answers
from inkjet_env.experiments.proof.protocol import as_judged
from inkjet_env.mismatch.probabilities import Calibration, Explanation, calibration
from inkjet_env.plant import catalogue
from inkjet_env.storage import write_json
from inkjet_env.typing import Real

RIDGE = 0.01
"""Penalty of the squared coefficients, so that separable answers have finite ones."""
FOLDS = 10
FALLING = (1, 2, 5)
"""Coefficients that may not be above 0: of what is left, fitted and held out, and of the overlap."""


def answered(cases: Sequence[Mapping[str, Any]], now_known: Iterable[str] = ()) -> list[Mapping[str, Any]]:
    """The cases with a verdict, without laws of hysteresis of their own and families that are known by now."""
    known = set(now_known)
    return [
        case
        for case in cases
        if case["answer"]["verdict"] and case["draw"]["family"] != "base" and not known & set(case["draw"]["effects"])
    ]


def found(case: Mapping[str, Any]) -> set[str]:
    """Ids that a verdict names or cannot tell apart; of what came closest, if it names none."""
    verdict = case["answer"]["verdict"]
    named = {effect["id"] for effect in verdict["effects"]} | {
        name for group in verdict["candidates"] for name in group
    }
    best = verdict["attributions"][:1]
    return named or {name for one in best for name in one["ids"]}


def right(case: Mapping[str, Any]) -> bool:
    """Whether one of these is concealed."""
    draw = case["draw"]
    return draw["family"] in ("effect", "pair") and bool(found(case) & set(draw["effects"]))


def explanation(case: Mapping[str, Any]) -> Explanation:
    """What was found, or what came closest if nothing is named, as `mismatch.verdict` judges it."""
    verdict = case["answer"]["verdict"]
    held_out = verdict["fit"]["heldout_left_over"]
    ids = [effect["id"] for effect in verdict["effects"]] or [
        i for one in verdict["attributions"][:1] for i in one["ids"]
    ]
    stage = {effect.id: effect.stage for effect in catalogue() if not effect.random}
    return Explanation(
        float(verdict["fit"]["left_over"]),
        math.nan if held_out is None else float(held_out),
        tuple(stage[name] for name in ids if name in stage),
        float(verdict["fit"]["overlap"]),
    )


def coefficients(explanations: Sequence[Explanation], labels: Sequence[bool]) -> tuple[float, ...]:
    """``β₀ … β₆`` of Eq. (3) by penalised maximum likelihood; what is left makes nothing more probable.

    Parameters
    ----------
    explanations : sequence of Explanation
    labels : sequence of bool
        Whether each was right.
    """
    table, truth = np.array([one.features for one in explanations]), np.array(labels, dtype=float)

    def cost(beta: Real) -> float:
        z = table @ beta
        return float(np.sum(np.logaddexp(0.0, z) - truth * z) + RIDGE * beta @ beta)

    falling = [(None, 0.0) if k in FALLING else (None, None) for k in range(table.shape[1])]
    start = np.zeros(table.shape[1])
    return tuple(float(b) for b in minimize(cost, start, method="L-BFGS-B", bounds=falling).x)


def told(beta: Sequence[float], one: Explanation) -> float:
    """Probability of Eq. (3)."""
    return Calibration(tuple(beta), 0.0, (1.0, 0.0)).explained(one)


def cross_validated(explanations: Sequence[Explanation], labels: Sequence[bool]) -> list[tuple[float, bool]]:
    """Probability that each explanation is right, predicted without its tenth of the cases, and whether it is."""
    order = np.random.default_rng(0).permutation(len(explanations))
    found: list[tuple[float, bool]] = []
    for k in range(FOLDS):
        out = set(order[k::FOLDS].tolist())
        rest = [i for i in range(len(explanations)) if i not in out]
        beta = coefficients([explanations[i] for i in rest], [labels[i] for i in rest])
        found += [(told(beta, explanations[i]), labels[i]) for i in sorted(out)]
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit, print and write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path, help="folder of a judged proof or of development answers")
    parser.add_argument(
        "--now-known", nargs="*", default=[], metavar="FAMILY", help="families that are no more outside"
    )
    parser.add_argument("--out", type=Path, help="JSON file to write")
    asked = parser.parse_args(arguments)
    development = read_answers(asked.folder)
    cases = answered(development or as_judged(asked.folder).cases, asked.now_known)
    something = [case for case in cases if case["answer"]["verdict"]["verdict"] != "none"]
    empty = [case for case in cases if case["answer"]["verdict"]["verdict"] == "none"]
    not_null = [case for case in something if case["draw"]["family"] != "null"]
    explanations, labels = [explanation(case) for case in not_null], [right(case) for case in not_null]
    beta, checked = coefficients(explanations, labels), cross_validated(explanations, labels)
    of_none = [case["draw"]["family"] for case in empty]
    shares = tuple((of_none.count(family) + 0.5) / (len(of_none) + 1) for family in ("null", "outside"))
    written: dict[str, Any] = {
        "source": f"answers to {len(cases)} campaigns of the corpus with seed {cases[0]['draw']['seed']}",
        "right": [round(b, 3) for b in beta],
        "nothing_if_found": round((len(something) - len(not_null) + 0.5) / (len(something) + 1), 4),
        "if_none": [round(share, 3) for share in shares],
    }
    if development:  # they hold a few of each kind, so heads without a mismatch are rarer than in a corpus
        before = calibration()
        written |= {"nothing_if_found": before.nothing_if_found, "if_none": list(before.if_none)}
    for part, value in written.items():
        print(f"{part}: {value}")
    error = calibration_error(checked)
    print(f"expected calibration error, cross-validated: {error:.3f} over {len(checked)} explanations")
    for one in reliability(checked):
        print(f"  said {one['mean']:.2f}, right {one['right']:.2f} of {one['of']:.0f}")
    if asked.out:
        write_json(asked.out, written)


if __name__ == "__main__":
    main()

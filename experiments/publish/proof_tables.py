"""Tables of a proof in Markdown, for the record in ``docs``.

``python -m inkjet_env.experiments.publish.proof_tables FOLDER`` prints them, and draws the figures with ``--figures``.
The stored judgements of a folder are counted again after both commitments have been checked, with the ids and criteria
of its version of the corpus; the campaigns may be absent."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from inkjet_env.experiments.proof.campaign_files import ProofError
from inkjet_env.experiments.proof.printing import figure_text, interval_text
from inkjet_env.experiments.proof.protocol import as_judged
from inkjet_env.experiments.proof.score import SCORE_FORMAT, score
from inkjet_env.experiments.proof.sealing import read_json
from inkjet_env.reporting.tables import markdown_table
from inkjet_env.storage import write_json

DPI = 110
MARKS = {True: "yes", False: "**no**", None: ""}
WORDS = {
    "none": "nothing", "unknown": "unknown", "set": "a set with it", "wrong set": "a set without it",
    "several": "several effects", "refused": "refused",
}  # fmt: skip


def _ranged(figure: Mapping[str, Any]) -> str:
    return f"{figure_text(figure['value'], figure['kind'])} ({interval_text(figure)})"


def figures_table(found: Mapping[str, Any]) -> str:
    """Every figure with its 90 % interval and its criterion."""
    return markdown_table(
        ("figure", "result (90 % interval)", "cases", "criterion", "met"),
        [
            (
                figure["name"], _ranged(figure),
                str(figure["of"]) if figure["hits"] is None else f"{figure['hits']} of {figure['of']}",
                figure["asked"], MARKS[figure["met"]],
            )
            for figure in found["figures"] if figure["of"]
        ],
    )  # fmt: skip


def curve_table(found: Mapping[str, Any]) -> str:
    """Detection rate against strength."""
    return markdown_table(
        ("strength", "median RMS of mismatch over noise", "detected", "right name or set"),
        [
            (
                row["strength"], f"{row['rho']:.2g}", _ranged(row["detected"]),
                "" if row["right"] is None else _ranged(row["right"]),
            )
            for row in found["curve"]
        ],
    )  # fmt: skip


def said_table(found: Mapping[str, Any]) -> str:
    """Verdicts on each strong or medium concealed effect, on families outside the catalogue and on other laws."""
    rows = []
    for hidden, row in found["confusion"].items():
        counts = {column: count for column, count in row.items() if count}
        if not counts:
            continue
        right = counts.pop(hidden, 0) if hidden in row else counts.pop("none" if hidden == "nothing" else "unknown", 0)
        others = sorted(counts.items(), key=lambda item: -item[1])
        rows.append(
            (hidden, str(sum(row.values())), str(right), "; ".join(f"{WORDS.get(k, k)} {n}" for k, n in others))
        )
    return markdown_table(("concealed", "heads", "right", "other verdicts"), rows)


def noise_table(found: Mapping[str, Any]) -> str:
    """False alarms by kind of noise."""
    rows = [(kind, str(len(alarms)), str(sum(alarms))) for kind, alarms in found["noise"].items()]
    return markdown_table(("noise", "heads with nothing concealed", "false alarms"), rows)


def coverage_table(found: Mapping[str, Any]) -> str:
    """Intervals that contain the truth, by effect."""
    rows = [(effect, str(len(inside)), str(sum(inside))) for effect, inside in found["coverage"].items()]
    return markdown_table(("effect", "intervals", "contain the truth"), rows)


def waveform_gain_table(found: Mapping[str, Any]) -> str:
    """Fraction of the oracle's gain achieved, by effect, where the oracle has a gain."""
    from inkjet_env.experiments.proof.score import LEAST_ORACLE

    heads = [h for h in found["waveform_gain"]["heads"] if h["base"] - h["oracle"] > LEAST_ORACLE * abs(h["base"])]
    by_effect: dict[str, list[Mapping[str, Any]]] = {}
    for head in heads:
        by_effect.setdefault("+".join(head["effects"]), []).append(head)

    def row(label: str, mine: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
        base, augmented, oracle = (sum(h[name] for h in mine) / len(mine) for name in ("base", "augmented", "oracle"))
        share = (base - augmented) / (base - oracle)
        return label, str(len(mine)), f"{base:.2f}", f"{augmented:.2f}", f"{oracle:.2f}", f"{100 * share:.0f} %"

    rows = [row(effect, mine) for effect, mine in sorted(by_effect.items())]
    if heads:
        rows.append(row("**all**", heads))
    return markdown_table(("concealed", "heads", "base, V", "corrected, V", "oracle, V", "gain achieved"), rows)


def misses_table(found: Mapping[str, Any]) -> str:
    """Number of times that each wrong effect or set was named, by truth, over all families and strengths."""
    counted = Counter((miss["concealed"], miss["strength"], miss["verdict"], miss["said"]) for miss in found["misses"])
    named = {key: n for key, n in counted.items() if key[2] in ("named", "set")}
    return markdown_table(
        ("concealed", "strength", "verdict", "effects named", "heads"),
        [(*key, str(n)) for key, n in sorted(named.items(), key=lambda item: (-item[1], item[0]))],
    )


def methods_table(found: Mapping[str, Any]) -> str:
    """Results of the baselines on the same heads."""
    methods = found["baselines"]
    return markdown_table(
        ("method", "median held-out RMS over noise", "verdicts"),
        [
            (
                name,
                "–" if over is None else f"{over:.3g}",
                ", ".join(
                    f"{word} {n}" for word, n in sorted(methods["judged"].get(name, {}).items(), key=lambda i: -i[1])
                ),
            )
            for name, over in methods["median_over_noise"].items()
        ],
    )


def document(found: Mapping[str, Any]) -> str:
    """All tables under their headings.

    Parameters
    ----------
    found : mapping
        A ``proof-score/1``.
    """
    sections = [
        ("Figures", figures_table(found)),
        ("Detection against strength", curve_table(found)),
        ("Verdicts by concealed effect", said_table(found)),
        ("False alarms by kind of noise", noise_table(found)) if found.get("noise") else None,
        ("Coverage by effect", coverage_table(found)) if found.get("noise") else None,
        ("Waveform gain", waveform_gain_table(found)) if found["waveform_gain"]["heads"] else None,
        ("Other methods", methods_table(found)) if found["baselines"]["cases"] else None,
        ("Wrong names and sets", misses_table(found)),
    ]
    return "\n\n".join(f"## {section[0]}\n\n{section[1]}" for section in sections if section) + "\n"


def draw(found: Mapping[str, Any], folder: Path) -> None:
    """Draw the figures of a score as PNG files in a folder."""
    from inkjet_env.experiments.proof.figures import (
        closures_figure,
        confusion_figure,
        curve_figure,
        waveform_gain_figure,
    )

    folder.mkdir(parents=True, exist_ok=True)
    drawn = {
        "curve": curve_figure(found["curve"]),
        "confusion": confusion_figure(found["confusion"]),
        "closure": closures_figure(found["closures"]),
        "waveform-gain": waveform_gain_figure(found["waveform_gain"]["heads"]),
    }
    for name, figure in drawn.items():
        figure.savefig(folder / f"proof-{name}.png", dpi=DPI)


def main() -> None:
    """Print the tables of a score."""
    parser = argparse.ArgumentParser(prog="python -m inkjet_env.experiments.publish.proof_tables", description=__doc__)
    parser.add_argument("score", type=Path, metavar="FOLDER", help="folder of a judged proof, or a score.json")
    parser.add_argument("--out", type=Path, help="file for the score: score.json")
    parser.add_argument("--figures", type=Path, help="folder for the figures")
    given = parser.parse_args()
    try:
        found = score(as_judged(given.score)) if given.score.is_dir() else read_json(given.score)
    except ProofError as error:
        parser.error(str(error))
    if found.get("format") != SCORE_FORMAT:
        parser.error(f"{given.score} is not a {SCORE_FORMAT}; it is {found.get('format')!r}.")
    if given.out is not None:
        write_json(given.out, found)
    if given.figures is not None:
        draw(found, given.figures)
    print(document(found), end="")


if __name__ == "__main__":
    main()

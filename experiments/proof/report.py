"""The page that a proof is read from: what was proven in plain words, the table, and the pictures behind it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from experiments.proof import figures
from experiments.proof.printing import figure_text, interval_text
from inkjet_env.reporting.plotting import svg_text
from inkjet_env.storage import write_atomically

MOST_WORTH_SHOWN = 100


def write_page(path: Path, found: Mapping[str, Any]) -> None:
    """Write the page of a ``proof-score/1``: one HTML file that needs nothing but itself.

    Raises
    ------
    OSError
        The folder is missing or not writable.
    """
    write_atomically(path, page_html(found))


def page_html(found: Mapping[str, Any]) -> str:
    """The page as text."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(loader=PackageLoader("experiments.proof"), autoescape=True, undefined=StrictUndefined)
    environment.filters["figure"] = figure_text
    environment.filters["interval"] = interval_text
    heads = found["worth"]["heads"][:MOST_WORTH_SHOWN]
    return environment.get_template("proof.html").render(
        found=found,
        headline=headline(found),
        sentences=sentences(found),
        shown=[figure for figure in found["figures"] if figure["of"]],
        curve=svg_text(figures.curve_figure(found["curve"])) if len(found["curve"]) > 1 else None,
        confusion=svg_text(figures.confusion_figure(found["confusion"])) if any_heads(found) else None,
        closures=svg_text(figures.closures_figure(found["closures"])) if found["closures"] else None,
        worth=svg_text(figures.worth_figure(heads)) if heads else None,
        parameters=parameter_rows(found),
        hours=found["cpu_seconds"]["sum"] / 3600,
    )


def any_heads(found: Mapping[str, Any]) -> bool:
    """Whether the confusion matrix has any."""
    return any(count for row in found["confusion"].values() for count in row.values())


def headline(found: Mapping[str, Any]) -> str:
    """What the proof came to, in one line."""
    asked = sum(figure["met"] is not None for figure in found["figures"])
    if not found["short"]:
        return f"The diagnosis passes its blind proof: all {asked} figures are what is asked of a first-rate one"
    return f"In {len(found['short'])} of {asked} figures the diagnosis falls short of a first-rate one"


def sentences(found: Mapping[str, Any]) -> list[str]:
    """What was proven, in plain words."""
    by_name = {figure["name"]: figure for figure in found["figures"]}

    def told(name: str, template: str) -> list[str]:
        figure = by_name[name]
        if not figure["of"] or figure["value"] is None:
            return []
        value = figure_text(figure["value"], figure["kind"])
        return [template.format(**(figure | {"value": value, "interval": interval_text(figure)}))]

    said = [
        *told(
            "false alarms where nothing is concealed",
            "Nothing was concealed in {of} heads; {hits} of them raised an alarm ({value}; 90 % interval {interval}).",
        ),
        *told(
            "right name or right set",
            "A strong or medium effect was concealed in {of} heads; in {hits} of them the diagnosis gave it its name, "
            "or named a set that holds it and the recording that would decide ({value}; {interval}).",
        ),
        *told(
            "confidently wrong, inside the catalogue",
            "In {hits} of those {of} it named physics that is not there ({value}; {interval}).",
        ),
        *told(
            "outside the catalogue told as unknown",
            "Physics that no catalogue has was concealed in {of} heads; “unknown” was said of {hits} ({value}; "
            "{interval}).",
        ),
        *told(
            "median closure on drives nobody saw",
            "On fresh drives, which the concealed plant answered and the diagnosis never saw, the corrected model "
            "removed a median of {value} of the base model's error (1 is all of it; heads: {of}).",
        ),
        *told(
            "share of the oracle's gain won back, all heads together",
            "Waveforms optimised on the corrected model won {value} of what waveforms optimised on the concealed head "
            "itself win over those of the base model (heads: {of}; {interval}).",
        ),
    ]
    if found["profile"] == "quick":
        said.append(
            f"These were {found['cases']} cases for a quick look: the intervals are wide. The full corpus has 1,200."
        )
    if found["short"]:
        said.append("Short of what is asked: " + "; ".join(found["short"]) + ".")
    return said


def parameter_rows(found: Mapping[str, Any]) -> list[tuple[str, str, int, int, float]]:
    """Effect, parameter, how often it was estimated, how often its interval held the truth, median relative error."""
    rows: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in found["parameters"]:
        rows.setdefault((row["effect"], row["parameter"]), []).append(row)
    return [
        (effect, name, len(mine), sum(row["inside"] for row in mine), sorted(r["error"] for r in mine)[len(mine) // 2])
        for (effect, name), mine in sorted(rows.items())
    ]

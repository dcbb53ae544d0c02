"""The HTML report of a proof: the result in plain words, the table and the figures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from inkjet_env.experiments.proof import figures
from inkjet_env.experiments.proof.corpus import FULL_SIZE
from inkjet_env.experiments.proof.printing import figure_text, interval_text
from inkjet_env.reporting.page import page_environment
from inkjet_env.reporting.plotting import svg_text
from inkjet_env.storage import write_atomically

MOST_HEADS_SHOWN = 100


def write_page(path: Path, found: Mapping[str, Any]) -> None:
    """Write the report of a ``proof-score/1``: one self-contained HTML file.

    Raises
    ------
    OSError
        The folder is missing or not writable.
    """
    write_atomically(path, page_html(found))


def page_html(found: Mapping[str, Any]) -> str:
    """The report as HTML text."""
    environment = page_environment("inkjet_env.experiments.proof")
    environment.filters["figure"] = figure_text
    environment.filters["interval"] = interval_text
    heads = found["waveform_gain"]["heads"][:MOST_HEADS_SHOWN]
    return environment.get_template("proof.html").render(
        found=found,
        headline=headline(found),
        sentences=sentences(found),
        shown=[figure for figure in found["figures"] if figure["of"]],
        curve=len(found["curve"]) > 1,
        pictures=[figures.curve_picture(found["curve"])] if len(found["curve"]) > 1 else [],
        confusion=svg_text(figures.confusion_figure(found["confusion"])) if any_heads(found) else None,
        closures=svg_text(figures.closures_figure(found["closures"])) if found["closures"] else None,
        waveform_gain=svg_text(figures.waveform_gain_figure(heads)) if heads else None,
        parameters=parameter_rows(found),
        hours=found["cpu_seconds"]["sum"] / 3600,
    )


def any_heads(found: Mapping[str, Any]) -> bool:
    """Whether the confusion matrix counts any heads."""
    return any(count for row in found["confusion"].values() for count in row.values())


def headline(found: Mapping[str, Any]) -> str:
    """Result of the proof in one line."""
    asked = sum(figure["met"] is not None for figure in found["figures"])
    if not asked:
        return f"{found['cases']} cases were judged; too few of each kind for any criterion of a first-rate diagnosis"
    if not found["short"]:
        return f"The diagnosis passes its blind proof: it meets all {asked} criteria of a first-rate one"
    return f"The diagnosis misses {len(found['short'])} of the {asked} criteria of a first-rate one"


def sentences(found: Mapping[str, Any]) -> list[str]:
    """Results of the proof in plain words."""
    by_name = {figure["name"]: figure for figure in found["figures"]}

    def section(name: str, template: str) -> list[str]:
        figure = by_name[name]
        if not figure["of"] or figure["value"] is None:
            return []
        value = figure_text(figure["value"], figure["kind"])
        return [template.format(**(figure | {"value": value, "interval": interval_text(figure)}))]

    said = [
        *section(
            "false alarms where nothing is concealed",
            "Nothing was concealed in {of} heads; {hits} of them raised an alarm ({value}; 90 % interval {interval}).",
        ),
        *section(
            "right name or right set",
            "A strong or medium effect was concealed in {of} heads; in {hits} of them the diagnosis named it, or gave "
            "a set that contains it and the recording that would decide ({value}; {interval}).",
        ),
        *section(
            "confidently wrong, inside the catalogue",
            "In {hits} of those {of} it named an effect that is not present ({value}; {interval}).",
        ),
        *section(
            "outside the catalogue, reported as unknown",
            "Effects outside the catalogue were concealed in {of} heads; the verdict was “unknown” for {hits} "
            "({value}; {interval}).",
        ),
        *section(
            "median closure on fresh drives",
            "On fresh drives of the concealed plant, which the diagnosis never saw, the corrected model removed a "
            "median fraction of {value} of the base model's mean squared error ({of} heads).",
        ),
        *section(
            "fraction of the oracle's gain achieved, all heads together",
            "Waveforms optimised on the corrected model achieved {value} of the gain over the base model's waveforms "
            "that waveforms optimised on the concealed head itself achieve ({of} heads; {interval}).",
        ),
    ]
    if found["profile"] == "quick":
        said.append(
            f"This quick proof has {found['cases']} cases, so its intervals are wide. The full corpus has "
            f"{FULL_SIZE[found['version']]:,}."
        )
    if found["short"]:
        said.append("Criteria not met: " + "; ".join(found["short"]) + ".")
    return said


def parameter_rows(found: Mapping[str, Any]) -> list[tuple[str, str, int, int, float]]:
    """Effect, parameter, number of estimates, number of intervals that contain the truth, median relative error."""
    rows: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in found["parameters"]:
        rows.setdefault((row["effect"], row["parameter"]), []).append(row)
    return [
        (effect, name, len(mine), sum(row["inside"] for row in mine), sorted(r["error"] for r in mine)[len(mine) // 2])
        for (effect, name), mine in sorted(rows.items())
    ]

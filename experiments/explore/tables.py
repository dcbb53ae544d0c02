"""Small tables of *Waveform* as HTML; every name is escaped."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence

from inkjet_env.experiments.explore.curves import CostTerms, Curves
from inkjet_env.jetting import Jetting
from inkjet_env.printhead import PeakCost
from inkjet_env.reporting.waveform_figures import signed


def table(head: Sequence[str], rows: Sequence[Sequence[str]], css: str = "") -> str:
    """A table of texts, which are escaped."""
    top = "".join(f"<th>{html.escape(one)}</th>" for one in head)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table class='told {css}'><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"


def cost_table(terms: CostTerms, cost: PeakCost, figures: Jetting) -> str:
    """The terms of the cost, and how long one drop rings."""
    rows = []
    if terms.effective_V is not None:
        rows.append((f"A·|effective|, {signed(cost.A, 3)}·{abs(terms.effective_V):.3f}", signed(terms.effective, 3)))
    if terms.next_V is not None:
        rows.append((f"B·|next|, {signed(cost.B, 3)}·{abs(terms.next_V):.3f}", signed(terms.next, 3)))
    rows.append(("Σ |others|", signed(terms.others, 3)))
    made = table(("term of the cost", "V"), rows)
    total = f"<p class='cost'>cost <b id='cost' data-cost='{terms.total!r}'>{signed(terms.total, 6)}</b> V</p>"
    return total + residual_line(figures) + made + f"<p>{html.escape(figures_sentence(figures))}</p>"


def residual_line(figures: Jetting) -> str:
    """The number to make small by hand: what one drop leaves, in percent of its effective peak."""
    if math.isnan(figures.effective_V):
        return ""
    share = 100 * figures.residual
    return f"<p class='cost'>residual <b id='residual' data-percent='{share!r}'>{share:.1f}</b> %</p>"


def figures_sentence(figures: Jetting) -> str:
    """Residual vibration, settling time and highest drop frequency of a single drop."""
    if math.isnan(figures.effective_V):
        return "No peak ejects a drop."
    said = "The residual is the largest peak after the effective one, of a single drop"
    if math.isinf(figures.settling_s):
        return f"{said}; it does not fall below 5 % within the window."
    return f"{said}; it is below 5 % after {1e6 * figures.settling_s:.4g} µs: up to {figures.highest_Hz / 1e3:.4g} kHz."


def pinned_table(rows: Sequence[tuple[str, str, Curves]]) -> str:
    """The edited waveform beside the pinned ones, single drops; each with its colour."""
    lines = []
    for name, colour, found in rows:
        t, f = found.terms, found.figures
        cells = (
            signed(t.total, 3),
            "–" if t.effective_V is None else f"{abs(t.effective_V):.3f}",
            "–" if math.isnan(f.effective_V) else f"{100 * f.residual:.3g}",
            "–" if not math.isfinite(f.settling_s) else f"{1e6 * f.settling_s:.4g}",
        )
        dot = f"<span class='dot' style='background:{colour}'></span>"
        lines.append(f"<tr><td>{dot}{html.escape(name)}</td>" + "".join(f"<td>{c}</td>" for c in cells) + "</tr>")
    heads = "".join(f"<th>{h}</th>" for h in ("", "cost (V)", "effective (V)", "left (%)", "settled (µs)"))
    return f"<table class='told'><thead><tr>{heads}</tr></thead><tbody>{''.join(lines)}</tbody></table>"

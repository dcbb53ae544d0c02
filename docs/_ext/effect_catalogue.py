"""The directive ``effect-catalogue``: every effect with its equation, parameters and source, read from its class."""

from __future__ import annotations

import math

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from inkjet_env.plant import Effect, Parameter, catalogue
from inkjet_env.plant.effect import STAGES


def number(value: float) -> str:
    """A bound, as a reader would write it."""
    return "∞" if math.isinf(value) else f"{value:.6g}".replace("-", "−")


class EffectCatalogue(SphinxDirective):
    """A section a stage, a section an effect within it."""

    def run(self) -> list[nodes.Node]:
        """Ask the catalogue."""
        return [self._stage(stage) for stage in STAGES]

    def _stage(self, stage: str) -> nodes.section:
        section = self._section(f"{stage.capitalize()} stage", f"stage-{stage}")
        section += [self._effect(effect) for effect in catalogue() if effect.stage == stage]
        return section

    def _section(self, title: str, label: str) -> nodes.section:
        section = nodes.section(ids=[label], names=[label])
        section += nodes.title(title, title)
        return section

    def _effect(self, effect: Effect) -> nodes.section:
        section = self._section(effect.id, f"effect-{effect.id}")
        section += nodes.paragraph("", effect.sentence)
        equation = nodes.literal_block(effect.equation, effect.equation, classes=["effect-equation"])
        equation["language"] = "text"
        section += equation
        section += self._parameters(effect.parameters)
        facts = [("Signature", effect.signature), ("Shown by", effect.shown_by), ("Source", effect.source)]
        if effect.confusable_with:
            facts.insert(1, ("May be mistaken for", ", ".join(effect.confusable_with)))
        rows = nodes.definition_list()
        for term, text in facts:
            sentence = f"{text if term == 'May be mistaken for' else text[:1].upper() + text[1:]}".rstrip(".") + "."
            rows += nodes.definition_list_item(
                "", nodes.term(term, term), nodes.definition("", nodes.paragraph("", sentence))
            )
        section += rows
        return section

    def _parameters(self, parameters: tuple[Parameter, ...]) -> nodes.table:
        head = ("parameter", "meaning", "bounds", "unit")
        group = nodes.tgroup(cols=len(head))
        group += [nodes.colspec(colwidth=width) for width in (24, 46, 20, 10)]
        table = nodes.table("", group)
        group += nodes.thead("", nodes.row("", *(nodes.entry("", nodes.paragraph("", cell)) for cell in head)))
        body = nodes.tbody()
        for p in parameters:
            bounds = f"{number(p.low)} … {number(p.high)}"
            first = nodes.paragraph("", "", nodes.literal(p.name, p.name))
            others = (nodes.paragraph("", cell) for cell in (p.meaning, bounds, p.unit))
            body += nodes.row("", *(nodes.entry("", cell) for cell in (first, *others)))
        group += body
        return table


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("effect-catalogue", EffectCatalogue)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

"""Equations as MathML, which browsers draw by themselves, with a font of our own: no script, no network."""

from __future__ import annotations

import re
from html import escape
from importlib import resources
from pathlib import Path

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.locale import _
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

LOGGER = logging.getLogger(__name__)
REPAIRS = (
    (re.compile("<mi>&#x000B1;</mi>"), "<mo>&#x000B1;</mo>"),  # ± is an operator
    (re.compile("<mi>ln</mi>"), '<mi>ln</mi><mspace width="0.167em"/>'),
    # Bars of a magnitude or a norm stand next to what they enclose.
    (re.compile("<mo([^>]*)>(&#x0007C;|&#x02016;)</mo>"), r'<mo\1 lspace="0" rspace="0">\2</mo>'),
    # A sign after a relation, a comma or an opening bracket belongs to the number that follows.
    (re.compile(r"(<mo[^>]*>(?:&#x0003D;|&#x0002C;|&#x00028;|&#x02264;|\[)</mo>)<mo>&#x02212;</mo>"),
     r'\1<mo form="prefix">&#x02212;</mo>'),
)  # fmt: skip


def mathml(node: nodes.math | nodes.math_block, display: str) -> str:
    """The equation, spaced as a typesetter would; a command that the converter does not know is a warning."""
    text = convert(node.astext(), display=display)
    if unknown := re.search(r"\\[A-Za-z|]+", text):
        LOGGER.warning("equation shows %s as it is written", unknown.group(), location=node, type="mathml")
    for pattern, replacement in REPAIRS:
        text = pattern.sub(replacement, text)
    return text


def visit_inline(self: HTML5Translator, node: nodes.math) -> None:
    """An equation within a line."""
    self.body.append(f'<span class="math">{mathml(node, "inline")}</span>')
    raise nodes.SkipNode


def visit_block(self: HTML5Translator, node: nodes.math_block) -> None:
    """An equation by itself, with its number where it has one."""
    self.body.append(self.starttag(node, "div", CLASS="math"))
    self.body.append(mathml(node, "block"))
    if number := node.get("number"):
        self.body.append(f'<span class="eqno">({escape(str(number))})')
        self.add_permalink_ref(node, _("Link to this equation"))
        self.body.append("</span>")
    self.body.append("</div>\n")
    raise nodes.SkipNode


def copy_font(app: Sphinx, exception: Exception | None) -> None:
    """Put STIX Two Math (SIL Open Font License) beside the style sheet that names it."""
    if exception is None and app.builder.format == "html":
        font = resources.files("ziamath") / "fonts" / "STIXTwoMath-Regular.ttf"
        Path(app.outdir, "_static", "STIXTwoMath-Regular.ttf").write_bytes(font.read_bytes())


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer: ``html_math_renderer = "mathml"``."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    app.connect("build-finished", copy_font)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

"""Where a line may break: not between a number and its unit, and in code only where a reader expects it."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform

UNIT = re.compile(r"(?<=\d) (?=%|(?:[nµmkMG]?(?:V|s|Hz)|dB|ppm|GB|[nµm]m)(?![\w-]))")
WORD = re.compile(r'<span class="pre">([^<]{25,})</span>')
"""A word of code, within a line, too long for a narrow page or a column of a table."""


class UnitsStay(SphinxPostTransform):
    """A no-break space between a number and its unit, outside code and equations."""

    default_priority = 900

    def run(self, **kwargs: Any) -> None:
        """Replace the text nodes concerned."""
        for text in list(self.document.findall(nodes.Text)):
            if not isinstance(text.parent, (nodes.literal, nodes.literal_block, nodes.math, nodes.raw)):
                joined = UNIT.sub("\N{NO-BREAK SPACE}", str(text))
                if joined != str(text):
                    text.parent.replace(text, nodes.Text(joined))


def break_long_words(app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: nodes.document) -> None:
    """Let a long word of code break after a slash, dot, underscore, bracket, sign or comma; no other word breaks."""
    if "body" in context:
        context["body"] = WORD.sub(
            lambda word: (
                f'<span class="pre">{re.sub(r"(?<=[/._(=,+:])(?=[A-Za-z0-9])", "<wbr>", word.group(1))}</span>'
            ),
            context["body"],
        )


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect both."""
    app.add_post_transform(UnitsStay)
    app.connect("html-page-context", break_long_words)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

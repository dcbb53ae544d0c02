"""The directive ``command-help``: what ``inkjet COMMAND --help`` prints, asked for by the build."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import ClassVar

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


class CommandHelp(SphinxDirective):
    """The help of a command, or of ``inkjet`` itself where none is named, as a terminal shows it."""

    optional_arguments = 1
    option_spec: ClassVar[dict] = {}

    def run(self) -> list[nodes.Node]:
        """Ask the command; a command that fails fails the build."""
        program = Path(sys.executable).with_name("inkjet")
        plain = os.environ | {"COLUMNS": "90", "NO_COLOR": "1", "TERM": "dumb"}
        command = [program, *self.arguments, "--help"]
        asked = subprocess.run(command, capture_output=True, text=True, check=False, env=plain)
        if asked.returncode:
            raise self.error(f"inkjet {' '.join(self.arguments)} --help failed: {asked.stderr.strip()}")
        shown = "\n".join(line.rstrip() for line in asked.stdout.strip().splitlines())
        block = nodes.literal_block(shown, shown)
        block["language"] = "text"
        return [block]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("command-help", CommandHelp)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

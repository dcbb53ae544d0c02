"""The directive ``module-map``: every module of a package with the first sentence of its docstring."""

from __future__ import annotations

import ast
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).parents[2]


def first_sentence(file: Path) -> str:
    """First paragraph of a module's docstring, on one line; empty where it has none."""
    docstring = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
    return " ".join(docstring.split("\n\n")[0].split())


class ModuleMap(SphinxDirective):
    """A definition list a package: its modules, in the order of their names, packages within it after them."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Read the package of that path below the repository, as ``inkjet_env/plant``."""
        folder = ROOT / self.arguments[0]
        if not (folder / "__init__.py").is_file():
            raise self.error(f"{self.arguments[0]} is no package")
        found: list[nodes.Node] = []
        for package in sorted({file.parent for file in folder.rglob("*.py")}):
            found += self._package(package)
        return found

    def _package(self, folder: Path) -> list[nodes.Node]:
        name = ".".join(folder.relative_to(ROOT).parts)
        title = nodes.paragraph("", "", nodes.strong(name, name), classes=["module-map-package"])
        if about := first_sentence(folder / "__init__.py"):
            title += nodes.Text(" — ")
            title += self.parse_inline(about)[0]
        rows = nodes.bullet_list(classes=["module-map"])
        for file in sorted(folder.glob("*.py")):
            self.env.note_dependency(str(file))
            if file.name != "__init__.py" and (about := first_sentence(file)):
                line = nodes.paragraph("", "", nodes.literal(file.name, file.name), nodes.Text(": "))
                line += self.parse_inline(about)[0]
                rows += nodes.list_item("", line)
        return [title, rows] if len(rows) else [title]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("module-map", ModuleMap)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

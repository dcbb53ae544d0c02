"""Names in docstrings: found where they are documented, though a docstring may name the module that defines them."""

from __future__ import annotations

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.nodes import make_refnode


def resolve(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, contnode: nodes.Element
) -> nodes.reference | nodes.Element | None:
    """The one documented object of that last name; in a docstring, a name that is none stays plain."""
    if node.get("refdomain") != "py":
        return None
    last = node["reftarget"].rsplit(".", 1)[-1]
    found = [
        (name, entry)
        for name, entry in env.domains.python_domain.objects.items()
        if name.rsplit(".", 1)[-1] == last and entry.objtype in ("class", "function", "exception") and not entry.aliased
    ]
    if len(found) == 1:
        name, entry = found[0]
        return make_refnode(app.builder, node["refdoc"], entry.docname, entry.node_id, contnode, name)
    # A docstring may speak of what is private; what a page written by hand names must be there.
    return contnode if node["refdoc"].startswith("reference/api/") else None


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to references that Sphinx does not find."""
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

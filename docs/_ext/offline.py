"""After the build: that no page loads anything from elsewhere, and how many pages took how long."""

from __future__ import annotations

import re
import time
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util import logging

LOGGER = logging.getLogger(__name__)
LOADED = re.compile(
    r"""<(?:script|img|iframe|source|video|audio|embed)\b[^>]*?\bsrc\s*=\s*["']?(?:https?:)?//"""
    r"""|<link\b(?=[^>]*\brel\s*=\s*["']?(?:stylesheet|preload|icon|preconnect))[^>]*?\bhref\s*=\s*["']?(?:https?:)?//""",
    re.IGNORECASE,
)
FETCHED = re.compile(r"""(?:@import\s+(?:url\()?|url\()\s*["']?(?:https?:)?//""", re.IGNORECASE)


def begin(app: Sphinx) -> None:
    """Look at the clock."""
    app.inkjet_begin_s = time.perf_counter()  # type: ignore[attr-defined]


def finish(app: Sphinx, exception: Exception | None) -> None:
    """Warn, which fails the build, of what a page or a style sheet would fetch; say what was built."""
    if exception is not None or app.builder.format != "html":
        return
    pages = sorted(Path(app.outdir).rglob("*.html"))
    for file in pages:
        text = file.read_text(encoding="utf-8")
        if found := LOADED.search(text) or FETCHED.search(text):
            LOGGER.warning("%s loads something from elsewhere: %s", file, found.group()[:120], type="offline")
    for file in sorted(Path(app.outdir).rglob("*.css")):
        if found := FETCHED.search(file.read_text(encoding="utf-8")):
            LOGGER.warning("%s loads something from elsewhere: %s", file, found.group()[:120], type="offline")
    seconds = time.perf_counter() - app.inkjet_begin_s  # type: ignore[attr-defined]
    print(f"{len(app.env.all_docs)} pages in {seconds:.0f} s: {Path(app.outdir) / 'index.html'}")


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect both ends of the build."""
    app.connect("builder-inited", begin)
    app.connect("build-finished", finish)
    return {"parallel_read_safe": True, "parallel_write_safe": True}

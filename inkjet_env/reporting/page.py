"""The frame of every page: one look, one set of filters, pictures to zoom, files that a page holds in itself.

A page's template extends ``page.html``. From top to bottom: the verdict in plain words, the picture that shows it, what
to do next, and the details, folded.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from inkjet_env.extras import extra
from inkjet_env.plant.wording import CHANNEL_WORDS
from inkjet_env.reporting.formatting import (
    channels_in_words,
    explained_text,
    hertz,
    number,
    probability,
    quantity_text,
    share_text,
    short,
    unit_text,
    with_minus,
)
from inkjet_env.reporting.plotting import svg_text

if TYPE_CHECKING:
    from jinja2 import Environment

    from inkjet_env.reporting.zoomable import Picture

KINDS = {"csv": "text/csv", "json": "application/json", "ini": "text/plain"}
"""Kinds of files that a page holds in itself, by the ending of the name."""


@dataclass(frozen=True)
class PageFile:
    """A file that the page holds in itself: its name, its text, and what it is."""

    name: str
    text: str
    what: str


def page_environment(package: str = "inkjet_env.reporting") -> Environment:
    """The Jinja environment of a package's pages: its own templates, ``page.html``, and the filters that all share.

    Parameters
    ----------
    package : str
        Package with a folder ``templates``.
    """
    with extra("a report"):
        from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    loaders = [PackageLoader(name) for name in dict.fromkeys((package, "inkjet_env.reporting"))]
    environment = Environment(loader=ChoiceLoader(loaders), autoescape=True, undefined=StrictUndefined)
    environment.filters |= {
        "short": short, "unit": unit_text, "svg": svg_text, "minus": with_minus,
        "channel": CHANNEL_WORDS.__getitem__, "channels": channels_in_words,
        "share": share_text, "explained": explained_text, "hertz": hertz, "number": number, "probability": probability,
        "quantity": quantity_text, "plain": lambda value: with_minus(f"{value:.4g}"), "address": file_address,
    }  # fmt: skip
    environment.globals |= {"bokeh_code": bokeh_code, "script_text": script_text}
    return environment


def file_address(text: str, name: str) -> str:
    """The content of a file as an address that a link can have: nothing else is needed to save it.

    Examples
    --------
    >>> file_address("time_s,drive_V", "next.csv")
    'data:text/csv;base64,dGltZV9zLGRyaXZlX1Y='
    """
    kind = KINDS[name.rpartition(".")[2]]
    return f"data:{kind};base64,{base64.b64encode(text.encode()).decode()}"


def script_text(value: Any) -> str:
    """JSON that is safe in a script element: it cannot contain a closing tag.

    Examples
    --------
    >>> script_text({"name": "</script>"})
    '{"name":"\\\\u003c/script>"}'
    """
    import json

    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def bokeh_code(pictures: Sequence[Picture]) -> str:
    """The code that draws pictures in a browser, without any network; empty where there are none."""
    if not pictures:
        return ""
    with extra("a report"):
        from bokeh.resources import Resources

    code: str = Resources(mode="inline", components=["bokeh"]).js_raw[0]
    return code

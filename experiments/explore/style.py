"""The look of the page: one font, quiet colours, tables that fit."""

from __future__ import annotations

from typing import Any

import panel as pn

from inkjet_env.experiments.explore.figures import FONT

PAGE = f"""
html, body {{ margin: 0; background: #fff; font-family: {FONT}; color: #1c1c1c; }}
body {{ overflow-x: hidden; }}
"""
INNER = f"""
:host {{ font-family: {FONT}; font-size: 14px; color: #1c1c1c; }}
p {{ margin: 4px 0; line-height: 1.35; }}
p.cost {{ font-size: 17px; }}
table.told {{ border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; font-size: 13px; }}
table.told th {{ text-align: left; font-weight: 600; border-bottom: 1px solid #bbb; padding: 3px 8px 3px 0;
  vertical-align: bottom; font-size: 12px; }}
table.told td {{ border-bottom: 1px solid #e8e8e8; padding: 3px 8px 3px 0; white-space: nowrap; }}
table.told th:not(:first-child), table.told td:not(:first-child) {{ text-align: right; }}
table.text td {{ white-space: normal; overflow-wrap: anywhere; }}
table.text th:not(:first-child), table.text td:not(:first-child) {{ text-align: left; }}
.dot {{ display: inline-block; width: 10px; height: 10px; border-radius: 5px; margin-right: 6px; }}
ul.excess {{ margin: 4px 0; padding: 6px 6px 6px 22px; background: #fff3e6; border-left: 3px solid #d55e00; }}
.scroll {{ overflow-x: auto; }}
ul.notes {{ margin: 2px 0; padding-left: 18px; color: #555; font-size: 12px; overflow-wrap: anywhere; }}
.trouble {{ padding: 8px 10px; background: #fff3e6; border-left: 3px solid #d55e00; }}
.verdict {{ padding: 8px 10px; background: #eef5fa; border-left: 3px solid #0072b2; font-size: 15px; }}
"""
VIEW = """
:host(.view) { align-items: flex-start; gap: 18px; }
:host(.controls) { flex: 0 0 270px; min-width: 250px; }
:host(.drawn) { flex: 1 1 420px; min-width: 300px; }
:host(.told) { flex: 0 0 270px; min-width: 250px; }
:host(.half) { flex: 1 1 300px; min-width: 280px; }
:host(.wide) { flex: 1 1 100%; min-width: 300px; }
@media (max-width: 720px) {
  :host(.controls), :host(.told), :host(.drawn) { flex: 1 1 100%; }
}
"""


def use() -> None:
    """Set Panel up: nothing from the network, this style."""
    pn.extension("tabulator", inline=False, raw_css=[PAGE], sizing_mode=None, template=None)


def text_pane(text: str = "", **options: Any) -> Any:
    """A pane of HTML that this program wrote; names in it are escaped by whoever made the text."""
    options.setdefault("sizing_mode", "stretch_width")
    return pn.pane.HTML(text, stylesheets=[INNER], **options)


def column(*parts: Any, kind: str = "") -> Any:
    """Parts below each other, in a box that takes its share of the width."""
    return pn.Column(*parts, css_classes=[kind] if kind else [], stylesheets=[VIEW], sizing_mode="stretch_width")


def row(*parts: Any, kind: str = "") -> Any:
    """Parts beside each other, wrapped where there is no room."""
    css = [kind] if kind else []
    return pn.FlexBox(*parts, css_classes=css, stylesheets=[VIEW], sizing_mode="stretch_width")


def set_differing(widget: Any, **values: Any) -> None:
    """Set what differs; what is the same is not sent again."""
    differs = {name: value for name, value in values.items() if getattr(widget, name) != value}
    if differs:
        widget.param.update(**differs)

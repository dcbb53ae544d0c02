"""A slider whose changes are acted upon at once, while it is dragged."""

from __future__ import annotations

from typing import Any, ClassVar

import panel as pn


class _AtOnce(pn.widgets.FloatSlider):
    """A slider that does not wait for further changes before it tells one: Panel waits for 50 ms otherwise."""

    _debounce: ClassVar[int] = 0


class QuickSlider(pn.widgets.EditableFloatSlider):
    """A slider with a field for its value, which tells a change at once."""

    _slider_widget: ClassVar[Any] = _AtOnce

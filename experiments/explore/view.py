"""What the four views of a tab share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar

import panel as pn

from inkjet_env.experiments.explore.exploration import Exploration

Guarded = Callable[[str, Callable[[], object]], None]
"""Runs a change, tells a refusal in a sentence, and the change of the view of that name to every tab."""


class View(ABC):
    """One tab's view of a part of the state.

    Parameters
    ----------
    exploration : Exploration
        The state.
    guarded : callable
        Makes a change, see `Guarded`.
    """

    name: ClassVar[str]
    layout: Any

    def __init__(self, exploration: Exploration, guarded: Guarded) -> None:
        self.exploration, self.guarded, self.drawing = exploration, guarded, False

    def change(self, act: Callable[[], object]) -> None:
        """Make a change that a user asks for; what the view itself sets while it draws is none."""
        if not self.drawing:
            self.guarded(self.name, act)

    def button(self, label: str, act: Callable[[], object], colour: str = "default", view: str = "") -> Any:
        """A button that makes a change, of this view unless another one is named."""
        made = pn.widgets.Button(label=label, color=colour)
        made.on_click(lambda _: self.guarded(view or self.name, act))
        return made

    def draw(self) -> None:
        """Show the state as it is now."""
        self.drawing = True
        try:
            self._draw()
        finally:
            self.drawing = False

    @abstractmethod
    def _draw(self) -> None: ...

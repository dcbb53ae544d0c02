"""The window of ``render_mode="human"``; needs pygame."""

from __future__ import annotations

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

from inkjet_env.extras import MissingExtraError


class Window:
    """A window that shows one picture at a time.

    Parameters
    ----------
    frames_per_second : float
        Largest rate at which pictures replace each other.

    Raises
    ------
    gymnasium.error.DependencyNotInstalled
        pygame is missing.
    """

    def __init__(self, frames_per_second: float) -> None:
        try:
            import pygame
        except ImportError:
            missing = MissingExtraError('render_mode="human"', "pygame", "human")
            raise DependencyNotInstalled(f'{missing}. Or use render_mode="rgb_array".') from None
        self._pygame = pygame
        self._frames_per_second = frames_per_second
        pygame.display.init()
        self._screen: pygame.Surface | None = None
        self._clock = pygame.time.Clock()

    def show(self, image: NDArray[np.uint8]) -> None:
        """Show a picture, shape (height, width, 3)."""
        pygame = self._pygame
        height, width, _ = image.shape
        if self._screen is None:
            pygame.display.set_caption("Inkjet printhead")
            self._screen = pygame.display.set_mode((width, height))
        pygame.event.pump()
        self._screen.blit(pygame.image.frombuffer(image.tobytes(), (width, height), "RGB"), (0, 0))
        pygame.display.flip()
        self._clock.tick(self._frames_per_second)

    def close(self) -> None:
        """Close the window."""
        self._pygame.display.quit()

"""A window for pictures of an environment. Needs pygame, which is imported with this first window."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray


def load_pygame() -> Any:
    """The package pygame, or an error that names the extra to install."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pygame imports modules that Python has deprecated
            import pygame
    except ImportError as error:
        raise DependencyNotInstalled(
            "render_mode='human' needs pygame, which is not installed: pip install redundant-envs[human]"
        ) from error
    return pygame


class Window:
    """A square window.

    Parameters
    ----------
    size : int
        Width and height, pixels.
    fps : int
        Most pictures a second: ``show`` waits until the next one is due.
    """

    def __init__(self, size: int, fps: int) -> None:
        self._pygame = load_pygame()
        self._pygame.display.init()
        self._pygame.display.set_caption("redundant-envs")
        self._screen = self._pygame.display.set_mode((size, size))
        self._clock = self._pygame.time.Clock()
        self._fps = fps

    def show(self, picture: NDArray[np.uint8]) -> None:
        """Show a picture, (size, size, 3) uint8."""
        self._pygame.surfarray.blit_array(self._screen, picture.swapaxes(0, 1))
        self._pygame.event.pump()
        self._clock.tick(self._fps)
        self._pygame.display.flip()

    def close(self) -> None:
        """Close the window."""
        self._pygame.display.quit()

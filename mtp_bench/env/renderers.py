"""Registry of renderers, by render mode."""

from __future__ import annotations

from pkgutil import resolve_name
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from .live import LiveEpisode

RENDERERS: dict[str, str] = {}  # render mode -> "module:class"; imported only when an env first renders


class Renderer(Protocol):
    """Drawing of an episode while it is played; one object serves all episodes of an env."""

    def render(self, episode: LiveEpisode) -> NDArray[np.uint8] | None:
        """Draw the frame that was answered last; returns the picture [height, width, 3], if there is one."""

    def close(self) -> None:
        """Release what drawing has opened."""


def open_renderer(mode: str) -> Renderer:
    """A renderer of a mode in `RENDERERS`."""
    renderer: Renderer = resolve_name(RENDERERS[mode])()
    return renderer

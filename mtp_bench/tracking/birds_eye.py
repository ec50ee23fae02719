"""Bird's-eye rectangles: boxes as trackers of image boxes want them, axis-aligned and in pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import ShapeError
from ..geometry import bev_corners
from ..types import Floats


@dataclass(frozen=True)
class BirdsEye:
    """A picture of the ground: ``scale`` pixels per metre, rectangles ``padding`` metres larger on every side.

    Pixel (0, 0) is the origin of the observations' frame, so coordinates may be negative. The frame does not move with
    the ego where the env compensates its motion: what stands still stays where it is. Padding helps where objects
    move by more than their own size between two frames, which leaves no overlap.
    """

    scale: float = 10.0
    padding: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.scale < np.inf:
            raise ShapeError(f"scale is {self.scale}, expected pixels per metre, a number above 0")
        if not 0 <= self.padding < np.inf:
            raise ShapeError(f"padding is {self.padding}, expected metres, 0 or more")

    def rectangles(self, box: Floats) -> Floats:
        """The rectangles [D, 4] x1 y1 x2 y2, pixels, around boxes [D, 7] x y z yaw l w h, metres."""
        corners = bev_corners(np.asarray(box, dtype=np.float64))
        low, high = corners.min(axis=-2) - self.padding, corners.max(axis=-2) + self.padding
        return self.scale * np.concatenate([low, high], axis=-1)

    def centres(self, rectangle: Floats) -> Floats:
        """Centres [N, 2] x y, metres, of rectangles [N, 4] in pixels: those of the boxes inside."""
        return np.asarray((rectangle[..., :2] + rectangle[..., 2:]) / (2 * self.scale))

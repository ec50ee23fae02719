"""A picture with coordinates in metres: lines and boxes of the world, drawn by Pillow without jagged edges.

No meaning depends on colour alone: truth is a bold outline (dashed where it is not tracked), a detection thin, a track
filled, a false positive crossed.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from ...geometry import bev_corners, rotate
from ...types import Floats
from ..framing import Window
from ..palette import BLACK, EVENT, Color

PAPER: Color = (247, 247, 247)  # beside a picture
WHITE: Color = (255, 255, 255)
GRAY: Color = (90, 90, 90)
EDGE: Color = (200, 200, 200)
FINER = 2  # everything but text is drawn this much larger and then made smaller
DASH = 4.0  # pixels
FAR = 20.0  # pixels that a heading may stand out of the picture


@dataclass(frozen=True)
class Outline:
    """Style of a box."""

    color: Color
    width: float = 1.0  # pixels
    fill: int = 0  # opacity of the inside, 0 (none) to 255
    dashed: bool = False
    heading: bool = False  # a tick out of the front
    crossed: bool = False


@dataclass(frozen=True, eq=False)
class Canvas:
    """A picture of ``width`` x ``height`` pixels that shows at least ``window``; world to pixels and back."""

    width: int
    height: int
    window: Window
    image: Image.Image
    draw: ImageDraw.ImageDraw
    taken: list[tuple[float, float, float, float]] = field(default_factory=list)  # pixels that hold text already

    @classmethod
    def blank(cls, width: int, height: int, window: Window, paper: Color = WHITE) -> Self:
        """An empty picture with the background ``paper``."""
        image = Image.new("RGB", (width * FINER, height * FINER), paper)
        return cls(width, height, window, image, ImageDraw.Draw(image, "RGBA"))

    @property
    def scale(self) -> float:
        """Pixels per metre."""
        return min(self.width / self.window.wide, self.height / self.window.high)

    def pixels(self, xy: Floats) -> NDArray[np.float64]:
        """Pixels [..., 2], y downwards, of places [..., 2] of the world, m."""
        moved = np.asarray(xy, dtype=np.float64) - [self.window.x, self.window.y]
        turned = rotate(moved, -self.window.turn) if self.window.turn else moved
        return np.asarray(turned * [self.scale, -self.scale] + [self.width / 2, self.height / 2], dtype=np.float64)

    def inside(self, xy: Floats, margin: float | Floats = 0.0) -> NDArray[np.bool_]:
        """Places [..., 2] of the world that lie in the picture or at most ``margin`` pixels around it."""
        x, y = np.moveaxis(self.pixels(xy), -1, 0)
        within = (x >= -margin) & (x <= self.width + margin) & (y >= -margin) & (y <= self.height + margin)
        return np.asarray(within, dtype=bool)

    def meets(self, xy: Floats) -> bool:
        """True if the rectangle around places [n, 2] of the world meets the picture."""
        pixels, size = self.pixels(xy), (self.width, self.height)
        return len(xy) > 0 and bool((pixels.max(axis=0) >= 0).all() and (pixels.min(axis=0) <= size).all())

    def lines(self, paths: Iterable[Floats], color: Color, width: float = 1.0, alpha: int = 255) -> None:
        """Draw polylines, each of points [n, 2] of the world, m; ``width`` pixels wide, ``alpha`` 255 is opaque."""
        for path in paths:
            if len(path) > 1:
                self.stroke(self.pixels(path), color, width, alpha)

    def boxes(self, box: Floats, mark: Outline) -> None:
        """Draw boxes [n, 7] x y z yaw l w h, m and rad, in the style ``mark``; skip those outside the picture."""
        reach = np.hypot(box[:, 4], box[:, 5]) * self.scale + FAR
        box = box[self.inside(box[:, :2], reach)]
        for corners, row in zip(self.pixels(bev_corners(box)), box, strict=True):
            if mark.fill:
                self.draw.polygon(_points(corners), fill=(*mark.color, mark.fill))
            self.stroke(np.concatenate([corners, corners[:1]]), mark.color, mark.width, dashed=mark.dashed)
            if mark.crossed:
                self.stroke(corners[[0, 2]], mark.color, mark.width)
                self.stroke(corners[[1, 3]], mark.color, mark.width)
            if mark.heading:
                ahead = np.array([np.cos(row[3]), np.sin(row[3])]) * (row[4] / 2 + max(0.4, 0.25 * row[4]))
                front = corners[[0, 3]].mean(axis=0)
                self.stroke(np.stack([front, self.pixels(row[:2] + ahead)]), mark.color, mark.width)

    def stroke(
        self, pixels: NDArray[np.float64], color: Color, width: float, alpha: int = 255, dashed: bool = False
    ) -> None:
        """Draw a polyline through ``pixels`` [n, 2], ``width`` pixels wide; ``alpha`` 255 is opaque."""
        thick = max(1, round(width * FINER))
        if dashed:
            for a, b in _dashes(pixels):
                self.draw.line([tuple(a * FINER), tuple(b * FINER)], fill=(*color, alpha), width=thick)
        else:
            self.draw.line(_points(pixels), fill=(*color, alpha), width=thick, joint="curve" if thick > 3 else None)

    def dot(self, pixel: NDArray[np.float64], radius: float, color: Color, alpha: int = 255) -> None:
        """Draw a disc around a pixel; ``radius`` in pixels."""
        self.draw.ellipse(_around(pixel, radius), fill=(*color, alpha))

    def ring(self, pixel: NDArray[np.float64], radius: float) -> None:
        """Draw the mark of an event: a bright circle with a dark edge around a pixel; ``radius`` in pixels."""
        for wider, color, width in ((1.0, BLACK, 5.0), (0.0, EVENT, 3.0)):
            self.draw.ellipse(_around(pixel, radius + wider), outline=color, width=round(width * FINER))

    def cross(self, pixel: NDArray[np.float64], reach: float, color: Color) -> None:
        """Draw two crossed lines on a white edge; ``reach`` pixels to each side."""
        for line_color, width in ((WHITE, 5.0), (color, 2.5)):
            for side in (1.0, -1.0):
                self.stroke(pixel + reach * np.array([[-1.0, -side], [1.0, side]]), line_color, width)

    def circle(self, pixel: NDArray[np.float64], radius: float, color: Color) -> None:
        """Draw a dashed circle around a pixel; ``radius`` in pixels."""
        angle = np.linspace(0.0, 2 * np.pi, 61)
        self.stroke(pixel + radius * np.column_stack([np.cos(angle), np.sin(angle)]), color, 1.5, dashed=True)

    def finished(self) -> Image.Image:
        """The picture reduced from FINER times its size; texts are drawn onto the result."""
        return self.image.reduce(FINER)


@cache
def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """The font that Pillow ships, the same on every machine."""
    return ImageFont.load_default(size)


@cache
def text_size(text: str, size: int) -> tuple[float, float]:
    """Width and height in pixels that a line of text takes."""
    left, _, right, _ = font(size).getbbox(text)
    return right - left, size * 1.2


def _points(pixels: NDArray[np.float64]) -> list[tuple[float, ...]]:
    return [tuple(p) for p in (pixels * FINER).tolist()]


def _around(pixel: NDArray[np.float64], radius: float) -> list[float]:
    """Bounding square (left, top, right, bottom) of a circle, in pixels of the enlarged image."""
    return [*((pixel - radius) * FINER).tolist(), *((pixel + radius) * FINER).tolist()]


def _dashes(path: NDArray[np.float64]) -> Iterable[tuple[Any, Any]]:
    """Ends of the dashes along a polyline [n, 2] of pixels."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    cuts = np.linspace(0.0, along[-1], 2 * max(2, round(float(along[-1]) / (2 * DASH))))
    points = np.column_stack([np.interp(cuts, along, axis) for axis in path.T])
    return zip(points[::2], points[1::2], strict=True)

"""A picture with coordinates in metres: lines, boxes and texts, drawn by Pillow without jagged edges.

No meaning depends on colour alone: truth is a bold outline (dashed where it is not tracked), a detection thin, a track
filled, a false positive crossed. A text is put at a free place beside its thing, or left out.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache
from itertools import product
from typing import Any, Self

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ...core import Bools, Floats, bev_corners, rotate, unit_vectors
from ..framing import Window
from ..palette import BLACK, EVENT, Color

PAPER = (247, 247, 247)  # beside a picture
WHITE = (255, 255, 255)
GRAY = (90, 90, 90)
EDGE = (200, 200, 200)
FINER = 2  # everything but text is drawn this much larger and then made smaller
DASH = 4.0  # pixels
FAR = 20.0  # pixels that a heading may stand out of the picture
SMALL, MIDDLE, LARGE = 11, 13, 16  # pixels of letters
AWAY = (8.0, 26.0, 48.0, 76.0, 110.0)  # pixels from a thing to a board with its name
EDGE_GAP = 12.0  # pixels between the edge and the tip of an arrow to it
ARROW = 36.0  # pixels, its length
SIDES = (
    -60,
    60,
    -120,
    120,
    -30,
    30,
    -90,
    90,
    180,
    0,
)  # degrees, directions of the text


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
    taken: list[tuple[float, float, float, float]] = field(
        default_factory=list
    )  # pixels that hold text already

    @classmethod
    def blank(
        cls, width: int, height: int, window: Window, paper: Color = WHITE
    ) -> Self:
        """An empty picture with the background ``paper``."""
        image = Image.new("RGB", (width * FINER, height * FINER), paper)
        return cls(width, height, window, image, ImageDraw.Draw(image, "RGBA"))

    @property
    def scale(self) -> float:
        """Pixels per metre."""
        return min(self.width / self.window.wide, self.height / self.window.high)

    def pixels(self, xy: Floats) -> Floats:
        """Pixels [..., 2], y downwards, of places [..., 2] of the world, m."""
        moved = np.asarray(xy, dtype=np.float64) - [self.window.x, self.window.y]
        turned = rotate(moved, -self.window.turn) if self.window.turn else moved
        return turned * [self.scale, -self.scale] + [self.width / 2, self.height / 2]

    def inside(self, xy: Floats, margin: float | Floats = 0.0) -> Bools:
        """Places [..., 2] of the world that lie in the picture or at most ``margin`` pixels around it."""
        x, y = np.moveaxis(self.pixels(xy), -1, 0)
        within: Bools = (
            (x >= -margin)
            & (x <= self.width + margin)
            & (y >= -margin)
            & (y <= self.height + margin)
        )
        return within

    def meets(self, xy: Floats) -> bool:
        """True if the rectangle around places [n, 2] of the world meets the picture."""
        pixels, size = self.pixels(xy), (self.width, self.height)
        return len(xy) > 0 and bool(
            (pixels.max(axis=0) >= 0).all() and (pixels.min(axis=0) <= size).all()
        )

    def lines(
        self,
        paths: Iterable[Floats],
        color: Color,
        width: float = 1.0,
        alpha: int = 255,
    ) -> None:
        """Draw polylines, each of points [n, 2] of the world, m; ``width`` pixels wide, ``alpha`` 255 is opaque."""
        for path in paths:
            if len(path) > 1:
                self.stroke(self.pixels(path), color, width, alpha)

    def boxes(self, box: Floats, mark: Outline) -> None:
        """Draw boxes [n, 7] x y z yaw l w h, m and rad, in the style ``mark``; skip those outside the picture."""
        box = box[
            self.inside(box[:, :2], np.hypot(box[:, 4], box[:, 5]) * self.scale + FAR)
        ]
        for corners, row in zip(self.pixels(bev_corners(box)), box, strict=True):
            if mark.fill:
                self.draw.polygon(_points(corners), fill=(*mark.color, mark.fill))
            self.stroke(
                np.concatenate([corners, corners[:1]]),
                mark.color,
                mark.width,
                dashed=mark.dashed,
            )
            if mark.crossed:
                self.stroke(corners[[0, 2]], mark.color, mark.width)
                self.stroke(corners[[1, 3]], mark.color, mark.width)
            if mark.heading:
                ahead = unit_vectors(row[3]) * (row[4] / 2 + max(0.4, 0.25 * row[4]))
                front = corners[[0, 3]].mean(axis=0)
                self.stroke(
                    np.stack([front, self.pixels(row[:2] + ahead)]),
                    mark.color,
                    mark.width,
                )

    def stroke(
        self,
        pixels: Floats,
        color: Color,
        width: float,
        alpha: int = 255,
        dashed: bool = False,
    ) -> None:
        """Draw a polyline through ``pixels`` [n, 2], ``width`` pixels wide; ``alpha`` 255 is opaque."""
        thick = max(1, round(width * FINER))
        if dashed:
            for a, b in _dashes(pixels):
                self.draw.line(
                    [tuple(a * FINER), tuple(b * FINER)],
                    fill=(*color, alpha),
                    width=thick,
                )
        else:
            self.draw.line(
                _points(pixels),
                fill=(*color, alpha),
                width=thick,
                joint="curve" if thick > 3 else None,
            )

    def dot(self, pixel: Floats, radius: float, color: Color, alpha: int = 255) -> None:
        """Draw a disc around a pixel; ``radius`` in pixels."""
        self.draw.ellipse(_around(pixel, radius), fill=(*color, alpha))

    def ring(self, pixel: Floats, radius: float) -> None:
        """Draw the mark of an event: a bright circle with a dark edge around a pixel; ``radius`` in pixels."""
        for wider, color, width in ((1.0, BLACK, 5.0), (0.0, EVENT, 3.0)):
            self.draw.ellipse(
                _around(pixel, radius + wider),
                outline=color,
                width=round(width * FINER),
            )

    def cross(self, pixel: Floats, reach: float, color: Color) -> None:
        """Draw two crossed lines on a white edge; ``reach`` pixels to each side."""
        for line_color, width in ((WHITE, 5.0), (color, 2.5)):
            for side in (1.0, -1.0):
                self.stroke(
                    pixel + reach * np.array([[-1.0, -side], [1.0, side]]),
                    line_color,
                    width,
                )

    def circle(self, pixel: Floats, radius: float, color: Color) -> None:
        """Draw a dashed circle around a pixel; ``radius`` in pixels."""
        angle = np.linspace(0.0, 2 * np.pi, 61)
        self.stroke(pixel + radius * unit_vectors(angle), color, 1.5, dashed=True)

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


def _points(pixels: Floats) -> list[tuple[float, ...]]:
    return [tuple(p) for p in (pixels * FINER).tolist()]


def _around(pixel: Floats, radius: float) -> list[float]:
    """Bounding square (left, top, right, bottom) of a circle, in pixels of the enlarged image."""
    return [*((pixel - radius) * FINER).tolist(), *((pixel + radius) * FINER).tolist()]


def _dashes(path: Floats) -> Iterable[tuple[Any, Any]]:
    """Ends of the dashes along a polyline [n, 2] of pixels."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    cuts = np.linspace(0.0, along[-1], 2 * max(2, round(float(along[-1]) / (2 * DASH))))
    points = np.column_stack([np.interp(cuts, along, axis) for axis in path.T])
    return zip(points[::2], points[1::2], strict=True)


def callout(
    canvas: Canvas,
    ink: ImageDraw.ImageDraw,
    xy: Floats,
    text: str,
    color: Color,
    reach: float,
    size: int = MIDDLE,
    board: Color | None = WHITE,
) -> None:
    """Write ``text`` at least ``reach`` pixels away from a thing at ``xy`` [2] of the world, if there is room.

    It stands on a ``board`` with a line to the thing; None: without one, and near the thing only.
    """
    if not canvas.inside(xy):
        return
    pad = 0 if board is None else 4
    wide, high = text_size(text, size)
    wide, high = wide + 2 * pad, high + pad
    x, y = canvas.pixels(xy).tolist()
    for far, angle in product(AWAY if board is not None else (1.0,), np.deg2rad(SIDES)):
        dx, dy = float(np.cos(angle)), float(np.sin(angle))
        left = x + dx * (reach + far) + wide * (dx - 1) / 2
        top = y + dy * (reach + far) + high * (dy - 1) / 2
        if _take(canvas, left, top, left + wide, top + high):
            break
    else:
        return
    if board is None:
        ink.text(
            (round(left), round(top)),
            text,
            fill=color,
            font=font(size),
            stroke_width=1,
            stroke_fill=WHITE,
        )
        return
    near = (min(max(x, left), left + wide), min(max(y, top), top + high))
    ink.line([x + dx * reach, y + dy * reach, *near], fill=color, width=1)
    ink.rectangle(
        [round(v) for v in (left, top, left + wide, top + high)],
        fill=board,
        outline=color,
    )
    ink.text((round(left + pad), round(top + 1)), text, fill=color, font=font(size))


def pointer(
    canvas: Canvas,
    ink: ImageDraw.ImageDraw,
    start: Floats,
    target: Floats,
    text: str,
    color: Color,
) -> None:
    """Draw an arrow with a text at the edge of the picture, from ``start`` [2] m in it towards ``target`` outside."""
    a, way = canvas.pixels(start), canvas.pixels(target) - canvas.pixels(start)
    room = np.where(way > 0, np.array([canvas.width, canvas.height]) - a, a) - EDGE_GAP
    share, length = (
        float((room / np.maximum(np.abs(way), 1e-9)).min()),
        float(np.hypot(*way)),
    )
    while share > 0 and any(
        l < x < r and t < y < b
        for x, y in [a + share * way]
        for l, t, r, b in canvas.taken
    ):
        share -= ARROW / length
    tip, unit = a + share * way, way / length
    tail, back, aside = (
        tip - ARROW * unit,
        tip - 14.0 * unit,
        5.0 * np.array([-unit[1], unit[0]]),
    )
    ink.line([*tail, *back], fill=color, width=2)
    ink.polygon([*tip, *(back + aside), *(back - aside)], fill=color)
    canvas.taken.append(
        (*np.minimum(tip, tail).tolist(), *np.maximum(tip, tail).tolist())
    )
    callout(
        canvas,
        ink,
        start + (share - ARROW / length) * (target - start),
        text,
        color,
        1.0,
    )


def scale_bar(canvas: Canvas, ink: ImageDraw.ImageDraw) -> None:
    """A bar of a round number of metres at the bottom left, which no other text overlaps."""
    most = canvas.width / canvas.scale / 5
    power = 10.0 ** np.floor(np.log10(most))
    metres = float(
        max(step * power for step in (0.5, 1.0, 2.0, 5.0) if step * power <= most)
    )
    left, bottom = 16, canvas.height - 16
    right = left + round(metres * canvas.scale)
    text = f"{metres:g} m"
    wide, high = text_size(text, MIDDLE)
    board = (left - 8, bottom - high - 12, max(right, left + wide) + 8, bottom + 8)
    canvas.taken.append(board)
    ink.rectangle(board, fill=WHITE)
    ink.line(
        [left, bottom - 5, left, bottom, right, bottom, right, bottom - 5],
        fill=BLACK,
        width=2,
    )
    ink.text(
        ((left + right - wide) // 2, bottom - high - 7),
        text,
        fill=BLACK,
        font=font(MIDDLE),
    )


def _take(canvas: Canvas, left: float, top: float, right: float, bottom: float) -> bool:
    """Take a rectangle if it lies in the picture and meets no other one; returns whether it was free."""
    inside = (
        left >= 2
        and top >= 2
        and right <= canvas.width - 2
        and bottom <= canvas.height - 2
    )
    free = inside and not any(
        left < r and l < right and top < b and t < bottom for l, t, r, b in canvas.taken
    )
    if free:
        canvas.taken.append((left, top, right, bottom))
    return free

"""Texts on a picture: each is put at a free place beside its thing, or left out."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from ...types import Floats
from ..palette import BLACK, EVENT, Color
from .canvas import Canvas, font, text_size

if TYPE_CHECKING:
    from PIL import ImageDraw

SMALL, MIDDLE = 11, 13  # pixels
PAPER: Color = (255, 255, 255)
FAR = (8.0, 26.0, 48.0, 76.0, 110.0)  # pixels from a thing to a board with its name
SIDES = (-60, 60, -120, 120, -30, 30, -90, 90, 180, 0)  # degrees, directions of the board
Spot = tuple[float, float, float, float]  # left, top, right, bottom


def label(canvas: Canvas, ink: ImageDraw.ImageDraw, xy: Floats, text: str, color: Color, reach: float) -> None:
    """Write ``text`` beside a thing at ``xy`` [2] that reaches ``reach`` metres, if there is room."""
    wide, high = text_size(text, SMALL)
    far = 0.7 * (reach * canvas.scale * 0.75 + 2.0)
    x, y = canvas.pixels(xy)
    corners = [
        (x + dx * far - (wide if dx < 0 else 0.0), y + dy * far - (high if dy < 0 else 0.0))
        for dx, dy in ((1, -1), (-1, -1), (1, 1), (-1, 1))
    ]
    place = _first_free(canvas, corners, wide, high)
    if place is not None:
        at = (round(corners[place][0]), round(corners[place][1]))
        ink.text(at, text, fill=color, font=font(SMALL), stroke_width=1, stroke_fill=PAPER)


def sign(canvas: Canvas, ink: ImageDraw.ImageDraw, xy: Floats, text: str, radius: float) -> None:
    """A board with the name of an event beside its ring of ``radius`` pixels around ``xy`` [2], if there is room."""
    if not canvas.inside(xy):
        return
    x, y = (float(value) for value in canvas.pixels(xy))
    wide, high = text_size(text, SMALL)
    wide, high = wide + 8, high + 4
    sides = list(product((0.0, 1.0, 2.0, 3.0), ((1, -1), (1, 1), (-1, -1), (-1, 1))))
    corners = [
        (x + radius if side > 0 else x - radius - wide, y + up * (radius + lift * (high + 2)) - high / 2)
        for lift, (side, up) in sides
    ]
    place = _first_free(canvas, corners, wide, high)
    if place is not None:
        (left, top), (side, up) = corners[place], sides[place][1]
        tip = (x + side * 0.7 * radius, y + up * 0.7 * radius)
        near = (left if tip[0] < left else left + wide, min(max(tip[1], top), top + high))
        ink.line([*tip, *near], fill=BLACK, width=1)
        ink.rectangle([round(v) for v in (left, top, left + wide, top + high)], fill=EVENT, outline=BLACK)
        ink.text((round(left + 4), round(top + 1)), text, fill=BLACK, font=font(SMALL))


def callout(
    canvas: Canvas, ink: ImageDraw.ImageDraw, tip: Floats, text: str, color: Color, reach: float, size: int = MIDDLE
) -> None:
    """A board with ``text`` and a line to the pixel ``tip`` [2], at least ``reach`` pixels away, if there is room."""
    wide, high = text_size(text, size)
    wide, high = wide + 10, high + 6
    x, y = (float(value) for value in tip)
    ways = [(far, float(np.cos(angle)), float(np.sin(angle))) for far, angle in product(FAR, np.deg2rad(SIDES))]
    corners = [
        (x + dx * (reach + far) + wide * (dx - 1) / 2, y + dy * (reach + far) + high * (dy - 1) / 2)
        for far, dx, dy in ways
    ]
    place = _first_free(canvas, corners, wide, high)
    if place is not None:
        (left, top), (_, dx, dy) = corners[place], ways[place]
        near = (min(max(x, left), left + wide), min(max(y, top), top + high))
        ink.line([x + dx * reach, y + dy * reach, *near], fill=color, width=1)
        ink.rectangle([round(v) for v in (left, top, left + wide, top + high)], fill=PAPER, outline=color)
        ink.text((round(left + 5), round(top + 2)), text, fill=color, font=font(size))


def scale_bar(canvas: Canvas, ink: ImageDraw.ImageDraw) -> None:
    """A bar of a round number of metres at the bottom left."""
    metres = round_length(canvas.width / canvas.scale / 5)
    left, bottom = 16, canvas.height - 16
    right = left + round(metres * canvas.scale)
    text = f"{metres:g} m"
    wide, high = text_size(text, MIDDLE)
    ink.rectangle([left - 8, bottom - high - 12, max(right, left + wide) + 8, bottom + 8], fill=PAPER)
    ink.line([left, bottom - 5, left, bottom, right, bottom, right, bottom - 5], fill=BLACK, width=2)
    ink.text(((left + right - wide) // 2, bottom - high - 7), text, fill=BLACK, font=font(MIDDLE))


def _first_free(canvas: Canvas, corners: Iterable[tuple[float, float]], wide: float, high: float) -> int | None:
    """Index of the first left top corner where a text fits, which takes the place; None without room.

    A text lies in the picture, clear of the scale bar and of every other text.
    """
    for place, (left, top) in enumerate(corners):
        right, bottom = left + wide, top + high
        outside = left < 2 or top < 2 or right > canvas.width - 2 or bottom > canvas.height - 2
        on_bar = bottom > canvas.height - 48 and left < 0.3 * canvas.width
        taken = any(left < r and l < right and top < b and t < bottom for l, t, r, b in canvas.taken)
        if not (outside or on_bar or taken):
            canvas.taken.append((left, top, right, bottom))
            return place
    return None


def round_length(metres: float) -> float:
    """The largest of 0.5, 1, 2, 5, 10, 20, ... that is at most ``metres``."""
    power = 10.0 ** np.floor(np.log10(metres))
    return float(max(step * power for step in (0.5, 1.0, 2.0, 5.0) if step * power <= metres))

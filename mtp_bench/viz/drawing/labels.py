"""Texts on a picture: each finds a free place beside what it names, or is left out."""

from __future__ import annotations

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
FAR = (8.0, 26.0, 48.0, 76.0, 110.0)  # pixels from a thing to a board that names it, and in which direction (degrees)
SIDES = (-60, 60, -120, 120, -30, 30, -90, 90, 180, 0)
Spot = tuple[float, float, float, float]  # left, top, right, bottom


def label(canvas: Canvas, ink: ImageDraw.ImageDraw, xy: Floats, text: str, color: Color, reach: float) -> None:
    """Write ``text`` beside a thing at ``xy`` [2] that reaches ``reach`` metres, where there is room.

    ``canvas`` knows the places that are taken, ``ink`` draws in ``color``.
    """
    wide, high = text_size(text, SMALL)
    far = 0.7 * (reach * canvas.scale * 0.75 + 2.0)
    x, y = canvas.pixels(xy)
    for dx, dy in ((1, -1), (-1, -1), (1, 1), (-1, 1)):
        left = x + dx * far - (wide if dx < 0 else 0.0)
        top = y + dy * far - (high if dy < 0 else 0.0)
        if _take(canvas, (left, top, left + wide, top + high)):
            ink.text((round(left), round(top)), text, fill=color, font=font(SMALL), stroke_width=1, stroke_fill=PAPER)
            return


def sign(canvas: Canvas, ink: ImageDraw.ImageDraw, xy: Floats, text: str, radius: float) -> None:
    """A sign that names an event by ``text``, beside its ring of ``radius`` pixels around ``xy`` [2].

    ``canvas`` knows the places that are taken, ``ink`` draws. Where there is no room, nothing is drawn.
    """
    if not canvas.inside(xy):
        return
    x, y = (float(value) for value in canvas.pixels(xy))
    wide, high = text_size(text, SMALL)
    wide, high = wide + 8, high + 4
    for lift, (side, up) in product((0.0, 1.0, 2.0, 3.0), ((1, -1), (1, 1), (-1, -1), (-1, 1))):
        left = x + radius if side > 0 else x - radius - wide
        top = y + up * (radius + lift * (high + 2)) - high / 2
        spot = (left, top, left + wide, top + high)
        if _take(canvas, spot):
            _board(ink, spot, (x + side * 0.7 * radius, y + up * 0.7 * radius), text)
            return


def callout(
    canvas: Canvas, ink: ImageDraw.ImageDraw, tip: Floats, text: str, color: Color, reach: float, size: int = MIDDLE
) -> None:
    """A board with ``text`` near the pixel ``tip`` [2], at least ``reach`` pixels away, with a line to it.

    ``canvas`` knows the places that are taken, ``ink`` draws in ``color`` and in this ``size``. Where there is no
    room near, nothing is drawn.
    """
    wide, high = text_size(text, size)
    wide, high = wide + 10, high + 6
    x, y = (float(value) for value in tip)
    for far, angle in product(FAR, np.deg2rad(SIDES)):
        dx, dy = float(np.cos(angle)), float(np.sin(angle))
        left = x + dx * (reach + far) + wide * (dx - 1) / 2
        top = y + dy * (reach + far) + high * (dy - 1) / 2
        spot = (left, top, left + wide, top + high)
        if _take(canvas, spot):
            near = (min(max(x, left), left + wide), min(max(y, top), top + high))
            ink.line([x + dx * reach, y + dy * reach, *near], fill=color, width=1)
            ink.rectangle([round(v) for v in spot], fill=PAPER, outline=color)
            ink.text((round(left + 5), round(top + 2)), text, fill=color, font=font(size))
            return


def scale_bar(canvas: Canvas, ink: ImageDraw.ImageDraw) -> None:
    """A bar of a round number of metres at the bottom left."""
    metres = _round_length(canvas.width / canvas.scale / 5)
    left, bottom = 16, canvas.height - 16
    right = left + round(metres * canvas.scale)
    text = f"{metres:g} m"
    wide, high = text_size(text, MIDDLE)
    ink.rectangle([left - 8, bottom - high - 12, max(right, left + wide) + 8, bottom + 8], fill=PAPER)
    ink.line([left, bottom - 5, left, bottom, right, bottom, right, bottom - 5], fill=BLACK, width=2)
    ink.text(((left + right - wide) // 2, bottom - high - 7), text, fill=BLACK, font=font(MIDDLE))


def _board(ink: ImageDraw.ImageDraw, spot: Spot, tip: tuple[float, float], text: str) -> None:
    """A board with ``text`` and a line from it to ``tip``."""
    left, top, right, bottom = spot
    near = (left if tip[0] < left else right, min(max(tip[1], top), bottom))
    ink.line([*tip, *near], fill=BLACK, width=1)
    ink.rectangle([round(v) for v in spot], fill=EVENT, outline=BLACK)
    ink.text((round(left + 4), round(top + 1)), text, fill=BLACK, font=font(SMALL))


def _take(canvas: Canvas, spot: Spot) -> bool:
    """Claim a place for text: it lies in the picture, clear of the scale bar and of every other text."""
    left, top, right, bottom = spot
    if left < 2 or top < 2 or right > canvas.width - 2 or bottom > canvas.height - 2:
        return False
    if bottom > canvas.height - 48 and left < 0.3 * canvas.width:
        return False
    if any(left < r and l < right and top < b and t < bottom for l, t, r, b in canvas.taken):
        return False
    canvas.taken.append(spot)
    return True


def _round_length(metres: float) -> float:
    """The largest of 1, 2, 5, 10, 20, ... that is at most ``metres``."""
    power = 10.0 ** np.floor(np.log10(metres))
    return float(max(step * power for step in (0.5, 1.0, 2.0, 5.0) if step * power <= metres))

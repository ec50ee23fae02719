"""Texts on a picture: each is put at a free place beside its thing, or left out."""

from itertools import product

import numpy as np
from PIL import ImageDraw

from ...types import Floats
from ..palette import BLACK, Color
from .canvas import WHITE, Canvas, font, text_size

SMALL, MIDDLE, LARGE = 11, 13, 16  # pixels of letters
FAR = (8.0, 26.0, 48.0, 76.0, 110.0)  # pixels from a thing to a board with its name
EDGE_GAP = 12.0  # pixels between the edge and the tip of an arrow to it
ARROW = 36.0  # pixels, its length
SIDES = (-60, 60, -120, 120, -30, 30, -90, 90, 180, 0)  # degrees, directions of the text


def callout(
    canvas: Canvas, ink: ImageDraw.ImageDraw, xy: Floats, text: str, color: Color, reach: float,
    size: int = MIDDLE, board: Color | None = WHITE,
) -> None:  # fmt: skip
    """Write ``text`` at least ``reach`` pixels away from a thing at ``xy`` [2] of the world, if there is room.

    It stands on a ``board`` with a line to the thing; None: without one, and near the thing only.
    """
    if not canvas.inside(xy):
        return
    pad = 0 if board is None else 4
    wide, high = text_size(text, size)
    wide, high = wide + 2 * pad, high + pad
    x, y = canvas.pixels(xy).tolist()
    for far, angle in product(FAR if board is not None else (1.0,), np.deg2rad(SIDES)):
        dx, dy = float(np.cos(angle)), float(np.sin(angle))
        left = x + dx * (reach + far) + wide * (dx - 1) / 2
        top = y + dy * (reach + far) + high * (dy - 1) / 2
        if _take(canvas, left, top, left + wide, top + high):
            break
    else:
        return
    if board is None:
        ink.text((round(left), round(top)), text, fill=color, font=font(size), stroke_width=1, stroke_fill=WHITE)
        return
    near = (min(max(x, left), left + wide), min(max(y, top), top + high))
    ink.line([x + dx * reach, y + dy * reach, *near], fill=color, width=1)
    ink.rectangle([round(v) for v in (left, top, left + wide, top + high)], fill=board, outline=color)
    ink.text((round(left + pad), round(top + 1)), text, fill=color, font=font(size))


def pointer(canvas: Canvas, ink: ImageDraw.ImageDraw, start: Floats, target: Floats, text: str, color: Color) -> None:
    """Draw an arrow with a text at the edge of the picture, from ``start`` [2] m in it towards ``target`` outside."""
    a, way = canvas.pixels(start), canvas.pixels(target) - canvas.pixels(start)
    room = np.where(way > 0, np.array([canvas.width, canvas.height]) - a, a) - EDGE_GAP
    share, length = float((room / np.maximum(np.abs(way), 1e-9)).min()), float(np.hypot(*way))
    while share > 0 and any(l < x < r and t < y < b for x, y in [a + share * way] for l, t, r, b in canvas.taken):
        share -= ARROW / length
    tip, unit = a + share * way, way / length
    tail, back, aside = tip - ARROW * unit, tip - 14.0 * unit, 5.0 * np.array([-unit[1], unit[0]])
    ink.line([*tail, *back], fill=color, width=2)
    ink.polygon([*tip, *(back + aside), *(back - aside)], fill=color)
    canvas.taken.append((*np.minimum(tip, tail).tolist(), *np.maximum(tip, tail).tolist()))
    callout(canvas, ink, start + (share - ARROW / length) * (target - start), text, color, 1.0)


def scale_bar(canvas: Canvas, ink: ImageDraw.ImageDraw) -> None:
    """A bar of a round number of metres at the bottom left, which no other text overlaps."""
    most = canvas.width / canvas.scale / 5
    power = 10.0 ** np.floor(np.log10(most))
    metres = float(max(step * power for step in (0.5, 1.0, 2.0, 5.0) if step * power <= most))
    left, bottom = 16, canvas.height - 16
    right = left + round(metres * canvas.scale)
    text = f"{metres:g} m"
    wide, high = text_size(text, MIDDLE)
    board = (left - 8, bottom - high - 12, max(right, left + wide) + 8, bottom + 8)
    canvas.taken.append(board)
    ink.rectangle(board, fill=WHITE)
    ink.line([left, bottom - 5, left, bottom, right, bottom, right, bottom - 5], fill=BLACK, width=2)
    ink.text(((left + right - wide) // 2, bottom - high - 7), text, fill=BLACK, font=font(MIDDLE))


def _take(canvas: Canvas, left: float, top: float, right: float, bottom: float) -> bool:
    """Take a rectangle if it lies in the picture and meets no other one; returns whether it was free."""
    inside = left >= 2 and top >= 2 and right <= canvas.width - 2 and bottom <= canvas.height - 2
    free = inside and not any(left < r and l < right and top < b and t < bottom for l, t, r, b in canvas.taken)
    if free:
        canvas.taken.append((left, top, right, bottom))
    return free

"""The column beside a picture: heading, bars, meaning of the marks, and remarks."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image

from ..framing import Window
from ..palette import BLACK, Color
from .canvas import FINER, GRAY, MIDDLE, PAPER, Canvas, Outline, text_size

MARK_PX = 20  # between two marks, if there is room
BAR_LEFT_PX = 150
BAR_PX = 90
TEXT_LEFT_PX = 12
NAME_LEFT_PX = 56
LINE_HEIGHT = 1.45  # of the size of letters
_TIED = "\u00a0"  # a blank that breaks no line; the font has none
Text = tuple[str, int, Color]  # text, size, colour


@dataclass(frozen=True)
class Mark:
    """A mark with its meaning: a box, a line with a dot at its end, or a sign."""

    text: str
    box: Outline | None = None
    line: Color | None = None
    width: float = 1.5  # pixels of the line
    dashed: bool = False
    sign: str = ""  # "ring", "cross" or "circle", the latter in the colour of the line

    def draw(self, canvas: Canvas, y: float) -> None:
        """Draw it at height ``y`` of a column, whose metres are pixels."""
        middle = np.array([28.0, y])
        color = self.line or BLACK
        if self.sign == "ring":
            canvas.ring(middle, 8.0)
        elif self.sign == "cross":
            canvas.cross(middle, 6.0, color)
        elif self.sign == "circle":
            canvas.circle(middle, 9.0, color)
        elif self.line is not None:
            ends = np.array([[14.0, y], [42.0, y]])
            canvas.stroke(ends, color, self.width, dashed=self.dashed)
            if self.box is None:
                canvas.dot(ends[1], 1.5 + self.width, color)
        if self.box is not None:
            # a box is in metres from the middle of the canvas, upwards
            place = (30.0 - canvas.width / 2, canvas.height / 2 - y)
            canvas.boxes(np.array([[*place, 0.0, 0.0, 18.0, 10.0, 1.0]]), self.box)


def column(
    size_px: tuple[int, int],
    heading: Sequence[Text],
    marks: Sequence[Mark],
    remarks: Sequence[Text] = (),
    parts: Mapping[str, float] | None = None,
) -> Image.Image:
    """Draw texts and marks below each other in ``size_px`` pixels.

    ``parts``: metres by name, drawn as bars below the heading; those below 0 are
    hollow. Remarks are left out where there is no room.
    """
    canvas = Canvas(*size_px, Window(0.0, 0.0, *size_px), PAPER)
    y = _write(canvas, 12.0, heading)
    y = _draw_bars(canvas, y, parts or {})
    y = _draw_marks(canvas, y + 8, marks)
    _write(canvas, y + 12, remarks)
    return canvas.finished()


def _write(canvas: Canvas, y: float, texts: Sequence[Text]) -> float:
    """Write texts from ``y`` on, as far as there is room.

    Returns the y below them.
    """
    for text, letter_px, color in texts:
        lines = wrapped(text, letter_px, canvas.width - 2 * TEXT_LEFT_PX)
        line_px = LINE_HEIGHT * letter_px
        if y + line_px * len(lines) < canvas.height:
            for line in lines:
                canvas.text(TEXT_LEFT_PX, y, line, letter_px, color)
                y += line_px
    return y


def _draw_bars(canvas: Canvas, y: float, parts: Mapping[str, float]) -> float:
    """Draw the bars of ``parts``, m, from ``y`` on, and return the y below."""
    largest = max(map(abs, parts.values()), default=0.0)
    for name, value in parts.items():
        right = BAR_LEFT_PX + BAR_PX * abs(value) / largest
        edges = [edge * FINER for edge in (BAR_LEFT_PX, y + 4, right, y + 14)]
        fill = None if value < 0 else GRAY
        canvas.draw.rectangle(edges, fill, GRAY, FINER)
        canvas.text(TEXT_LEFT_PX, y + 1, name, MIDDLE, BLACK)
        canvas.text(right + 6, y + 1, f"{value:.1f} m", MIDDLE, BLACK)
        y += 19
    return y


def _draw_marks(canvas: Canvas, y: float, marks: Sequence[Mark]) -> float:
    """Draw marks with their texts, closer together where room is short.

    Returns the y below them.
    """
    texts = [
        wrapped(mark.text, MIDDLE, canvas.width - NAME_LEFT_PX - 6) for mark in marks
    ]
    line_count = max(sum(map(len, texts)), 1)
    line_px = min(MARK_PX, (canvas.height - y - 4) / line_count)
    for mark, lines in zip(marks, texts, strict=True):
        mark.draw(canvas, y + line_px / 2)
        for line in lines:
            canvas.text(NAME_LEFT_PX, y + line_px / 2 - 7, line, MIDDLE, BLACK)
            y += line_px
    return y


def wrapped(text: str, size_px: int, width_px: float) -> list[str]:
    """Break ``text`` into lines of at most ``width_px`` pixels.

    It is broken between words, but not between a number and its unit.
    """
    lines: list[str] = []
    for word in re.sub(r"(\d) (m|s)\b", rf"\1{_TIED}\2", text).split(" "):
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and text_size(longer, size_px)[0] <= width_px:
            lines[-1] = longer
        else:
            lines.append(word)
    return [line.replace(_TIED, " ") for line in lines]

"""The column beside a picture: a heading, the meaning of the marks, and remarks."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw

from ..framing import Window
from ..palette import BLACK, Color
from .canvas import FINER, GRAY, MIDDLE, PAPER, Canvas, Outline, font, text_size

LINE = 20  # pixels between two marks, if there is room
BAR_LEFT, BAR = 150, 90  # pixels, of bars
_TIED = "\u00a0"  # a blank that breaks no line; the font has none
Text = tuple[str, int, Color]  # text, size, colour


@dataclass(frozen=True)
class Mark:
    """A mark with its meaning: a box, a line with a dot at its end, both, or a sign; a ring if none of them."""

    text: str
    box: Outline | None = None
    line: Color | None = None
    width: float = 1.5  # pixels of the line
    dashed: bool = False
    sign: str = ""  # "cross" or "circle", in the colour of the line, or "none"

    def draw(self, canvas: Canvas, y: float) -> None:
        """Draw it at the height ``y`` of a canvas where a metre is a pixel."""
        middle = np.array([28.0, y])
        if self.sign == "cross":
            canvas.cross(middle, 6.0, self.line or BLACK)
        elif self.sign == "circle":
            canvas.circle(middle, 9.0, self.line or BLACK)
        elif self.line is not None and not self.sign:
            path = np.array([[14.0, y], [42.0, y]])
            canvas.stroke(path, self.line, self.width, dashed=self.dashed)
            if self.box is None:
                canvas.dot(path[1], 1.5 + self.width, self.line)
        if self.box is not None:
            x = 30.0 - canvas.width / 2
            canvas.boxes(
                np.array([[x, canvas.height / 2 - y, 0.0, 0.0, 18.0, 10.0, 1.0]]),
                self.box,
            )
        elif self.line is None and not self.sign:
            canvas.ring(middle, 8.0)


def column(
    size: tuple[int, int],
    heading: Sequence[Text],
    marks: Sequence[Mark],
    remarks: Sequence[Text],
    parts: Mapping[str, float],
) -> Image.Image:
    """A picture of ``size`` pixels with texts and marks below each other; remarks as many as there is room for.

    ``parts``: metres by name, drawn as bars below the heading; those below 0 are hollow.
    """
    canvas = Canvas.blank(*size, Window(0.0, 0.0, *size), PAPER)
    texts: list[tuple[float, float, Text]] = []
    y = 12.0

    def write(lines: Sequence[Text]) -> None:
        nonlocal y
        for text, letters, color in lines:
            broken = wrapped(text, letters, size[0] - 24)
            for part in broken if y + 1.45 * letters * len(broken) < size[1] else ():
                texts.append((12, y, (part, letters, color)))
                y += 1.45 * letters

    write(heading)
    for name, value in parts.items():
        long = round(BAR * abs(value) / max(map(abs, parts.values())))
        bar, fill = (
            [FINER * v for v in (BAR_LEFT, y + 4, BAR_LEFT + long, y + 14)],
            None if value < 0 else GRAY,
        )
        canvas.draw.rectangle(bar, fill, GRAY, FINER)
        texts.append((12, y + 1, (name, MIDDLE, BLACK)))
        texts.append((BAR_LEFT + long + 6, y + 1, (f"{value:.1f} m", MIDDLE, BLACK)))
        y += 19
    y += 8
    named = [
        (i, mark, text)
        for mark in marks
        for i, text in enumerate(wrapped(mark.text, MIDDLE, size[0] - 62))
    ]
    line = min(LINE, (size[1] - y - 4) / max(len(named), 1))
    for i, mark, text in named:
        if i == 0:
            mark.draw(canvas, y + line / 2)
        texts.append((56, y + line / 2 - 7, (text, MIDDLE, BLACK)))
        y += line
    y += 12
    write(remarks)
    image = canvas.finished()
    ink = ImageDraw.Draw(image)
    for x, top, (text, letters, color) in texts:
        ink.text((x, round(top)), text, fill=color, font=font(letters))
    return image


def wrapped(text: str, size: int, wide: float) -> list[str]:
    """``text`` in lines of at most ``wide`` pixels, broken between words, but not between a number and its unit."""
    lines, rest = [], re.sub(r"(\d) (m|s)\b", rf"\1{_TIED}\2", text).split(" ")
    while rest:
        count = len(rest)
        while count > 1 and text_size(" ".join(rest[:count]), size)[0] > wide:
            count -= 1
        lines.append(" ".join(rest[:count]).replace(_TIED, " "))
        rest = rest[count:]
    return lines

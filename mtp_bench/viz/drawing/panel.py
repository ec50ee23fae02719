"""The column beside a picture: scene and frame, meaning of the marks, and events."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from PIL import Image, ImageDraw

from ..focus import Window
from ..frame_view import FrameView, event_text
from ..palette import BLACK, FALSE, FORECAST, TRACK, Color
from .canvas import (
    DETECTED,
    EDGE,
    FALSE_DETECTION,
    FALSE_TRACK,
    GRAY,
    OTHER,
    PAPER,
    TRACK_BOX,
    TRACKED,
    UNTRACKED,
    VEHICLE,
    Canvas,
    Outline,
    font,
    text_size,
)
from .labels import MIDDLE, SMALL

LARGE = 16
LINE = 21  # pixels between two entries
Mark = Callable[[Canvas, float], None]  # draws a mark at this height
Text = tuple[str, int, Color]  # one line: text, size, colour


def panel(picture: Image.Image, view: FrameView, wide: int) -> Image.Image:
    """``picture`` with a column of ``wide`` pixels on its right."""
    column = Canvas.blank(wide, picture.height, Window(0.0, 0.0, wide, picture.height), PAPER)
    entries = list(legend(view))
    heading = [(part, size, color) for text, size, color in _heading(view) for part in wrapped(text, size, wide - 20)]
    top = 14 + sum(size * 1.45 for _, size, _ in heading) + 12
    for i, (mark, _) in enumerate(entries):
        mark(column, top + LINE * (i + 0.5))
    image = column.finished()
    ink = ImageDraw.Draw(image)
    y = 14.0
    for line in heading:
        _write(ink, (12, y), line, wide - 20)
        y += line[1] * 1.45
    for i, (_, text) in enumerate(entries):
        _write(ink, (50, top + LINE * i + 2), (text, MIDDLE, BLACK), wide - 56)
    y = top + LINE * len(entries) + 16
    for text, color in _events(view):
        if y + 0.85 * LINE < picture.height - 8:  # as many as there is room for
            _write(ink, (12, y), (text, SMALL + 1, color), wide - 20)
            y += 0.85 * LINE
    whole = Image.new("RGB", (picture.width + wide, picture.height), PAPER)
    whole.paste(picture, (0, 0))
    whole.paste(image, (picture.width, 0))
    ImageDraw.Draw(whole).line([picture.width, 0, picture.width, picture.height], fill=EDGE)
    return whole


def _write(ink: ImageDraw.ImageDraw, place: tuple[float, float], line: Text, wide: float) -> None:
    text, size, color = line
    ink.text((place[0], round(place[1])), fitting(text, size, wide), fill=color, font=font(size))


def wrapped(text: str, size: int, wide: float) -> list[str]:
    """``text``, or its parts between commas if it does not fit into ``wide`` pixels."""
    return [text] if text_size(text, size)[0] <= wide else text.split(", ")


def fitting(text: str, size: int, wide: float) -> str:
    """``text``, or as much of it as fits into ``wide`` pixels with dots behind."""
    if text_size(text, size)[0] <= wide:
        return text
    while text and text_size(text + "...", size)[0] > wide:
        text = text[:-1]
    return text + "..."


def _heading(view: FrameView) -> Iterator[Text]:
    """Lines at the top."""
    seconds = view.scene.time[view.frame] - view.scene.time[0]
    yield view.agent or view.card.id, LARGE, BLACK
    if view.agent:
        yield view.card.id, MIDDLE, GRAY
    yield f"scene {view.scene.name}", MIDDLE, GRAY
    yield f"frame {view.frame} of {view.scene.frames - 1}   {seconds:.1f} s", MIDDLE, BLACK
    if view.answer is None:
        yield "no answer yet", MIDDLE, GRAY
    elif view.answer.hypotheses > 1:
        yield f"best of {view.answer.hypotheses} hypotheses ({100 * view.answer.weight:.0f} %)", MIDDLE, BLACK
    if view.judgement is not None:
        tracked, untracked, false = view.judgement.counts
        text = f"tracked {tracked}, untracked {untracked}"
        yield text + (f", false {false}" if view.scene.truth_complete else ""), MIDDLE, BLACK


def _events(view: FrameView) -> Iterator[tuple[str, Color]]:
    """The last events."""
    if view.judgement is not None:
        yield ("events so far, newest first" if view.judgement.log else "no event so far"), GRAY
        for event in view.judgement.log:
            yield f"{event.frame}: {event_text(event)}", BLACK


def legend(view: FrameView) -> Iterator[tuple[Mark, str]]:
    """Marks of this kind of picture with their meaning; the same for all frames of a video."""
    judged = view.judgement is not None
    complete = judged and view.scene.truth_complete
    if view.truth_shown:
        yield _box(TRACKED), "true box"
        if judged:
            yield _box(UNTRACKED), "true box, untracked"
    yield _box(DETECTED), "detection"
    if complete:
        yield _box(FALSE_DETECTION), "false positive"
    yield _track(TRACK_BOX, TRACK), "track, where it was"
    if complete:
        yield _track(FALSE_TRACK, FALSE), "false track"
    yield _box(OTHER), "other hypotheses"
    yield _forecast(FORECAST), "forecast"
    if complete:
        yield _forecast(FALSE), "false forecast"
    if judged:
        yield lambda canvas, y: canvas.ring(np.array([26.0, y]), 7.5), "event"
    if view.ego is not None:
        yield _box(VEHICLE), "ego"


def _box(outline: Outline, x: float = 24.0, size: tuple[float, float] = (20.0, 10.0)) -> Mark:
    """A box around pixel ``x`` of the column, in whose world a metre is a pixel."""

    def mark(canvas: Canvas, y: float) -> None:
        canvas.boxes(np.array([[x - canvas.width / 2, canvas.height / 2 - y, 0.0, 0.0, *size, 1.0]]), outline)

    return mark


def _track(outline: Outline, color: Color) -> Mark:
    def mark(canvas: Canvas, y: float) -> None:
        _box(outline, 32.0, (14.0, 8.0))(canvas, y)
        canvas.stroke(np.array([[10.0, y], [30.0, y]]), color, 1.6, 150)

    return mark


def _forecast(color: Color) -> Mark:
    def mark(canvas: Canvas, y: float) -> None:
        for end, alpha in ((-5.0, 110), (0.0, 230), (5.0, 110)):
            path = np.array([[12.0, y], [26.0, y + end / 3], [38.0, y + end]])
            canvas.stroke(path, color, 1.3, alpha)
            canvas.dot(path[-1], 2.2, color, alpha)

    return mark

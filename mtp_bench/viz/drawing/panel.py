"""The column beside a picture: which scene and frame, what the marks mean, which events happened."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from PIL import Image, ImageDraw

from ..frame_view import FrameView, event_text
from .canvas import Canvas, Viewport, font, text_size
from .labels import MIDDLE, SMALL
from .palette import BLACK, DETECTION, EGO, EVENT, FALSE, FORECAST, OTHER_TRACK, TRACK, TRUTH, Color

LARGE = 16
PAPER: Color = (247, 247, 247)
GRAY: Color = (90, 90, 90)
LINE = 21  # pixels between two entries
Mark = Callable[[Canvas, float], None]  # draws a mark at this height


def panel(picture: Image.Image, view: FrameView, wide: int) -> Image.Image:
    """``picture`` with a column of ``wide`` pixels on its right."""
    column = Canvas.blank(wide, picture.height, Viewport(0.0, 0.0, wide, picture.height), PAPER)
    entries = list(legend(view))
    heading = [(part, size, color) for text, size, color in _heading(view) for part in wrapped(text, size, wide - 20)]
    top = 14 + sum(size * 1.45 for _, size, _ in heading) + 12
    for i, (mark, _) in enumerate(entries):
        mark(column, top + LINE * (i + 0.5))
    image = column.finished()
    ink = ImageDraw.Draw(image)
    y = 14.0
    for text, size, color in heading:
        ink.text((12, round(y)), fitting(text, size, wide - 20), fill=color, font=font(size))
        y += size * 1.45
    for i, (_, text) in enumerate(entries):
        ink.text((50, round(top + LINE * i + 2)), fitting(text, MIDDLE, wide - 56), fill=BLACK, font=font(MIDDLE))
    _list_events(ink, view, top + LINE * len(entries) + 16, wide, picture.height)
    whole = Image.new("RGB", (picture.width + wide, picture.height), PAPER)
    whole.paste(picture, (0, 0))
    whole.paste(image, (picture.width, 0))
    ImageDraw.Draw(whole).line([picture.width, 0, picture.width, picture.height], fill=(200, 200, 200))
    return whole


def wrapped(text: str, size: int, wide: float) -> list[str]:
    """``text``, or its parts between commas where it does not fit into ``wide`` pixels."""
    return [text] if text_size(text, size)[0] <= wide else text.split(", ")


def fitting(text: str, size: int, wide: float) -> str:
    """``text``, or as much of it as fits into ``wide`` pixels with dots behind."""
    if text_size(text, size)[0] <= wide:
        return text
    while text and text_size(text + "...", size)[0] > wide:
        text = text[:-1]
    return text + "..."


def _heading(view: FrameView) -> list[tuple[str, int, Color]]:
    """Lines at the top: text, size, colour."""
    lines = [
        (view.agent or view.env_id, LARGE, BLACK),
        *([(view.env_id, MIDDLE, GRAY)] if view.agent else []),
        (f"scene {view.scene}", MIDDLE, GRAY),
        (f"frame {view.frame} of {view.frames - 1}   {view.seconds:.1f} s", MIDDLE, BLACK),
    ]
    if view.said is not None and view.said.hypotheses > 1:
        said = view.said
        lines.append((f"best of {said.hypotheses} hypotheses ({100 * said.weight:.0f} %)", MIDDLE, BLACK))
    elif view.said is None:
        lines.append(("no answer yet", MIDDLE, GRAY))
    if view.judged is not None:
        tracked, missed, false = view.judged.counts
        text = f"tracked {tracked}, missed {missed}" + (f", false {false}" if view.judged.complete else "")
        lines.append((text, MIDDLE, BLACK))
    return lines


def _list_events(ink: ImageDraw.ImageDraw, view: FrameView, top: float, wide: int, high: int) -> None:
    """The last events, as many as there is room for."""
    if view.judged is None:
        return
    lines = [("events so far, newest first", GRAY)]
    lines += [(f"{event.frame}: {event_text(event)}", BLACK) for event in view.judged.log]
    for i, (text, color) in enumerate(lines if len(lines) > 1 else [("no event so far", GRAY)]):
        if top + LINE * 0.85 * (i + 1) < high - 8:
            ink.text((12, round(top + LINE * 0.85 * i)), fitting(text, SMALL + 1, wide - 20), color, font(SMALL + 1))


def legend(view: FrameView) -> Iterator[tuple[Mark, str]]:
    """What the marks of this kind of picture mean; the same for all frames of a video."""
    judged = view.judged is not None
    complete = view.judged is not None and view.judged.complete
    if view.truth_box is not None:
        yield _box(TRUTH, width=2.0, heading=True), "true box"
        if judged:
            yield _box(TRUTH, width=2.0, heading=True, dashed=True), "true box, missed"
    yield _box(DETECTION, width=1.2), "detection"
    if complete:
        yield _box(DETECTION, width=1.0, crossed=True), "detection of nothing"
    yield _trail(TRACK, 95), "track, where it was"
    if complete:
        yield _trail(FALSE, 25), "track of nothing"
    yield _box(OTHER_TRACK, width=0.8, dashed=True), "other hypotheses"
    yield _forecast(FORECAST), "forecast"
    if complete:
        yield _forecast(FALSE), "forecast of nothing"
    if judged:
        yield _event, "event"
    if view.ego is not None:
        yield _box(EGO, width=1.5, fill=200, heading=True), "ego"


def _place(canvas: Canvas, y: float, x: float = 26.0) -> tuple[float, float]:
    """Pixel (x, y) of the column in its world, where a metre is a pixel."""
    return x - canvas.width / 2, canvas.height / 2 - y


def _box(color: Color, **how: object) -> Mark:
    def mark(canvas: Canvas, y: float) -> None:
        box = np.array([[*_place(canvas, y, 24.0), 0.0, 0.0, 20.0, 10.0, 1.0]])
        canvas.boxes(box, color, **how)  # type: ignore[arg-type]

    return mark


def _trail(color: Color, fill: int) -> Mark:
    def mark(canvas: Canvas, y: float) -> None:
        canvas.boxes(np.array([[*_place(canvas, y, 32.0), 0.0, 0.0, 14.0, 8.0, 1.0]]), color, 1.0, fill=fill)
        canvas.stroke(np.array([[10.0, y], [30.0, y]]), color, 1.6, 150)

    return mark


def _forecast(color: Color) -> Mark:
    def mark(canvas: Canvas, y: float) -> None:
        for end, alpha in ((-5.0, 110), (0.0, 230), (5.0, 110)):
            path = np.array([[12.0, y], [26.0, y + end / 3], [38.0, y + end]])
            canvas.stroke(path, color, 1.3, alpha)
            canvas.dot(path[-1], 2.2, color, alpha)

    return mark


def _event(canvas: Canvas, y: float) -> None:
    center = np.array([26.0, y])
    canvas.ring(center, 8.5, BLACK, 5.0)
    canvas.ring(center, 7.5, EVENT, 3.0)

"""The column beside a picture: scene and frame, meaning of the marks, and events."""

from __future__ import annotations

from collections.abc import Iterator

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
)  # fmt: skip
from .labels import MIDDLE, SMALL

LARGE = 16
LINE = 21  # pixels between two entries
LOG = 10  # events that are listed
Text = tuple[str, int, Color]  # one line: text, size, colour
Mark = tuple[str, Outline | None, Color]  # "box", "track", "forecast" or "ring"


def panel(picture: Image.Image, view: FrameView, wide: int) -> Image.Image:
    """``picture`` with a column of ``wide`` pixels on its right."""
    column = Canvas.blank(wide, picture.height, Window(0.0, 0.0, wide, picture.height), PAPER)
    entries = list(legend(view))
    heading = [(part, size, color) for text, size, color in _heading(view) for part in wrapped(text, size, wide - 20)]
    top = 14 + sum(size * 1.45 for _, size, _ in heading) + 12
    for i, (mark, _) in enumerate(entries):
        _draw_mark(column, mark, top + LINE * (i + 0.5))
    image = column.finished()
    ink = ImageDraw.Draw(image)

    def write(x: float, y: float, text: str, size: int, color: Color) -> None:
        ink.text((x, round(y)), fitting(text, size, wide - 8 - x), fill=color, font=font(size))

    y = 14.0
    for text, size, color in heading:
        write(12, y, text, size, color)
        y += size * 1.45
    for i, (_, text) in enumerate(entries):
        write(50, top + LINE * i + 2, text, MIDDLE, BLACK)
    y = top + LINE * len(entries) + 16
    for text, color in _events(view):
        if y + 0.85 * LINE < picture.height - 8:  # as many as there is room for
            write(12, y, text, SMALL + 1, color)
            y += 0.85 * LINE
    whole = Image.new("RGB", (picture.width + wide, picture.height), PAPER)
    whole.paste(picture, (0, 0))
    whole.paste(image, (picture.width, 0))
    ImageDraw.Draw(whole).line([picture.width, 0, picture.width, picture.height], fill=EDGE)
    return whole


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
    scene, replay, t = view.scene, view.replay, view.answered
    if replay is not None and replay.agent:
        yield replay.agent, LARGE, BLACK
        yield view.card.id, MIDDLE, GRAY
    else:
        yield view.card.id, LARGE, BLACK
    yield f"scene {scene.name}", MIDDLE, GRAY
    seconds = scene.time[view.frame] - scene.time[0]
    yield f"frame {view.frame} of {scene.frames - 1}   {seconds:.1f} s", MIDDLE, BLACK
    if view.answers is None:
        yield "no answer yet", MIDDLE, GRAY
    else:
        weight = view.answers.rollout.hypothesis_log_weight[t]
        alive, best = int(np.isfinite(weight).sum()), int(view.answers.hypotheses.best[t])
        if alive > 1:
            yield f"best of {alive} hypotheses ({100 * float(np.exp(weight[best])):.0f} %)", MIDDLE, BLACK
    if replay is not None:
        tracked, untracked, false = (int(series[view.frame]) for series in replay.counts.values())
        text = f"tracked {tracked}, untracked {untracked}"
        yield text + (f", false {false}" if scene.truth_complete else ""), MIDDLE, BLACK


def _events(view: FrameView) -> Iterator[tuple[str, Color]]:
    """The last events."""
    if view.replay is not None:
        events = [event for event in reversed(view.replay.events) if event.frame <= view.frame][:LOG]
        yield ("events so far, newest first" if events else "no event so far"), GRAY
        for event in events:
            yield f"{event.frame}: {event_text(event)}", BLACK


def legend(view: FrameView) -> Iterator[tuple[Mark, str]]:
    """Marks of this kind of picture with their meaning; the same for all frames of a video."""
    judged = view.replay is not None
    complete = judged and view.scene.truth_complete
    entries: list[tuple[bool, Mark, str]] = [
        (view.truth_shown, ("box", TRACKED, BLACK), "true box"),
        (view.truth_shown and judged, ("box", UNTRACKED, BLACK), "true box, untracked"),
        (True, ("box", DETECTED, BLACK), "detection"),
        (complete, ("box", FALSE_DETECTION, BLACK), "false positive"),
        (True, ("track", TRACK_BOX, TRACK), "track, where it was"),
        (complete, ("track", FALSE_TRACK, FALSE), "false track"),
        (True, ("box", OTHER, BLACK), "other hypotheses"),
        (True, ("forecast", None, FORECAST), "forecast"),
        (complete, ("forecast", None, FALSE), "false forecast"),
        (judged, ("ring", None, BLACK), "event"),
        (view.ego is not None, ("box", VEHICLE, BLACK), "ego"),
    ]
    yield from ((mark, text) for shown, mark, text in entries if shown)


def _draw_mark(canvas: Canvas, mark: Mark, y: float) -> None:
    """Draw a mark at the height ``y`` of the column, where a metre is a pixel."""
    kind, outline, color = mark
    if outline is not None:
        x, *size = (32.0, 14.0, 8.0) if kind == "track" else (24.0, 20.0, 10.0)
        canvas.boxes(np.array([[x - canvas.width / 2, canvas.height / 2 - y, 0.0, 0.0, *size, 1.0]]), outline)
    if kind == "track":
        canvas.stroke(np.array([[10.0, y], [30.0, y]]), color, 1.6, 150)
    elif kind == "forecast":
        for end, alpha in ((-5.0, 110), (0.0, 230), (5.0, 110)):
            path = np.array([[12.0, y], [26.0, y + end / 3], [38.0, y + end]])
            canvas.stroke(path, color, 1.3, alpha)
            canvas.dot(path[-1], 2.2, color, alpha)
    elif kind == "ring":
        canvas.ring(np.array([26.0, y]), 7.5)

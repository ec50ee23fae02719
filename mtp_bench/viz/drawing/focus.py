"""The picture of an event alone: the object, its tracks and forecasts bright, all else dim, seen from above."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from PIL import Image, ImageDraw

from ...types import Floats
from ..case import Forecast
from ..focus import ROLES, Focus, FocusFrame, Window
from ..palette import BLACK, Color
from .birds_eye import draw_lanes
from .canvas import Canvas, Outline, Viewport
from .labels import MIDDLE, callout, scale_bar

OBJECT = Outline(ROLES["truth"], 2.5, heading=True)
OTHER_OBJECT = Outline(ROLES["truth"], 1.2, heading=True, dashed=True)
DETECTED = Outline(ROLES["detection"], 1.0, dashed=True)
DIM_TRUTH = Outline((205, 205, 205), 1.0, fill=40)
DIM_TRACK = Outline((215, 215, 215), 0.8)
DIM_DETECTION = Outline((225, 225, 225), 0.8)
BIG = 15  # pixels, of the labels
Said = Sequence[tuple[str, Forecast]]  # the forecasts in sight, each with its role
GAP = 1.0  # m, that the forecast is off at its end: less needs no line


def draw_focus(focus: Focus, t: int, size: tuple[int, int], window: Window, near: bool = False) -> Image.Image:
    """Frame ``t`` of an event in ``size`` pixels; ``near``: a small picture of the boxes, without forecasts."""
    canvas = Canvas.blank(*size, Viewport(window.x, window.y, window.wide, window.high, window.turn))
    shown = focus.frame(t)
    forecasts = [] if near else focus.forecasts(t)
    draw_lanes(canvas, focus.replay.scene.lanes)
    canvas.boxes(shown.dim_detection, DIM_DETECTION)
    canvas.boxes(shown.dim_track, DIM_TRACK)
    canvas.boxes(shown.dim_truth, DIM_TRUTH)
    ring, radius = canvas.pixels(focus.case.place(t)), _radius(canvas, shown)
    if near or focus.lasts(t):
        canvas.ring(ring, radius)
    for role, forecast in forecasts:
        _draw_forecast(canvas, forecast, ROLES[role], role == "now")
    _draw_way(canvas, shown, near)
    _draw_boxes(canvas, shown)
    gap = None if near else _gap(focus, t)
    if gap is not None:
        canvas.stroke(canvas.pixels(gap), BLACK, 1.2, dashed=True)
    image = canvas.finished()
    ink = ImageDraw.Draw(image)
    scale_bar(canvas, ink)
    canvas.taken.append((*(ring - 0.8 * radius).tolist(), *(ring + 0.8 * radius).tolist()))
    for path in [shown.future, *(forecast.nearest_path for _, forecast in forecasts)]:
        _keep_clear(canvas, path)
    for place, text, color, reach in _labels(focus, shown, forecasts, gap, radius, near):
        if canvas.inside(place):
            callout(canvas, ink, canvas.pixels(place), text, color, reach, MIDDLE if near else BIG)
    return image


def _draw_forecast(canvas: Canvas, forecast: Forecast, color: Color, newest: bool) -> None:
    """The sample nearest to the truth bold, with a dot at its end, the others thin; of an old one it alone, dashed."""
    for path in forecast.path if newest else ():
        canvas.lines([np.concatenate([forecast.start[None], path])], color, 1.0, 70)
    nearest = canvas.pixels(forecast.nearest_path)
    canvas.stroke(nearest, color, 3.0 if newest else 2.0, dashed=not newest)
    canvas.dot(nearest[-1], 5.0 if newest else 3.5, color)


def _draw_way(canvas: Canvas, shown: FocusFrame, near: bool) -> None:
    """Where the object was and, but for a small picture, where it goes; where the tracks were."""
    for track in shown.tracks:
        canvas.lines([track.trail], ROLES[track.role], 2.0, 130)
    canvas.lines([shown.past], ROLES["truth"], 1.5, 150)
    if not near and len(shown.future) > 1:
        canvas.lines([shown.future], ROLES["truth"], 4.0)
        canvas.dot(canvas.pixels(shown.future[-1]), 6.0, ROLES["truth"])


def _draw_boxes(canvas: Canvas, shown: FocusFrame) -> None:
    canvas.boxes(shown.others, OTHER_OBJECT)
    for track in shown.tracks:
        canvas.boxes(track.box[None], Outline(ROLES[track.role], 1.5, fill=90))
    canvas.boxes(shown.object_box, OBJECT)
    canvas.boxes(shown.detection_box, DETECTED)
    for xy in canvas.pixels(shown.detection_box[:, :2]):
        canvas.dot(xy, 2.0, BLACK)


def _gap(focus: Focus, t: int) -> Floats | None:
    """From where the newest forecast ends to where the object then is [2, 2]; None where that is near or not known."""
    forecast = focus.case.forecast(t) if t >= focus.at.frame else None
    future = focus.case.future(t)
    if forecast is None or len(future) < 2:
        return None
    ends = np.stack([forecast.nearest_path[: len(future)][-1], future[-1]])
    return ends if np.hypot(*(ends[1] - ends[0])) > GAP else None


def _radius(canvas: Canvas, shown: FocusFrame) -> float:
    """Pixels of the ring: around the box of the object."""
    length = float(shown.object_box[0, 4]) if len(shown.object_box) else 2.0
    return float(np.clip(0.75 * length * canvas.scale, 15.0, 60.0))


def _keep_clear(canvas: Canvas, path: Floats) -> None:
    """No label lies on ``path`` [n, 2]."""
    for a, b in pairwise(path):
        for xy in canvas.pixels(np.linspace(a, b, 4)):
            canvas.taken.append((*(xy - 4).tolist(), *(xy + 4).tolist()))


def _labels(
    focus: Focus,
    shown: FocusFrame,
    forecasts: Said,
    gap: Floats | None,
    radius: float,
    near: bool,
) -> Iterator[tuple[Floats, str, Color, float]]:
    """Texts with their places [2], colours, and pixels to stay away; the most important first."""
    if gap is not None:
        yield gap.mean(axis=0), f"{np.hypot(*(gap[1] - gap[0])):.1f} m off", BLACK, 2.0
    for track in shown.tracks:
        yield track.box[:2], f"track {track.track_id}", ROLES[track.role], 10.0 if near else radius
    if len(shown.object_box) and not near:
        yield shown.object_box[0, :2], f"{focus.case.noun} {focus.at.object_id}", ROLES["truth"], radius
    for box, name in zip(shown.others, shown.other_names, strict=True):
        yield box[:2], name, ROLES["truth"], 10.0
    if near:
        return
    if (missing := _missing(focus, shown, forecasts)) is not None:
        yield focus.case.place(shown.frame), missing, ROLES["now"], radius
    if len(shown.future) > 1:
        seconds = focus.case.seconds(shown.frame + len(shown.future) - 1) - focus.case.seconds(shown.frame)
        yield shown.future[-1], f"true, {seconds:.1f} s later", ROLES["truth"], 7.0
    for role, forecast in reversed(forecasts):
        yield forecast.nearest_path[-1], "forecast " + _when(focus, role, shown.frame), ROLES[role], 6.0


def _missing(focus: Focus, shown: FocusFrame, forecasts: Said) -> str | None:
    """What the object ought to have from the event on and has not."""
    if shown.frame < focus.at.frame or not len(shown.object_box):
        return None
    track, forecast = shown.follower < 0, not any(role == "now" for role, _ in forecasts)
    return {(True, True): "no track, no forecast", (True, False): "no track", (False, True): "no forecast"}.get(
        (track, forecast)
    )


def _when(focus: Focus, role: str, t: int) -> str:
    if role == "now" or t < focus.at.frame:
        return "now"
    return "a frame before" if t == focus.at.frame else "before the event"

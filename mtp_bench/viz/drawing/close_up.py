"""Picture of an event alone: the object, its tracks and forecasts bright, all else dim, seen from above."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from ...geometry import bev_corners
from ...types import Floats
from ..focus import Focus, ObjectForecast
from ..framing import ROLES, FocusFrame, Window, frame_of
from ..palette import BLACK, Color
from .birds_eye import draw_lanes
from .canvas import Canvas, Outline
from .labels import MIDDLE, callout, scale_bar

OBJECT = Outline(ROLES["truth"], 2.5, heading=True)
OTHER_OBJECT = Outline(ROLES["truth"], 1.2, heading=True, dashed=True)
DETECTION_NEAR = Outline(ROLES["detection"], 1.0, dashed=True)
DIM_TRUTH = Outline((205, 205, 205), 1.0, fill=40)
DIM_TRACK = Outline((215, 215, 215), 0.8)
DIM_DETECTION = Outline((225, 225, 225), 0.8)
GAP = 1.0  # m, between the ends of forecast and future: smaller gaps need no line
BIG = 15  # pixels of letters
Forecasts = Sequence[tuple[str, ObjectForecast]]  # each with its role


class Name(NamedTuple):
    """A text for a place."""

    place: Floats  # [2] m
    text: str
    color: Color
    reach: float = 6.0  # pixels from the place to the edge of the thing


def draw_focus(focus: Focus, t: int, size: tuple[int, int], window: Window, near: bool = False) -> Image.Image:
    """Frame ``t`` of an event in ``size`` pixels; ``near``: a small picture of the boxes, without forecasts."""
    canvas, shown = Canvas.blank(*size, window), frame_of(focus, t)
    forecasts = [] if near else focus.forecasts(t)
    place = focus.place(t)
    box = shown.object_box[0, 4:6] if len(shown.object_box) else np.ones(2)
    radius = float(np.clip(0.6 * np.hypot(*box) * canvas.scale, 15.0, 110.0))  # pixels of the ring
    ringed, gap = near or focus.ringed(t), _gap(shown, forecasts)
    draw_lanes(canvas, focus.replay.scene.lanes)
    _draw_things(canvas, shown, forecasts, near)
    if gap is not None:
        canvas.stroke(canvas.pixels(gap), BLACK, 1.2, dashed=True)
    if ringed:
        canvas.ring(canvas.pixels(place), radius)
    image = canvas.finished()
    ink = ImageDraw.Draw(image)
    scale_bar(canvas, ink)
    _keep_clear(canvas, shown, forecasts, place, radius + 3.0 if ringed else 0.8 * radius)
    names = list(_names_of_boxes(shown, gap, canvas.scale))
    names += [] if near else _other_names(focus, shown, forecasts, radius)
    for name in names:  # the most important first, the last ones if there is room
        callout(canvas, ink, name.place, name.text, name.color, name.reach, MIDDLE if near else BIG)
    return image


def _gap(shown: FocusFrame, forecasts: Forecasts) -> Floats | None:
    """From the end of the newest forecast to the object's place then [2, 2]; None if near or unknown."""
    future = shown.future
    newest = [forecast for role, forecast in forecasts if role == "now"]
    if not newest or len(future) < 2:
        return None
    ends = np.stack([newest[-1].nearest_path[: len(future)][-1], future[-1]])
    return ends if np.hypot(*(ends[1] - ends[0])) > GAP else None


def _draw_things(canvas: Canvas, shown: FocusFrame, forecasts: Forecasts, near: bool) -> None:
    """Draw boxes and paths, the dim ones first."""
    canvas.boxes(shown.dim_detection, DIM_DETECTION)
    canvas.boxes(shown.dim_track, DIM_TRACK)
    canvas.boxes(shown.dim_truth, DIM_TRUTH)
    for role, forecast in forecasts:
        # the sample nearest to the truth bold, the others thin; an old one alone, dashed
        newest = role == "now"
        for path in forecast.path if newest else ():
            canvas.lines([np.concatenate([forecast.start[None], path])], ROLES[role], 1.0, 70)
        nearest = canvas.pixels(forecast.nearest_path)
        canvas.stroke(nearest, ROLES[role], 3.0 if newest else 2.0, dashed=not newest)
        canvas.dot(nearest[-1], 5.0 if newest else 3.5, ROLES[role])
    for track in shown.tracks:
        canvas.lines([track.trail], ROLES[track.role], 2.0, 130)
    canvas.lines([shown.past], ROLES["truth"], 1.5, 150)
    if not near and len(shown.future) > 1:
        canvas.lines([shown.future], ROLES["truth"], 4.0)
        canvas.dot(canvas.pixels(shown.future[-1]), 6.0, ROLES["truth"])
    canvas.boxes(shown.others, OTHER_OBJECT)
    for track in shown.tracks:
        canvas.boxes(track.box[None], Outline(ROLES[track.role], 1.5, fill=90))
    canvas.boxes(shown.object_box, OBJECT)
    canvas.boxes(shown.detection_box, DETECTION_NEAR)
    for xy in canvas.pixels(shown.detection_box[:, :2]):
        canvas.dot(xy, 2.0, BLACK)


def _keep_clear(canvas: Canvas, shown: FocusFrame, forecasts: Forecasts, place: Floats, radius: float) -> None:
    """Keep names off the object, its tracks and its paths."""
    center = canvas.pixels(place)
    parts = [np.stack([center - radius, center + radius])]
    parts += [canvas.pixels(bev_corners(box)) for box in [*(track.box for track in shown.tracks), *shown.others]]
    for path in [shown.future, *(forecast.nearest_path for _, forecast in forecasts)]:
        steps = np.linspace(path[:-1], path[1:], 4).reshape(-1, 2)
        parts += [np.stack([xy - 4.0, xy + 4.0]) for xy in canvas.pixels(steps)]
    for part in parts:
        (left, top), (right, bottom) = part.min(axis=0).tolist(), part.max(axis=0).tolist()
        canvas.taken.append((left, top, right, bottom))


def _names_of_boxes(shown: FocusFrame, gap: Floats | None, scale: float) -> Iterator[Name]:
    if gap is not None:
        yield Name(gap.mean(axis=0), f"{np.hypot(*(gap[1] - gap[0])):.1f} m off", BLACK, 2.0)
    boxes = [(track.box, f"track {track.track_id}", ROLES[track.role]) for track in shown.tracks]
    boxes += [(box, name, ROLES["truth"]) for box, name in zip(shown.others, shown.other_names, strict=True)]
    for box, text, color in boxes:
        yield Name(box[:2], text, color, 0.5 * float(box[5]) * scale)


def _other_names(focus: Focus, shown: FocusFrame, forecasts: Forecasts, radius: float) -> Iterator[Name]:
    """The object, its missing track or forecast from the event on, and the ends of its future and of the forecasts."""
    t, future, place = shown.frame, shown.future, focus.place(shown.frame)
    if len(shown.object_box):
        missing = ["no track"] if focus.follower(t) < 0 else []
        missing += ["no forecast"] if all(role != "now" for role, _ in forecasts) else []
        if missing and t >= focus.at.frame:
            yield Name(place, ", ".join(missing), ROLES["now"], radius)
        yield Name(place, focus.named, ROLES["truth"], radius)
    if len(future) > 1:
        later = focus.seconds(t + len(future) - 1) - focus.seconds(t)
        yield Name(future[-1], f"true, {later:.1f} s later", ROLES["truth"], 7.0)
    for role, forecast in reversed(forecasts):
        when = {t: "now", t - 1: "a frame before"}.get(forecast.frame, "before the event")
        yield Name(forecast.nearest_path[-1], f"forecast {when}", ROLES[role])

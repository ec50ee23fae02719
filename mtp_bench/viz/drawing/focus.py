"""The picture of an event alone: the object, its tracks and forecasts bright, all else dim, seen from above."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw

from ..case import Forecast
from ..focus import ROLES, Focus, Window
from ..palette import BLACK, Color
from .birds_eye import draw_lanes
from .canvas import Canvas, Outline
from .close_up import CloseUp
from .names import write_names

OBJECT = Outline(ROLES["truth"], 2.5, heading=True)
OTHER_OBJECT = Outline(ROLES["truth"], 1.2, heading=True, dashed=True)
DETECTED = Outline(ROLES["detection"], 1.0, dashed=True)
DIM_TRUTH = Outline((205, 205, 205), 1.0, fill=40)
DIM_TRACK = Outline((215, 215, 215), 0.8)
DIM_DETECTION = Outline((225, 225, 225), 0.8)


def draw_focus(focus: Focus, t: int, size: tuple[int, int], window: Window, near: bool = False) -> Image.Image:
    """Frame ``t`` of an event in ``size`` pixels; ``near``: a small picture of the boxes, without forecasts."""
    view = CloseUp.of(focus, t, size, window, near)
    canvas = view.canvas
    draw_lanes(canvas, focus.replay.scene.lanes)
    canvas.boxes(view.shown.dim_detection, DIM_DETECTION)
    canvas.boxes(view.shown.dim_track, DIM_TRACK)
    canvas.boxes(view.shown.dim_truth, DIM_TRUTH)
    for role, forecast in view.forecasts:
        _draw_forecast(canvas, forecast, ROLES[role], role == "now")
    _draw_ways(view)
    _draw_boxes(view)
    if view.gap is not None:
        canvas.stroke(canvas.pixels(view.gap), BLACK, 1.2, dashed=True)
    if view.ringed:
        canvas.ring(view.center, view.radius)
    image = canvas.finished()
    write_names(view, ImageDraw.Draw(image))
    return image


def _draw_forecast(canvas: Canvas, forecast: Forecast, color: Color, newest: bool) -> None:
    """The sample nearest to the truth bold, with a dot at its end, the others thin; of an old one it alone, dashed."""
    for path in forecast.path if newest else ():
        canvas.lines([np.concatenate([forecast.start[None], path])], color, 1.0, 70)
    nearest = canvas.pixels(forecast.nearest_path)
    canvas.stroke(nearest, color, 3.0 if newest else 2.0, dashed=not newest)
    canvas.dot(nearest[-1], 5.0 if newest else 3.5, color)


def _draw_ways(view: CloseUp) -> None:
    """Where the tracks and the object were and, but for a small picture, where the object goes."""
    canvas, shown = view.canvas, view.shown
    for track in shown.tracks:
        canvas.lines([track.trail], ROLES[track.role], 2.0, 130)
    canvas.lines([shown.past], ROLES["truth"], 1.5, 150)
    if not view.near and len(shown.future) > 1:
        canvas.lines([shown.future], ROLES["truth"], 4.0)
        canvas.dot(canvas.pixels(shown.future[-1]), 6.0, ROLES["truth"])


def _draw_boxes(view: CloseUp) -> None:
    canvas, shown = view.canvas, view.shown
    canvas.boxes(shown.others, OTHER_OBJECT)
    for track in shown.tracks:
        canvas.boxes(track.box[None], Outline(ROLES[track.role], 1.5, fill=90))
    canvas.boxes(shown.object_box, OBJECT)
    canvas.boxes(shown.detection_box, DETECTED)
    for xy in canvas.pixels(shown.detection_box[:, :2]):
        canvas.dot(xy, 2.0, BLACK)

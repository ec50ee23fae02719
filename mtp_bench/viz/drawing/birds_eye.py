"""Bird's-eye pictures of a scene, for a glance: what is true, what was detected, what the agent said, what went wrong.

Tracks are numbered, false tracks and forecasts red, an event is a ring with its name.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import ImageDraw

from ...types import Bools, Lane
from ..frame_view import EGO_SIZE, FrameView, Said, ego_boxes, event_text, track_text
from ..palette import EGO, FALSE, FORECAST, TRACK
from .camera import Camera
from .canvas import DETECTED, FALSE_DETECTION, FALSE_TRACK, OTHER, TRACK_BOX, TRACKED, UNTRACKED, VEHICLE, Canvas
from .labels import label, scale_bar, sign
from .panel import panel

SIZE = (960, 720)  # pixels
PANEL = 230  # pixels of the width
SAMPLES = 5  # of each forecast, the heaviest
ROAD, CENTER_LINE, BORDER = (240, 240, 240), (205, 205, 205), (150, 150, 150)


def draw_frame(view: FrameView, seen_by: Camera) -> NDArray[np.uint8]:
    """A frame as a picture [height, width, 3] of SIZE."""
    canvas = Canvas.blank(SIZE[0] - PANEL, SIZE[1], seen_by.at(view.scene.ego[view.frame]))
    draw_lanes(canvas, view.scene.lanes)
    _draw_boxes(canvas, view)
    for _, xy in view.judged.marked if view.judged else ():
        canvas.ring(canvas.pixels(xy), _ring(canvas))
    image = canvas.finished()
    ink = ImageDraw.Draw(image)
    _write(canvas, ink, view)
    scale_bar(canvas, ink)
    return np.array(panel(image, view, PANEL), dtype=np.uint8)  # a copy, which can be drawn on


def draw_lanes(canvas: Canvas, lanes: tuple[Lane, ...]) -> None:
    """The road, under everything else."""
    near = [lane for lane in lanes if canvas.meets(np.concatenate([lane.left, lane.right]))]
    for lane in near:
        outline = np.concatenate([lane.left, lane.right[::-1]])
        canvas.draw.polygon([(2 * x, 2 * y) for x, y in canvas.pixels(outline).tolist()], fill=ROAD)
    for lane in near:
        canvas.lines([] if lane.junction else [lane.left, lane.right], BORDER)
        canvas.lines([lane.center], CENTER_LINE, 0.5)


def _draw_boxes(canvas: Canvas, view: FrameView) -> None:
    judged, said = view.judged, view.said
    if said is not None:
        _draw_forecasts(canvas, said, judged.forecast_false if judged else _none(said.object_box))
        canvas.boxes(said.other_box, OTHER)
        false = judged.track_false if judged else _none(said.track_box)
        for trail, wrong in zip(said.trails, false, strict=True):
            canvas.lines([trail], FALSE if wrong else TRACK, 1.0 if wrong else 1.6, 150)
        canvas.boxes(said.track_box[false], FALSE_TRACK)
        canvas.boxes(said.track_box[~false], TRACK_BOX)
    false = judged.detection_false if judged else _none(view.detection_box)
    canvas.boxes(view.detection_box[~false], DETECTED)
    canvas.boxes(view.detection_box[false], FALSE_DETECTION)
    if view.truth_shown:
        tracked = judged.tracked if judged else ~_none(view.truth_box)
        canvas.boxes(view.truth_box[tracked], TRACKED)
        canvas.boxes(view.truth_box[~tracked], UNTRACKED)
    if view.ego is not None:
        canvas.boxes(ego_boxes(view.ego[None]), VEHICLE)


def _none(rows: NDArray[np.floating]) -> Bools:
    """False for each row."""
    return np.zeros(len(rows), dtype=bool)


def _draw_forecasts(canvas: Canvas, said: Said, false: Bools) -> None:
    """The heaviest samples of each object, the lighter the fainter, with a dot where they end."""
    for i in np.flatnonzero(canvas.inside(said.object_box[:, :2], canvas.width / 4)):
        weight = said.forecast_weight[i]
        color, width, most = (FALSE, 0.8, 1) if false[i] else (FORECAST, 1.3, SAMPLES)
        for k in np.argsort(-weight, kind="stable")[:most][::-1]:
            if weight[k] > 0:
                path = canvas.pixels(np.concatenate([said.object_box[i, None, :2], said.forecast[i, k]]))
                alpha = round((0.4 if false[i] else 0.9) * (100 + 140 * float(weight[k] / weight.max())))
                canvas.stroke(path, color, width, alpha)
                canvas.dot(path[-1], 1.6 * width, color, alpha)


def _ring(canvas: Canvas) -> float:
    """Radius in pixels of the ring around an event."""
    return min(max(10.0, 2.5 * canvas.scale), 20.0)


def _write(canvas: Canvas, ink: ImageDraw.ImageDraw, view: FrameView) -> None:
    """Names of what is seen: events first, then the numbers of the tracks, as far as there is room."""
    judged, said = view.judged, view.said
    for incident, xy in judged.marked if judged else ():
        sign(canvas, ink, xy, event_text(incident), _ring(canvas))
    if view.ego is not None:
        label(canvas, ink, view.ego[:2], "ego", EGO, reach=EGO_SIZE[0] / 2)
    if said is None:
        return
    false = judged.track_false if judged else _none(said.track_box)
    for i in np.argsort(false, kind="stable"):
        box = said.track_box[i]
        text = track_text(int(said.track_id[i]), float(said.track_confidence[i]))
        label(canvas, ink, box[:2], text, FALSE if false[i] else TRACK, reach=float(box[4]) / 2)

"""Bird's-eye pictures of a scene, for a glance: what is true, what was detected, what the agent said, what went wrong.

No meaning hangs on colour alone: truth is a bold outline (dashed where it was missed), a detection thin, a track
filled and numbered, whatever is false red and crossed, an event a ring with its name.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import ImageDraw

from ...types import Floats, Lane
from ..frame_view import FrameView, Said, event_text, replay_camera, replay_view
from ..replay import Replay
from .canvas import Canvas
from .labels import label, scale_bar, sign
from .palette import BLACK, DETECTION, EGO, EVENT, FALSE, FORECAST, OTHER_TRACK, TRACK, TRUTH
from .panel import panel

SIZE = (960, 720)
SAMPLES = 5  # of each forecast, the heaviest
PANEL, PANEL_LEAST = 0.24, 200  # share of the width, pixels
LEAST = (600, 400)  # pixels; a smaller picture has no panel
ROAD, CENTER_LINE, BORDER = (240, 240, 240), (205, 205, 205), (150, 150, 150)
EGO_SIZE = (4.6, 1.9)  # m


def picture(replay: Replay, t: int, size: tuple[int, int] = SIZE) -> NDArray[np.uint8]:
    """Frame ``t`` of a scored run as a picture [height, width, 3]; ``size`` is width, height in pixels."""
    return draw_frame(replay_view(replay, t, replay_camera(replay)), size)


def draw_frame(view: FrameView, size: tuple[int, int] = SIZE) -> NDArray[np.uint8]:
    """A frame as a picture [height, width, 3]; ``size`` is width, height in pixels."""
    wide = max(round(PANEL * size[0]), PANEL_LEAST) if size[0] >= LEAST[0] and size[1] >= LEAST[1] else 0
    canvas = Canvas.blank(size[0] - wide, size[1], view.viewport)
    _draw_lanes(canvas, view.lanes)
    _draw_boxes(canvas, view)
    _draw_rings(canvas, view)
    image = canvas.finished()
    ink = ImageDraw.Draw(image)
    _write(canvas, ink, view)
    scale_bar(canvas, ink)
    if wide:
        image = panel(image, view, wide)
    return np.asarray(image, dtype=np.uint8)


def _draw_lanes(canvas: Canvas, lanes: tuple[Lane, ...]) -> None:
    near = [lane for lane in lanes if canvas.meets(np.concatenate([lane.left, lane.right]))]
    for lane in near:
        outline = np.concatenate([lane.left, lane.right[::-1]])
        canvas.draw.polygon([(2 * x, 2 * y) for x, y in canvas.pixels(outline).tolist()], fill=ROAD)
    for lane in near:
        canvas.lines([lane.left, lane.right], BORDER)
        canvas.lines([lane.center], CENTER_LINE, 0.5)


def _draw_boxes(canvas: Canvas, view: FrameView) -> None:
    judged, said = view.judged, view.said
    if said is not None:
        _draw_forecasts(canvas, said, None if judged is None else judged.spurious)
        canvas.boxes(said.other_box, OTHER_TRACK, 0.8, dashed=True)
        wrong = np.zeros(len(said.track_box), dtype=bool) if judged is None else judged.track_false
        for i, trail in enumerate(said.trails):
            canvas.lines([trail], FALSE if wrong[i] else TRACK, 1.0 if wrong[i] else 1.6, 150)
        canvas.boxes(said.track_box[wrong], FALSE, 1.0, fill=25)
        canvas.boxes(said.track_box[~wrong], TRACK, 1.0, fill=95)
    false = np.zeros(len(view.detection_box), dtype=bool) if judged is None else judged.detection_false
    canvas.boxes(view.detection_box[~false], DETECTION, 1.2)
    canvas.boxes(view.detection_box[false], DETECTION, 1.0, crossed=True)
    if view.truth_box is not None:
        missed = np.zeros(len(view.truth_box), dtype=bool) if judged is None else judged.truth_missed
        canvas.boxes(view.truth_box[~missed], TRUTH, 2.0, heading=True)
        canvas.boxes(view.truth_box[missed], TRUTH, 2.0, dashed=True, heading=True)
    if view.ego is not None:
        canvas.boxes(ego_box(view.ego), EGO, 1.5, fill=200, heading=True)


def _draw_forecasts(canvas: Canvas, said: Said, spurious: NDArray[np.bool_] | None) -> None:
    """The heaviest samples of each object, the lighter the fainter, with a dot where they end."""
    for i in np.flatnonzero(canvas.inside(said.object_box[:, :2], canvas.width / 4)):
        false = spurious is not None and bool(spurious[i])
        weight = said.forecast_weight[i]
        color, width, most = (FALSE, 0.8, 1) if false else (FORECAST, 1.3, SAMPLES)
        for k in np.argsort(-weight, kind="stable")[:most][::-1]:
            if weight[k] > 0:
                path = canvas.pixels(np.concatenate([said.object_box[i, None, :2], said.forecast[i, k]]))
                alpha = round((0.4 if false else 0.9) * (100 + 140 * float(weight[k] / weight.max())))
                canvas.stroke(path, color, width, alpha)
                canvas.dot(path[-1], 1.6 * width, color, alpha)


def _draw_rings(canvas: Canvas, view: FrameView) -> None:
    for _, xy in () if view.judged is None else view.judged.marked:
        canvas.ring(canvas.pixels(xy), _ring(canvas) + 1.0, BLACK, 5.0)
        canvas.ring(canvas.pixels(xy), _ring(canvas), EVENT, 3.0)


def _ring(canvas: Canvas) -> float:
    """Radius in pixels of the ring around an event."""
    return min(max(10.0, 2.5 * canvas.scale), 20.0)


def ego_box(ego: Floats) -> Floats:
    """Box [1, 7] that stands for the vehicle with the pose ``ego`` [4]; its true size is not known."""
    x, y, z, yaw = ego
    return np.array([[x, y, z, yaw, *EGO_SIZE, 1.6]])


def _write(canvas: Canvas, ink: ImageDraw.ImageDraw, view: FrameView) -> None:
    """Names of what is seen: events first, then the numbers of the tracks, as far as there is room."""
    judged, said = view.judged, view.said
    if judged is not None:
        for incident, xy in judged.marked:
            sign(canvas, ink, xy, event_text(incident), _ring(canvas))
    if view.ego is not None:
        label(canvas, ink, view.ego[:2], "ego", EGO, reach=EGO_SIZE[0] / 2)
    if said is None:
        return
    wrong = np.zeros(len(said.track_id), dtype=bool) if judged is None else judged.track_false
    for i in np.argsort(wrong, kind="stable"):
        box = said.track_box[i]
        label(canvas, ink, box[:2], str(said.track_id[i]), FALSE if wrong[i] else TRACK, reach=float(box[4]) / 2)

"""Bird's-eye pictures of a scene: truth, detections, the agent's answers, and errors.

Tracks are numbered, false tracks and forecasts red, an event is a ring with its name.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from PIL import ImageDraw

from ...cards import Card
from ...env.live import LiveEpisode
from ...scoring.forecasts import sample_weights
from ...types import Floats, Lane, Rollout, Scene, to_metres
from ..answers import Answers
from ..focus import TRAIL_SECONDS, Window
from ..frame_view import EGO_SIZE, FrameView, ego_boxes, event_text
from ..palette import EGO, FALSE, FORECAST, TRACK, Color
from .canvas import DETECTED, FALSE_DETECTION, FALSE_TRACK, OTHER, TRACK_BOX, TRACKED, UNTRACKED, VEHICLE, Canvas
from .labels import label, scale_bar, sign
from .panel import panel

SIZE = (960, 720)  # pixels
PANEL = 230  # pixels of the width
SAMPLES = 5  # of each forecast, the heaviest
ROAD, CENTER_LINE, BORDER = (240, 240, 240), (205, 205, 205), (150, 150, 150)
SMALLEST, LARGEST = 16.0, 50.0  # m, half of what is shown around a vehicle
MARGIN = 3.0  # m around the objects of a fixed place


@dataclass(frozen=True)
class Camera:
    """A view from above that follows the ego or stays; it never turns, and its size never changes."""

    follows: bool  # the ego
    window: Window  # its x: metres ahead of the ego, if it follows

    def at(self, ego: Floats) -> Window:
        """The window at the ego's pose ``ego`` [4]."""
        if not self.follows:
            return self.window
        x, y, yaw = float(ego[0]), float(ego[1]), float(ego[3])
        return replace(self.window, x=x + self.window.x * np.cos(yaw), y=y + self.window.x * np.sin(yaw))


def camera(scene: Scene, card: Card) -> Camera:
    """The camera of a scene, by its detections; by its true boxes if it has no detections."""
    seen = scene.detections if len(scene.detections.box) else scene.truth
    xy = seen.box[:, :2]
    if not card.has_ego:
        places = xy if len(xy) else scene.ego[:, :2]
        low, high = np.quantile(places, 0.01, axis=0) - MARGIN, np.quantile(places, 0.99, axis=0) + MARGIN
        (x, y), (wide, tall) = (low + high) / 2, np.maximum(high - low, 2 * MARGIN)
        return Camera(False, Window(float(x), float(y), float(wide), float(tall)))
    if len(xy) == 0:
        return Camera(True, Window(0.0, 0.0, 2 * SMALLEST, 2 * SMALLEST))
    pose = scene.ego[seen.frame_of_rows]
    gap = xy - pose[:, :2]
    cos, sin = np.cos(pose[:, 3]), np.sin(pose[:, 3])
    ahead, aside = cos * gap[:, 0] + sin * gap[:, 1], cos * gap[:, 1] - sin * gap[:, 0]
    rear, front = (float(value) for value in np.quantile(ahead, [0.05, 0.95]))
    rear, front = min(rear, -5.0), max(front, 5.0)
    half = max((front - rear) / 2, float(np.quantile(np.abs(aside), 0.9)), SMALLEST)
    # if the detections reach too far for one picture, those near the ego matter most
    center = (front + rear) / 2 if half <= LARGEST else np.clip((front + rear) / 2, -LARGEST / 2, LARGEST / 2)
    half = min(half, LARGEST)
    return Camera(True, Window(float(center), 0.0, 2 * half, 2 * half))


def draw_frame(view: FrameView, seen_by: Camera) -> NDArray[np.uint8]:
    """A frame as a picture [height, width, 3] of SIZE."""
    canvas = Canvas.blank(SIZE[0] - PANEL, SIZE[1], seen_by.at(view.scene.ego[view.frame]))
    ring = min(max(10.0, 2.5 * canvas.scale), 20.0)  # pixels
    draw_lanes(canvas, view.scene.lanes)
    names = [] if view.answers is None else _draw_answers(canvas, view, view.answers)
    _draw_boxes(canvas, view)
    for _, xy in view.marked:
        canvas.ring(canvas.pixels(xy), ring)
    image = canvas.finished()
    ink = ImageDraw.Draw(image)
    for incident, xy in view.marked:  # names are written as far as there is room, events first
        sign(canvas, ink, xy, event_text(incident), ring)
    if view.ego is not None:
        label(canvas, ink, view.ego[:2], "ego", EGO, reach=EGO_SIZE[0] / 2)
    for box, text, color in names:
        label(canvas, ink, box[:2], text, color, reach=float(box[4]) / 2)
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


def _draw_answers(canvas: Canvas, view: FrameView, answers: Answers) -> list[tuple[Floats, str, Color]]:
    """Draw forecasts, trails and tracks; returns the boxes of the tracks with their names, false tracks last."""
    rollout, hypotheses, t = answers.rollout, answers.hypotheses, view.answered
    _draw_forecasts(canvas, view, rollout)
    tracks, best = rollout.tracks.rows(t), int(hypotheses.best[t])
    member, shown = hypotheses.member[tracks].any(axis=1), answers.shown[tracks]
    boxes = rollout.track_box[tracks].astype(np.float64)
    canvas.boxes(boxes[member & ~shown], OTHER)
    rows = tracks.start + np.flatnonzero(shown)
    boxes, false = boxes[shown], view.false("track", rows, len(rows))
    past = answers.past(rows, best, min(t, max(1, round(TRAIL_SECONDS * view.card.task.rate))))
    for row, wrong in zip(past, false, strict=True):
        trail = rollout.track_box[np.unique(row), :2]
        canvas.lines([trail], FALSE if wrong else TRACK, 1.0 if wrong else 1.6, 150)
    canvas.boxes(boxes[false], FALSE_TRACK)
    canvas.boxes(boxes[~false], TRACK_BOX)
    names = []
    for i in np.argsort(false, kind="stable"):
        number, confidence = int(rollout.track_id[rows[i]]), float(answers.track_confidence[rows[i]])
        sure = "" if np.isnan(confidence) or confidence >= 0.995 else f" {100 * confidence:.0f}%"
        names.append((boxes[i], f"{number}{sure}", FALSE if false[i] else TRACK))
    return names


def _draw_forecasts(canvas: Canvas, view: FrameView, rollout: Rollout) -> None:
    """The heaviest samples of each object, lighter ones fainter, each with a dot at its end."""
    objects = rollout.objects.rows(view.answered)
    start = rollout.object_box[objects, :2].astype(np.float64)
    false = view.false("forecast", objects, len(start))
    weights = sample_weights(rollout.forecast_log_weight[objects])
    for i in np.flatnonzero(canvas.inside(start, canvas.width / 4)):
        weight, paths = weights[i], start[i] + to_metres(rollout.forecast[objects.start + i])
        color, width, most = (FALSE, 0.8, 1) if false[i] else (FORECAST, 1.3, SAMPLES)
        for k in np.argsort(-weight, kind="stable")[:most][::-1]:
            if weight[k] > 0:
                path = canvas.pixels(np.concatenate([start[i, None], paths[k]]))
                alpha = round((0.4 if false[i] else 0.9) * (100 + 140 * float(weight[k] / weight.max())))
                canvas.stroke(path, color, width, alpha)
                canvas.dot(path[-1], 1.6 * width, color, alpha)


def _draw_boxes(canvas: Canvas, view: FrameView) -> None:
    """Detections, true boxes and the ego."""
    rows = view.scene.detections.rows(view.frame)
    detections = view.scene.detections.box[rows]
    false = view.false("detection", rows, len(detections))
    canvas.boxes(detections[~false], DETECTED)
    canvas.boxes(detections[false], FALSE_DETECTION)
    if view.truth_shown:
        truth = view.scene.truth.box[view.truth_rows]
        tracked = np.ones(len(truth), dtype=bool)
        if view.replay is not None:
            tracked = view.replay.truth_track[view.truth_rows] >= 0
        canvas.boxes(truth[tracked], TRACKED)
        canvas.boxes(truth[~tracked], UNTRACKED)
    if view.ego is not None:
        canvas.boxes(ego_boxes(view.ego[None]), VEHICLE)


class EpisodePictures:
    """Renderer of an env: pictures of the frame that was answered last; before the first answer, of frame 0."""

    def __init__(self) -> None:
        self._seen_by: tuple[LiveEpisode, Camera] | None = None

    def render(self, episode: LiveEpisode) -> NDArray[np.uint8]:
        """A picture [height, width, 3], always of the same size; true boxes are not compared with the answer."""
        scene, card, t = episode.scene, episode.card, episode.frame
        if self._seen_by is None or self._seen_by[0] is not episode:
            self._seen_by = episode, camera(scene, card)
        rollout = episode.rollout(max(0, t - round(TRAIL_SECONDS * card.task.rate)))
        answers = None if rollout is None else Answers(rollout, card)
        answered = 0 if rollout is None else rollout.frames - 1
        view = FrameView(scene, card, t, answers, answered, truth_shown=episode.truth_shown)
        return draw_frame(view, self._seen_by[1])

    def close(self) -> None:
        """Do nothing: pictures keep no resource open."""

"""Entities of a recording: boxes and polylines over frames, the map, the sensor platform, tracks and forecasts."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ...cards import Card
from ...types import Bools, Ints, Scene
from ..answers import Answers
from . import arrays as arrays
from .arrays import Boxes, Strips, at_frame
from .colors import BORDER, CENTER, packed
from .sdk import rr

TRAIL, FUTURE, FORECAST, EDGE = 0.14, 0.09, 0.035, 0.05  # m, half the width of lines
TRACK_FILL = "transparentfillmajorwireframe"


@dataclass(frozen=True, eq=False)
class Log:
    """Where entities go."""

    recording: rr.RecordingStream
    times: list[rr.TimeColumn]  # of the frames that are logged
    root: str = ""  # prefix of the paths
    only: int | None = None  # the one frame of the arrays that is logged; None: all

    def boxes(self, path: str, boxes: Boxes, fill: Any = "majorwireframe", radius: float = EDGE) -> None:
        """Boxes of the frames; a frame without any shows none."""
        boxes = boxes if self.only is None else at_frame(boxes, self.only)
        style = rr.Boxes3D.from_fields(fill_mode=fill, radii=radius, show_labels=False)
        columns = rr.Boxes3D.columns(
            centers=boxes.box[:, :3],
            half_sizes=boxes.box[:, 4:7] / 2,
            quaternions=Rotation.from_euler("z", boxes.box[:, 3:4]).as_quat(),
            colors=packed(boxes.color),
            labels=boxes.label or None,
        )
        self.columns(path, style, columns.partition(boxes.counts))

    def strips(self, path: str, strips: Strips, radius: float) -> None:
        """Polylines of the frames; a frame without any shows none."""
        strips = strips if self.only is None else at_frame(strips, self.only)
        style = rr.LineStrips3D.from_fields(radii=radius, show_labels=False)
        columns = rr.LineStrips3D.columns(strips=strips.point, colors=packed(strips.color), labels=strips.label or None)
        self.columns(path, style, columns.partition(strips.counts))

    def columns(self, path: str, style: Any, columns: Any) -> None:
        """Values of the frames, and what is the same in all of them."""
        self.recording.log(self.root + path, style, static=True)
        self.recording.send_columns(self.root + path, self.times, columns)


def frame_times(scene: Scene, frames: Ints | None = None) -> list[rr.TimeColumn]:
    """Both timelines at ``frames``, by default all: numbers of frames, and seconds since the first."""
    frames = np.arange(scene.frames) if frames is None else frames
    seconds = (scene.time - scene.time[0])[frames]
    return [
        rr.TimeColumn("frame", sequence=frames),
        rr.TimeColumn("time", duration=np.rint(seconds * 1e9).astype("timedelta64[ns]")),
    ]


def log_map(recording: rr.RecordingStream, scene: Scene, root: str = "") -> None:
    """What does not move."""
    recording.log(f"{root}world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for name, color in (("center", CENTER), ("border", BORDER)):
        lines = arrays.map_lines(scene, border=name == "border")
        if lines:
            recording.log(f"{root}world/map/{name}", rr.LineStrips3D(lines, colors=color, radii=EDGE), static=True)


def log_scene(log: Log, scene: Scene, card: Card, false: Bools | None = None, truth_shown: bool = True) -> None:
    """What is the same for every agent: sensors, truth and detections, of which some are ``false`` positives [D].

    ``log``: the recording and its times; ``scene``: what is logged; ``card`` says whether a vehicle carries the
    sensors. Without ``truth_shown`` the truth is left out. A frame moves along with the sensors without turning, for
    views.
    """
    if card.has_ego:
        log.boxes("world/ego", arrays.platform_boxes(scene.ego), "solid")
        place = scene.ego[:, :3] if log.only is None else scene.ego[log.only, None, :3]
        columns = rr.Transform3D.columns(translation=place.astype(np.float32))
        log.recording.send_columns(f"{log.root}world/follow", log.times, columns)
    if truth_shown:
        log.boxes("world/gt", arrays.truth_boxes(scene.truth), radius=2 * EDGE)
        log.strips("world/gt_future", arrays.true_futures(scene.truth, card.task.future), FUTURE)
    false = np.zeros(len(scene.detections.box), dtype=bool) if false is None else false
    log.boxes("world/det", arrays.detection_boxes(scene.detections, false))


def log_answers(log: Log, said: Answers, hypotheses: Iterable[int], level: str, false: Bools | None = None) -> None:
    """Tracks and trails of these hypotheses; and forecasts, where the ``level`` shows them.

    The ``false`` ones [O], of nothing, have an entity of their own, so that they can be hidden.
    """
    for h in hypotheses:
        log.boxes(f"world/hyp/{h:02d}/box", arrays.hypothesis_boxes(said, h), TRACK_FILL)
        log.strips(f"world/hyp/{h:02d}/trail", arrays.trails(said, h), TRAIL)
    if level in ("top", "all"):
        false = np.zeros(len(said.rollout.object_box), dtype=bool) if false is None else false
        log.strips("world/forecast", arrays.forecasts(said, level, ~false), FORECAST)
        if false.any():
            log.strips("world/false_forecast/path", arrays.forecasts(said, level, false), FORECAST)

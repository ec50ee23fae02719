"""Entities of a recording: boxes and polylines over frames, the map, the sensor platform, tracks and forecasts."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ...core import Bools, Floats, Ints, Scene, Truth, starts_of, to_metres
from ...scoring import history, separated_truth
from ..framing import arrows_of
from ..palette import FALSE, Color
from ..plan import plan_at
from ..run_replay import Replay, ego_boxes
from .sdk import rr
from .shown import (
    BORDER,
    CENTER,
    DETECTION,
    EGO,
    NEUTRAL,
    TRUTH,
    Colors,
    drawable,
    object_names,
    packed,
    track_colors,
)

TRAIL, FUTURE, FORECAST, EDGE, PLAN = (
    0.14,
    0.09,
    0.035,
    0.05,
    0.2,
)  # m, half the width of lines
TRACK_FILL = "transparentfillmajorwireframe"
TRAIL_POINTS = 12
TRAIL_RATE = 5.0  # Hz, at most: a longer trail of faster recordings has no more points
TOP_SAMPLES = 3
EVENT = "event"  # timeline with the frames around an event alone
Labels = Sequence[str] | None


@dataclass(frozen=True, eq=False)
class Log:
    """Target of entities: a recording, the frames and timelines that are logged, and the prefix of the paths.

    The rows of an entity are those of all frames from ``first`` on, which has those from ``start[0]`` to ``start[1]``.
    """

    recording: rr.RecordingStream
    scene: Scene
    frames: range  # that are logged
    root: str = ""  # prefix of the paths
    seconds: tuple[str, ...] = (
        "time",
    )  # timelines that have the seconds since frame 0; beside them "frame"
    first: int = 0

    def boxes(
        self,
        path: str,
        start: Ints,
        box: Floats,
        color: Colors,
        labels: Labels = None,
        fill: Any = "majorwireframe",
        radius: float = EDGE,
    ) -> None:
        """Boxes [R, 7] with colours [R, 3] and labels [R]; a frame without any shows none."""
        rows, counts = self._rows(start)
        box = np.ascontiguousarray(box[rows], dtype=np.float32)
        columns = rr.Boxes3D.columns(
            centers=box[:, :3],
            half_sizes=box[:, 4:7] / 2,
            quaternions=Rotation.from_euler("z", box[:, 3:4]).as_quat(),
            colors=packed(color[rows]),
            labels=(labels and labels[rows]) or None,
        )
        style = rr.Boxes3D.from_fields(fill_mode=fill, radii=radius, show_labels=False)
        self.columns(path, style, columns.partition(counts))

    def strips(
        self,
        path: str,
        start: Ints,
        point: Floats,
        color: Colors,
        radius: float,
        labels: Labels = None,
    ) -> None:
        """Polylines [R, points, 3] with colours [R, 3] and labels [R]; a frame without any shows none."""
        rows, counts = self._rows(start)
        point = np.ascontiguousarray(point[rows], dtype=np.float32)
        labels = (labels and labels[rows]) or None
        columns = rr.LineStrips3D.columns(
            strips=point, colors=packed(color[rows]), labels=labels
        )
        style = rr.LineStrips3D.from_fields(radii=radius, show_labels=False)
        self.columns(path, style, columns.partition(counts))

    def names(
        self,
        path: str,
        start: Ints,
        place: Floats,
        color: Colors,
        labels: Labels,
        size: float,
    ) -> None:
        """Names [R] at places [R, 3] with colours [R, 3], which are made lighter; dots of ``size`` points."""
        rows, counts = self._rows(start)
        # a viewer writes names on a dark ground, or on grey
        pale = np.uint8(255) - (0.36 * (255 - color[rows].astype(np.float64))).astype(
            np.uint8
        )
        labels = [drawable(label) for label in labels[rows]] if labels else None
        columns = rr.Points3D.columns(
            positions=place[rows], colors=packed(pale), labels=labels or None
        )
        style = rr.Points3D.from_fields(
            radii=rr.Radius.ui_points(size), show_labels=True
        )
        self.columns(path, style, columns.partition(counts))

    def columns(
        self, path: str, style: Any, columns: Any, frames: Sequence[int] | None = None
    ) -> None:
        """Values of ``frames``, by default all that are logged, and the style of all of them."""
        frame = np.array(self.frames if frames is None else frames, dtype=np.int64)
        duration = np.rint((self.scene.time - self.scene.time[0])[frame] * 1e9).astype(
            "timedelta64[ns]"
        )
        times = [rr.TimeColumn(name, duration=duration) for name in self.seconds]
        if self.seconds != (EVENT,):  # whose frames are logged for the second time
            times.append(rr.TimeColumn("frame", sequence=frame))
            if style is not None:
                self.recording.log(self.root + path, style, static=True)
        self.recording.send_columns(self.root + path, times, columns)

    def _rows(self, start: Ints) -> tuple[slice, Ints]:
        """The rows that are logged, and their number in each frame."""
        start = start[
            self.frames.start - self.first : self.frames.stop + 1 - self.first
        ]
        return slice(int(start[0]), int(start[-1])), np.diff(start)


def log_map(recording: rr.RecordingStream, run: Replay, root: str = "") -> None:
    """Log the coordinates and the road, which do not move; with the directions of lanes where agents see these."""
    scene = run.scene
    recording.log(f"{root}world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    boxes = scene.detections.box  # not the true ones, which an evaluation does not show
    ground = float(np.median(boxes[:, 2] - boxes[:, 6] / 2)) if len(boxes) else 0.0
    borders = [
        line
        for lane in scene.lanes
        if not lane.junction
        for line in (lane.left, lane.right)
    ]
    arrows = [] if run.card.lanes is None else [*arrows_of(scene.lanes)]
    centers = [lane.center for lane in scene.lanes]
    for name, color, lines in (
        ("center", CENTER, centers),
        ("border", BORDER, borders),
        ("direction", BORDER, arrows),
    ):
        strips = [
            np.column_stack([line, np.full(len(line), ground)]).astype(np.float32)
            for line in lines
        ]
        if strips:
            recording.log(
                f"{root}world/map/{name}",
                rr.LineStrips3D(strips, colors=color, radii=EDGE),
                static=True,
            )


def log_scene(log: Log, run: Replay) -> None:
    """Log the content that all agents share: sensors, truth and detections, false positives in red.

    ``world/follow`` is a frame of reference that moves along with the sensors without turning, for views.
    """
    scene, truth, detections = run.scene, run.scene.truth, run.scene.detections
    if run.card.has_ego:
        log.boxes(
            "world/ego",
            np.arange(scene.frames + 1),
            ego_boxes(scene.ego),
            _all(EGO, scene.frames),
            fill="solid",
        )
        log.columns(
            "world/follow",
            None,
            rr.Transform3D.columns(translation=np.float32(scene.ego[log.frames, :3])),
        )
    if len(truth.box):
        names, colors = object_names(run), _either(truth.neutral, NEUTRAL, TRUTH)
        labels = [names[object_id] for object_id in truth.object_id.tolist()]
        log.boxes("world/gt", truth.start, truth.box, colors, labels, radius=2 * EDGE)
        start, point = true_futures(
            separated_truth(scene, run.card), run.card.task.future
        )
        log.strips("world/gt_future", start, point, _all(TRUTH, len(point)), FUTURE)
    log.boxes(
        "world/det",
        detections.start,
        detections.box,
        _either(run.detection_false, FALSE, DETECTION),
    )


def log_plan(log: Log, run: Replay) -> None:
    """Log the plans of the ego of a closed loop, red where it brakes hard, and the object that slows it."""
    plans = [
        plan
        for t in range(run.first, run.frames)
        if (plan := plan_at(run, t)) is not None
    ]
    if not plans:
        return
    step = np.concatenate(
        [np.stack([plan.path[:-1], plan.path[1:]], axis=1) for plan in plans]
    )
    height = np.full((*step.shape[:2], 1), float(np.median(run.scene.ego[:, 2])))
    colors = _either(np.concatenate([plan.hard for plan in plans]), FALSE, EGO)
    every = np.arange(len(plans) + 1) * len(plans[0].hard)
    log.strips(
        "world/plan", every, np.concatenate([step, height], axis=-1), colors, PLAN
    )
    slower, start = (
        np.concatenate([plan.slower for plan in plans]),
        starts_of([len(plan.slower) for plan in plans]),
    )
    log.boxes(
        "world/slower",
        start,
        slower,
        _all(FALSE, len(slower)),
        ["slows the ego"] * len(slower),
        radius=3 * EDGE,
    )


def true_futures(truth: Truth, future: int) -> tuple[Ints, NDArray[np.float32]]:
    """Start [F + 1] and points [R, future + 1, 3] of the evaluated objects' ways within the horizon, up to a gap.

    ``truth``: objects have another identity after a hole in time.
    """
    before = history(truth.frame_of_rows, truth.object_id).previous()
    after = np.arange(len(before))  # a row without a successor follows itself
    after[before[before >= 0]] = np.flatnonzero(before >= 0)
    evaluated = np.flatnonzero(~truth.neutral)
    row = evaluated
    point = np.empty((len(row), future + 1, 3), dtype=np.float32)
    for k in range(future + 1):
        point[:, k] = truth.box[row, :3]
        row = after[row]
    return np.searchsorted(evaluated, truth.start), point


def log_answers(log: Log, run: Replay, hypotheses: Iterable[int], level: str) -> None:
    """Log tracks and trails of these hypotheses, and forecasts if the ``level`` shows them.

    False forecasts have an entity of their own, so that they can be hidden.
    """
    rollout, answers = run.rollout, run.answers
    log_plan(log, run)
    for h in hypotheses:
        rows = np.flatnonzero(answers.hypotheses.member[:, h])
        start, ids = np.searchsorted(rows, rollout.track_start), rollout.track_id[rows]
        box, colors = rollout.track_box[rows], track_colors(ids)
        log.boxes(f"world/hyp/{h:02d}/box", start, box, colors, fill=TRACK_FILL)
        log.names(
            f"world/hyp/{h:02d}/name",
            start,
            box[:, :3],
            colors,
            ids.astype(str).tolist(),
            1.0,
        )
        past = answers.past(rows, h, trail_frames(run.card.task.rate))[
            :, :: _stride(run.card.task.rate)
        ]
        log.strips(
            f"world/hyp/{h:02d}/trail",
            start,
            rollout.track_box[past, :3],
            colors,
            TRAIL,
        )
    if level != "tracks":
        _log_forecasts(log, "world/forecast", run, level, ~run.forecast_false)
        if run.forecast_false.any():
            _log_forecasts(log, "world/false_forecast", run, level, run.forecast_false)


def _log_forecasts(log: Log, path: str, run: Replay, level: str, chosen: Bools) -> None:
    """Log forecast samples of the ``chosen`` objects [O], in the colour of the object's track: all, or the heaviest."""
    rollout = run.rollout
    weight = rollout.forecast_log_weight
    stated = np.isfinite(weight) & chosen[:, None]
    if level != "all":
        rank = np.argsort(
            np.argsort(-weight, axis=1, kind="stable"), axis=1, kind="stable"
        )
        stated &= rank < TOP_SAMPLES
    row, sample = np.nonzero(stated)
    point = np.repeat(
        rollout.object_box[row, None, :3].astype(np.float64),
        rollout.forecast.shape[2] + 1,
        axis=1,
    )
    point[:, 1:, :2] += to_metres(rollout.forecast[row, sample])
    labels = [f"confidence {value:.2f}" for value in rollout.object_confidence[row]]
    start = np.searchsorted(row, rollout.object_start)
    log.strips(
        path,
        start,
        point,
        track_colors(run.answers.object_track_id[row]),
        FORECAST,
        labels,
    )


def trail_frames(rate: float) -> int:
    """Number of frames that a trail reaches back."""
    return (TRAIL_POINTS - 1) * _stride(rate)


def _stride(rate: float) -> int:
    return max(1, round(rate / TRAIL_RATE))


def _either(mask: Bools, yes: Color, no: Color) -> Colors:
    return np.where(mask[:, None], yes, no).astype(np.uint8)


def _all(color: Color, count: int) -> Colors:
    return np.full((count, 3), color, dtype=np.uint8)

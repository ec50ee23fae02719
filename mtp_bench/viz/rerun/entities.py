"""Entities of a recording: boxes and polylines over frames, map, tracks, forecasts."""

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
from ..run_replay import Replay
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
    track_colors,
)

# m, half the width of lines
TRAIL_M = 0.14
FUTURE_M = 0.09
FORECAST_M = 0.035
EDGE_M = 0.05
PLAN_M = 0.2
TRACK_FILL = "transparentfillmajorwireframe"
TRAIL_POINTS = 12
MAX_TRAIL_HZ = 5.0  # a longer trail of faster recordings has no more points
TOP_SAMPLES = 3
PALE_SHARE = 0.36  # of the distance of a colour to white, for names on dark ground
EVENT = "event"  # timeline with the frames around an event alone
Labels = Sequence[str] | None


@dataclass(frozen=True, eq=False)
class Log:
    """Target of entities: a recording, the frames and timelines, a prefix of paths.

    The methods take the rows of all frames from ``first`` on, of which those of
    ``frames`` are logged. Frame ``first`` has the rows from ``row_start[0]`` to
    ``row_start[1]``.
    """

    recording: rr.RecordingStream
    scene: Scene
    frames: range  # that are logged
    root: str = ""  # prefix of the paths
    # name of that of the seconds since frame 0; "time" comes with one of frames
    timeline: str = "time"
    first: int = 0

    def boxes(
        self,
        entity_path: str,
        row_start: Ints,
        box: Floats,
        row_colors: Colors,
        labels: Labels = None,
        fill: Any = "majorwireframe",
        radius: float = EDGE_M,
    ) -> None:
        """Log boxes [R, 7] with colours [R, 3] and labels [R]."""
        rows, counts = self._rows(row_start)
        box = np.ascontiguousarray(box[rows], dtype=np.float32)
        columns = rr.Boxes3D.columns(
            centers=box[:, :3],
            half_sizes=box[:, 4:7] / 2,
            quaternions=Rotation.from_euler("z", box[:, 3:4]).as_quat(),
            colors=row_colors[rows],
            labels=(labels and labels[rows]) or None,
        )
        style = rr.Boxes3D.from_fields(fill_mode=fill, radii=radius, show_labels=False)
        self.columns(entity_path, style, columns.partition(counts))

    def strips(
        self,
        entity_path: str,
        row_start: Ints,
        strip_points: Floats,
        row_colors: Colors,
        radius: float,
        labels: Labels = None,
    ) -> None:
        """Log polylines [R, points, 3] with colours and labels [R]."""
        rows, counts = self._rows(row_start)
        columns = rr.LineStrips3D.columns(
            strips=np.ascontiguousarray(strip_points[rows], dtype=np.float32),
            colors=row_colors[rows],
            labels=(labels and labels[rows]) or None,
        )
        style = rr.LineStrips3D.from_fields(radii=radius, show_labels=False)
        self.columns(entity_path, style, columns.partition(counts))

    def names(
        self,
        entity_path: str,
        row_start: Ints,
        place: Floats,
        row_colors: Colors,
        labels: Sequence[str],
        size: float,
    ) -> None:
        """Log names [R] and dots of ``size`` screen units at places [R, 3].

        Their colours [R, 3] are made lighter: a viewer writes them on dark ground.
        """
        rows, counts = self._rows(row_start)
        pale = 255 - (PALE_SHARE * (255.0 - row_colors[rows])).astype(np.uint8)
        texts = [drawable(label) for label in labels[rows]]
        columns = rr.Points3D.columns(
            positions=place[rows], colors=pale, labels=texts or None
        )
        radii = rr.Radius.ui_points(size)
        style = rr.Points3D.from_fields(radii=radii, show_labels=True)
        self.columns(entity_path, style, columns.partition(counts))

    def columns(
        self,
        entity_path: str,
        style: Any,
        columns: Any,
        frames: Sequence[int] | None = None,
    ) -> None:
        """Log values of ``frames``, by default all, and their style."""
        frame = np.array(self.frames if frames is None else frames, dtype=np.int64)
        seconds = (self.scene.time - self.scene.time[0])[frame]
        duration = np.rint(seconds * 1e9).astype("timedelta64[ns]")
        times = [rr.TimeColumn(self.timeline, duration=duration)]
        if self.timeline != EVENT:  # its frames have been logged by "time" already
            times.append(rr.TimeColumn("frame", sequence=frame))
            if style is not None:
                self.recording.log(self.root + entity_path, style, static=True)
        self.recording.send_columns(self.root + entity_path, times, columns)

    def _rows(self, row_start: Ints) -> tuple[slice, Ints]:
        """Return the logged rows, and their number per frame."""
        first = self.frames.start - self.first
        row_start = row_start[first : self.frames.stop + 1 - self.first]
        return slice(int(row_start[0]), int(row_start[-1])), np.diff(row_start)


def log_map(recording: rr.RecordingStream, replay: Replay, root: str = "") -> None:
    """Log the coordinates and the road, which do not move.

    The directions of lanes are logged where agents see these.
    """
    recording.log(f"{root}world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    # the lower side of detections, as an evaluation does not show true boxes
    boxes = replay.scene.detections.box
    ground = float(np.median(boxes[:, 2] - boxes[:, 6] / 2)) if len(boxes) else 0.0
    lanes = replay.scene.lanes
    borders: list[Floats] = []
    for lane in lanes:
        if not lane.junction:
            borders += [lane.left, lane.right]
    arrows: list[Floats] = []
    if replay.card.lanes is not None:
        arrows = list(arrows_of(lanes))
    centers = [lane.center for lane in lanes]
    for name, row_colors, lines in (
        ("center", CENTER, centers),
        ("border", BORDER, borders),
        ("direction", BORDER, arrows),
    ):
        strips = [np.insert(line, 2, ground, axis=1) for line in lines]
        if strips:
            shape = rr.LineStrips3D(strips, colors=row_colors, radii=EDGE_M)
            recording.log(f"{root}world/map/{name}", shape, static=True)


def log_scene(log: Log, replay: Replay) -> None:
    """Log what all agents share: sensors, truth and detections.

    ``world/follow`` is a frame of reference that moves along with the sensors without
    turning, for views.
    """
    scene = replay.scene
    truth = scene.truth
    if replay.card.has_ego:
        row_colors = _all(EGO, scene.frames)
        row_start: Ints = np.arange(scene.frames + 1)
        log.boxes("world/ego", row_start, replay.ego_boxes, row_colors, fill="solid")
        translation = np.float32(scene.ego[log.frames, :3])
        log.columns(
            "world/follow", None, rr.Transform3D.columns(translation=translation)
        )
    if len(truth.box):
        names = object_names(replay)
        labels = [names[object_id] for object_id in truth.object_id.tolist()]
        row_colors = _either(truth.neutral, NEUTRAL, TRUTH)
        log.boxes(
            "world/gt", truth.start, truth.box, row_colors, labels, radius=2 * EDGE_M
        )
        separated = separated_truth(scene, replay.card)
        row_start, strip_points = true_futures(separated, replay.card.task.future)
        log.strips(
            "world/gt_future",
            row_start,
            strip_points,
            _all(TRUTH, len(strip_points)),
            FUTURE_M,
        )
    detections = scene.detections
    row_colors = _either(replay.detection_false, FALSE, DETECTION)
    log.boxes("world/det", detections.start, detections.box, row_colors)


def log_plan(log: Log, replay: Replay) -> None:
    """Log plans of the ego, and the object that slows it.

    Plans are red where the ego brakes hard.
    """
    frames = range(replay.first, replay.frames)
    plans = [plan for t in frames if (plan := plan_at(replay, t)) is not None]
    if not plans:
        return
    steps = [np.stack([plan.path[:-1], plan.path[1:]], axis=1) for plan in plans]
    step = np.concatenate(steps)
    ground = float(np.median(replay.scene.ego[:, 2]))
    row_start: Ints = np.arange(len(plans) + 1) * len(plans[0].hard)
    row_colors = _either(np.concatenate([plan.hard for plan in plans]), FALSE, EGO)
    log.strips(
        "world/plan", row_start, np.insert(step, 2, ground, axis=2), row_colors, PLAN_M
    )
    slower = np.concatenate([plan.slower for plan in plans])
    row_start = starts_of([len(plan.slower) for plan in plans])
    labels = ["slows the ego"] * len(slower)
    row_colors = _all(FALSE, len(slower))
    log.boxes("world/slower", row_start, slower, row_colors, labels, radius=3 * EDGE_M)


def true_futures(truth: Truth, future: int) -> tuple[Ints, NDArray[np.float32]]:
    """Return the true paths of evaluated objects over ``future`` frames.

    Returns the first path of each frame [F + 1] and the points of all
    [R, future + 1, 3]. Before a gap a path ends, and repeats its last point. In
    ``truth`` objects have another identity after a hole in time.
    """
    previous = history(truth.frame_of_rows, truth.object_id).previous()
    following = np.arange(len(previous))  # a row without a successor follows itself
    following[previous[previous >= 0]] = np.flatnonzero(previous >= 0)
    evaluated = np.flatnonzero(~truth.neutral)
    rows = [evaluated]
    for _ in range(future):
        rows.append(following[rows[-1]])
    strip_points = truth.box[np.stack(rows, axis=1), :3].astype(np.float32)
    return np.searchsorted(evaluated, truth.start), strip_points


def log_answers(
    log: Log, replay: Replay, hypotheses: Iterable[int], is_all: bool
) -> None:
    """Log tracks and trails of hypotheses, and forecasts.

    ``is_all``: all samples, else the heaviest. False forecasts have an entity of their
    own, so that they can be hidden.
    """
    rollout = replay.rollout
    rate_hz = replay.card.task.rate
    log_plan(log, replay)
    for hypothesis in hypotheses:
        entity_path = f"world/hyp/{hypothesis:02d}"
        rows = np.flatnonzero(replay.answers.hypotheses.member[:, hypothesis])
        row_start = np.searchsorted(rows, rollout.track_start)
        track_ids = rollout.track_id[rows]
        names = track_ids.astype(str).tolist()
        box = rollout.track_box[rows]
        row_colors = track_colors(track_ids)
        log.boxes(f"{entity_path}/box", row_start, box, row_colors, fill=TRACK_FILL)
        log.names(f"{entity_path}/name", row_start, box[:, :3], row_colors, names, 1.0)
        past = replay.answers.past(rows, hypothesis, trail_frames(rate_hz))
        trails = rollout.track_box[past[:, :: _stride(rate_hz)], :3]
        log.strips(f"{entity_path}/trail", row_start, trails, row_colors, TRAIL_M)
    is_false = replay.forecast_false
    _log_forecasts(log, "world/forecast", replay, is_all, ~is_false)
    if is_false.any():
        _log_forecasts(log, "world/false_forecast", replay, is_all, is_false)


def _log_forecasts(
    log: Log, entity_path: str, replay: Replay, is_all: bool, chosen: Bools
) -> None:
    """Log all or the heaviest samples of ``chosen`` objects [O].

    They have the colour of the object's track.
    """
    rollout = replay.rollout
    weight = rollout.forecast_log_weight
    is_stated = np.isfinite(weight) & chosen[:, None]
    if not is_all:
        order = np.argsort(-weight, axis=1, kind="stable")
        rank = np.argsort(order, axis=1, kind="stable")
        is_stated &= rank < TOP_SAMPLES
    row, sample = np.nonzero(is_stated)
    steps = to_metres(rollout.forecast[row, sample])
    # the first point is the object itself, and the height does not change
    offset = np.pad(steps, ((0, 0), (1, 0), (0, 1)))
    strip_points = rollout.object_box[row, None, :3].astype(np.float64) + offset
    labels = [f"confidence {value:.2f}" for value in rollout.object_confidence[row]]
    row_start = np.searchsorted(row, rollout.object_start)
    row_colors = track_colors(replay.answers.object_track_id[row])
    log.strips(entity_path, row_start, strip_points, row_colors, FORECAST_M, labels)


def trail_frames(rate_hz: float) -> int:
    """Return the number of frames that a trail reaches back."""
    return (TRAIL_POINTS - 1) * _stride(rate_hz)


def _stride(rate_hz: float) -> int:
    """Return the number of frames from one point of a trail to the next."""
    return max(1, round(rate_hz / MAX_TRAIL_HZ))


def _either(mask: Bools, yes: Color, no: Color) -> Colors:
    return np.where(mask[:, None], yes, no).astype(np.uint8)


def _all(color: Color, count: int) -> Colors:
    return np.full((count, 3), color, dtype=np.uint8)

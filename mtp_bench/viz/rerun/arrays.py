"""What a recording shows of a scene and a run, as dense arrays over all frames; no drawing library here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...cards import Card
from ...scoring.events import history
from ...types import Bools, Detections, Floats, Ints, Rollout, Scene, Truth, to_metres
from ..drawing.palette import FALSE
from .colors import DETECTION, EGO, NEUTRAL, TRUTH, Colors, track_colors

LEVELS = ("off", "tracks", "top", "all")  # of detail, each with what the one before it has
TRAIL_POINTS = 12
TRAIL_RATE = 5.0  # Hz, at most: a longer trail of faster recordings has no more points
TOP_SAMPLES = 3
TOP_HYPOTHESES = 4
EGO_SIZE = (4.5, 1.9, 1.6)  # m, drawn; no source says it


class Said(Protocol):
    """What is drawn of an answer: a scored run has it, and the last frames of an episode while it is played."""

    @property
    def rollout(self) -> Rollout:
        """What was said."""
        ...

    @property
    def card(self) -> Card:
        """The rules."""
        ...

    @property
    def member(self) -> Bools:
        """Tracks of alive hypotheses [N, H]."""
        ...

    @property
    def parent(self) -> Ints:
        """Hypothesis of the frame before [F, H]."""
        ...

    @property
    def object_track(self) -> Ints:
        """Track at the place of each forecast object [O], -1 none."""
        ...


@dataclass(frozen=True, eq=False)
class BoxRows:
    """Boxes over all frames, sorted by frame."""

    count: Ints  # [F] boxes of each frame
    box: NDArray[np.float32]  # [R, 7]
    color: Colors  # [R, 3]
    label: list[str]  # [R], or empty


@dataclass(frozen=True, eq=False)
class Strips:
    """Polylines over all frames, sorted by frame; a shorter one repeats its last point."""

    count: Ints  # [F]
    point: NDArray[np.float32]  # [S, points, 3]
    color: Colors  # [S, 3]


def truth_boxes(truth: Truth) -> BoxRows:
    """True boxes, labelled with their object; those beside the evaluated classes are darker."""
    color = np.where(truth.neutral[:, None], NEUTRAL, TRUTH).astype(np.uint8)
    return BoxRows(np.diff(truth.start), _single(truth.box), color, [str(g) for g in truth.object_id])


def detection_boxes(detections: Detections, false: Bools) -> BoxRows:
    """Detections; those of nothing [D] in another colour."""
    color = np.where(false[:, None], FALSE, DETECTION).astype(np.uint8)
    return BoxRows(np.diff(detections.start), _single(detections.box), color, [])


def ego_boxes(ego: Floats) -> BoxRows:
    """The sensor platform, as a box of a usual car around its poses [F, 4]."""
    box = np.concatenate([ego, np.broadcast_to(EGO_SIZE, (len(ego), 3))], axis=1)
    return BoxRows(np.ones(len(ego), dtype=int), _single(box), np.full((len(ego), 3), EGO, dtype=np.uint8), [])


def shown_hypotheses(said: Said, level: str) -> list[int]:
    """The hypotheses of a level: all, else the few that weigh most over the scene."""
    alive = np.flatnonzero(said.member.any(axis=0))
    if level == "all":
        return [int(h) for h in alive]
    weight = np.exp(said.rollout.hypothesis_log_weight.astype(np.float64))[:, alive].sum(axis=0)
    heaviest = alive[np.argsort(-weight, kind="stable")[:TOP_HYPOTHESES]]
    return sorted(int(h) for h in heaviest)


def hypothesis_boxes(said: Said, hypothesis: int) -> BoxRows:
    """Tracks of one hypothesis, labelled with their id."""
    rollout = said.rollout
    rows = np.flatnonzero(said.member[:, hypothesis])
    ids = rollout.track_id[rows]
    return BoxRows(
        per_frame(rollout.track_start, rows),
        _single(rollout.track_box[rows]),
        track_colors(ids),
        ids.astype(str).tolist(),
    )


def earlier_rows(said: Said) -> Ints:
    """Row [N, H] of each track in the frame before, along the lineage of each hypothesis; -1 none."""
    rollout, member = said.rollout, said.member
    earlier = np.full(member.shape, -1, dtype=np.int64)
    for t in range(1, said.rollout.frames):
        now, past = rollout.tracks.rows(t), rollout.tracks.rows(t - 1)
        i, j = np.nonzero(rollout.track_id[now][:, None] == rollout.track_id[past])
        held = member[now][i] & member[past][j][:, said.parent[t]]
        pair, hypothesis = np.nonzero(held)
        earlier[now.start + i[pair], hypothesis] = past.start + j[pair]
    return earlier


def trails(said: Said, hypothesis: int, earlier: Ints) -> Strips:
    """Where the tracks of a hypothesis were, now first; ``earlier`` [N, H] as `earlier_rows` gives it."""
    rollout = said.rollout
    frame = rollout.tracks.frame_of_rows
    start = row = np.flatnonzero(said.member[:, hypothesis])
    lineage = np.full(len(row), hypothesis)
    stride = _stride(said.card.task.rate)
    point = np.empty((len(row), TRAIL_POINTS, 3), dtype=np.float32)
    for k in range(TRAIL_POINTS):
        point[:, k] = rollout.track_box[row, :3]
        for _ in range(stride):
            past = earlier[row, lineage]
            lineage = np.where(past >= 0, said.parent[frame[row], lineage], lineage)
            row = np.where(past >= 0, past, row)
    return Strips(per_frame(rollout.track_start, start), point, track_colors(rollout.track_id[start]))


def trail_frames(rate: float) -> int:
    """How many frames a trail reaches back."""
    return (TRAIL_POINTS - 1) * _stride(rate)


def _stride(rate: float) -> int:
    return max(1, round(rate / TRAIL_RATE))


def forecasts(said: Said, level: str) -> Strips:
    """Forecast samples, from the object on: all, or the few that weigh most; in the colour of the object's track."""
    rollout = said.rollout
    weight = rollout.forecast_log_weight
    stated = np.isfinite(weight)
    if level != "all":
        rank = np.argsort(np.argsort(-weight, axis=1, kind="stable"), axis=1, kind="stable")
        stated &= rank < TOP_SAMPLES
    row, sample = np.nonzero(stated)
    center = rollout.object_box[row, :3].astype(np.float64)
    future = rollout.forecast.shape[2]
    point = np.repeat(center[:, None], future + 1, axis=1)
    point[:, 1:, :2] += to_metres(rollout.forecast[row, sample])
    color = track_colors(np.append(rollout.track_id, -1)[said.object_track[row]])
    return Strips(per_frame(rollout.object_start, row), _single(point), color)


def true_futures(truth: Truth, future: int) -> Strips:
    """Where the evaluated objects go within the horizon of ``future`` frames, while they are there without a gap."""
    before = history(truth.frame_of_rows, truth.object_id).previous()
    after = np.arange(len(before))  # a row without a successor follows itself
    after[before[before >= 0]] = np.flatnonzero(before >= 0)
    start = row = np.flatnonzero(~truth.neutral)
    point = np.empty((len(row), future + 1, 3), dtype=np.float32)
    for k in range(future + 1):
        point[:, k] = truth.box[row, :3]
        row = after[row]
    return Strips(per_frame(truth.start, start), point, np.full((len(start), 3), TRUTH, dtype=np.uint8))


def map_lines(scene: Scene, border: bool) -> list[NDArray[np.float32]]:
    """Polylines [n, 3] of the road: lane borders, or the middle of lanes; on the ground of the detections."""
    boxes = scene.detections.box  # not the true ones, which an evaluation does not show
    ground = float(np.median(boxes[:, 2] - boxes[:, 6] / 2)) if len(boxes) else 0.0
    lines = [line for lane in scene.lanes for line in ((lane.left, lane.right) if border else (lane.center,))]
    return [_single(np.column_stack([line, np.full(len(line), ground)])) for line in lines]


def per_frame(start: Ints, rows: Ints) -> Ints:
    """Number [F] of ``rows`` in each frame; they are sorted."""
    return np.diff(np.searchsorted(rows, start))


def _single(values: Floats) -> NDArray[np.float32]:
    return np.ascontiguousarray(values, dtype=np.float32)


def frame_of(rows: BoxRows, t: int) -> BoxRows:
    """The boxes of one frame."""
    part = _slice(rows.count, t)
    return BoxRows(rows.count[t][None], rows.box[part], rows.color[part], rows.label[part])


def strips_of(lines: Strips, t: int) -> Strips:
    """The polylines of one frame."""
    part = _slice(lines.count, t)
    return Strips(lines.count[t][None], lines.point[part], lines.color[part])


def _slice(count: Ints, t: int) -> slice:
    end = np.cumsum(count)[t]
    return slice(int(end - count[t]), int(end))


def quaternions(yaw: Floats) -> NDArray[np.float32]:
    """Rotations [R, 4] x y z w about z by ``yaw`` [R]."""
    half = np.asarray(yaw, dtype=np.float64) / 2
    zero = np.zeros(len(half))
    return _single(np.column_stack([zero, zero, np.sin(half), np.cos(half)]))

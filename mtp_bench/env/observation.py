"""Observations of a scene: detections in a local frame of reference, cut to the size of the spaces.

The first ego pose is the origin of the local frame and time starts at zero: neither map nor clock tells the scene.
"""

from dataclasses import dataclass

import numpy as np

from ..agent import COORDINATE_LIMIT, SIZE_LIMIT, padded
from ..cards import Card
from ..core import (
    Bools,
    DataError,
    Detections,
    Floats,
    Ints,
    Observation,
    Ragged,
    Scene,
    Task,
    rotate,
    starts_of,
    transform_boxes,
)
from ..scoring import columns_to_rows, match, near_truth
from .lanes import LaneFeed, make_lane_feed
from .spaces import SCORE_LIMIT, VELOCITY_LIMIT


@dataclass(frozen=True, eq=False)
class LocalFrame:
    """Planar rigid motion from the scene's frame of reference to the frame of the observations."""

    yaw: float
    translation: Floats  # [3] m, applied after the rotation

    @classmethod
    def of(cls, scene: Scene, rng: np.random.Generator | None = None) -> "LocalFrame":
        """The frame with the first ego pose as origin, moved at random if ``rng`` is given."""
        x, y, z, ego_yaw = (float(value) for value in scene.ego[0])
        turn, shift = 0.0, np.zeros(3)
        if rng is not None:
            turn = float(rng.uniform(-np.pi, np.pi))
            shift = rng.uniform(-1.0, 1.0, 3) * np.array([100.0, 100.0, 1.0])
        yaw = turn - ego_yaw
        return cls(yaw, shift - rotate(np.array([x, y, z]), yaw))

    def to_local(self, box: Floats) -> Floats:
        """Boxes [R, 7] of the scene in the local frame."""
        return transform_boxes(box, self.yaw, self.translation)

    def to_scene(self, box: Floats) -> Floats:
        """Boxes [R, 7] of the local frame in the scene's."""
        return transform_boxes(box, -self.yaw, -rotate(self.translation, -self.yaw))


@dataclass(frozen=True, eq=False)
class Feed(Ragged):
    """All observations of a scene."""

    size: int  # D
    box: Floats  # [R, 7]
    velocity: Floats  # [R, 2]
    score: Floats  # [R]
    class_id: Ints  # [R]
    object_id: Ints | None  # [R] unless observe="detections"
    ego: Floats  # [F, 4]
    time: Floats  # [F] s since the first frame
    dt: Floats  # [F] s since the frame before
    dropped: Ints  # [F] rows that were out of range or did not fit
    lanes: LaneFeed | None = None

    def of_class(self, t: int, classes: int) -> Ints:
        """Number of detections of each class [C] in frame ``t``."""
        return np.bincount(self.class_id[self.rows(t)], minlength=classes)

    def observe(self, t: int) -> Observation:
        """Fresh arrays of frame ``t``; after the last frame, no detections at the last frame's time and pose."""
        rows = self.rows(t) if t < self.frames else slice(0, 0)
        now = min(t, self.frames - 1)
        seen: Observation = {
            "detection_box": padded(self.box[rows], self.size, np.float32, 0),
            "detection_velocity": padded(self.velocity[rows], self.size, np.float32, 0),
            "detection_score": padded(self.score[rows], self.size, np.float32, 0),
            "detection_class": padded(self.class_id[rows], self.size, np.int32, -1),
            "detection_valid": (np.arange(self.size) < rows.stop - rows.start).astype(
                np.int8
            ),
            "ego_pose": self.ego[now].astype(np.float32),
            "time": np.array(self.time[now], dtype=np.float64),
            "dt": np.array(self.dt[now], dtype=np.float64),
        }
        if self.object_id is not None:
            seen["detection_id"] = padded(self.object_id[rows], self.size, np.int64, -1)
        return seen if self.lanes is None else {**seen, **self.lanes.observe(now)}


def make_feed(scene: Scene, frame: LocalFrame, task: Task, card: Card) -> Feed:
    """Observations of ``scene`` under ``task`` of ``card``; see `shown_boxes` and `true_ids`."""
    shown, object_id = shown_boxes(scene, task.observe)
    with np.errstate(
        over="ignore", invalid="ignore"
    ):  # inf where float32 overflows is out of range below
        box = frame.to_local(shown.box).astype(np.float32)
        velocity = rotate(shown.velocity, frame.yaw).astype(np.float32)
        score = shown.score.astype(np.float32)
    known = np.asarray(task.velocity & (np.abs(velocity) <= VELOCITY_LIMIT).all(axis=1))
    in_frame = shown.frame_of_rows
    sound = _in_range(box, score, shown.class_id, len(task.classes))
    kept = sound & (_rank(in_frame, np.where(sound, score, -np.inf)) < task.detections)
    if task.observe == "associated":  # of the shown detections alone
        object_id = np.full(len(kept), -1)
        object_id[kept] = true_ids(
            scene, in_frame[kept], shown.box[kept], shown.class_id[kept], card
        )
    count = np.bincount(in_frame[kept], minlength=scene.frames)
    pose = np.concatenate([scene.ego, np.zeros((scene.frames, 3))], axis=1)
    time = scene.time - scene.time[0]
    return Feed(
        start=starts_of(count),
        size=task.detections,
        box=box[kept],
        velocity=np.where(known[:, None], velocity, np.float32(0))[kept],
        score=score[kept],
        class_id=shown.class_id[kept],
        object_id=None if object_id is None else object_id[kept],
        ego=frame.to_local(pose)[:, :4].astype(np.float32),
        time=time,
        dt=np.diff(time, prepend=-task.dt),
        dropped=shown.counts - count,
        lanes=None
        if card.lanes is None
        else make_lane_feed(scene, frame.yaw, frame.translation[:2], card.lanes),
    )


def shown_boxes(scene: Scene, observe: str) -> tuple[Detections, Ints | None]:
    """The boxes of a scene that an agent is shown, and their ids or None.

    ``observe``: "detections" or "associated", "truth" for the true boxes, or "tracks" for those of a foreign tracker.
    Raises DataError for a scene without stored tracks.
    """
    if observe in ("detections", "associated"):
        return scene.detections, None
    if observe == "truth":
        return true_detections(scene)
    if scene.tracks is None:
        raise DataError(
            f"scene {scene.name!r} has no stored tracks: name them with --tracks or tracks="
        )
    return scene.tracks, scene.tracks.object_id


def true_detections(scene: Scene) -> tuple[Detections, Ints]:
    """True boxes of the evaluated classes as detections, and their ids."""
    shown = scene.truth.select(~scene.truth.neutral)
    score = np.ones(len(shown.box))
    return Detections(
        shown.start, shown.box, shown.velocity, shown.class_id, score
    ), shown.object_id


def true_ids(
    scene: Scene, frame: Ints, box: Floats, class_id: Ints, card: Card
) -> Ints:
    """The true object [n] that each detection is matched to, -1 for none.

    ``frame`` [n], ``box`` [n, 7] in the scene's frame of reference and ``class_id`` [n] of the detections, by frame.
    They are matched one-to-one to all true boxes, neutral ones too, inside the forecast gate.
    """
    truth = scene.truth
    matched = match(near_truth(truth, frame, box, class_id, card), len(truth.box))
    row = columns_to_rows(matched, len(frame))
    return np.append(truth.object_id, -1)[row]


def _in_range(box: Floats, score: Floats, class_id: Ints, classes: int) -> Bools:
    """Mask [R] of the rows inside the observation space; False for NaN."""
    ok = (np.abs(box[:, :4]) <= COORDINATE_LIMIT).all(axis=1) & (
        np.abs(score) <= SCORE_LIMIT
    )
    ok &= ((box[:, 4:] >= 0) & (box[:, 4:] <= SIZE_LIMIT)).all(axis=1)
    return ok & (class_id >= 0) & (class_id < classes)


def _rank(in_frame: Ints, score: Floats) -> Ints:
    """Rank [R] of each row in its frame by score, the earlier row first among equals."""
    order = np.lexsort((-score, in_frame))
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    first = np.searchsorted(in_frame, in_frame, side="left")  # rows are sorted by frame
    return rank - first

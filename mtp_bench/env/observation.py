"""Observations of a scene: detections in a local frame of reference, cut to size.

The first ego pose is the origin of the local frame and time starts at zero: neither map
nor clock tells the scene.
"""

from dataclasses import dataclass

import numpy as np

from ..agent import COORDINATE_LIMIT, SIZE_LIMIT, pad_rows
from ..cards import Card
from ..core import (
    UNKNOWN_OBJECT,
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

_MAX_SHIFT = np.array([100.0, 100.0, 1.0])  # m, of the random motion of a local frame


@dataclass(frozen=True, eq=False)
class LocalFrame:
    """Planar rigid motion from the scene's frame of reference to the observations'."""

    yaw: float
    translation: Floats  # [3] m, applied after the rotation

    @classmethod
    def of(cls, scene: Scene, rng: np.random.Generator | None = None) -> "LocalFrame":
        """Return the frame with the first ego pose as origin.

        ``rng``: turn and shift it at random.
        """
        turn = 0.0
        shift = np.zeros(3)
        if rng is not None:
            turn = float(rng.uniform(-np.pi, np.pi))
            shift = rng.uniform(-1.0, 1.0, 3) * _MAX_SHIFT
        yaw = turn - float(scene.ego[0, 3])
        origin = np.array(scene.ego[0, :3], dtype=np.float64)
        return cls(yaw, shift - rotate(origin, yaw))

    def to_local(self, box: Floats) -> Floats:
        """Return boxes [R, 7] of the scene in the local frame."""
        return transform_boxes(box, self.yaw, self.translation)

    def to_scene(self, box: Floats) -> Floats:
        """Return boxes [R, 7] of the local frame in the scene's."""
        return transform_boxes(box, -self.yaw, -rotate(self.translation, -self.yaw))


@dataclass(frozen=True, eq=False)
class Feed(Ragged):
    """All observations of a scene."""

    size: int  # D, rows of an observation
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

    def class_counts(self, t: int, classes: int) -> Ints:
        """Count the detections of each class [C] in frame ``t``."""
        return np.bincount(self.class_id[self.rows(t)], minlength=classes)

    def observe(self, t: int) -> Observation:
        """Return fresh arrays of frame ``t``.

        A frame after the last one has no detections, and the last one's time and pose.
        """
        rows = self.rows(t) if t < self.frames else slice(0, 0)
        last_t = min(t, self.frames - 1)
        valid = np.arange(self.size) < rows.stop - rows.start
        observation: Observation = {
            "detection_box": pad_rows(self.box[rows], self.size, np.float32),
            "detection_velocity": pad_rows(self.velocity[rows], self.size, np.float32),
            "detection_score": pad_rows(self.score[rows], self.size, np.float32),
            "detection_class": pad_rows(self.class_id[rows], self.size, np.int32, -1),
            "detection_valid": valid.astype(np.int8),
            "ego_pose": self.ego[last_t].astype(np.float32),
            "time": np.array(self.time[last_t], dtype=np.float64),
            "dt": np.array(self.dt[last_t], dtype=np.float64),
        }
        if self.object_id is not None:
            ids = pad_rows(self.object_id[rows], self.size, np.int64, -1)
            observation["detection_id"] = ids
        if self.lanes is not None:
            observation |= self.lanes.observe(last_t)
        return observation


def make_feed(scene: Scene, frame: LocalFrame, task: Task, card: Card) -> Feed:
    """Make the observations of ``scene`` under ``task`` of ``card``.

    See `shown_boxes` and `true_ids`.
    """
    shown, object_id = shown_boxes(scene, task.observe)
    # inf where float32 overflows is out of range below
    with np.errstate(over="ignore", invalid="ignore"):
        box = frame.to_local(shown.box).astype(np.float32)
        velocity = rotate(shown.velocity, frame.yaw).astype(np.float32)
        score = shown.score.astype(np.float32)
    in_frame = shown.frame_of_rows
    sound = _in_range(box, score, shown.class_id, len(task.classes))
    # the detections with the highest scores fit
    rank = _rank_in_frame(in_frame, np.where(sound, score, -np.inf))
    fits = sound & (rank < task.detections)
    if object_id is not None:
        object_id = object_id[fits]
    elif task.observe == "associated":  # of the shown detections alone
        object_id = true_ids(
            scene, in_frame[fits], shown.box[fits], shown.class_id[fits], card
        )
        annotated = np.isin(in_frame[fits], scene.annotated_frames)
        object_id = np.where(annotated, object_id, UNKNOWN_OBJECT)
    count = np.bincount(in_frame[fits], minlength=scene.frames)
    pose = np.concatenate([scene.ego, np.zeros((scene.frames, 3))], axis=1)
    time = scene.time - scene.time[0]
    lanes = None
    if card.lanes is not None:
        lanes = make_lane_feed(scene, frame.yaw, frame.translation[:2], card.lanes)
    return Feed(
        start=starts_of(count),
        size=task.detections,
        box=box[fits],
        velocity=_shown_velocity(velocity, task)[fits],
        score=score[fits],
        class_id=shown.class_id[fits],
        object_id=object_id,
        ego=frame.to_local(pose)[:, :4].astype(np.float32),
        time=time,
        dt=np.diff(time, prepend=-task.dt),  # the first frame has the nominal period
        dropped=shown.counts - count,
        lanes=lanes,
    )


def shown_boxes(scene: Scene, observe: str) -> tuple[Detections, Ints | None]:
    """Return the boxes that an agent is shown, and their ids.

    ``observe``: "truth" for the true boxes, "tracks" for those of a foreign tracker,
    else the detections. Raises DataError for a scene without stored tracks.
    """
    if observe == "truth":
        return true_detections(scene)
    if observe != "tracks":
        return scene.detections, None
    if scene.tracks is None:
        raise DataError(
            f"scene {scene.name!r} has no stored tracks: "
            "name them with --tracks or tracks="
        )
    return scene.tracks, scene.tracks.object_id


def true_detections(scene: Scene) -> tuple[Detections, Ints]:
    """Return true boxes of the evaluated classes as detections, and their ids."""
    shown = scene.truth.select(~scene.truth.neutral)
    score = np.ones(len(shown.box))
    detections = Detections(
        shown.start, shown.box, shown.velocity, shown.class_id, score
    )
    return detections, shown.object_id


def true_ids(
    scene: Scene, frame: Ints, box: Floats, class_id: Ints, card: Card
) -> Ints:
    """Return the true object [n] of each detection, -1 for none.

    ``frame`` [n], ``box`` [n, 7] in the scene's frame of reference and ``class_id`` [n]
    of the detections, by frame. They are matched one-to-one to all true boxes, neutral
    ones too, inside the forecast gate.
    """
    truth = scene.truth
    matches = match(near_truth(truth, frame, box, class_id, card), len(truth.box))
    row = columns_to_rows(matches, len(frame))
    return np.append(truth.object_id, -1)[row]


def _in_range(box: Floats, score: Floats, class_id: Ints, classes: int) -> Bools:
    """Mask the rows [R] inside the observation space.

    False for NaN.
    """
    placed = (np.abs(box[:, :4]) <= COORDINATE_LIMIT).all(axis=1)
    sized = ((box[:, 4:] >= 0) & (box[:, 4:] <= SIZE_LIMIT)).all(axis=1)
    evaluated = (class_id >= 0) & (class_id < classes)
    return placed & sized & evaluated & (np.abs(score) <= SCORE_LIMIT)


def _shown_velocity(velocity: Floats, task: Task) -> Floats:
    """Return measured velocities [R, 2] as they are shown.

    They are 0 where a velocity is not measured, or the task shows none.
    """
    measured = (np.abs(velocity) <= VELOCITY_LIMIT).all(axis=1)
    shown = np.asarray(task.velocity & measured)
    return np.where(shown[:, None], velocity, np.float32(0))


def _rank_in_frame(in_frame: Ints, score: Floats) -> Ints:
    """Rank each row [R] in its frame by score, from 0 for the highest."""
    order = np.lexsort((-score, in_frame))
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    # rows are sorted by frame
    return rank - np.searchsorted(in_frame, in_frame, side="left")

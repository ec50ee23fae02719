"""Labels of tracks: the true object that a track follows, and its future."""

from typing import NamedTuple

import numpy as np

from ..cards import Card
from ..core import Bools, Floats, Ints, Scene
from ..env import Feed, LocalFrame
from ..prediction import TrackWindows
from ..scoring import evaluated, find_targets, neutral_places, pieces

NO_OBJECT = -1  # a track follows no true object
UNKNOWN = -2  # the truth does not tell which object it follows


class TrackLabels(NamedTuple):
    """Truth of n tracks of a frame; positions in the frame of the observations."""

    object_id: Ints  # [n] NO_OBJECT, UNKNOWN
    present: Floats  # [n, 2]
    future: Floats  # [n, T, 2]
    future_known: Bools  # [n, T]
    target: Bools  # [n]


class SceneLabels:
    """Labels of the tracks in a scene, whose observations are ``feed``.

    Here an object is a number: the index of its id among the sorted ids of the scene.
    """

    def __init__(self, scene: Scene, card: Card, local: LocalFrame, feed: Feed) -> None:
        self._scene = evaluated(scene)
        self._local = local
        truth = self._scene.truth
        future = card.task.future
        self._future = future
        self._gate = np.asarray(card.per_class(card.task.forecast_gate))
        self._ids, self._object = np.unique(truth.object_id, return_inverse=True)
        self._box = local.to_local(truth.box)
        # The last row is of no object.
        shape = (len(self._ids) + 1, scene.frames + future)
        self._place = np.full((*shape, 2), np.nan)
        self._place[self._object, truth.frame_of_rows] = self._box[:, :2]
        # piece of time [F + T]; the frames after the scene lie in none
        self._piece = np.append(pieces(scene, card), np.full(future, -1))
        targets = find_targets(scene, card)
        self._target = np.zeros(shape, dtype=bool)
        self._target[self._object[targets.row], targets.frame] = True
        self._start = feed.start
        self._object_of_detection = self._objects_of_detections(feed)

    def _objects_of_detections(self, feed: Feed) -> Ints:
        """Return the object of each detection, NO_OBJECT or UNKNOWN.

        One more row, UNKNOWN, is for tracks without a detection in their kept past.
        """
        if feed.object_id is not None:
            return np.append(np.searchsorted(self._ids, feed.object_id), UNKNOWN)
        objects = []
        for t in range(feed.frames):
            rows = feed.rows(t)
            objects.append(self._nearest(t, feed.box[rows], feed.class_id[rows]))
        return np.concatenate([*objects, np.array([UNKNOWN])])

    def _nearest(self, t: int, box: Floats, class_id: Ints) -> Ints:
        """Return the object [n] of boxes, NO_OBJECT or UNKNOWN."""
        truth = self._scene.truth
        rows = truth.rows(t)
        label = np.full(len(box), NO_OBJECT if self._scene.truth_complete else UNKNOWN)
        if rows.stop > rows.start and len(box):
            offset = box[:, None, :2] - self._box[None, rows, :2]
            distance_m = np.linalg.norm(offset, axis=-1)
            distance_m[class_id[:, None] != truth.class_id[None, rows]] = np.inf
            column = distance_m.argmin(axis=1)
            in_gate = distance_m[np.arange(len(box)), column] <= self._gate[class_id]
            true_row = rows.start + column[in_gate]
            label[in_gate] = np.where(
                truth.neutral[true_row], UNKNOWN, self._object[true_row]
            )
        return label

    def at(self, t: int, windows: TrackWindows) -> TrackLabels:
        """Return the labels of the tracks of frame ``t``.

        A track follows the object of the last detection that it took.
        """
        label = self._followed(t, windows)
        # its object is hidden, or no longer there; rows below 0 read the last row
        is_gone = np.isnan(self._place[np.maximum(label, -1), t, 0])
        label = np.where((label >= 0) & is_gone, UNKNOWN, label)
        unmatched = np.flatnonzero(label == NO_OBJECT)
        xy = self._local.to_scene(windows.box[unmatched, -1])[:, :2]
        is_neutral = neutral_places(
            self._scene, np.full(len(unmatched), t), xy, windows.class_id[unmatched]
        )
        label[unmatched[is_neutral]] = UNKNOWN
        has_object = label >= 0
        object_row = np.where(has_object, label, -1)  # the last row is of no object
        ahead = slice(t + 1, t + self._future + 1)
        same_piece = self._piece[ahead] == self._piece[t]
        future = np.where(same_piece[:, None], self._place[object_row, ahead], np.nan)
        return TrackLabels(
            # the appended 0 is replaced
            object_id=np.where(has_object, np.append(self._ids, 0)[object_row], label),
            present=np.nan_to_num(self._place[object_row, t]),
            future=np.nan_to_num(future),
            future_known=~np.isnan(future[:, :, 0]),
            target=has_object & self._target[object_row, t],
        )

    def _followed(self, t: int, windows: TrackWindows) -> Ints:
        """Return the object [n] of the last detection that each track took.

        If a tracker does not state detections, it is the nearest object now.
        """
        if not (windows.detection >= 0).any():
            return self._nearest(t, windows.box[:, -1], windows.class_id)
        # 0 without any detection, as its entry now is negative too
        frames_ago = (windows.detection[:, ::-1] >= 0).argmax(axis=1)
        detection = windows.detection[np.arange(len(windows)), -1 - frames_ago]
        detection_row = self._start[np.maximum(t - frames_ago, 0)] + detection
        return self._object_of_detection[np.where(detection >= 0, detection_row, -1)]

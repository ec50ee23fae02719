"""Labels of tracks: the true object that a track follows, and what that object does next."""

from typing import NamedTuple

import numpy as np

from ..cards import Card
from ..core import Bools, Floats, Ints, Scene
from ..env import Feed, LocalFrame
from ..prediction import TrackWindows
from ..scoring import evaluated, find_targets, neutral_places, pieces

# a track follows no true object; the object is unknown
NO_OBJECT = -1
UNKNOWN = -2


class TrackLabels(NamedTuple):
    """Truth of n tracks of a frame; positions in the frame of the observations."""

    object_id: Ints  # [n] NO_OBJECT, UNKNOWN
    present: Floats  # [n, 2]
    future: Floats  # [n, T, 2]
    future_known: Bools  # [n, T]
    target: Bools  # [n]


class SceneLabels:
    """Labels of a scene, whose observations are ``feed``."""

    def __init__(self, scene: Scene, card: Card, local: LocalFrame, feed: Feed) -> None:
        self._scene = evaluated(scene)
        self._local = local
        truth = self._scene.truth
        self._gate = np.asarray(card.per_class(card.task.forecast_gate))
        self._ids, self._object = np.unique(
            truth.object_id, return_inverse=True
        )  # objects by their place in `_ids`
        self._box = local.to_local(truth.box)
        self._future = card.task.future
        # The last row is of no object.
        self._place = np.full(
            (len(self._ids) + 1, scene.frames + self._future, 2), np.nan
        )
        self._place[self._object, truth.frame_of_rows] = self._box[:, :2]
        self._piece = np.append(
            pieces(scene, card), np.full(self._future, -1)
        )  # [F + T] of time
        targets = find_targets(scene, card)
        self._target = np.zeros(self._place.shape[:2], dtype=bool)
        self._target[self._object[targets.row], targets.frame] = True
        if (
            feed.object_id is not None
        ):  # the last row is of "no detection in the past that is kept"
            known = np.searchsorted(self._ids, feed.object_id)
        else:
            frames = map(feed.rows, range(feed.frames))
            nearest = [
                self._nearest(t, feed.box[rows], feed.class_id[rows])
                for t, rows in enumerate(frames)
            ]
            known = np.concatenate([np.zeros(0, dtype=np.int64), *nearest])
        self._start = feed.start
        self._of_row = np.append(known, UNKNOWN)

    def _nearest(self, t: int, box: Floats, class_id: Ints) -> Ints:
        """The object [n] of boxes in frame ``t``, NO_OBJECT or UNKNOWN."""
        truth = self._scene.truth
        rows = self._scene.truth.rows(t)
        label = np.full(len(box), NO_OBJECT if self._scene.truth_complete else UNKNOWN)
        if rows.stop > rows.start and len(box):
            distance = np.linalg.norm(
                box[:, None, :2] - self._box[None, rows, :2], axis=-1
            )
            distance[class_id[:, None] != truth.class_id[None, rows]] = np.inf
            nearest = distance.argmin(axis=1)
            near = distance[np.arange(len(box)), nearest] <= self._gate[class_id]
            row = rows.start + nearest
            label[near] = np.where(truth.neutral[row], UNKNOWN, self._object[row])[near]
        return label

    def of(self, t: int, windows: TrackWindows) -> TrackLabels:
        """The labels of the tracks of frame ``t``: the object of the last detection that each of them took."""
        follows = self._followed(t, windows)
        gone = np.isnan(
            self._place[np.maximum(follows, -1), t, 0]
        )  # hidden, or no longer there
        follows = np.where((follows >= 0) & gone, UNKNOWN, follows)
        alone = np.flatnonzero(follows == NO_OBJECT)
        xy = self._local.to_scene(windows.box[alone, -1])[:, :2]
        follows[
            alone[
                neutral_places(
                    self._scene, np.full(len(alone), t), xy, windows.class_id[alone]
                )
            ]
        ] = UNKNOWN
        known = follows >= 0
        row = np.where(known, follows, -1)  # the last row is of no object
        place = self._place[row, t : t + self._future + 1]
        future = np.where(
            (self._piece[t + 1 : t + self._future + 1] == self._piece[t])[:, None],
            place[:, 1:],
            np.nan,
        )
        return TrackLabels(
            object_id=np.where(known, np.append(self._ids, 0)[row], follows),
            present=np.nan_to_num(place[:, 0]),
            future=np.nan_to_num(future),
            future_known=~np.isnan(future[:, :, 0]),
            target=known & self._target[row, t],
        )

    def _followed(self, t: int, windows: TrackWindows) -> Ints:
        """The object [n] of the last detection taken; if a tracker does not state detections, the nearest one now."""
        if not (windows.detection >= 0).any():
            return self._nearest(t, windows.box[:, -1], windows.class_id)
        back = (windows.detection[:, ::-1] >= 0).argmax(axis=1)
        row = windows.detection[np.arange(len(windows)), -1 - back]
        return self._of_row[
            np.where(row >= 0, self._start[np.maximum(t - back, 0)] + row, -1)
        ]

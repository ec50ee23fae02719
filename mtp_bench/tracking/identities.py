"""Perfect association: tracks that continue by the true objects of their detections, as the env states them."""

import numpy as np

from ..types import Floats, Ints


class GivenIdentities:
    """True objects of the tracks of one hypothesis: that of the detection which started a track, -1 for none.

    A detection of an object may only continue or start the track of that object, at any distance; a track that
    has ended is not resumed. Detections and tracks without an object are associated as always.
    """

    def __init__(self) -> None:
        self._track: Ints = np.zeros(0, dtype=np.int64)  # [N] object of each leaf
        self._detection: Ints = np.zeros(0, dtype=np.int64)  # [D] object of each detection of this frame

    def observe(self, detection_id: Ints) -> None:
        """Take the objects [D] of the detections of the next frame; none of them occurs twice."""
        self._detection = np.asarray(detection_id, dtype=np.int64)

    def free_pairs(self, indptr: Ints, column: Ints, gain: Floats) -> tuple[Ints, Ints, Floats]:
        """The pairs of tracks and detections that are both without an object; arguments as of `sparse_gains`."""
        track = np.repeat(self._track, np.diff(indptr))
        free = (track < 0) & (self._detection[column] < 0)
        return np.append(0, np.cumsum(free))[indptr], column[free], gain[free]

    def assign(self, column: Ints) -> Ints:
        """The assignment [1, N], where tracks of an object take its detection."""
        same = (self._track[:, None] == self._detection) & (self._detection >= 0)
        assigned = column.copy()
        track, detection = np.nonzero(same)
        assigned[0, track] = detection
        return assigned

    def grow(self, before: Ints, detection: Ints) -> None:
        """Hand the objects on to the new leaves: old leaf (-1: a new track) and detection of each, [N]."""
        started = np.append(self._detection, -1)[detection]
        self._track = np.where(before >= 0, np.append(self._track, -1)[before], started)

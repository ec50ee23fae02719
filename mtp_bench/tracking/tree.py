"""The hypothesis tree: tracks that hypotheses share are stored and filtered once.

A leaf is a distinct track state. Leaves of one frame are a layer; every leaf knows its
parent in the layer before, so that the past of a track is a walk up the tree (paper,
"Multi-Hypothesis Data Association").
"""

from typing import NamedTuple, final

import numpy as np

from ..core import NO_ROWS, Floats, Ints
from .kernels.motion_kernels import STATE, predict, update_pairs
from .kernels.tree_kernels import (
    AGE,
    CLASS,
    HITS,
    ID,
    descend,
    distinct_rows,
    grow,
    histories,
)


class FrameDetections(NamedTuple):
    """The detections of a frame."""

    box: Floats  # [D, 7]
    class_id: Ints  # [D]
    score: Floats  # [D]
    velocity: Floats  # [D, 2] m/s, [0, 2] where velocities are not measured
    row: Ints  # [D] in the observation


@final
class HypothesisTree:
    """Leaves after the last frame, their hypotheses, and layers of ``past`` frames.

    Public arrays belong to the tree and change with the next frame. It begins with one
    hypothesis, which holds no track; ``next_id`` is the identity of the first track.
    """

    def __init__(self, past: int, next_id: int = 0) -> None:
        self._set_leaves(np.zeros((0, STATE)), np.zeros((4, 0), dtype=np.int64))
        self.score_sum = np.zeros(0)  # [N] over the detections taken
        self.last_score = np.zeros(0)  # [N] of the last detection taken
        self.age = NO_ROWS  # [N] frames since the first detection, this one included
        self.detection = NO_ROWS  # [N] taken in the last frame, -1: none
        self.old_leaf = NO_ROWS  # [N] the leaf of the frame before, -1 at birth
        self.member = np.ones((1, 0), dtype=bool)  # [H, N]
        # [H] equal for hypotheses that hold the same leaves
        self._leaf_set: Ints = np.zeros(1, dtype=np.int64)
        self.next_id = next_id
        # the layers are rings: place of the last one, and how many are filled
        self._last_layer = -1
        self._layer_count = 0
        self._measured = np.zeros((past, 0, 7))
        self._detections = np.zeros((past, 0), dtype=np.int64)
        self._parents = np.zeros((past, 0), dtype=np.int64)

    def _set_leaves(self, state: Floats, memory: Ints) -> None:
        """Replace the arrays of all leaves, and the views of their columns.

        ``state`` [N, STATE]: see motion_kernels; ``memory`` [4, N]: see tree_kernels.
        """
        self.state = state
        self._memory = memory
        self.box = state[:, :7]
        self.class_id = memory[CLASS]  # [N]
        self.track_id = memory[ID]  # [N]
        self.hits = memory[HITS]  # [N] detections taken

    def predict(self) -> None:
        """Move all leaves to the next frame."""
        predict(self.state)

    def grow(
        self,
        column: Ints,
        parent: Ints,
        detections: FrameDetections,
        max_age: Ints,
        dt: float,
    ) -> None:
        """Replace the leaves by those of the new hypotheses.

        Args:
            column: [K, N] the detection that each leaf takes in each new hypothesis,
                -1 for none.
            parent: [K] the old hypothesis that a new one comes from.
            detections: of the frame.
            max_age: [N] a track ends after so many frames without a detection.
            dt: seconds since the frame before.
        """
        leaf, detection, self.member, self._leaf_set = grow(
            column,
            parent,
            self.member,
            self._memory[AGE],
            max_age,
            len(detections.box),
        )
        leaf_count = len(leaf)
        layer = self._new_layer(leaf_count)
        state = np.empty((leaf_count, STATE))
        memory = np.empty((4, leaf_count), dtype=np.int64)
        score_sum = np.empty(leaf_count)
        update_pairs(
            self.state,
            leaf,
            detection,
            detections.box,
            detections.velocity,
            dt,
            state,
            self._measured[layer],
        )
        self.next_id = descend(
            leaf,
            detection,
            self._memory,
            self.score_sum,
            detections.class_id,
            detections.score,
            self.next_id,
            memory,
            score_sum,
        )
        continued = leaf >= 0
        hit = detection >= 0
        age = np.ones(leaf_count, dtype=np.int64)
        age[continued] += self.age[leaf[continued]]
        last_score = np.zeros(leaf_count)
        last_score[continued] = self.last_score[leaf[continued]]
        last_score[hit] = detections.score[detection[hit]]
        self.age = age
        self.last_score = last_score
        self.score_sum = score_sum
        self.detection = detection
        self.old_leaf = leaf
        # index -1 picks the appended -1
        self._detections[layer, :leaf_count] = np.append(detections.row, -1)[detection]
        self._parents[layer, :leaf_count] = leaf
        self._set_leaves(state, memory)

    def merge_equal(self) -> Ints:
        """Keep the first of the hypotheses that hold the same leaves.

        Returns the old numbers of those that are kept.
        """
        first = distinct_rows(self.member, self._leaf_set)
        if len(first) < len(self.member):
            self.member = self.member.take(first, axis=0)
        return first

    def covariance(self, leaf: Ints) -> Floats:
        """Return covariances [n, 2, 2] of position (m) and velocity (m/frame).

        ``leaf`` [n]: leaves of the tree. Each matrix holds for one axis, and both axes
        have the same. Columns of the state: see motion_kernels.
        """
        return self.state[leaf, 10:14].reshape(-1, 2, 2)

    def history(self, leaf: Ints) -> tuple[Floats, Ints]:
        """Return boxes [n, P, 7] of the last P frames, and the rows taken [n, P].

        The frames lie along the branches that end in ``leaf`` [n]. Where a track took
        no detection the row is -1 and the box that of its state; before its birth the
        row is UNBORN and the box zeros.
        """
        return histories(
            leaf,
            self._measured,
            self._detections,
            self._parents,
            self._last_layer,
            self._layer_count,
        )

    def _new_layer(self, leaf_count: int) -> int:
        """Return the place of a new layer in the rings, made wide enough for it."""
        layers, width = self._parents.shape
        if leaf_count > width:
            added = max(leaf_count, 2 * width) - width
            no_rows = np.full((layers, added), -1)
            no_boxes = np.zeros((layers, added, 7))
            self._measured = np.concatenate([self._measured, no_boxes], axis=1)
            self._detections = np.concatenate([self._detections, no_rows], axis=1)
            self._parents = np.concatenate([self._parents, no_rows], axis=1)
        self._last_layer = (self._last_layer + 1) % layers
        self._layer_count = min(self._layer_count + 1, layers)
        return self._last_layer

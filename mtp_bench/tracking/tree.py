"""The hypothesis tree: tracks shared by hypotheses, stored and filtered once however many hypotheses hold them.

A leaf is a distinct track state. Leaves of one frame are a layer; every leaf knows its parent in the layer before, so
that the past of a track is a walk up the tree (paper, "Multi-Hypothesis Data Association").
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


class Seen(NamedTuple):
    """The detections of a frame."""

    box: Floats  # [D, 7]
    class_id: Ints  # [D]
    score: Floats  # [D]
    velocity: Floats  # [D, 2] m/s, [0, 2] where velocities are not measured
    row: Ints  # [D] in the observation


@final
class HypothesisTree:
    """The leaves after the last frame, the hypotheses that hold them, and the layers of the last ``past`` frames.

    Public arrays belong to the tree and change with the next frame.
    """

    def __init__(self, past: int, next_id: int = 0) -> None:
        """An empty tree with one hypothesis, which holds nothing; ``next_id``: the identity of the first track."""
        self._hold(np.zeros((0, STATE)), np.zeros((4, 0), dtype=np.int64))
        self.score = np.zeros(0)  # [N] sum of the scores of the detections taken
        self.last_score = np.zeros(0)  # [N] of the last detection taken
        self.age = NO_ROWS  # [N] frames since the first detection, this one included
        self.detection = NO_ROWS  # taken in the last frame, -1: none
        self.before = NO_ROWS  # [N] the leaf of the frame before, -1 at birth
        self.member = np.ones((1, 0), dtype=bool)  # [H, N]
        self._name: Ints = np.zeros(
            1, dtype=np.int64
        )  # [H] equal for hypotheses that hold the same leaves
        self.next_id = next_id
        self._last, self._filled = (
            -1,
            0,
        )  # place of the last layer in the rings, and layers in them
        self._measured = np.zeros((past, 0, 7))
        self._detections = np.zeros((past, 0), dtype=np.int64)
        self._parents = np.zeros((past, 0), dtype=np.int64)

    def _hold(self, state: Floats, memory: Ints) -> None:
        """Take ``state`` [N, STATE], see motion_kernels, and ``memory`` [4, N], see tree_kernels, of all leaves."""
        self.state, self._memory = state, memory
        self.box = state[:, :7]
        self.class_id, self.track_id, self.hits = (
            memory[CLASS],
            memory[ID],
            memory[HITS],
        )  # [N], detections taken

    def predict(self) -> None:
        """Move all leaves one frame on."""
        predict(self.state)

    def grow(
        self, column: Ints, parent: Ints, seen: Seen, max_age: Ints, dt: float
    ) -> None:
        """Replace the leaves by those of the new hypotheses.

        ``column`` [K, N]: the detection that each leaf takes in each new hypothesis, -1 for none; ``parent`` [K]: the
        old hypothesis that it comes from; ``max_age`` [N]: a track ends after so many frames without a detection.
        ``seen``: the detections of the frame; ``dt``: seconds since the frame before.
        """
        leaf, detection, self.member, self._name = grow(
            column, parent, self.member, self._memory[AGE], max_age, len(seen.box)
        )
        n, layer = len(leaf), self._new_layer(len(leaf))
        state, memory, score = (
            np.empty((n, STATE)),
            np.empty((4, n), dtype=np.int64),
            np.empty(n),
        )
        update_pairs(
            self.state,
            leaf,
            detection,
            seen.box,
            seen.velocity,
            dt,
            state,
            self._measured[layer],
        )
        self.next_id = descend(
            leaf,
            detection,
            self._memory,
            self.score,
            seen.class_id,
            seen.score,
            self.next_id,
            memory,
            score,
        )
        old, taken = leaf >= 0, detection >= 0
        age, last_score = np.ones(n, dtype=np.int64), np.zeros(n)
        age[old] += self.age[leaf[old]]
        last_score[old] = self.last_score[leaf[old]]
        last_score[taken] = seen.score[detection[taken]]
        self.age, self.last_score = age, last_score
        self._detections[layer, :n] = np.append(seen.row, -1)[detection]
        self._parents[layer, :n] = self.before = leaf
        self._hold(state, memory)
        self.score, self.detection = score, detection

    def merge_equal(self) -> Ints:
        """Keep the first of the hypotheses that hold the same leaves; their numbers before."""
        kept = distinct_rows(self.member, self._name)
        if len(kept) < len(self.member):
            self.member = self.member.take(kept, axis=0)
        return kept

    def covariance(self, leaf: Ints) -> Floats:
        """Covariances [n, 2, 2] of position (m) and velocity (m/frame) of the leaves [n], per axis."""
        return self.state[leaf, 10:14].reshape(-1, 2, 2)

    def history(self, leaf: Ints) -> tuple[Floats, Ints]:
        """Boxes [n, P, 7] of the last P frames along the branches that end in ``leaf`` [n], and the rows taken.

        Where a track took none the row is -1 and the box that of its state; before its birth UNBORN and zeros.
        """
        return histories(
            leaf,
            self._measured,
            self._detections,
            self._parents,
            self._last,
            self._filled,
        )

    def _new_layer(self, leaves: int) -> int:
        """Place of a new layer in the rings, which are made wide enough for it."""
        layers, width = self._parents.shape
        if leaves > width:
            more = max(leaves, 2 * width) - width
            self._measured = np.concatenate(
                [self._measured, np.zeros((layers, more, 7))], axis=1
            )
            self._detections = np.concatenate(
                [self._detections, np.full((layers, more), -1)], axis=1
            )
            self._parents = np.concatenate(
                [self._parents, np.full((layers, more), -1)], axis=1
            )
        self._last = (self._last + 1) % layers
        self._filled = min(self._filled + 1, layers)
        return self._last

"""Answers of an agent on a scene, for all drawings: hypotheses, the lineage of their tracks, and forecasts."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..cards import Card
from ..core import Bools, Ints, Rollout
from ..scoring import Hypotheses, box_pairs, hypotheses, match


@dataclass(frozen=True, eq=False)
class Answers:
    """A whole rollout, or the last frames of an episode, and properties that need no truth."""

    rollout: Rollout
    card: Card

    @cached_property
    def hypotheses(self) -> Hypotheses:
        """The hypotheses of the rollout with their lineage."""
        return hypotheses(self.rollout, self.card)

    @cached_property
    def shown(self) -> Bools:
        """Mask [N] of the tracks in the best hypothesis of their frame."""
        frame = self.rollout.tracks.frame_of_rows
        return self.hypotheses.member[
            np.arange(len(frame)), self.hypotheses.best[frame]
        ]

    @cached_property
    def object_track(self) -> Ints:
        """Track [O] of the best hypothesis nearest to each forecast object inside the forecast gate, -1 without one.

        The matching is one-to-one. An action does not say which track a forecast belongs to: this is only for names.
        """
        rollout, chosen = self.rollout, np.flatnonzero(self.shown)
        objects = (
            rollout.objects.frame_of_rows,
            rollout.object_box,
            rollout.object_class,
        )
        tracks = (
            rollout.tracks.frame_of_rows[chosen],
            rollout.track_box[chosen],
            rollout.track_class[chosen],
        )
        gates = self.card.per_class(self.card.task.forecast_gate)
        pairs = box_pairs(*objects, *tracks, "center_distance", gates)
        return np.append(chosen, -1)[match(pairs, len(rollout.object_box))]

    @property
    def object_track_id(self) -> Ints:
        """Id [O] of that track, -1 without one."""
        return np.append(self.rollout.track_id, -1)[self.object_track]

    @cached_property
    def earlier(self) -> Ints:
        """Row [N, H] of each track in the frame before, along the lineage of each hypothesis; -1 for a new track."""
        rollout, member = self.rollout, self.hypotheses.member
        earlier = np.full(member.shape, -1)
        for t in range(1, rollout.frames):
            now, past = rollout.tracks.rows(t), rollout.tracks.rows(t - 1)
            i, j = np.nonzero(rollout.track_id[now][:, None] == rollout.track_id[past])
            pair, hypothesis = np.nonzero(
                member[now][i] & member[past][j][:, self.hypotheses.parent[t]]
            )
            earlier[now.start + i[pair], hypothesis] = past.start + j[pair]
        return earlier

    def past(self, rows: Ints, hypothesis: int, frames: int) -> Ints:
        """Rows [n, frames + 1] of the tracks ``rows`` [n] of a hypothesis, now and in the frames before.

        A track that did not exist then repeats its first row.
        """
        frame = self.rollout.tracks.frame_of_rows
        past = np.empty((len(rows), frames + 1), dtype=np.int64)
        past[:, 0] = row = rows
        lineage = np.full(len(rows), hypothesis)
        for k in range(1, frames + 1):
            before = self.earlier[row, lineage]
            lineage = np.where(
                before >= 0, self.hypotheses.parent[frame[row], lineage], lineage
            )
            past[:, k] = row = np.where(before >= 0, before, row)
        return past

"""Answers of an agent on a scene: hypotheses, lineages of tracks, and forecasts."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..cards import Card
from ..core import Bools, Ints, Rollout
from ..scoring import Hypotheses, box_pairs, hypotheses, match


@dataclass(frozen=True, eq=False)
class Answers:
    """A rollout, or the last frames of an episode, with what needs no truth."""

    rollout: Rollout
    card: Card

    @cached_property
    def hypotheses(self) -> Hypotheses:
        """The hypotheses of the rollout with their lineage."""
        return hypotheses(self.rollout, self.card)

    @cached_property
    def shown(self) -> Bools:
        """Mask [N] of tracks in the best hypothesis of their frame."""
        frame = self.rollout.tracks.frame_of_rows
        best = self.hypotheses.best[frame]
        return self.hypotheses.member[np.arange(len(frame)), best]

    @cached_property
    def object_track(self) -> Ints:
        """Track [O] of the best hypothesis at each forecast object.

        It is the nearest, -1 without one. It lies inside the forecast gate; the
        matching is one-to-one. An action does not say which track a forecast belongs
        to: this is only for names.
        """
        rollout = self.rollout
        chosen = np.flatnonzero(self.shown)
        pairs = box_pairs(
            rollout.objects.frame_of_rows,
            rollout.object_box,
            rollout.object_class,
            rollout.tracks.frame_of_rows[chosen],
            rollout.track_box[chosen],
            rollout.track_class[chosen],
            "center_distance",
            self.card.per_class(self.card.task.forecast_gate),
        )
        return np.append(chosen, -1)[match(pairs, len(rollout.object_box))]

    @property
    def object_track_id(self) -> Ints:
        """Id [O] of that track, -1 without one."""
        return np.append(self.rollout.track_id, -1)[self.object_track]

    @cached_property
    def earlier(self) -> Ints:
        """Row [N, H] of each track in the frame before.

        It is -1 for a new track. It follows the lineage of each hypothesis.
        """
        rollout = self.rollout
        member = self.hypotheses.member
        earlier = np.full(member.shape, -1)
        for t in range(1, rollout.frames):
            rows = rollout.tracks.rows(t)
            past = rollout.tracks.rows(t - 1)
            same_id = rollout.track_id[rows][:, None] == rollout.track_id[past]
            i, j = np.nonzero(same_id)
            past_member = member[past][j][:, self.hypotheses.parent[t]]
            pair, hypothesis = np.nonzero(member[rows][i] & past_member)
            earlier[rows.start + i[pair], hypothesis] = past.start + j[pair]
        return earlier

    def past(self, rows: Ints, hypothesis: int, frames: int) -> Ints:
        """Return rows of tracks now and in the frames before.

        Their shape is [n, frames + 1]. ``rows`` [n] are those of the tracks of a
        hypothesis. A track that did not exist then repeats its first row.
        """
        frame = self.rollout.tracks.frame_of_rows
        past_rows = [rows]
        lineage = np.full(len(rows), hypothesis)
        for _ in range(frames):
            row = past_rows[-1]
            row_before = self.earlier[row, lineage]
            exists = row_before >= 0
            parent = self.hypotheses.parent[frame[row], lineage]
            lineage = np.where(exists, parent, lineage)
            past_rows.append(np.where(exists, row_before, row))
        return np.stack(past_rows, axis=1)

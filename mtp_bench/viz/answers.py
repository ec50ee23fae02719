"""Answers of an agent on a scene: hypotheses, lineages of tracks, and forecasts."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..cards import Card
from ..core import Bools, Ints, Rollout
from ..scoring import Hypotheses, box_pairs, hypotheses, match


@dataclass(frozen=True, eq=False)
class Answers:
    """A rollout, or the last frames of an episode, and what follows from it alone."""

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
        """Row [O] of the best hypothesis's track at each forecast object.

        It is -1 without a track. Objects and tracks are matched one-to-one by distance,
        inside the forecast gate. An action does not say which track a forecast belongs
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
        # an object without a match, -1, takes the -1 at the end
        return np.append(chosen, -1)[match(pairs, len(rollout.object_box))]

    @property
    def object_track_id(self) -> Ints:
        """Id [O] of the track of `object_track`, -1 without one."""
        return np.append(self.rollout.track_id, -1)[self.object_track]

    @cached_property
    def earlier(self) -> Ints:
        """Row [N, H] of each track in the frame before, by hypothesis.

        The frame before is that of the hypothesis's parent. It is -1 for a new track,
        and for one that the hypothesis does not hold.
        """
        rollout = self.rollout
        member = self.hypotheses.member
        earlier = np.full(member.shape, -1)
        for t in range(1, rollout.frames):
            rows = rollout.tracks.rows(t)
            past = rollout.tracks.rows(t - 1)
            same_id = rollout.track_id[rows][:, None] == rollout.track_id[past]
            now_index, past_index = np.nonzero(same_id)
            in_parent = member[past][past_index][:, self.hypotheses.parent[t]]
            pair, hypothesis = np.nonzero(member[rows][now_index] & in_parent)
            past_rows = past.start + past_index[pair]
            earlier[rows.start + now_index[pair], hypothesis] = past_rows
        return earlier

    def past(self, rows: Ints, hypothesis: int, frames: int) -> Ints:
        """Return rows [n, frames + 1] of tracks, from now back in time.

        ``rows`` [n]: those of tracks of ``hypothesis`` now. ``frames``: number of
        frames to go back. A track that did not exist then repeats its first row.
        """
        frame = self.rollout.tracks.frame_of_rows
        past_rows = [rows]
        lineage = np.full(len(rows), hypothesis)  # hypothesis of each row, back in time
        for _ in range(frames):
            row = past_rows[-1]
            row_before = self.earlier[row, lineage]
            exists = row_before >= 0
            parent = self.hypotheses.parent[frame[row], lineage]
            lineage = np.where(exists, parent, lineage)
            past_rows.append(np.where(exists, row_before, row))
        return np.stack(past_rows, axis=1)

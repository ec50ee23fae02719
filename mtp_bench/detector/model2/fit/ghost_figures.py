"""Figures of false positives, real or simulated: rates, how long they stay, how close they stand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....types import Bools, Floats, Ints

NEAR = 3.0  # m: a false positive that near to a true box of its kind belongs to it
_SAME_PLACE = 1.0  # m: a false positive that near in a later frame is the same one


@dataclass(frozen=True, eq=False)
class Seen:
    """False positives of a class over scenes, real or simulated."""

    scene: Ints  # [D]
    frame: Ints  # [D]
    place: Floats  # [D, 2] m
    score: Floats  # [D]
    near: Bools  # [D] beside a true box of its kind
    alone: Bools  # [D] that box is not reported with a high score, where this one's is and it is near

    def followed(self, lag: int, by: Bools) -> Bools:
        """Which have another one of ``by`` at the same place ``lag`` frames later ``[D]``."""
        return self._any_within(_SAME_PLACE, lag, by)

    def together(self, by: Bools) -> Bools:
        """Which have another one of ``by`` within 3 m in the same frame ``[D]``."""
        return self._any_within(NEAR, 0, by)

    def _any_within(self, distance: float, lag: int, by: Bools) -> Bools:
        from scipy.spatial import KDTree

        if not by.any():
            return np.zeros(len(self.frame), dtype=bool)
        # frames far apart in the third coordinate, scenes farther
        here = np.column_stack([self.place, self._moment(lag)])
        there = np.column_stack([self.place, self._moment(0)])[by]
        # two of each, for in its own frame the nearest one is itself
        nearest = np.isfinite(KDTree(there).query(here, k=2, distance_upper_bound=distance)[0])
        return np.asarray(np.where(by, nearest[:, 1], nearest[:, 0]) if lag == 0 else nearest[:, 0])

    def _moment(self, lag: int) -> Floats:
        return 10.0 * (self.scene * (int(self.frame.max(initial=0)) + 20.0) + self.frame + lag)


def figures(seen: Seen, frames: int, high: float) -> Floats:
    """What is compared: rates, dispersion, how long they stay, how close they stand."""
    free, near, strong = ~seen.near, seen.near, seen.score >= high
    everyone = np.ones(len(free), dtype=bool)
    first, fourth = seen.followed(1, everyone), seen.followed(4, everyone)
    again = seen.followed(1, strong)
    count = np.unique(np.column_stack([seen.scene, seen.frame])[free], axis=0, return_counts=True)[1]
    square = float((count.astype(np.float64) ** 2).sum())
    rate = free.sum() / frames
    return np.array(
        [
            rate,
            (square / frames - rate**2) / max(rate, 1e-9),
            *(_share(one, some) for some in (free, near) for one in (first, fourth)),
            *(_share(again, some & strong) for some in (free, near)),
            _share(seen.together(everyone), everyone),
            _share(seen.together(strong), strong),
            _share(seen.alone, near & strong),
        ]
    )


def _share(yes: Bools, of: Bools) -> float:
    return float(yes[of].mean()) if of.any() else 0.0

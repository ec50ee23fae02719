"""Counted figures of false positives, real or simulated, and the parameters that follow from real ones by counting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...types import Bools, Floats, Ints
from ..grid import Neighbours
from ..near import BESIDE
from ..profile import QUANTILES, RANKS, SLOTS, FreeFalsePositives, NearFalsePositives
from .samples import FalsePositiveSamples
from .search import from_log_odds

NEAR = 3.0  # m: a false positive this near to a true box of its classes belongs to it
_SAME_PLACE = 1.0  # m: a false positive this near in a later frame is the same one
_FEW = 20  # least duplicates for quantiles
_NEAREST = 2.0  # m: the sensor's own vehicle is nearer
_FADES = 1.0  # s in which the autoregression decays to 1 / e
_PLACES = tuple(np.linspace(0.0, 1.0, QUANTILES))
_FRAMES = 100_000  # more than a scene has


@dataclass(frozen=True, eq=False)
class VisibleFalsePositives:
    """False positives of a class over scenes, real or simulated."""

    scene: Ints  # [D]
    frame: Ints  # [D]
    place: Floats  # [D, 2] m
    score: Floats  # [D]
    near: Bools  # [D] within `NEAR` of a true box of its classes
    alone: Bools  # [D] within 1.5 m of such a box that has no detection with a high score

    def followed(self, lag: int, by: Bools) -> Bools:
        """Mask of those with one of ``by`` at the same place ``lag`` frames later ``[D]``."""
        return self._any_within(_SAME_PLACE, lag, by)

    def together(self, by: Bools) -> Bools:
        """Mask of those with another one of ``by`` within 3 m in the same frame ``[D]``."""
        return self._any_within(NEAR, 0, by)

    def _any_within(self, distance: float, lag: int, by: Bools) -> Bools:
        from scipy.spatial import KDTree

        if not by.any():
            return np.zeros(len(self.frame), dtype=bool)
        # the third coordinate separates frames, and scenes even more
        query = np.column_stack([self.place, self._moment(lag)])
        targets = np.column_stack([self.place, self._moment(0)])[by]
        # two of each, as in its own frame the nearest one is itself
        nearest = np.isfinite(KDTree(targets).query(query, k=2, distance_upper_bound=distance)[0])
        return np.asarray(np.where(by, nearest[:, 1], nearest[:, 0]) if lag == 0 else nearest[:, 0])

    def _moment(self, lag: int) -> Floats:
        return 10.0 * (self.scene * (int(self.frame.max(initial=0)) + 20.0) + self.frame + lag)

    def figures(self, frames: int, high: float) -> Floats:
        """Compared figures over ``frames`` frames; scores from ``high`` on count as high.

        Rate and dispersion of free ones, shares that stay for 1 and 4 frames, stand together, are alone; rate of near
        ones.
        """
        free, near, strong = ~self.near, self.near, self.score >= high
        everyone = np.ones(len(free), dtype=bool)
        first, fourth = self.followed(1, everyone), self.followed(4, everyone)
        again = self.followed(1, strong)
        count = np.unique(np.column_stack([self.scene, self.frame])[free], axis=0, return_counts=True)[1]
        square = float((count.astype(np.float64) ** 2).sum())
        rate = free.sum() / frames
        return np.array(
            [
                rate,
                (square / frames - rate**2) / max(rate, 1e-9),
                *(_share(stays, kind) for kind in (free, near) for stays in (first, fourth)),
                *(_share(again, kind & strong) for kind in (free, near)),
                _share(self.together(everyone), everyone),
                _share(self.together(strong), strong),
                _share(self.alone, near & strong),
                near.sum() / frames,
            ]
        )


def _share(yes: Bools, among: Bools) -> float:
    return float(yes[among].mean()) if among.any() else 0.0


def count_near(real: FalsePositiveSamples, near: Bools, boxes: int, dt: float) -> NearFalsePositives | None:
    """Parameters of the false positives ``near`` true boxes, ``boxes`` in number; None without any.

    ``dt``: s between frames. The memory is a start value.
    """
    if not near.any() or not boxes:
        return None
    return NearFalsePositives(
        chance=round(min(float(near.sum()) / boxes / SLOTS, 1.0), 5),
        score=_quantiles(real.score[near], RANKS),
        offset=_quantiles(real.beside[near]),
        same=_same_class_shares(real, near),
        duplicates=_duplicate_scores(real, near),
        **memory_from_log_odds(1.0, 0.0, dt),
    )


def _duplicate_scores(real: FalsePositiveSamples, near: Bools) -> tuple[float, ...] | None:
    """Quantiles of the scores of duplicates; None if there are too few."""
    beside = near & real.of_class & (real.beside < BESIDE[0])
    return _quantiles(real.score[beside], RANKS) if beside.sum() >= _FEW else None


def _same_class_shares(real: FalsePositiveSamples, near: Bools) -> tuple[float, float, float]:
    """Shares with the class of the true box, by distance from it; 1 where there is no false positive."""
    zone = np.digitize(real.beside, BESIDE)
    rows = [near & (zone == number) for number in range(3)]
    first, second, third = (round(float(real.of_class[row].mean()) if row.any() else 1.0, 4) for row in rows)
    return first, second, third


def count_free(real: FalsePositiveSamples, free: Bools, frames: int, dt: float) -> FreeFalsePositives | None:
    """Parameters of the ``free`` false positives over ``frames`` frames of ``dt`` s; None without any.

    Chances, lives, families and memory are start values.
    """
    if not free.any():
        return None
    moment = real.scene[free] * _FRAMES + real.frame[free]
    count = np.bincount(moment)
    count = count[count > 0]
    rate = float(free.sum()) / frames
    place = real.place[free]
    pairs = Neighbours.within(NEAR, place, moment, np.arange(len(place)))
    distance = np.hypot(*(place[pairs.row] - place[pairs.other]).T)
    length, width, height = (round(float(side), 4) for side in real.size[free].mean(axis=0))
    return FreeFalsePositives(
        rate=round(rate, 4),
        dispersion=round(max(float((count**2).sum()) / frames / rate - rate, 1.0), 4),
        chance=0.15,
        survive=0.88,
        siblings=0.4,
        spread=round(float(np.median(distance)) / 1.3 if len(distance) else 1.0, 3),
        family=0.5,
        size=(length, width, height),
        distance=_quantiles(np.maximum(real.distance[free], _NEAREST)),
        score=_quantiles(real.score[free], RANKS),
        **memory_from_log_odds(1.0, 0.0, dt),
    )


def _quantiles(value: Floats, share: Sequence[float] = _PLACES) -> tuple[float, ...]:
    return tuple(round(float(quantile), 4) for quantile in np.quantile(value, share))


def memory_from_log_odds(lasting: float, constant: float, dt: float) -> dict[str, float]:
    """Shares of the variance from the log-odds of the lasting share, and of the constant share of that."""
    last, stay = from_log_odds(lasting), from_log_odds(constant)
    bias, ar = round(last * stay, 4), round(last * (1 - stay), 4)
    return {"bias": bias, "ar": ar, "phi": round(float(np.exp(-dt / _FADES)), 4), "white": round(1.0 - bias - ar, 4)}

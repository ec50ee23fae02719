"""What close neighbours share: what hides or blurs one object does so to those beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...types import Floats, Ints


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Pairs of rows that share, each in both directions, by row and then by the other's id."""

    row: Ints  # [Q]
    other: Ints  # [Q]
    weight: Floats  # [Q] 1 at distance 0, 0 where nothing is shared

    @classmethod
    def none(cls) -> Neighbours:
        """No pairs."""
        no_rows = np.zeros(0, dtype=np.int64)
        return cls(no_rows, no_rows, np.zeros(0))

    def shared(self, value: Floats, share: Floats) -> Floats:
        """Numbers ``[R]`` of variance 1 mixed with those of the neighbours; the variance stays 1.

        ``share`` ``[R]`` is the weight of a neighbour at distance 0. Over frames, standing neighbours keep the memory
        that ``value`` has.
        """
        if not len(self.row):
            return value
        weight = share[self.row] * self.weight
        # bincount adds up in the given order: a row's sum is the same to the last digit whatever other rows there are
        others = np.bincount(self.row, weight * value[self.other], len(value))
        variance = 1.0 + np.bincount(self.row, weight**2, len(value))
        return np.asarray((value + others) / np.sqrt(variance))


def neighbours_of(place: Floats, moment: Ints, ids: Ints, length: float) -> Neighbours:
    """Neighbours within ``length`` m, of rows with the same ``moment``.

    ``place`` ``[R, 2]`` m; ``moment`` ``[R]`` any whole number; ``ids`` ``[R]`` of their objects.
    """
    from scipy.spatial import KDTree

    if not len(place):
        return Neighbours.none()
    apart = np.column_stack([place, 2.0 * length * moment])
    tree = KDTree(apart, balanced_tree=False, compact_nodes=False)
    one, two = tree.query_pairs(length, output_type="ndarray").reshape(-1, 2).T
    distance = np.hypot(*(place[one] - place[two]).T)
    weight = (1.0 - np.minimum(distance / length, 1.0)) ** 2
    row, other = np.concatenate([one, two]), np.concatenate([two, one])
    _, rank = np.unique(ids, return_inverse=True)
    order = np.argsort(row * len(place) + rank[other])  # no two are equal
    return Neighbours(row[order], other[order], np.concatenate([weight, weight])[order])

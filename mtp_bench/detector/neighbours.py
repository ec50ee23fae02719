"""Noise that neighbours share."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from ..core import NO_ROWS, Floats, Ints


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Pairs of rows that share noise, each in both directions.

    Pairs are sorted by row, then by the object of the other row.
    """

    row: Ints  # [Q]
    other: Ints  # [Q]
    weight: Floats  # [Q] 1 at distance 0, 0 where the pair shares no noise

    @classmethod
    def within(
        cls, length: float, place: Floats, moment: Ints, object_id: Ints
    ) -> Self:
        """Find pairs of rows within ``length`` m and of equal ``moment`` [R].

        ``place`` [R, 2] m; ``object_id`` [R] decides the order of the pairs of a row.
        """
        if not len(place):
            return cls(NO_ROWS, NO_ROWS, np.zeros(0))
        from scipy.spatial import KDTree

        separated = np.column_stack([place, 2.0 * length * moment])
        tree = KDTree(separated, balanced_tree=False, compact_nodes=False)
        one, two = tree.query_pairs(length, output_type="ndarray").reshape(-1, 2).T
        distance = np.hypot(*(place[one] - place[two]).T)
        weight = (1.0 - np.minimum(distance / length, 1.0)) ** 2
        row = np.concatenate([one, two])
        other = np.concatenate([two, one])
        _, rank = np.unique(object_id, return_inverse=True)
        order = np.argsort(row * len(place) + rank[other])  # no two are equal
        return cls(row[order], other[order], np.concatenate([weight, weight])[order])

    def mixed(self, value: Floats, share: Floats) -> Floats:
        """Mix numbers [m, R] of variance 1 with neighbours'.

        The variance stays 1. ``share`` [m, R]: weight of a neighbour at distance 0.
        Neighbours at rest keep the memory of ``value``.
        """
        if not len(self.row):
            return value
        weight = share.take(self.row, axis=1) * self.weight
        others = self._sums(weight * value.take(self.other, axis=1), value.shape[1])
        variance = self._sums(weight**2, value.shape[1])
        return np.asarray((value + others) / np.sqrt(1.0 + variance))

    def _sums(self, terms: Floats, rows: int) -> Floats:
        """Add terms [m, Q] over the pairs of each row, [m, R].

        `bincount` adds in the order of the pairs, so that the sum of a row does not
        depend on other rows.
        """
        return np.array([np.bincount(self.row, line, rows) for line in terms])

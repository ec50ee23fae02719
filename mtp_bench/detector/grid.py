"""Boxes of a scene as a grid of frames and objects, their lasting noise, and the noise shared by neighbours."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from ..types import Floats, Ints, Truth
from .draws import Component, Draws, Keys, NoiseKind, NoiseSubject, decayed, extended_key, keys_of
from .profile import ClassNoise, SharedMemory

_TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Pairs of rows that share noise, each in both directions, sorted by row and then by the other's object."""

    row: Ints  # [Q]
    other: Ints  # [Q]
    weight: Floats  # [Q] 1 at distance 0, 0 where the pair shares no noise

    @classmethod
    def within(cls, length: float, place: Floats, moment: Ints, object_id: Ints) -> Self:
        """Pairs within ``length`` m of rows at ``place`` ``[R, 2]`` with equal ``moment`` ``[R]``.

        ``object_id`` ``[R]`` decides the order of the pairs of a row.
        """
        if not len(place):
            return cls(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))
        from scipy.spatial import KDTree

        separated = np.column_stack([place, 2.0 * length * moment])
        tree = KDTree(separated, balanced_tree=False, compact_nodes=False)
        one, two = tree.query_pairs(length, output_type="ndarray").reshape(-1, 2).T
        distance = np.hypot(*(place[one] - place[two]).T)
        weight = (1.0 - np.minimum(distance / length, 1.0)) ** 2
        row, other = np.concatenate([one, two]), np.concatenate([two, one])
        _, rank = np.unique(object_id, return_inverse=True)
        order = np.argsort(row * len(place) + rank[other])  # no two are equal
        return cls(row[order], other[order], np.concatenate([weight, weight])[order])

    def mixed(self, value: Floats, share: Floats) -> Floats:
        """Numbers ``[R]`` of variance 1 mixed with those of the neighbours; the variance stays 1.

        ``share`` ``[R]`` is the weight of a neighbour at distance 0. Neighbours at rest keep the memory of ``value``.
        """
        weight = share[self.row] * self.weight
        # bincount adds in the given order, so the sum of a row does not depend on other rows
        others = np.bincount(self.row, weight * value[self.other], len(value))
        variance = 1.0 + np.bincount(self.row, weight**2, len(value))
        return np.asarray((value + others) / np.sqrt(variance))


@dataclass(eq=False)
class Memory:
    """Kept state of a scene that is detected frame by frame, so that no number is drawn twice."""

    frame: int = -1  # the one that is detected
    objects: dict[int, tuple[int, int, int]] = field(default_factory=dict)  # column, first frame, class index, by id
    series: dict[tuple[NoiseSubject, NoiseKind], Floats] = field(default_factory=dict)  # last numbers, by column
    families: dict[int, Any] = field(default_factory=dict)  # of free false positives, by number of the noise

    def before(self, subject: NoiseSubject, kind: NoiseKind, count: int) -> Floats:
        """Numbers of the first ``count`` columns in the frame before; 0 for new ones."""
        known = self.series.get((subject, kind), np.zeros(0))
        return np.append(known, np.zeros(count - len(known)))


@dataclass(frozen=True, eq=False)
class Grid:
    """R boxes in F frames of J objects, and the noise of each object.

    The rows of an object are in the order of frames. A cell is an object and a frame from its first to its last one.
    """

    frames: int
    ids: Ints  # [J] ascending, or with a memory in the order in which they came
    frame: Ints  # [R]
    column: Ints  # [R] object of every row
    noise: tuple[ClassNoise, ...]
    noise_number: Ints  # [J] index into ``noise``
    steps: float  # frame periods of the profile per frame of the scene
    lives: tuple[Ints, Ints] | None = None  # [J] first frame and the one after the last; None: those of the rows
    memory: Memory | None = None  # the cells are those of the last frame alone, of all objects so far

    @cached_property
    def object_keys(self) -> Keys:
        """Keys of the objects ``[J]``."""
        return keys_of(self.ids)

    @cached_property
    def row_keys(self) -> Keys:
        """Keys of object and frame of every row ``[R]``."""
        return extended_key(self.object_keys[self.column], self.frame)

    def of_objects(self, parameter: Callable[[ClassNoise], float | Sequence[float]]) -> Floats:
        """A parameter of every object's noise: ``[J]``, or ``[J, n]`` for n numbers."""
        return np.array([parameter(noise) for noise in self.noise], dtype=np.float64)[self.noise_number]

    def of_rows(self, parameter: Callable[[ClassNoise], float | Sequence[float]]) -> Floats:
        """A parameter of every row's noise: ``[R]``, or ``[R, n]`` for n numbers."""
        return self.of_objects(parameter)[self.column]

    def by_noise(self) -> list[tuple[ClassNoise, Ints]]:
        """Each noise with its rows."""
        number = self.noise_number[self.column]
        return [(noise, np.flatnonzero(number == k)) for k, noise in enumerate(self.noise)]

    def select(self, row: Ints) -> Self:
        """The grid of some rows, without objects that have none of them."""
        old = self.column[row]
        kept = np.bincount(old, minlength=len(self.ids)) > 0
        objects, column = np.flatnonzero(kept), (np.cumsum(kept) - 1)[old]
        frame, end = self.frame[row], np.zeros(len(objects), dtype=np.int64)
        end[column] = frame + 1
        lives = self.span[0][objects], end  # memory begins where it did; later frames do not matter
        number = self.noise_number[objects]
        ids = self.ids[objects]
        return replace(self, ids=ids, frame=frame, column=column, noise_number=number, lives=lives, memory=None)

    @cached_property
    def span(self) -> tuple[Ints, Ints]:
        """First frame of every object and the one after its last ``[J]``."""
        if self.lives is not None:
            return self.lives
        first, end = np.full(len(self.ids), self.frames), np.zeros(len(self.ids), dtype=np.int64)
        first[self.column[::-1]] = self.frame[::-1]  # the last assignment to an object stays
        end[self.column] = self.frame + 1
        return first, end

    @cached_property
    def cells(self) -> tuple[Ints, Ints]:
        """Frames and objects of all cells."""
        first, end = self.span
        if self.memory is not None:
            return end - 1, np.arange(len(end))
        frame = np.arange(self.frames)[:, None]
        frame, column = ((frame >= first) & (frame < end)).nonzero()
        return frame, column

    @cached_property
    def cell_keys(self) -> Keys:
        """Keys of object and frame of all `cells`."""
        frame, column = self.cells
        return extended_key(self.object_keys[column], frame)

    def on_grid(self, value: Floats, other: float = 0.0) -> Floats:
        """Numbers of the `cells` on the whole grid ``[F, J]``, ``other`` elsewhere."""
        grid = np.full((self.frames, len(self.ids)), other)
        grid[self.cells] = value
        return grid

    def autoregression(self, phi: Floats, draws: Draws, kind: NoiseKind, push: Floats | None = None) -> Floats:
        """Autoregressive standard normal numbers ``[R]`` from standard normal numbers ``push`` of all `cells`.

        ``phi`` ``[J]``: correlation between neighbouring frames of the profile.
        """
        phi, (frame, column) = decayed(phi, self.steps), self.cells
        scale = np.sqrt(1.0 - phi**2)[column]
        scale[frame == self.span[0][column]] = 1.0
        push = draws.normal(kind, Component.PUSH, self.cell_keys) if push is None else push
        if self.memory is not None:
            last = push * scale + phi * self.memory.before(draws.subject, kind, len(phi))
            self.memory.series[draws.subject, kind] = last
            return np.asarray(last[self.column])
        value = self.on_grid(push * scale)
        for t in range(1, self.frames):
            value[t] += phi * value[t - 1]
        return value[self.frame, self.column]

    def lasting(self, bias: Floats, phi: Floats, draws: Draws, kind: NoiseKind) -> Floats:
        """Standard normal numbers ``[R]``: a constant share ``bias`` ``[J]``, the rest autoregressive with ``phi``."""
        series = self.autoregression(phi, draws, kind)
        constant = np.sqrt(bias) * draws.normal(kind, Component.BIAS, self.object_keys)
        return np.asarray(constant[self.column] + np.sqrt(1 - bias)[self.column] * series)

    def latent(
        self, memory: Callable[[ClassNoise], SharedMemory], neighbours: Neighbours | None, draws: Draws, kind: NoiseKind
    ) -> Floats:
        """Standard normal numbers ``[R]`` with a memory; their lasting part is shared with neighbours, if any."""
        bias, ar, phi, white, shared = self.of_objects(
            lambda n: (memory(n).bias, memory(n).ar, memory(n).phi, memory(n).white, memory(n).shared)
        ).T
        lasting = self.lasting(bias / np.maximum(bias + ar, _TINY), phi, draws, kind)
        if neighbours is not None:
            lasting = neighbours.mixed(lasting, shared[self.column])
        new = draws.normal(kind, Component.WHITE, self.row_keys)
        share = (white / (bias + ar + white))[self.column]  # the rounded shares of a profile may not sum to 1
        return np.asarray(np.sqrt(1 - share) * lasting + np.sqrt(share) * new)


def truth_grid(truth: Truth, noise: Sequence[ClassNoise], steps: float, memory: Memory | None = None) -> Grid:
    """Grid of a truth; ``noise`` is that of each class index; ``memory``: of its last frame, which alone has rows."""
    distinct: list[ClassNoise] = []
    for parameters in noise:
        if parameters not in distinct:
            distinct.append(parameters)
    number = np.array([distinct.index(parameters) for parameters in noise])
    if memory is None:
        ids, first, column = np.unique(truth.object_id, return_index=True, return_inverse=True)
        number = number[truth.class_id[first]]
        return Grid(truth.frames, ids, truth.frame_of_rows, column, tuple(distinct), number, steps)
    rows, objects = truth.object_id.tolist(), memory.objects
    for object_id, class_id in zip(rows, truth.class_id.tolist(), strict=True):
        objects.setdefault(object_id, (len(objects), memory.frame, class_id))
    column = np.array([objects[object_id][0] for object_id in rows], dtype=np.int64)
    _, since, class_ids = np.array(list(objects.values()), dtype=np.int64).reshape(-1, 3).T
    lives, ids = (since, np.full(len(since), memory.frame + 1)), np.array(list(objects), dtype=np.int64)
    frame = np.full(len(rows), memory.frame)
    return Grid(truth.frames, ids, frame, column, tuple(distinct), number[class_ids], steps, lives, memory)


def truth_neighbours(grid: Grid, place: Floats, length: float) -> Neighbours:
    """Neighbours within ``length`` m of rows at ``place`` ``[R, 2]``, in the same frame and with the same noise."""
    moment = grid.frame * len(grid.noise) + grid.noise_number[grid.column]
    return Neighbours.within(length, place, moment, grid.ids[grid.column])

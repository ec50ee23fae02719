"""Boxes of a scene as a grid of frames and objects, and their lasting noise.

Neighbours share a part of the noise.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter
from typing import Any, Self

import numpy as np
from scipy.special import ndtri

from ..core import NO_ROWS, Floats, Ints, Truth
from .draws import (
    Component,
    Draws,
    Keys,
    Memory,
    NoiseKind,
    decayed,
    extended_key,
    keys_of,
    parts,
    remembered,
)
from .profile import ClassNoise, SharedMemory


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Pairs of rows that share noise, each in both directions.

    They are sorted by row and then by the other's object.
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

        # rows of different moments are too far apart to be pairs
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
        neighbour_sum = self._sums(
            weight * value.take(self.other, axis=1), value.shape[1]
        )
        variance = self._sums(weight**2, value.shape[1])
        return np.asarray((value + neighbour_sum) / np.sqrt(1.0 + variance))

    def _sums(self, terms: Floats, rows: int) -> Floats:
        """Add terms [m, Q] over the pairs of each row, [m, R].

        `bincount` adds in the order of the pairs, so that the sum of a row does not
        depend on other rows.
        """
        sums = [np.bincount(self.row, term, rows) for term in terms]
        return np.array(sums, dtype=float)


# names of fields, or a function of a module: its values are remembered
Parameter = str | Callable[[ClassNoise], Any]
Kinds = tuple[NoiseKind, ...]
Shares = tuple[float, float, float, float]  # see `shares_of`
_MIN_DIVISOR = 1e-12


@dataclass(frozen=True, eq=False)
class Grid:
    """R boxes in F frames of J objects, and the noise of each object.

    The rows of an object are in the order of frames. A cell is an object and a frame
    from its first to its last one.
    """

    frames: int
    ids: Ints  # [J] ascending, or with a memory in the order in which they came
    frame: Ints  # [R]
    column: Ints  # [R] object of every row
    noise: tuple[ClassNoise, ...]
    noise_number: Ints  # [J] index into ``noise``
    steps: float  # frame periods of the profile per frame of the scene
    # [J] first frame and the one after the last; None: those of the rows
    lives: tuple[Ints, Ints] | None = None
    # the cells are those of the last frame alone, of all objects so far
    memory: Memory | None = None

    @cached_property
    def object_keys(self) -> Keys:
        """Keys of the objects [J]."""
        return keys_of(self.ids)

    @cached_property
    def row_keys(self) -> Keys:
        """Keys of object and frame of every row [R]."""
        return extended_key(self.object_keys[self.column], self.frame)

    @cached_property
    def row_noise(self) -> Ints:
        """Index into ``noise`` of every row [R]."""
        return self.noise_number[self.column]

    def of_noise(self, parameter: Parameter) -> Floats:
        """Return a parameter of every noise ``[K, ...]``.

        None becomes NaN.
        """
        read = parameter
        if isinstance(read, str):
            read = attrgetter(*read.split())
        return remembered(
            self.memory,
            parameter,
            lambda: np.array([read(noise) for noise in self.noise], np.float64),
        )

    def of_rows(self, parameter: Parameter) -> Floats:
        """Return a parameter of every row's noise [R], or ``[R, ...]``."""
        return self.of_noise(parameter)[self.row_noise]

    def constant(
        self, draws: Draws, name: Any, make: Callable[[Keys], Floats]
    ) -> Floats:
        """Return numbers ``[..., J]`` that every object keeps.

        ``make`` draws them by the keys of objects.
        """
        if self.memory is None:
            return make(self.object_keys)
        return self.memory.grown((draws.subject, name), self.object_keys, make)

    def by_noise(self) -> list[tuple[ClassNoise, Ints]]:
        """Return each noise that has rows, with its rows."""
        rows_of: list[tuple[ClassNoise, Ints]] = []
        for number, noise in enumerate(self.noise):
            rows = np.flatnonzero(self.row_noise == number)
            if len(rows):
                rows_of.append((noise, rows))
        return rows_of

    def select(self, row: Ints) -> Self:
        """Return the grid of some rows.

        Without a memory, objects that have none of them are left out.
        """
        frame = self.frame[row]
        column = self.column[row]
        if self.memory is not None:
            part = replace(self, frame=frame, column=column)
            # the same objects: their keys are not hashed again
            vars(part)["object_keys"] = self.object_keys
            return part
        objects, column = np.unique(column, return_inverse=True)
        end = np.zeros(len(objects), dtype=np.int64)
        end[column] = frame + 1
        return replace(
            self,
            ids=self.ids[objects],
            frame=frame,
            column=column,
            noise_number=self.noise_number[objects],
            # memory begins where it did; later frames do not matter
            lives=(self.span[0][objects], end),
        )

    @cached_property
    def span(self) -> tuple[Ints, Ints]:
        """First frame of every object and the one after its last [J]."""
        if self.lives is not None:
            return self.lives
        first = np.full(len(self.ids), self.frames)
        end = np.zeros(len(self.ids), dtype=np.int64)
        # the last assignment to an object stays
        first[self.column[::-1]] = self.frame[::-1]
        end[self.column] = self.frame + 1
        return first, end

    @cached_property
    def cells(self) -> tuple[Ints, Ints]:
        """Frames and objects of all cells."""
        first, end = self.span
        if self.memory is not None:
            return end - 1, np.arange(len(end))
        frame = np.arange(self.frames)[:, None]
        frame, column = np.nonzero((frame >= first) & (frame < end))
        return frame, column

    @cached_property
    def cell_keys(self) -> Keys:
        """Keys of object and frame of all `cells`."""
        frame, column = self.cells
        return extended_key(self.object_keys[column], frame)

    def on_grid(self, value: Floats, elsewhere: float = 0.0) -> Floats:
        """Return numbers of the `cells` on the whole grid ``[..., F, J]``.

        ``value``: ``[..., cells]``; ``elsewhere``: number of the other cells.
        """
        grid = np.full((*value.shape[:-1], self.frames, len(self.ids)), elsewhere)
        frame, column = self.cells
        grid[..., frame, column] = value
        return grid

    def autoregression(
        self, phi: Floats, draws: Draws, kinds: Kinds, push: Floats | None = None
    ) -> Floats:
        """Return autoregressive standard normal numbers [m, R] of m kinds.

        ``push``: independent numbers of all `cells`, from which they are made. ``phi``
        [m, K]: correlation between neighbouring frames of the profile, of every noise.
        """
        frame, column = self.cells
        phi = decayed(phi, self.steps)
        scale = np.sqrt(1.0 - phi**2).take(self.noise_number[column], axis=1)
        # the first number of an object has the variance 1 already
        scale[:, np.flatnonzero(frame == self.span[0][column])] = 1.0
        if push is None:
            push = ndtri(draws.uniforms(parts(Component.PUSH, *kinds), self.cell_keys))
        phi = phi.take(self.noise_number, axis=1)
        value = push * scale
        if self.memory is not None:
            value += phi * self.memory.previous((draws.subject, kinds), value.shape)
            self.memory.series[draws.subject, kinds] = value
            return np.asarray(value.take(self.column, axis=1))
        value = self.on_grid(value)
        for t in range(1, self.frames):
            value[:, t] += phi * value[:, t - 1]
        index = self.frame * len(self.ids) + self.column
        return value.reshape(len(value), -1).take(index, axis=1)

    def lasting(
        self,
        memories: Parameter,
        neighbours: Neighbours | None,
        draws: Draws,
        kinds: Kinds,
    ) -> Floats:
        """Return standard normal numbers [m, R] of m kinds.

        They have a constant part and an autoregressive one, and are shared with
        neighbours, if any. ``memories``: `shares_of` each kind.
        """
        bias, phi, shared, _ = self.of_noise(memories).T
        series = self.autoregression(phi, draws, kinds)
        bias_parts = parts(Component.BIAS, *kinds)
        constant = self.constant(
            draws, kinds, lambda keys: ndtri(draws.uniforms(bias_parts, keys))
        )
        constant = np.sqrt(bias).take(self.noise_number, axis=1) * constant
        value = np.sqrt(1 - bias).take(self.row_noise, axis=1) * series
        value = constant.take(self.column, axis=1) + value
        if neighbours is None:
            return np.asarray(value)
        return neighbours.mixed(value, shared.take(self.row_noise, axis=1))

    def with_new(self, lasting: Floats, new: Floats, memories: Parameter) -> Floats:
        """Return numbers [m, R] of `lasting` with their share of ``new`` ones.

        The new ones differ in every frame.
        """
        _, _, _, new_share = self.of_noise(memories).T
        share = new_share.take(self.row_noise, axis=1)
        return np.asarray(np.sqrt(1 - share) * lasting + np.sqrt(share) * new)


def shares_of(memory: SharedMemory) -> Shares:
    """Return four parameters of a memory.

    In order: the constant share of the lasting part, phi, the weight of a neighbour at
    distance 0, and the share of the new part.
    """
    # the rounded shares of a profile may not sum to 1
    lasting = memory.bias + memory.ar
    constant_share = memory.bias / max(lasting, _MIN_DIVISOR)
    new_share = memory.white / (lasting + memory.white)
    return constant_share, memory.phi, memory.shared, new_share


def truth_grid(
    truth: Truth,
    noise: Sequence[ClassNoise],
    steps: float,
    memory: Memory | None = None,
) -> Grid:
    """Return the grid of a truth.

    ``noise``: noise of each class index. ``memory``: state of the frames before,
    if only the last frame has rows.
    """
    distinct, noise_of_class = remembered(memory, "noise", lambda: _distinct(noise))
    if memory is None:
        ids, first, column = np.unique(
            truth.object_id, return_index=True, return_inverse=True
        )
        noise_number = noise_of_class[truth.class_id[first]]
        frame = truth.frame_of_rows
        return Grid(truth.frames, ids, frame, column, distinct, noise_number, steps)
    objects = memory.objects
    columns = []
    for object_id, class_id in zip(
        truth.object_id.tolist(), truth.class_id.tolist(), strict=True
    ):
        # a new object gets the next column
        objects.setdefault(object_id, (len(objects), memory.frame, class_id))
        columns.append(objects[object_id][0])
    object_facts = np.array(list(objects.values()), dtype=np.int64).reshape(-1, 3)
    _, first_frame, class_ids = object_facts.T
    return Grid(
        frames=truth.frames,
        ids=np.array(list(objects), dtype=np.int64),
        frame=np.full(len(columns), memory.frame),
        column=np.array(columns, dtype=np.int64),
        noise=distinct,
        noise_number=noise_of_class[class_ids],
        steps=steps,
        lives=(first_frame, np.full(len(objects), memory.frame + 1)),
        memory=memory,
    )


def _distinct(noise: Sequence[ClassNoise]) -> tuple[tuple[ClassNoise, ...], Ints]:
    """Return different noises, and the number of that of each class index."""
    distinct: list[ClassNoise] = []
    for class_noise in noise:
        if class_noise not in distinct:
            distinct.append(class_noise)
    return tuple(distinct), np.array([distinct.index(item) for item in noise])


def truth_neighbours(grid: Grid, place: Floats, length: float) -> Neighbours:
    """Return neighbours within ``length`` m of rows at ``place`` [R, 2].

    Neighbours are in the same frame and have the same noise.
    """
    moment = grid.frame * len(grid.noise) + grid.noise_number[grid.column]
    return Neighbours.within(length, place, moment, grid.ids[grid.column])

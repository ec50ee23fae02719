"""Boxes of a scene as a grid of frames and objects, their lasting noise, and the noise shared by neighbours."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
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
    NoiseKind,
    decayed,
    extended_key,
    keys_of,
    parts,
)
from .profile import ClassNoise, SharedMemory

Parameter = (
    str | Callable[[ClassNoise], Any]
)  # names of fields, or a function that stays: its values are remembered
Kinds = tuple[NoiseKind, ...]
Shares = tuple[float, float, float, float]  # see `shares_of`
_TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Pairs of rows that share noise, each in both directions, sorted by row and then by the other's object."""

    row: Ints  # [Q]
    other: Ints  # [Q]
    weight: Floats  # [Q] 1 at distance 0, 0 where the pair shares no noise

    @classmethod
    def within(
        cls, length: float, place: Floats, moment: Ints, object_id: Ints
    ) -> Self:
        """Pairs within ``length`` m of rows at ``place`` ``[R, 2]`` with equal ``moment`` ``[R]``.

        ``object_id`` ``[R]`` decides the order of the pairs of a row.
        """
        if not len(place):
            return cls(NO_ROWS, NO_ROWS, np.zeros(0))
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
        """Numbers ``[m, R]`` of variance 1 mixed with those of the neighbours; the variance stays 1.

        ``share`` ``[m, R]``: weight of a neighbour at distance 0. Neighbours at rest keep the memory of ``value``.
        """
        if not len(self.row):
            return value
        weight = share.take(self.row, axis=1) * self.weight
        terms, squares = weight * value.take(self.other, axis=1), weight**2
        # bincount adds in the given order, so the sum of a row does not depend on other rows
        others, variance = (
            np.array([np.bincount(self.row, each, value.shape[1]) for each in part])
            for part in (terms, squares)
        )
        return np.asarray((value + others) / np.sqrt(1.0 + variance))


@dataclass(eq=False)
class Memory:
    """Kept state of a scene that is detected frame by frame, so that no number is drawn twice."""

    frame: int = -1  # the one that is detected
    objects: dict[int, tuple[int, int, int]] = field(
        default_factory=dict
    )  # column, first frame, class index, by id
    series: dict[Any, Floats] = field(
        default_factory=dict
    )  # last numbers, by column, of subjects and kinds
    kept: dict[Any, Any] = field(
        default_factory=dict
    )  # what does not change, by what it is

    def before(self, name: Any, shape: tuple[int, ...]) -> Floats:
        """The numbers of ``name`` in the frame before, filled up to ``shape`` with 0 for new columns."""
        numbers = np.zeros(shape)
        if (known := self.series.get(name)) is not None:
            numbers[..., : known.shape[-1]] = known
        return numbers

    def grown(self, name: Any, keys: Keys, make: Callable[[Keys], Floats]) -> Floats:
        """Numbers that ``make`` draws by the keys of objects ``[J]``, on the last axis, of new objects alone."""
        known = self.kept.get(name)
        if known is None or known.shape[-1] < len(keys):
            new = make(keys if known is None else keys[known.shape[-1] :])
            known = self.kept[name] = (
                new if known is None else np.concatenate([known, new], axis=-1)
            )
        return known


def kept(memory: Memory | None, name: Any, make: Callable[[], Any]) -> Any:
    """Result of ``make``; with a memory, made once under this name."""
    if memory is None:
        return make()
    if name not in memory.kept:
        memory.kept[name] = make()
    return memory.kept[name]


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
    lives: tuple[Ints, Ints] | None = (
        None  # [J] first frame and the one after the last; None: those of the rows
    )
    memory: Memory | None = (
        None  # the cells are those of the last frame alone, of all objects so far
    )

    @cached_property
    def object_keys(self) -> Keys:
        """Keys of the objects ``[J]``."""
        return keys_of(self.ids)

    @cached_property
    def row_keys(self) -> Keys:
        """Keys of object and frame of every row ``[R]``."""
        return extended_key(self.object_keys[self.column], self.frame)

    @cached_property
    def row_noise(self) -> Ints:
        """Index into ``noise`` of every row ``[R]``."""
        return self.noise_number[self.column]

    def of_noise(self, parameter: Parameter) -> Floats:
        """A parameter of every noise ``[K]``, or ``[K, ...]``; NaN for None."""
        read = (
            attrgetter(*parameter.split()) if isinstance(parameter, str) else parameter
        )
        value: Floats = kept(
            self.memory,
            parameter,
            lambda: np.array([read(noise) for noise in self.noise], np.float64),
        )
        return value

    def of_rows(self, parameter: Parameter) -> Floats:
        """A parameter of every row's noise ``[R]``, or ``[R, ...]``."""
        return self.of_noise(parameter)[self.row_noise]

    def constant(
        self, draws: Draws, name: Any, make: Callable[[Keys], Floats]
    ) -> Floats:
        """Numbers ``[..., J]`` that every object keeps; ``make`` draws them by the keys of objects."""
        keys = self.object_keys
        return (
            make(keys)
            if self.memory is None
            else self.memory.grown((draws.subject, name), keys, make)
        )

    def by_noise(self) -> list[tuple[ClassNoise, Ints]]:
        """Each noise with its rows, without those that have none."""
        rows_of = [
            (noise, (self.row_noise == number).nonzero()[0])
            for number, noise in enumerate(self.noise)
        ]
        return [(noise, rows) for noise, rows in rows_of if len(rows)]

    def select(self, row: Ints) -> Self:
        """The grid of some rows; without a memory, without objects that have none of them."""
        old, frame = self.column[row], self.frame[row]
        if self.memory is not None:
            part = replace(self, frame=frame, column=old)
            vars(part)["object_keys"] = self.object_keys  # the objects are the same
            return part
        used = np.bincount(old, minlength=len(self.ids)) > 0
        objects, column = np.flatnonzero(used), (np.cumsum(used) - 1)[old]
        end = np.zeros(len(objects), dtype=np.int64)
        end[column] = frame + 1
        lives = (
            self.span[0][objects],
            end,
        )  # memory begins where it did; later frames do not matter
        number = self.noise_number[objects]
        return replace(
            self,
            ids=self.ids[objects],
            frame=frame,
            column=column,
            noise_number=number,
            lives=lives,
        )

    @cached_property
    def span(self) -> tuple[Ints, Ints]:
        """First frame of every object and the one after its last ``[J]``."""
        if self.lives is not None:
            return self.lives
        first, end = (
            np.full(len(self.ids), self.frames),
            np.zeros(len(self.ids), dtype=np.int64),
        )
        first[self.column[::-1]] = self.frame[
            ::-1
        ]  # the last assignment to an object stays
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
        """Numbers ``[..., cells]`` of the `cells` on the whole grid ``[..., F, J]``, ``other`` elsewhere."""
        grid = np.full((*value.shape[:-1], self.frames * len(self.ids)), other)
        grid[..., self.cells[0] * len(self.ids) + self.cells[1]] = value
        return grid.reshape(*value.shape[:-1], self.frames, len(self.ids))

    def autoregression(
        self, phi: Floats, draws: Draws, kinds: Kinds, push: Floats | None = None
    ) -> Floats:
        """Autoregressive standard normal numbers ``[m, R]`` of m kinds, from such numbers ``push`` of all `cells`.

        ``phi`` ``[m, K]``: correlation between neighbouring frames of the profile, of every noise.
        """
        phi, (frame, column) = decayed(phi, self.steps), self.cells
        scale = np.sqrt(1.0 - phi**2).take(self.noise_number[column], axis=1)
        scale[:, (frame == self.span[0][column]).nonzero()[0]] = 1.0
        push = (
            ndtri(draws.uniforms(parts(Component.PUSH, *kinds), self.cell_keys))
            if push is None
            else push
        )
        phi, value = phi.take(self.noise_number, axis=1), push * scale
        if self.memory is not None:
            value += phi * self.memory.before((draws.subject, kinds), value.shape)
            self.memory.series[draws.subject, kinds] = value
            return np.asarray(value.take(self.column, axis=1))
        value = self.on_grid(value)
        for t in range(1, self.frames):
            value[:, t] += phi * value[:, t - 1]
        return value.reshape(len(value), -1).take(
            self.frame * len(self.ids) + self.column, axis=1
        )

    def lasting(
        self,
        memories: Parameter,
        neighbours: Neighbours | None,
        draws: Draws,
        kinds: Kinds,
    ) -> Floats:
        """Standard normal numbers ``[m, R]`` of m kinds: a constant part and an autoregressive one.

        ``memories``: `shares_of` each kind. The numbers are shared with neighbours, if any.
        """
        bias, phi, shared, _ = self.of_noise(memories).T
        series = self.autoregression(phi, draws, kinds)
        constant = self.constant(
            draws,
            kinds,
            lambda keys: ndtri(draws.uniforms(parts(Component.BIAS, *kinds), keys)),
        )
        constant = np.sqrt(bias).take(self.noise_number, axis=1) * constant
        value = (
            constant.take(self.column, axis=1)
            + np.sqrt(1 - bias).take(self.row_noise, axis=1) * series
        )
        return (
            value
            if neighbours is None
            else neighbours.mixed(value, shared.take(self.row_noise, axis=1))
        )

    def with_new(self, lasting: Floats, new: Floats, memories: Parameter) -> Floats:
        """Numbers ``[m, R]`` of `lasting` with their share of ``new`` ones in every frame."""
        share = self.of_noise(memories).T[3]
        old = np.sqrt(1 - share).take(self.row_noise, axis=1) * lasting
        return np.asarray(old + np.sqrt(share).take(self.row_noise, axis=1) * new)


def shares_of(memory: SharedMemory) -> Shares:
    """Constant share of the lasting part, phi, weight of a neighbour at distance 0, and share of the new part."""
    lasting = (
        memory.bias + memory.ar
    )  # the rounded shares of a profile may not sum to 1
    return (
        memory.bias / max(lasting, _TINY),
        memory.phi,
        memory.shared,
        memory.white / (lasting + memory.white),
    )


def truth_grid(
    truth: Truth,
    noise: Sequence[ClassNoise],
    steps: float,
    memory: Memory | None = None,
) -> Grid:
    """Grid of a truth; ``noise`` is that of each class index; ``memory``: of its last frame, which alone has rows."""
    distinct = kept(
        memory,
        "noise",
        lambda: tuple(one for i, one in enumerate(noise) if one not in noise[:i]),
    )
    number = kept(
        memory, "number", lambda: np.array([distinct.index(one) for one in noise])
    )
    if memory is None:
        ids, first, column = np.unique(
            truth.object_id, return_index=True, return_inverse=True
        )
        number = number[truth.class_id[first]]
        return Grid(
            truth.frames, ids, truth.frame_of_rows, column, distinct, number, steps
        )
    rows, objects = truth.object_id.tolist(), memory.objects
    for object_id, class_id in zip(rows, truth.class_id.tolist(), strict=True):
        objects.setdefault(object_id, (len(objects), memory.frame, class_id))
    column = np.array([objects[object_id][0] for object_id in rows], dtype=np.int64)
    _, since, class_ids = (
        np.array(list(objects.values()), dtype=np.int64).reshape(-1, 3).T
    )
    lives, ids = (
        (since, np.full(len(since), memory.frame + 1)),
        np.array(list(objects), dtype=np.int64),
    )
    frame = np.full(len(rows), memory.frame)
    return Grid(
        truth.frames,
        ids,
        frame,
        column,
        distinct,
        number[class_ids],
        steps,
        lives,
        memory,
    )


def truth_neighbours(grid: Grid, place: Floats, length: float) -> Neighbours:
    """Neighbours within ``length`` m of rows at ``place`` ``[R, 2]``, in the same frame and with the same noise."""
    moment = grid.frame * len(grid.noise) + grid.noise_number[grid.column]
    return Neighbours.within(length, place, moment, grid.ids[grid.column])

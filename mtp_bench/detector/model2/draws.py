"""Random numbers by what they are for: the seed, the kind of noise, the object, the frame.

Each number is a hash of these. So neither the order of objects nor the presence of others changes any number.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...types import Bools, Floats, Ints, Truth
from ..chains import decayed
from .neighbours import Neighbours, neighbours_of
from .profile import ClassNoise, Shared

_GOLDEN, _FIRST, _SECOND = (np.uint64(n) for n in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB))
Keys = NDArray[np.uint64]  # what numbers are drawn for

_MODEL = 2  # keeps the streams apart from those of model 1
_TINY = 1e-12
_SHIFTS = np.uint64(30), np.uint64(27), np.uint64(31)
_LOW = np.uint64(11)  # bits that a float has no room for


class Kind(IntEnum):
    """Kinds of noise; the numbers are part of every hash and never change their meaning."""

    QUALITY = 0
    RADIAL = 1
    TANGENTIAL = 2
    HEADING = 3
    FLIP = 4
    SIZE = 5
    Z = 6
    VELOCITY = 7
    PLACE = 8
    SCENE = 9
    BIRTH = 10
    LIFE = 11
    CLASS = 12
    FAMILY = 13
    LAPSE = 14
    TAIL = 15


class Whose(IntEnum):
    """Whose noise is drawn: each has numbers of its own; these stay too."""

    OBJECTS = 0
    NEAR = 1
    FREE = 2


class Part(IntEnum):
    """What a number is within its kind."""

    BIAS = 0
    PUSH = 1
    WHITE = 2
    OTHER = 3


@dataclass(frozen=True)
class Draws:
    """The random numbers of a scene."""

    seed: int
    whose: Whose = Whose.OBJECTS
    number: int = 0  # which noise of the profile free false positives have; 0 for everything else

    @cached_property
    def _key(self) -> int:
        words = [self.seed, _MODEL, int(self.whose), self.number]
        return int(np.random.SeedSequence(words).generate_state(1, np.uint64)[0])

    def stream(self, kind: Kind) -> np.random.Generator:
        """A generator, for what belongs to the scene as a whole."""
        return np.random.default_rng([self.seed, _MODEL, int(self.whose), self.number, int(kind)])

    def uniform(self, kind: Kind, part: int, where: Keys) -> Floats:
        """Numbers in (0, 1), one for each key of `keys_of`."""
        own = self._key + (64 * int(kind) + part + 1) * int(_GOLDEN)
        bits = _mixed(where + _mixed(np.array([own % 2**64], dtype=np.uint64)))
        bits >>= _LOW
        number = bits.astype(np.float64)
        number += 0.5
        number *= 2.0**-53
        return number

    def normal(self, kind: Kind, part: int, where: Keys) -> Floats:
        """Standard normal numbers, as `uniform`."""
        from scipy.special import ndtri

        return np.asarray(ndtri(self.uniform(kind, part, where)))


def keys_of(*index: Ints | Keys) -> Keys:
    """A key for each tuple of whole numbers, of a common shape; further numbers may be added to a key."""
    state = np.zeros(1, dtype=np.uint64)
    for one in index:
        state = further(state, one)
    return state


def further(key: Keys, index: Ints | Keys) -> Keys:
    """The key of `keys_of` for one more number."""
    return _mixed(key + (np.asarray(index).astype(np.uint64) * _GOLDEN + _GOLDEN))


def _mixed(state: Keys) -> Keys:
    """Every bit of the result depends on every bit of ``state``, which is lost (the finaliser of SplitMix64)."""
    for shift, factor in ((_SHIFTS[0], _FIRST), (_SHIFTS[1], _SECOND)):
        state ^= state >> shift
        state *= factor
    state ^= state >> _SHIFTS[2]
    return state


@dataclass(frozen=True, eq=False)
class Grid:
    """Rows of boxes in F frames of J objects, and the noise of each."""

    frames: int
    ids: Ints  # [J] ascending
    frame: Ints  # [R]
    column: Ints  # [R] object of every row
    noise: tuple[ClassNoise, ...]
    of_noise: Ints  # [J] index of each object's noise
    steps: float  # frame periods of the profile per frame of the scene
    lives: tuple[Ints, Ints] | None = None  # [J] first frame and the one after the last; None: those of the rows

    @property
    def id_of_rows(self) -> Ints:
        """The object's id ``[R]``."""
        return self.ids[self.column]

    @cached_property
    def of_ids(self) -> Keys:
        """Keys of the objects ``[J]``."""
        return keys_of(self.ids)

    @cached_property
    def of_frames(self) -> Keys:
        """Keys of object and frame of every row ``[R]``."""
        return further(self.of_ids[self.column], self.frame)

    def of_objects(self, parameter: Callable[[ClassNoise], float | Sequence[float]]) -> Floats:
        """A parameter of every object's noise: ``[J]``, or ``[J, n]`` if it has n components."""
        return np.array([parameter(noise) for noise in self.noise], dtype=np.float64)[self.of_noise]

    def of_rows(self, parameter: Callable[[ClassNoise], float | Sequence[float]]) -> Floats:
        """The same for every row: ``[R]`` or ``[R, n]``."""
        return self.of_objects(parameter)[self.column]

    def by_noise(self) -> list[tuple[ClassNoise, Ints]]:
        """Each noise, and the rows that have it."""
        of_rows = self.of_noise[self.column]
        return [(noise, np.flatnonzero(of_rows == number)) for number, noise in enumerate(self.noise)]

    def of_these(self, row: Ints) -> Grid:
        """The grid of some rows, without the objects that have none of them."""
        old = self.column[row]
        kept = np.bincount(old, minlength=len(self.ids)) > 0
        used, column = np.flatnonzero(kept), (np.cumsum(kept) - 1)[old]
        frame, end = self.frame[row], np.zeros(len(used), dtype=np.int64)
        end[column] = frame + 1  # rows of an object are in the order of frames
        lives = self.span[0][used], end  # memory begins where it did, and what comes later does not matter
        return replace(self, ids=self.ids[used], frame=frame, column=column, of_noise=self.of_noise[used], lives=lives)

    @cached_property
    def span(self) -> tuple[Ints, Ints]:
        """First frame of every object and the one after its last ``[J]``."""
        if self.lives is not None:
            return self.lives
        first, end = np.full(len(self.ids), self.frames), np.zeros(len(self.ids), dtype=np.int64)
        first[self.column[::-1]] = self.frame[::-1]  # an object's rows are in the order of frames: the last one stays
        end[self.column] = self.frame + 1
        return first, end

    @cached_property
    def cells(self) -> tuple[Ints, Ints]:
        """Frames and objects of all cells of the grid from each object's first to its last frame."""
        first, end = self.span
        frame = np.arange(self.frames)[:, None]
        frame, column = ((frame >= first) & (frame < end)).nonzero()
        return frame, column

    @cached_property
    def _at_cells(self) -> Ints:
        """Where the `cells` are on the grid as one row of numbers."""
        frame, column = self.cells
        return np.asarray(frame * len(self.ids) + column)

    @cached_property
    def _at_rows(self) -> Ints:
        """Where the rows are on the grid as one row of numbers ``[R]``."""
        return np.asarray(self.frame * len(self.ids) + self.column)

    @cached_property
    def _begins(self) -> Bools:
        """Which of the `cells` are the first of their objects."""
        frame, column = self.cells
        return np.asarray(frame == self.span[0][column])

    @cached_property
    def of_cells(self) -> Keys:
        """Keys of object and frame of all `cells`."""
        frame, column = self.cells
        return further(self.of_ids[column], frame)

    def lasting(self, bias: Floats, phi: Floats, draws: Draws, kind: Kind) -> Floats:
        """Standard normal numbers ``[R]``: a share ``bias`` [J] of object bias, else autoregression with ``phi``."""
        series = self.series(phi, draws, kind)
        constant = np.sqrt(bias) * draws.normal(kind, Part.BIAS, self.of_ids)
        return np.asarray(constant[self.column] + np.sqrt(1 - bias)[self.column] * series)

    def series(self, phi: Floats, draws: Draws, kind: Kind) -> Floats:
        """Autoregressive standard normal numbers ``[R]``, with ``phi`` [J] from frame to frame of the profile."""
        return self.series_of(phi, draws.normal(kind, Part.PUSH, self.of_cells))

    def series_of(self, phi: Floats, push: Floats) -> Floats:
        """The same from standard normal numbers for all `cells`."""
        phi = decayed(phi, self.steps)
        scale = np.sqrt(1.0 - phi**2)[self.cells[1]]
        scale[self._begins] = 1.0
        value = self.spread(push * scale)
        for t in range(1, self.frames):
            value[t] += phi * value[t - 1]
        return self.of_rows_in(value)

    def spread(self, value: Floats) -> Floats:
        """Numbers of the `cells` on the whole grid ``[F, J]``, 0 elsewhere."""
        spread = np.zeros(self.frames * len(self.ids))
        spread[self._at_cells] = value
        return spread.reshape(self.frames, len(self.ids))

    def of_rows_in(self, value: Floats) -> Floats:
        """What the rows have of numbers ``[F, J]``: ``[R]``."""
        return value.ravel()[self._at_rows]

    def latent(
        self, memory: Callable[[ClassNoise], Shared], neighbours: Neighbours, draws: Draws, kind: Kind
    ) -> Floats:
        """Standard normal numbers ``[R]`` that last, and are shared with neighbours as far as they last."""
        bias, ar, phi, white, shared = self.of_objects(
            lambda n: (memory(n).bias, memory(n).ar, memory(n).phi, memory(n).white, memory(n).shared)
        ).T
        lasting = self.lasting(bias / np.maximum(bias + ar, _TINY), phi, draws, kind)
        lasting = neighbours.shared(lasting, shared[self.column])
        new = draws.normal(kind, Part.WHITE, self.of_frames)
        share = (white / (bias + ar + white))[self.column]  # the rounded shares of a profile may not sum to 1
        return np.asarray(np.sqrt(1 - share) * lasting + np.sqrt(share) * new)


def grid_of(truth: Truth, noise: Sequence[ClassNoise], steps: float) -> Grid:
    """The grid of a truth whose ``class_id`` is an index into ``noise``."""
    ids, first, column = np.unique(truth.object_id, return_index=True, return_inverse=True)
    kinds: list[ClassNoise] = []
    for one in noise:
        if one not in kinds:
            kinds.append(one)
    of_noise = np.array([kinds.index(one) for one in noise])[truth.class_id[first]]
    return Grid(truth.frames, ids, truth.frame_of_rows, column, tuple(kinds), of_noise, steps)


def neighbours_in(grid: Grid, place: Floats, length: float) -> Neighbours:
    """Neighbours within ``length`` m of rows at ``place`` ``[R, 2]``: of one frame and with the same noise."""
    moment = grid.frame * len(grid.noise) + grid.of_noise[grid.column]
    return neighbours_of(place, moment, grid.id_of_rows, length)

"""Random numbers of a scene: one stream per kind of noise, memory over frames, and the grid they are drawn on.

The grid has a number for every frame and object, so that changing one kind of noise leaves every other draw alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ...types import Floats, Ints, Truth
from ..chains import decayed
from ..sections import Memory
from .profile import ClassNoise

ScalarT = TypeVar("ScalarT", bound=np.generic)


class Kind(IntEnum):
    """Kinds of noise; the numbers are part of every seed and never change their meaning."""

    UNDETECTED = 0
    RADIAL = 1
    TANGENTIAL = 2
    HEADING = 3
    FLIP = 4
    SIZE = 5
    Z = 6
    SCORE = 7
    VELOCITY = 8
    DUPLICATE = 9
    FALSE_SCENE = 10
    FALSE_BIRTH = 11
    FALSE_LIFE = 12
    FALSE_PLACE = 13
    FALSE_HEADING = 14
    FALSE_SIZE = 15
    FALSE_CLASS = 16


class Whose(IntEnum):
    """Whose errors are drawn: each has its own streams of the kinds `RADIAL` to `VELOCITY`; the numbers stay too."""

    OBJECTS = 0
    DUPLICATES = 100
    FALSE_POSITIVES = 200


@dataclass(frozen=True)
class Streams:
    """The generators of a scene, or of the errors of some boxes."""

    seed: int
    whose: Whose = Whose.OBJECTS
    number: int = 0  # which noise of the profile false positives have; 0 for everything else

    def of(self, kind: Kind) -> np.random.Generator:
        """The generator of one kind of noise."""
        return np.random.default_rng([self.seed, int(kind) + int(self.whose), self.number])


def autoregression(phi: Floats, normal: Floats) -> Floats:
    """Stationary AR(1) processes of variance 1 ``[F, J]`` from ``phi`` ``[J]`` and standard normals ``[F, J]``."""
    value = np.asarray(normal * np.sqrt(1.0 - phi**2))
    value[:1] = normal[:1]
    for t in range(1, len(value)):
        value[t] += phi * value[t - 1]
    return value


@dataclass(frozen=True, eq=False)
class Grid:
    """F frames by J objects, the objects in ascending order of their ids."""

    frames: int
    objects: int
    frame: Ints  # [R] frame of every row of the truth
    column: Ints  # [R] object of every row
    noise: tuple[ClassNoise, ...]  # per class
    object_class: Ints  # [J] that of the object's first row
    steps: float  # frame periods of the profile per frame of the scene

    @property
    def shape(self) -> tuple[int, int]:
        """F and J."""
        return self.frames, self.objects

    def of_objects(self, parameter: Callable[[ClassNoise], float | Sequence[float]]) -> Floats:
        """A parameter of every object's class: ``[J]``, or ``[J, n]`` if it has n components."""
        return np.array([parameter(noise) for noise in self.noise], dtype=np.float64)[self.object_class]

    def of_rows(self, parameter: Callable[[ClassNoise], float | Sequence[float]]) -> Floats:
        """The same for every row of the truth: ``[R]`` or ``[R, n]``."""
        return self.of_objects(parameter)[self.column]

    def rows_of(self, values: NDArray[ScalarT]) -> NDArray[ScalarT]:
        """What the rows of the truth have of ``values`` ``[F, J, ...]``: ``[R, ...]``."""
        return values[self.frame, self.column]

    def latent(self, memory: Callable[[ClassNoise], Memory], rng: np.random.Generator) -> Floats:
        """Standard normal numbers with memory for every row ``[R]``: object bias, autoregression and white share."""
        bias, pushes, white = (rng.standard_normal(shape) for shape in (self.objects, self.shape, self.shape))
        shares = self.of_objects(lambda noise: (memory(noise).bias, memory(noise).ar, memory(noise).white))
        of_bias, of_ar, of_white = np.sqrt(shares / shares.sum(1, keepdims=True)).T
        phi = decayed(self.of_objects(lambda noise: memory(noise).phi), self.steps)
        return self.rows_of(of_bias * bias + of_ar * autoregression(phi, pushes) + of_white * white)


def grid_of(truth: Truth, noise: Sequence[ClassNoise], steps: float) -> Grid:
    """The grid of a truth whose ``class_id`` is an index into ``noise``."""
    ids, first, column = np.unique(truth.object_id, return_index=True, return_inverse=True)
    return Grid(truth.frames, len(ids), truth.frame_of_rows, column, tuple(noise), truth.class_id[first], steps)

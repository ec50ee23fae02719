"""The (frame, object) grid that noise is drawn on, and the noise parameters of its objects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..types import Floats, Ints, Truth
from .chains import autoregression, decayed
from .profile import ClassNoise, Memory
from .sight import frame_of_rows

ScalarT = TypeVar("ScalarT", bound=np.generic)


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
        taken: NDArray[ScalarT] = values[self.frame, self.column]
        return taken

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
    frame = frame_of_rows(truth.start)
    return Grid(len(truth.start) - 1, len(ids), frame, column, tuple(noise), truth.class_id[first], steps)

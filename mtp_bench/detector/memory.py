"""Memory of a scene that is detected frame by frame."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from ..core import Floats
from .draws import Keys

ResultT = TypeVar("ResultT")


@dataclass(eq=False)
class Memory:
    """State of a scene that is detected frame by frame.

    It keeps the random numbers of earlier frames, so that they are drawn only once.
    """

    frame: int = -1  # the one that is detected
    # column, first frame, class index, by id
    objects: dict[int, tuple[int, int, int]] = field(default_factory=dict)
    # last numbers, by column, of subjects and kinds
    series: dict[Any, Floats] = field(default_factory=dict)
    # results that do not change, by name
    results: dict[Any, Any] = field(default_factory=dict)

    def previous(self, name: Any, shape: tuple[int, ...]) -> Floats:
        """Return the numbers of ``name`` in the frame before.

        New columns, up to ``shape``, are filled with 0.
        """
        numbers = np.zeros(shape)
        if name in self.series:
            stored = self.series[name]
            numbers[..., : stored.shape[-1]] = stored
        return numbers

    def grown(self, name: Any, keys: Keys, make: Callable[[Keys], Floats]) -> Floats:
        """Return numbers of objects, on the last axis.

        ``make`` draws them by the keys of objects [J], of new objects alone.
        """
        numbers = remembered(self, name, lambda: make(keys))
        count = numbers.shape[-1]
        if count < len(keys):
            numbers = np.concatenate([numbers, make(keys[count:])], axis=-1)
            self.results[name] = numbers
        return numbers


def remembered(
    memory: Memory | None, name: Any, make: Callable[[], ResultT]
) -> ResultT:
    """Return the result of ``make``.

    A memory stores it under ``name``, so that later calls do not make it again.
    """
    if memory is None:
        return make()
    if name not in memory.results:
        memory.results[name] = make()
    result: ResultT = memory.results[name]
    return result

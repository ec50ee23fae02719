"""A Box that is no continuous control.

Gymnasium's checker asks every one-dimensional Box of an action space to lie in [-1, 1]. Ids and log-weights cannot, so
they have a space of their own, which Gymnasium treats as a Box everywhere else.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.spaces import utils as flattening
from gymnasium.vector import utils as batching
from numpy.typing import DTypeLike, NDArray


class Numbers(spaces.Space[NDArray[Any]]):
    """Arrays of ``shape`` with entries from ``low`` to ``high``."""

    def __init__(
        self, low: float, high: float, shape: tuple[int, ...], dtype: DTypeLike, seed: int | None = None
    ) -> None:
        self._box = spaces.Box(low, high, shape, np.dtype(dtype).type)
        self.low, self.high = self._box.low, self._box.high
        super().__init__(shape, self._box.dtype, seed)

    @property
    def is_np_flattenable(self) -> bool:
        """True, as for a Box."""
        return True

    def seed(self, seed: int | None = None) -> int | list[int] | dict[str, int]:
        """Seed the random draws."""
        return self._box.seed(seed)

    def sample(self, mask: Any | None = None, probability: Any | None = None) -> NDArray[Any]:
        """A random element, drawn as from a Box."""
        return self._box.sample(mask, probability)

    def contains(self, x: Any) -> bool:
        """Whether ``x`` has the shape, the type and the range."""
        return self._box.contains(x)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Numbers) and self._box == other._box

    def __hash__(self) -> int:
        return hash((self.shape, str(self.dtype)))

    def __repr__(self) -> str:
        return self._box.__repr__().replace("Box", "Numbers")


_SINGLE_DISPATCH: tuple[Any, ...] = (
    batching.batch_space,
    batching.concatenate,
    batching.create_empty_array,
    batching.iterate,
    flattening._flat_dtype,
    flattening.flatdim,
    flattening.flatten,
    flattening.flatten_space,
    flattening.unflatten,
)
for _function in _SINGLE_DISPATCH:
    _function.register(Numbers, _function.dispatch(spaces.Box))

"""Signs: statistics of a recording, each of which a limit turns into a doubt."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..core import Bools, Floats, Ints
from .recording import NEVER, RecordedScene

Undo = Callable[[RecordedScene], RecordedScene]


@dataclass(frozen=True, eq=False)
class Sign:
    """A statistic of a recording."""

    kind: str  # key of `kinds.toml`
    value: float  # that is compared with the limit
    size: float = np.nan  # in the unit of the kind; NaN: the value
    variant: str = ""  # in words, such as a unit or a direction
    names: tuple[str, str] = ("", "")  # true class and detected class
    values: tuple[float, ...] = ()  # parameters of a fit
    first: int = NEVER  # first frame that it touches; `NEVER`: all
    last: int = NEVER
    object_id: int = NEVER
    other_id: int = NEVER
    before: float = np.nan  # misfit, in [0, 1]; NaN: it is not fitted
    after: float = np.nan  # misfit when undone
    undo: Undo | None = None

    @property
    def stated_size(self) -> float:
        """Size in the unit of the kind."""
        return self.value if np.isnan(self.size) else self.size


def mean_of_others(values: Floats | Bools, object_id: Ints) -> float:
    """Return the mean of values [n] without the object whose sum is largest.

    A fault of a recording shows in more than one object. 0 without a second one.
    """
    _, number, rows = np.unique(object_id, return_inverse=True, return_counts=True)
    if len(rows) < 2:
        return 0.0
    sums = np.bincount(number, values)
    largest = sums.argmax()
    return float((sums.sum() - sums[largest]) / (rows.sum() - rows[largest]))

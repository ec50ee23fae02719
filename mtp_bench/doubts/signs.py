"""Signs: statistics of a recording, each of which a limit turns into a doubt."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

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

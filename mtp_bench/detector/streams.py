"""One stream of random numbers per kind of noise, so that changing one level leaves every other draw alone."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np


class Kind(IntEnum):
    """Kinds of noise; the numbers are part of every seed and never change their meaning."""

    MISS = 0
    RADIAL = 1
    TANGENTIAL = 2
    HEADING = 3
    FLIP = 4
    SIZE = 5
    Z = 6
    SCORE = 7
    VELOCITY = 8
    DUPLICATE = 9
    CLUTTER_SCENE = 10
    CLUTTER_BIRTH = 11
    CLUTTER_LIFE = 12
    CLUTTER_PLACE = 13
    CLUTTER_HEADING = 14
    CLUTTER_SIZE = 15
    CLUTTER_CLASS = 16


class Whose(IntEnum):
    """Whose errors are drawn: each has its own streams of the kinds `RADIAL` to `VELOCITY`; the numbers stay too."""

    OBJECTS = 0
    DUPLICATES = 100
    CLUTTER = 200


@dataclass(frozen=True)
class Streams:
    """The generators of the errors of some boxes."""

    seed: int
    whose: Whose = Whose.OBJECTS
    number: int = 0  # which noise of the profile clutter has; 0 for everything else

    def of(self, kind: Kind) -> np.random.Generator:
        """The generator of one kind of error."""
        return np.random.default_rng([self.seed, int(kind) + int(self.whose), self.number])


def stream(seed: int, kind: Kind, number: int = 0) -> np.random.Generator:
    """The generator of one kind of noise; clutter has one for each noise of the profile too."""
    return np.random.default_rng([seed, int(kind), number])

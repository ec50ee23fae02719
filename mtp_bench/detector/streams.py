"""One stream of random numbers per kind of noise, so that changing one level leaves every other draw alone."""

from __future__ import annotations

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
    CLUTTER_SCORE = 16
    CLUTTER_VELOCITY = 17


def stream(seed: int, kind: Kind, class_id: int = 0) -> np.random.Generator:
    """The generator of one kind of noise; clutter has one for each class too."""
    return np.random.default_rng([seed, int(kind), class_id])

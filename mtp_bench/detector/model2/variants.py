"""Variants of a profile of model 2: without memory, and harder."""

from __future__ import annotations

from typing import Any

from ..sections import more
from .profile import ClassNoise, FreeGhosts, PositionNoise

LOWER = 0.6  # the quality of all objects is lower: log-odds of being undetected about + 1
_NEW = {"bias": 0.0, "ar": 0.0, "phi": 0.0, "white": 1.0}


def without_memory(noise: ClassNoise) -> ClassNoise:
    """The same recall, scores and margins of the errors; every frame of an object is drawn anew and by itself."""
    quality = noise.quality
    alone = {**_NEW, "shared": 0.0}
    lapses = quality.lapses.model_copy(update={"bias": 0.0, "phi": 0.0, "shared": 0.0})
    changed: dict[str, Any] = {
        "quality": quality.model_copy(update={**alone, "lapses": lapses}),
        "radial": noise.radial.model_copy(update=alone),
        "tangential": noise.tangential.model_copy(update=alone),
        "heading": noise.heading.without_memory(),
        "size": noise.size.model_copy(update={"white": 1.0}),
        "free": None if noise.free is None else noise.free.model_copy(update={**_NEW, "survive": 0.0}),
        "near": None if noise.near is None else noise.near.model_copy(update=_NEW),
    }
    return noise.model_copy(update=changed)


def harder(noise: ClassNoise, worse: float) -> ClassNoise:
    """Lower quality; position errors and false positives x ``worse``."""
    location = noise.quality.location
    lower = noise.quality.model_copy(update={"location": (location[0] - LOWER, *location[1:])})
    free, near = noise.free, noise.near
    changed: dict[str, Any] = {
        "quality": lower,
        "radial": _wider(noise.radial, worse),
        "tangential": _wider(noise.tangential, worse),
        "free": None if free is None else _more(free, worse),
        "near": None if near is None else near.model_copy(update={"chance": min(worse * near.chance, 1.0)}),
    }
    return noise.model_copy(update=changed)


def _more(free: FreeGhosts, factor: float) -> FreeGhosts:
    return free.model_copy(update=more(free.rate, free.dispersion, factor))


def _wider(axis: PositionNoise, worse: float) -> PositionNoise:
    return axis.model_copy(update={"s0": worse * axis.s0, "s1": worse * axis.s1})

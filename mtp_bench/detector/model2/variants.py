"""Variants of a profile of model 2: without memory, and harder."""

from __future__ import annotations

from typing import Any

from ..draws import stationary_share
from ..profile import HeadingNoise
from .profile import ClassNoise2, FreeGhosts, PositionNoise2

LOWER = 0.6  # the quality of all objects is lower: log-odds of being undetected about + 1
_NEW = {"bias": 0.0, "ar": 0.0, "phi": 0.0, "white": 1.0}


def without_memory(noise: ClassNoise2) -> ClassNoise2:
    """The same recall, scores and margins of the errors; every frame of an object is drawn anew and by itself."""
    quality = noise.quality
    alone = {**_NEW, "shared": 0.0}
    lapses = quality.lapses.model_copy(update={"bias": 0.0, "phi": 0.0, "shared": 0.0})
    changed: dict[str, Any] = {
        "quality": quality.model_copy(update={**alone, "lapses": lapses}),
        "radial": noise.radial.model_copy(update=alone),
        "tangential": noise.tangential.model_copy(update=alone),
        "heading": _flips_without_memory(noise.heading),
        "size": noise.size.model_copy(update={"white": 1.0}),
        "free": None if noise.free is None else noise.free.model_copy(update={**_NEW, "survive": 0.0}),
        "near": None if noise.near is None else noise.near.model_copy(update=_NEW),
    }
    return noise.model_copy(update=changed)


def harder(noise: ClassNoise2, worse: float) -> ClassNoise2:
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


def _flips_without_memory(heading: HeadingNoise) -> HeadingNoise:
    share = stationary_share(heading.flip, heading.flip_again)
    return heading.model_copy(update={"flip": share, "flip_again": share})


def _more(free: FreeGhosts, factor: float) -> FreeGhosts:
    """How much scenes differ, relatively, stays."""
    dispersion = 1.0 + factor * (free.dispersion - 1.0)
    return free.model_copy(update={"rate": factor * free.rate, "dispersion": dispersion})


def _wider(axis: PositionNoise2, worse: float) -> PositionNoise2:
    return axis.model_copy(update={"s0": worse * axis.s0, "s1": worse * axis.s1})

"""Variants of a profile: without memory, and harder."""

from __future__ import annotations

from typing import Any, TypeVar, cast

from ..strict import Section
from .model1.profile import ClassNoise as ClassNoise1
from .model1.profile import PositionNoise as PositionNoise1
from .model1.profile import Profile1
from .model2.profile import ClassNoise, PositionNoise, Profile
from .sections import Variant, more

WORSE = 2.0  # factor on position errors and on false positives
MISSES = 1.0  # model 1: added to the log-odds that an object is undetected
LOWER = 0.6  # model 2: the quality of all objects is lower, log-odds of being undetected about + 1
_WHITE = {"bias": 0.0, "ar": 0.0, "white": 1.0}
_ALONE = {**_WHITE, "phi": 0.0}

ProfileT = TypeVar("ProfileT", bound=Profile | Profile1)


def with_variant(profile: ProfileT, variant: Variant) -> ProfileT:
    """``profile`` itself, or one named "<name>-iid" or "<name>-hard".

    "iid": the same recall and margins without memory: every frame of an object is drawn anew. "hard": log-odds of
    being undetected + 1, about; position errors x 2, false positives x 2.
    """
    if variant == "as_fitted":
        return profile
    changes = _without_memory if variant == "iid" else _harder
    classes = {name: noise.model_copy(update=changes(noise)) for name, noise in profile.classes.items()}
    changed = profile.model_copy(update={"name": f"{profile.name}-{variant}", "classes": classes})
    return cast("ProfileT", changed)


def _without_memory(noise: ClassNoise | ClassNoise1) -> dict[str, Any]:
    """What changes of a noise so that every frame of an object is drawn anew and by itself."""
    always = {"heading": noise.heading.without_memory(), "size": _with(noise.size, {"white": 1.0})}
    if isinstance(noise, ClassNoise1):
        return {
            **always,
            "miss": _with(noise.miss, {"memory": False}),
            "radial": _with(noise.radial, _WHITE),
            "tangential": _with(noise.tangential, _WHITE),
            "score": _with(noise.score, _WHITE),
            "false_positives": _with(noise.false_positives, {"survive": 0.0}),
        }
    unshared = {**_ALONE, "shared": 0.0}
    lapses = _with(noise.quality.lapses, {"bias": 0.0, "phi": 0.0, "shared": 0.0})
    return {
        **always,
        "quality": _with(noise.quality, {**unshared, "lapses": lapses}),
        "radial": _with(noise.radial, unshared),
        "tangential": _with(noise.tangential, unshared),
        "free": _with(noise.free, {**_ALONE, "survive": 0.0}),
        "near": _with(noise.near, _ALONE),
    }


def _harder(noise: ClassNoise | ClassNoise1) -> dict[str, Any]:
    """What changes of a noise with more misses, larger position errors and more false positives."""
    wider = {"radial": _wider(noise.radial), "tangential": _wider(noise.tangential)}
    if isinstance(noise, ClassNoise1):
        first, later, false = noise.miss.first, noise.miss.later, noise.false_positives
        misses = {"first": (first[0] + MISSES, *first[1:]), "later": (later[0] + MISSES, *later[1:])}
        rate = {} if false is None else more(false.rate, false.dispersion, WORSE)
        return {**wider, "miss": _with(noise.miss, misses), "false_positives": _with(false, rate)}
    location, free, near = noise.quality.location, noise.free, noise.near
    return {
        **wider,
        "quality": _with(noise.quality, {"location": (location[0] - LOWER, *location[1:])}),
        "free": _with(free, {} if free is None else more(free.rate, free.dispersion, WORSE)),
        "near": _with(near, {} if near is None else {"chance": min(WORSE * near.chance, 1.0)}),
    }


def _wider(axis: PositionNoise | PositionNoise1) -> Section | None:
    return _with(axis, {"s0": WORSE * axis.s0, "s1": WORSE * axis.s1})


def _with(part: Section | None, figures: dict[str, Any]) -> Section | None:
    """A part of a noise with other figures; None stays."""
    return None if part is None else part.model_copy(update=figures)

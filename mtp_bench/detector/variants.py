"""Variants of a profile: without memory, and harder."""

from __future__ import annotations

from typing import TypeVar, cast

from .draws import stationary_share
from .false_positives import more_false_positives
from .model2.profile import ClassNoise2, Profile2
from .model2.variants import harder, without_memory
from .profile import ClassNoise, HeadingNoise, PositionNoise, Profile, UndetectedNoise, Variant

WORSE = 2.0  # factor on position errors and on false positives
HARDER = 1.0  # added to the log-odds that an object is undetected


ProfileT = TypeVar("ProfileT", bound=Profile | Profile2)


def with_variant(profile: ProfileT, variant: Variant) -> ProfileT:
    """``profile`` itself, or one named "<name>-iid" or "<name>-hard".

    "iid": the same recall and margins without memory: every frame of an object is drawn anew. "hard": log-odds of
    being undetected + 1, position errors x 2, false positives x 2.
    """
    if variant == "as_fitted":
        return profile
    classes = {name: _changed(noise, variant) for name, noise in profile.classes.items()}
    changed = profile.model_copy(update={"name": f"{profile.name}-{variant}", "classes": classes})
    return cast("ProfileT", changed)


def _changed(noise: ClassNoise | ClassNoise2, variant: Variant) -> ClassNoise | ClassNoise2:
    if isinstance(noise, ClassNoise2):
        return without_memory(noise) if variant == "iid" else harder(noise, WORSE)
    return _without_memory(noise) if variant == "iid" else _harder(noise)


def _without_memory(noise: ClassNoise) -> ClassNoise:
    white = {"bias": 0.0, "ar": 0.0, "white": 1.0}
    false = noise.false_positives
    return noise.model_copy(
        update={
            "miss": noise.miss.model_copy(update={"memory": False}),
            "radial": noise.radial.model_copy(update=white),
            "tangential": noise.tangential.model_copy(update=white),
            "heading": _flips_without_memory(noise.heading),
            "size": noise.size.model_copy(update={"white": 1.0}),
            "score": noise.score.model_copy(update=white),
            "false_positives": None if false is None else false.model_copy(update={"survive": 0.0}),
        }
    )


def _flips_without_memory(heading: HeadingNoise) -> HeadingNoise:
    share = stationary_share(heading.flip, heading.flip_again)
    return heading.model_copy(update={"flip": share, "flip_again": share})


def _harder(noise: ClassNoise) -> ClassNoise:
    false = noise.false_positives
    return noise.model_copy(
        update={
            "miss": _more_undetected(noise.miss),
            "radial": _wider(noise.radial),
            "tangential": _wider(noise.tangential),
            "false_positives": None if false is None else more_false_positives(false, WORSE),
        }
    )


def _more_undetected(miss: UndetectedNoise) -> UndetectedNoise:
    first, later = miss.first, miss.later
    return miss.model_copy(update={"first": (first[0] + HARDER, *first[1:]), "later": (later[0] + HARDER, *later[1:])})


def _wider(axis: PositionNoise) -> PositionNoise:
    return axis.model_copy(update={"s0": WORSE * axis.s0, "s1": WORSE * axis.s1})

"""Variants of a profile: without memory, and harder."""

from __future__ import annotations

from typing import TypeVar, cast

from .model1 import variants as model1
from .model1.profile import ClassNoise as ClassNoise1
from .model1.profile import Profile1
from .model2 import variants as model2
from .model2.profile import ClassNoise, Profile
from .sections import Variant

WORSE = 2.0  # factor on position errors and on false positives

ProfileT = TypeVar("ProfileT", bound=Profile | Profile1)


def with_variant(profile: ProfileT, variant: Variant) -> ProfileT:
    """``profile`` itself, or one named "<name>-iid" or "<name>-hard".

    "iid": the same recall and margins without memory: every frame of an object is drawn anew. "hard": log-odds of
    being undetected + 1, about; position errors x 2, false positives x 2.
    """
    if variant == "as_fitted":
        return profile
    classes = {name: _changed(noise, variant) for name, noise in profile.classes.items()}
    changed = profile.model_copy(update={"name": f"{profile.name}-{variant}", "classes": classes})
    return cast("ProfileT", changed)


def _changed(noise: ClassNoise | ClassNoise1, variant: Variant) -> ClassNoise | ClassNoise1:
    if isinstance(noise, ClassNoise1):
        return model1.without_memory(noise) if variant == "iid" else model1.harder(noise, WORSE)
    return model2.without_memory(noise) if variant == "iid" else model2.harder(noise, WORSE)

"""Variants of a profile: without memory, and harder."""

from typing import Any

import numpy as np

from ..strict import Section
from .draws import stationary
from .profile import ClassNoise, Profile, Variant

WORSE = 2.0  # factor on position errors and on false positives
LOWER = 0.6  # decrease of the quality of all objects; adds about 1 to the log-odds of being undetected
_NO_MEMORY = {"bias": 0.0, "ar": 0.0, "white": 1.0, "phi": 0.0}


def with_variant(profile: Profile, variant: Variant) -> Profile:
    """``profile`` itself, or a variant named "<name>-iid" or "<name>-hard".

    "iid": the same recall and error distributions without memory; "hard": lower quality, twice the position errors and
    false positives.
    """
    if variant == "as_fitted":
        return profile
    changes = _without_memory if variant == "iid" else _harder
    classes = {name: noise.model_copy(update=changes(noise)) for name, noise in profile.classes.items()}
    return profile.model_copy(update={"name": f"{profile.name}-{variant}", "classes": classes})


def _without_memory(noise: ClassNoise) -> dict[str, Any]:
    heading = noise.heading
    flips = float(stationary(np.asarray(heading.flip), np.asarray(heading.flip_again)))
    unshared = {**_NO_MEMORY, "shared": 0.0}
    lapses = _with(noise.quality.lapses, {"bias": 0.0, "phi": 0.0, "shared": 0.0})
    return {
        "heading": _with(heading, {"flip": flips, "flip_again": flips}),
        "size": _with(noise.size, {"white": 1.0}),
        "quality": _with(noise.quality, {**unshared, "lapses": lapses}),
        "radial": _with(noise.radial, unshared),
        "tangential": _with(noise.tangential, unshared),
        "free": _with(noise.free, {**_NO_MEMORY, "survive": 0.0}),
        "near": _with(noise.near, _NO_MEMORY),
    }


def _harder(noise: ClassNoise) -> dict[str, Any]:
    location, free, near = noise.quality.location, noise.free, noise.near
    # the relative difference between scenes stays
    dispersion = 1.0 if free is None else 1.0 + WORSE * (free.dispersion - 1.0)
    return {
        "radial": _with(noise.radial, {"s0": WORSE * noise.radial.s0, "s1": WORSE * noise.radial.s1}),
        "tangential": _with(noise.tangential, {"s0": WORSE * noise.tangential.s0, "s1": WORSE * noise.tangential.s1}),
        "quality": _with(noise.quality, {"location": (location[0] - LOWER, *location[1:])}),
        "free": _with(free, {} if free is None else {"rate": WORSE * free.rate, "dispersion": dispersion}),
        "near": _with(near, {} if near is None else {"chance": min(WORSE * near.chance, 1.0)}),
    }


def _with(part: Section | None, changes: dict[str, Any]) -> Section | None:
    """A part of a noise with other parameters; None stays None."""
    return None if part is None else part.model_copy(update=changes)

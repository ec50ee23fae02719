"""What profiles of both models have: kinds of numbers, memory, and the noise of headings and sizes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from ..errors import UnknownNameError
from ..strict import Section
from .chains import stationary

Variant = Literal["as_fitted", "iid", "hard"]
Share = Annotated[float, Field(ge=0, le=1)]
Scale = Annotated[float, Field(ge=0)]
Correlation = Annotated[float, Field(gt=-1, lt=1)]

_SIMILAR = {  # for profiles that do not know a class
    "cyclist": "bicycle", "bicycle": "motorcycle", "construction_vehicle": "truck"
}  # fmt: skip


class Memory(Section):
    """How a latent number is correlated over the frames of an object; the three shares of its variance sum to 1."""

    bias: Share  # constant over the object's life
    ar: Share  # autoregressive
    phi: Correlation  # of the autoregression, from frame to frame
    white: Share

    @field_validator("white")
    @classmethod
    def _shares_are_complete(cls, white: float, info: ValidationInfo) -> float:
        total = white + info.data.get("bias", 0.0) + info.data.get("ar", 0.0)
        if {"bias", "ar"} <= set(info.data) and abs(total - 1.0) > 0.01:
            raise ValueError(f"bias + ar + white is {total:.4g}, expected 1")
        return white


class HeadingNoise(Section):
    """Heading error: Student's t with 4 degrees of freedom, and turns by pi as a two-state Markov chain."""

    scale: Scale  # rad, robust standard deviation (1.4826 x median absolute deviation) of the unflipped error
    flip: Share  # chance of a flip after a frame without
    flip_again: Share  # chance of a flip after a flip

    def without_memory(self) -> HeadingNoise:
        """As many flips, each frame by itself."""
        share = float(stationary(np.asarray(self.flip), np.asarray(self.flip_again)))
        return self.model_copy(update={"flip": share, "flip_again": share})


class SizeNoise(Section):
    """Error of length, width, height: normal, constant over the object's life up to ``white``."""

    mean: Annotated[tuple[float, float, float], Field(strict=False)]  # m
    deviation: Annotated[tuple[float, float, float], Field(strict=False)]  # m
    white: Share = 0.1  # share of the variance that changes from frame to frame


def known_noise(alike: dict[str, str], info: ValidationInfo) -> dict[str, str]:
    """``alike`` of a profile; ValueError where it names a class without noise."""
    known: dict[str, object] = info.data.get("classes", {})
    for own in alike.values():
        if known and own not in known:
            raise ValueError(f"{own!r} has no noise; expected one of {', '.join(map(repr, known))}")
    return alike


def noise_name(class_name: str, classes: Mapping[str, object], alike: Mapping[str, str], profile: str) -> str:
    """The class whose noise a class has; raises UnknownNameError for what the profile does not know."""
    own = alike.get(class_name, class_name)
    if own not in classes and class_name in _SIMILAR:
        return noise_name(_SIMILAR[class_name], classes, alike, profile)
    if own not in classes:
        raise UnknownNameError(f"class of detector profile {profile!r}", class_name, [*classes, *alike])
    return own


def more(rate: float, dispersion: float, factor: float) -> dict[str, float]:
    """``factor`` times as many false positives; how much scenes differ, relatively, stays."""
    return {"rate": factor * rate, "dispersion": 1.0 + factor * (dispersion - 1.0)}

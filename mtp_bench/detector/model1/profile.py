"""Noise of model 1: fitted parameters per class, as stored in TOML without the key ``model``.

The model and its symbols are described in ``mtp_bench/detector/README.md``. Distances d are in units of 10 m from the
sensor; ``z`` is a latent standard normal number with a memory.
"""

from __future__ import annotations

import itertools
from typing import Annotated, ClassVar

from pydantic import Field, ValidationInfo, field_validator

from ...strict import Section
from ..sections import HeadingNoise, Memory, Scale, Share, SizeNoise, known_noise, noise_name

_EVENLY = tuple(round(2.0 + 5.8 * tenth, 1) for tenth in range(11))  # from 2 m to 60 m


class UndetectedNoise(Section):
    """Log-odds that an object is undetected."""

    first: Annotated[tuple[float, ...], Field(min_length=6, max_length=6, strict=False)]
    # of an object's first frame: 1, d, partly occluded, largely occluded, hidden, truncated
    later: Annotated[tuple[float, ...], Field(min_length=7, max_length=7, strict=False)]
    # the same, and: undetected in the frame before
    memory: bool = True  # False: every later frame is drawn with the long-run chance of that chain


class PositionNoise(Memory):
    """Position error along one axis: ``(s0 + s1 d) T_nu^-1(Phi(z))``, metres."""

    s0: Scale  # m
    s1: Scale  # m per 10 m
    nu: Annotated[float, Field(gt=1)]  # degrees of freedom of Student's t


class ScoreNoise(Memory):
    """Score of a detection: a normal number around ``quadratic(d)`` that ends at ``floor`` and ``ceiling``."""

    quadratic: Annotated[tuple[float, float, float], Field(strict=False)]  # constant, per d, per d^2
    deviation: Scale
    floor: float  # the operating point: the detector's output ends here
    ceiling: float | None = None  # e.g. 1 for probabilities

    @field_validator("ceiling")
    @classmethod
    def _is_above_the_floor(cls, ceiling: float | None, info: ValidationInfo) -> float | None:
        floor = info.data.get("floor")
        if ceiling is not None and floor is not None and ceiling <= floor:
            raise ValueError(f"expected more than the floor, {floor:g}")
        return ceiling


class FalsePositives(Section):
    """False positives: births are Poisson, with a rate that is Gamma distributed over scenes; survival is geometric."""

    rate: Scale  # false positives per frame over the profile's whole field of view
    dispersion: Annotated[float, Field(ge=1)]  # variance over mean of the count per frame
    survive: Annotated[float, Field(ge=0, lt=1)]  # chance that one is there in the next frame too
    score: float  # location and deviation of a normal number that ends at the detector's floor and ceiling
    score_deviation: Scale
    size: Annotated[tuple[float, float, float], Field(strict=False)]  # m, mean length, width, height
    distance: Annotated[tuple[Scale, ...], Field(min_length=11, max_length=11, strict=False)] = _EVENLY
    # m from the sensor: quantiles at 0, 10, ..., 100 %

    @field_validator("distance")
    @classmethod
    def _ascends(cls, distance: tuple[float, ...]) -> tuple[float, ...]:
        if any(far < near for near, far in itertools.pairwise(distance)):
            raise ValueError("expected ascending distances")
        return distance


class ClassNoise(Section):
    """All noise of one class."""

    miss: UndetectedNoise
    radial: PositionNoise
    tangential: PositionNoise
    heading: HeadingNoise
    size: SizeNoise
    score: ScoreNoise
    false_positives: FalsePositives | None = None
    velocity: Scale | None = None  # m/s per axis; None: velocities are not measured
    z: Annotated[tuple[float, float], Field(strict=False)] = (0.0, 0.0)  # m, height of the centre: mean, deviation
    duplicates: Share = 0.0  # chance that a detection comes twice


class Profile1(Section):
    """A detector by model 1: noise per class at one frame period."""

    model: ClassVar[int] = 1  # turns a profile into detections; part of every card's digest
    name: str
    summary: str
    source: str  # where the figures come from
    dt: Annotated[float, Field(gt=0)]  # s between frames at which the memory was fitted
    field_of_view: Annotated[float, Field(gt=0, le=360)] = 360.0  # degrees in which the false positives were counted
    classes: dict[str, ClassNoise]
    # Further classes and the class whose noise they have.
    alike: dict[str, str] = Field(default_factory=dict)

    _have_noise = field_validator("alike")(known_noise)

    def noise(self, class_name: str) -> ClassNoise:
        """Noise of a class, or of a similar one; raises UnknownNameError for what the profile does not know."""
        return self.classes[self.noise_name(class_name)]

    def noise_name(self, class_name: str) -> str:
        """The class whose noise a class has; raises UnknownNameError for what the profile does not know."""
        return noise_name(class_name, self.classes, self.alike, self.name)

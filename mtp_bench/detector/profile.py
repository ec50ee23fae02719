"""Parameters of a simulated detector, as stored in a profile file.

``README.md`` beside this file explains the model and its symbols. Distances d are in
units of 10 m.
"""

import itertools
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from ..core import Section, UnknownNameError, rule

QUANTILES = 11  # of distances, at `DISTANCE_RANKS`: 0, 10, ..., 100 %
DISTANCE_RANKS = np.linspace(0.0, 1.0, QUANTILES)
# ranks at which scores are stored: denser where scores are high
SCORE_RANKS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.98, 0.99, 0.997, 1.0)
DISTANCE_UNIT_M = 10.0  # of the distances d
SLOTS_PER_BOX = 2  # places beside every true box at which a false positive can appear
_SIMILAR = {  # class -> the one whose noise it has in profiles without the class
    "cyclist": "bicycle",
    "bicycle": "motorcycle",
    "construction_vehicle": "truck",
}
_ROUNDING = 0.01  # of a sum of shares
_ASCENDING = rule(
    lambda values: all(a <= b for a, b in itertools.pairwise(values)),
    "expected ascending numbers",
)
Variant = Literal["as_fitted", "iid"]
Share = Annotated[float, Field(ge=0, le=1)]
Scale = Annotated[float, Field(ge=0)]
Correlation = Annotated[float, Field(gt=-1, lt=1)]
Three = Annotated[tuple[float, float, float], Field(strict=False)]
Quantiles = Annotated[
    tuple[float, ...],
    Field(min_length=QUANTILES, max_length=QUANTILES, strict=False),
    _ASCENDING,
]
Curve = Annotated[tuple[float, ...], Field(min_length=2, strict=False), _ASCENDING]


class LatentMemory(Section):
    """Correlation of a latent number over the frames of an object.

    The three shares of its variance sum to 1.
    """

    bias: Share  # constant over the object's life
    ar: Share  # autoregressive
    phi: Correlation  # of the autoregression, from frame to frame
    white: Share  # new in every frame

    @field_validator("white")
    @classmethod
    def _shares_are_complete(cls, white: float, info: ValidationInfo) -> float:
        total = white + info.data.get("bias", 0.0) + info.data.get("ar", 0.0)
        if {"bias", "ar"} <= set(info.data) and abs(total - 1.0) > _ROUNDING:
            raise ValueError(f"bias + ar + white is {total:.4g}, expected 1")
        return white


class SharedMemory(LatentMemory):
    """Memory of a latent number whose lasting part is shared with close neighbours."""

    # weight of a neighbour at distance 0; the object itself has weight 1
    shared: Share = 0.0


class Lapses(Section):
    """The skewed part of the quality: close to 0, or a large loss that lasts."""

    # share of the variance of the random part of the quality
    share: Annotated[float, Field(ge=0, lt=1)]
    # share of the latent number that is constant over the object's life; the rest is
    # autoregressive
    bias: Share
    phi: Correlation  # of the autoregression, from frame to frame
    shared: Share  # weight of a neighbour at distance 0; the object itself has weight 1


class Quality(SharedMemory):
    """Quality of an object's detection in a frame.

    It decides the score and whether the object is detected.
    """

    # mean: 1, d, d^2, partly occluded, largely occluded, hidden, truncated; the random
    # part has variance 1
    location: Annotated[
        tuple[float, ...], Field(min_length=7, max_length=7, strict=False)
    ]
    lapses: Lapses
    latent: Curve  # qualities
    score: Curve  # their scores; linear between them
    floor: float  # operating point: detections with lower scores are not reported

    @field_validator("floor")
    @classmethod
    def _fits_the_curve(cls, floor: float, info: ValidationInfo) -> float:
        latent = info.data.get("latent", ())
        score = info.data.get("score", ())
        if len(latent) != len(score):
            raise ValueError(
                f"latent has {len(latent)} numbers and score {len(score)},"
                " expected as many of both"
            )
        if score and floor > score[-1]:
            raise ValueError(f"expected at most the highest score, {score[-1]:g}")
        return floor


class PositionNoise(SharedMemory):
    """Position error along one axis: ``(s0 + s1 d) exp(-quality q) H z``.

    q is the random part of the quality. H turns normal errors into Student's t; it
    lasts, and both axes have the same one.
    """

    s0: Scale  # m
    s1: Scale  # m per 10 m
    quality: float = 0.0  # decrease of the error with the quality


class HeadingNoise(Section):
    """Heading error: Student's t with 4 degrees of freedom, and turns by pi.

    The turns are a two-state Markov chain.
    """

    # rad, robust standard deviation (1.4826 x median absolute deviation) of the
    # unflipped error
    scale: Scale
    flip: Share  # chance of a flip after a frame without one
    flip_again: Share  # chance of a flip after a flip


class SizeNoise(Section):
    """Error of length, width and height: normal.

    All of it but the share ``white`` is constant over a life.
    """

    mean: Three  # m
    deviation: Three  # m
    white: Share = 0.1  # share of the variance that changes from frame to frame


class FalsePositives(LatentMemory):
    """False positives of one kind.

    Each has a lasting quality and is visible while that is high enough. The constant
    share ``bias`` of the quality is exponential: few are good, and those stay good.
    """

    # share of the frames of its life in which one is visible
    chance: Annotated[float, Field(gt=0, le=1)]
    # quantiles of scores of the visible ones, at the ranks `SCORE_RANKS`
    score: Quantiles


class FreeFalsePositives(FalsePositives):
    """False positives away from all objects: born in families, standing still."""

    rate: Scale  # visible per frame over the profile's whole field of view
    # variance over mean of the count per frame, as far as scenes differ
    dispersion: Annotated[float, Field(ge=1)]
    # chance to live on for another frame, visible or not
    survive: Annotated[float, Field(ge=0, lt=1)]
    siblings: Scale  # mean number born together with the first one of a family
    spread: Scale  # m, deviation of their places per axis
    family: Share  # share of the quality that siblings have in common
    size: Three  # m, mean length, width, height
    distance: Quantiles  # m from the sensor, at 0, 10, ..., 100 %


class NearFalsePositives(FalsePositives):
    """False positives that follow a true box.

    They are duplicates, shadows and boxes of a wrong class.
    """

    offset: Quantiles  # m from the centre of the true box, at 0, 10, ..., 100 %
    # share with the class of the object: within 0.75 m, within 1.5 m, beyond
    same: Annotated[tuple[Share, Share, Share], Field(strict=False)]
    # scores of those of the object's class within 0.75 m; None: same as all
    duplicates: Quantiles | None = None
    parent: Correlation = 0.0  # correlation of their quality with that of the object


class ClassNoise(Section):
    """All noise of one class."""

    quality: Quality
    radial: PositionNoise
    tangential: PositionNoise
    # degrees of freedom of Student's t, of both position errors
    nu: Annotated[float, Field(gt=1)]
    heading: HeadingNoise
    size: SizeNoise
    free: FreeFalsePositives | None = None
    near: NearFalsePositives | None = None
    velocity: Scale | None = None  # m/s per axis; None: velocities are not measured
    # m, height of the centre: mean, deviation
    z: Annotated[tuple[float, float], Field(strict=False)] = (0.0, 0.0)


class Profile(Section):
    """A detector: noise per class at one frame period."""

    name: str
    summary: str
    source: str  # data that the parameters were fitted to
    # stored detectors that it can replace
    stands_for: Annotated[tuple[str, ...], Field(strict=False)] = ()
    dt: Annotated[float, Field(gt=0)]  # s between frames at which the memory was fitted
    # degrees in which false positives were counted
    field_of_view: Annotated[float, Field(gt=0, le=360)] = 360.0
    # m; objects farther apart share no noise
    neighbours: Annotated[float, Field(gt=0)] = 20.0
    classes: dict[str, ClassNoise]
    # further classes and the class whose noise they have
    alike: dict[str, str] = Field(default_factory=dict)

    @field_validator("alike")
    @classmethod
    def _have_noise(cls, alike: dict[str, str], info: ValidationInfo) -> dict[str, str]:
        classes: dict[str, object] = info.data.get("classes", {})
        for name in alike.values():
            if classes and name not in classes:
                names = ", ".join(map(repr, classes))
                raise ValueError(f"{name!r} has no noise; expected one of {names}")
        return alike

    def noise(self, class_name: str) -> ClassNoise:
        """Return the noise of a class, or of a similar one.

        Raises UnknownNameError for an unknown class.
        """
        return self.classes[self.noise_name(class_name)]

    def noise_name(self, class_name: str) -> str:
        """Return the name of the class whose noise a class has.

        Raises UnknownNameError for an unknown class.
        """
        name = self.alike.get(class_name, class_name)
        if name in self.classes:
            return name
        if name in _SIMILAR:
            return self.noise_name(_SIMILAR[name])
        raise UnknownNameError(
            f"class of detector profile {self.name!r}",
            class_name,
            [*self.classes, *self.alike],
        )

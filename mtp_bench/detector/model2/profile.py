"""Noise of model 2: fitted parameters per class, as stored in TOML with ``model = 2``.

The model and its symbols are described in ``mtp_bench/detector/README.md``. Distances d are in units of 10 m.
"""

from __future__ import annotations

import itertools
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, ValidationInfo, field_validator

from ...strict import Section
from ..sections import Correlation, HeadingNoise, Memory, Scale, Share, SizeNoise, known_noise, noise_name

LOCATION = 7  # what the quality depends on: 1, d, d^2, partly, largely occluded, hidden, truncated
QUANTILES = 11  # of places: at 0, 10, ..., 100 %
RANKS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.98, 0.99, 0.997, 1.0)  # of scores, of which the high ones count
SLOTS = 2  # places beside every true box at which a false positive may be seen


def _ascending(values: tuple[float, ...]) -> tuple[float, ...]:
    if any(later < earlier for earlier, later in itertools.pairwise(values)):
        raise ValueError("expected ascending numbers")
    return values


Quantiles = Annotated[tuple[float, ...], Field(min_length=QUANTILES, max_length=QUANTILES, strict=False)]
Ascending = Annotated[Quantiles, AfterValidator(_ascending)]
Curve = Annotated[tuple[float, ...], Field(min_length=2, strict=False), AfterValidator(_ascending)]


class Shared(Memory):
    """Memory of a latent number whose lasting part is shared with close neighbours."""

    shared: Share = 0.0  # weight of a neighbour at distance 0, beside 1 of the object itself


class Lapses(Section):
    """The skewed part of the quality: most of the time nothing, now and then a loss that lasts."""

    share: Annotated[float, Field(ge=0, lt=1)]  # of the variance of the random part of the quality
    bias: Share  # share of the latent number that is constant over the object's life; the rest is autoregressive
    phi: Correlation  # of the autoregression, from frame to frame
    shared: Share  # weight of a neighbour at distance 0, beside 1 of the object itself


class Quality(Shared):
    """Quality of an object's detection in a frame; its score, and whether there is one, follow from it."""

    location: Annotated[tuple[float, ...], Field(min_length=LOCATION, max_length=LOCATION, strict=False)]
    # mean: 1, d, d^2, partly occluded, largely occluded, hidden, truncated; the random part has variance 1
    lapses: Lapses
    latent: Curve  # qualities
    score: Curve  # their scores; linear between
    floor: float  # the operating point: what has a lower score is not reported

    @field_validator("floor")
    @classmethod
    def _fits(cls, floor: float, info: ValidationInfo) -> float:
        latent, score = info.data.get("latent", ()), info.data.get("score", ())
        if len(latent) != len(score):
            raise ValueError(f"latent has {len(latent)} numbers and score {len(score)}, expected as many of both")
        if score and floor > score[-1]:
            raise ValueError(f"expected at most the highest score, {score[-1]:g}")
        return floor


class PositionNoise(Shared):
    """Position error along one axis: ``(s0 + s1 d) exp(-quality q) H z``, q the random part of quality.

    H makes the errors Student's t; it lasts, and both axes have the same.
    """

    s0: Scale  # m
    s1: Scale  # m per 10 m
    quality: float = 0.0  # how much better detections lie nearer


class Ghosts(Memory):
    """False positives of one kind: each has a lasting quality, and is seen while that is high enough.

    The constant share ``bias`` of the quality is exponential: few are good, and those stay so.
    """

    chance: Annotated[float, Field(gt=0, le=1)]  # share of the frames of its life in which one is seen
    score: Ascending  # of those that are seen: at 0, 20, 40, 60, 80, 90, 95, 98, 99, 99.7, 100 %


class FreeGhosts(Ghosts):
    """False positives where nothing is: born in families, standing still."""

    rate: Scale  # seen per frame over the profile's whole field of view
    dispersion: Annotated[float, Field(ge=1)]  # variance over mean of the count per frame that comes from the scene
    survive: Annotated[float, Field(ge=0, lt=1)]  # chance that one lives on for another frame, seen or not
    siblings: Scale  # mean number of further ones that are born beside each first one
    spread: Scale  # m, deviation per axis of their places
    family: Share  # share of the quality that siblings have in common
    size: Annotated[tuple[float, float, float], Field(strict=False)]  # m, mean length, width, height
    distance: Ascending  # m from the sensor: at 0, 10, ..., 100 %


class NearGhosts(Ghosts):
    """False positives beside true boxes, which they follow: duplicates, shadows, boxes of a wrong class."""

    offset: Ascending  # m from the centre of the true box: at 0, 10, ..., 100 %
    same: Annotated[tuple[Share, Share, Share], Field(strict=False)]
    # share with the class of the object, where within .75 m, within 1.5 m, beyond
    duplicates: Ascending | None = None  # scores of those of its class within .75 m; None: the same as of all
    parent: Correlation = 0.0  # correlation of their quality with that of the object


class ClassNoise(Section):
    """All noise of one class."""

    quality: Quality
    radial: PositionNoise
    tangential: PositionNoise
    nu: Annotated[float, Field(gt=1)]  # degrees of freedom of Student's t, of both position errors
    heading: HeadingNoise
    size: SizeNoise
    free: FreeGhosts | None = None
    near: NearGhosts | None = None
    velocity: Scale | None = None  # m/s per axis; None: velocities are not measured
    z: Annotated[tuple[float, float], Field(strict=False)] = (0.0, 0.0)  # m, height of the centre: mean, deviation


class Profile(Section):
    """A detector by model 2: noise per class at one frame period."""

    model: Literal[2]
    name: str
    summary: str
    source: str  # where the figures come from
    dt: Annotated[float, Field(gt=0)]  # s between frames at which the memory was fitted
    field_of_view: Annotated[float, Field(gt=0, le=360)] = 360.0  # degrees in which the false positives were counted
    neighbours: Annotated[float, Field(gt=0)] = 20.0  # m: farther objects share nothing
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

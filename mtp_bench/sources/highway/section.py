"""Table ``[source]`` of cards that simulate traffic."""

from __future__ import annotations

import itertools
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, ValidationInfo, field_validator, model_validator

from ...cards.source import SourceSection, Traits
from ...strict import Section


def _rising(seeds: tuple[int, int]) -> tuple[int, int]:
    if not 0 <= seeds[0] < seeds[1] <= 999_999:
        raise ValueError("expected 0 <= first < end <= 999999")
    return seeds


def _current(generator: int) -> int:
    if generator != GENERATOR:
        raise ValueError(f"this version of the library makes generator {GENERATOR}")
    return generator


SECRET_SEEDS = 2**40  # scenes of these and larger seeds belong to seals; even their names are secret
GENERATOR = 2  # version of the simulated content
Generator = Annotated[int, AfterValidator(_current)]
SeedRange = Annotated[tuple[int, int], Field(strict=False), AfterValidator(_rising)]


class SeedRanges(Section):
    """Seeds of each split: the first, and the one after the last; splits have no common seed."""

    train: SeedRange
    val: SeedRange
    test: SeedRange

    @model_validator(mode="after")
    def _apart(self) -> SeedRanges:
        ranges = sorted((self.train, self.val, self.test))
        if any(end > first for (_, end), (first, _) in itertools.pairwise(ranges)):
            raise ValueError("expected splits without a common seed")
        return self


class HighwaySource(SourceSection):
    """Simulated traffic on highway-env roads, one scene per seed; needs a ``[detector]``."""

    splits = ("train", "val", "test")

    generator: Generator = GENERATOR  # version of the simulated content
    scenario: Literal["intersection", "roundabout", "merge", "highway"]
    sensor: Literal["ego", "roadside"] = "ego"  # on a moving vehicle, or at a fixed place
    seconds: Annotated[float, Field(gt=0, le=600)] = 20.0
    vehicles: Annotated[int, Field(ge=2, le=200)]  # number to keep on the road
    pedestrians: Annotated[int, Field(ge=0, le=200)] = 0  # number to keep; only the intersection has crossings
    parked: Annotated[int, Field(ge=0, le=200)] = 0  # cars along the kerbs of junctions
    seeds: SeedRanges

    @field_validator("pedestrians")
    @classmethod
    def _where_they_cross(cls, pedestrians: int, info: ValidationInfo) -> int:
        if pedestrians and info.data.get("scenario") != "intersection":
            raise ValueError("expected 0: only the intersection has crossings")
        return pedestrians

    @field_validator("parked")
    @classmethod
    def _where_they_park(cls, parked: int, info: ValidationInfo) -> int:
        if parked and info.data.get("scenario") not in ("intersection", "roundabout"):
            raise ValueError("expected 0: only the intersection and the roundabout have kerbs")
        return parked

    @property
    def traits(self) -> Traits:
        """Abilities of the source."""
        return Traits(
            simulated=True,
            without_detections="simulated traffic",
            has_ego=self.sensor == "ego",
            scene_seconds=self.seconds,
        )

"""Sections of a card: where its scenes come from, and the simulated detector."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from ._strict import Section
from .detector import Profile, Variant, load_profile
from .errors import CardError


def _rising(seeds: tuple[int, int]) -> tuple[int, int]:
    if not 0 <= seeds[0] < seeds[1] <= 999_999:
        raise ValueError("expected 0 <= first < end <= 999999")
    return seeds


SeedRange = Annotated[tuple[int, int], Field(strict=False), AfterValidator(_rising)]


class KittiSource(Section):
    """KITTI tracking logs with stored detections."""

    name: Literal["kitti"]
    detector: str = "pointrcnn"  # folder under detections/
    split: Literal["train", "val"] = "val"
    ego_motion: bool = True  # False: every frame in its own camera frame, as without ego-motion compensation
    stride: Annotated[int, Field(ge=1)] = 1  # keep every n-th frame


class SeedRanges(Section):
    """Seeds of the scenes of each split: the first, and the one after the last."""

    train: SeedRange
    val: SeedRange
    test: SeedRange


class HighwaySource(Section):
    """Simulated traffic on highway-env roads, one scene per seed; needs a ``[detector]``."""

    name: Literal["highway"]
    generator: Literal[1]  # version of the simulated content: a change of the traffic gets a new number
    scenario: Literal["intersection", "roundabout", "merge", "highway"]
    split: Literal["train", "val", "test"] = "val"
    sensor: Literal["ego", "roadside"] = "ego"  # on a moving vehicle, or at a fixed place
    seconds: Annotated[float, Field(gt=0, le=600)] = 20.0
    vehicles: Annotated[int, Field(ge=2, le=200)]  # aimed at on the road
    pedestrians: Annotated[int, Field(ge=0, le=200)] = 0  # aimed at; only the intersection has crossings
    drivers: Literal["cooperative", "idm"] = "cooperative"  # "idm": highway-env's own, on merge and highway only
    seeds: SeedRanges


Source = Annotated[KittiSource | HighwaySource, Field(discriminator="name")]


class DetectorSection(Section):
    """A simulated detector in place of stored detections: a shipped profile by name, or ``noise`` of one's own."""

    profile: str | None = None
    noise: Profile | None = None
    variant: Variant = "as_fitted"
    reach: Annotated[float, Field(gt=0)] = 80.0  # m
    field_of_view: Annotated[float, Field(gt=0, le=360)] = 90.0  # degrees, centred on the ego's heading
    seed: Annotated[int, Field(ge=0)] = 0  # of the noise

    @property
    def name(self) -> str:
        """Name of the profile and its variant."""
        return self.resolved.name

    @property
    def resolved(self) -> Profile:
        """The noise that is meant; raises CardError or UnknownNameError where it is not there."""
        if (self.profile is None) == (self.noise is None):
            raise CardError("[detector] has both or none of 'profile' and 'noise', expected one of them")
        noise = self.noise or load_profile(str(self.profile))
        if self.variant == "as_fitted":
            return noise
        from .detector.variants import with_variant

        return with_variant(noise, self.variant)

"""Sections of a card that are no dataset's: own scenes, and the simulated detector."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, InstanceOf

from ..detector import Profile, Variant, load_profile
from ..errors import CardError
from ..strict import Section
from ..types import Scene
from .source import STORED_DETECTOR, LocalPath, SourceSection, Traits


class FilesSource(SourceSection):
    """Own scenes: a folder of NPZ files and of tables in sub-folders (``docs/data/own.md``), or `Scene` objects."""

    splits = ("all", "train", "val", "test")

    split: str = "all"  # "all": the folder itself, else its sub-folder
    folder: LocalPath = None  # of the scenes, relative to the card's file
    sha256: str | None = None  # of the scenes' content; filled in when the card is read
    scenes: Annotated[tuple[InstanceOf[Scene], ...] | None, Field(exclude=True)] = None  # in place of a folder
    detector: Annotated[str, Field(pattern=STORED_DETECTOR)] = "megvii-own"
    # what agents choose their settings by: a detector that they know, a hyphen and a word of one's own
    velocity: bool = False  # show the velocities of the detections, where the files have them
    ego_motion: bool = True  # False: every frame is in its own sensor frame
    ego: bool = True  # False: no vehicle carries the sensors
    truth: Literal["all", "targets"] = "all"  # "targets": objects exist that the truth does not have
    view: Annotated[float, Field(gt=0, le=360)] = 360.0  # degrees around the heading that the truth covers
    velocity_ahead: bool | None = None  # of a source with this trait; None: no, and in no digest
    places_only: bool | None = None  # the same
    bounded_by_truth: bool | None = None  # the same

    @property
    def traits(self) -> Traits:
        """What the source can do."""
        return Traits(
            stored_detector=self.detector,
            places_only=bool(self.places_only),
            bounded_by_truth=bool(self.bounded_by_truth),
            measured_velocity=self.velocity,
            velocity_ahead=bool(self.velocity_ahead),
            common_frame=self.ego_motion,
            has_ego=self.ego,
            truth_complete=self.truth == "all",
            view=self.view,
        )


def _name(profile: str) -> str:
    if profile.endswith(".toml"):  # a card would mean another file in another folder
        raise ValueError("expected the name of a shipped profile; a file's content belongs into [detector.noise]")
    return profile


def _corners(area: tuple[float, float, float, float] | None) -> tuple[float, float, float, float] | None:
    if area is not None and not (area[0] < area[2] and area[1] < area[3]):
        raise ValueError("expected least x and y, then largest x and y")
    return area


class DetectorSection(Section):
    """A simulated detector in place of stored detections: a shipped profile by name, or ``noise`` of one's own."""

    profile: Annotated[str, AfterValidator(_name)] | None = None
    noise: Profile | None = None
    variant: Variant = "as_fitted"
    reach: Annotated[float, Field(gt=0)] = 80.0  # m
    field_of_view: Annotated[float, Field(gt=0, le=360)] = 90.0  # degrees, centred on the ego's heading
    area: Annotated[tuple[float, float, float, float] | None, Field(strict=False), AfterValidator(_corners)] = None
    # m: least x and y, largest x and y of false positives; without it they are anywhere within reach
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
        from ..detector.variants import with_variant

        return with_variant(noise, self.variant)

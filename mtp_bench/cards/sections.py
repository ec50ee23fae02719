"""Sections of a card: where its scenes come from, and the simulated detector.

What a source can do is stated here, as traits of its section. The package ``mtp_bench.sources.<name>`` reads the scenes
of the section ``name``.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    Discriminator,
    Field,
    InstanceOf,
    Tag,
    ValidationInfo,
    field_validator,
    model_validator,
)

from ..detector import Profile, Profile1, Variant, load_profile
from ..errors import CardError
from ..strict import Section
from ..types import Scene


def _rising(seeds: tuple[int, int]) -> tuple[int, int]:
    if not 0 <= seeds[0] < seeds[1] <= 999_999:
        raise ValueError("expected 0 <= first < end <= 999999")
    return seeds


def _current(generator: int) -> int:
    if generator != GENERATOR:
        raise ValueError(f"this version of the library makes generator {GENERATOR}")
    return generator


SECRET_SEEDS = 2**40  # scenes of these and larger seeds are of seals: not even their names are anybody's
GENERATOR = 2  # version of the simulated content: of what a seed gives
STORED_DETECTOR = r"^[A-Za-z0-9][A-Za-z0-9_.-]*$"  # begins the names of files
Generator = Annotated[int, AfterValidator(_current)]
Place = Annotated[str | None, Field(exclude=True)]  # of files: what they hold counts, not where they are
SeedRange = Annotated[tuple[int, int], Field(strict=False), AfterValidator(_rising)]


@dataclass(frozen=True)
class Traits:
    """What a source can do, and what is special about it; they are no keys of a card and no part of its digest."""

    simulated: bool = False  # there is a scene for any seed
    stored_detector: str = ""  # name of the detector with stored detections; empty where there is none
    without_detections: str = ""  # what of it has no stored detections, so that the card needs a [detector]
    mixed_detections: bool = False  # stored detections of some scenes stand beside the simulated ones of the others
    other_detections: bool = False  # other stored detections can be named
    detection_file: str = ""  # what a file of one's own detections must be; empty: it takes none
    measured_velocity: bool = False  # stored detections carry a velocity
    velocity_ahead: bool = False  # true velocities are taken from the next frame too: no agent may be shown them
    places_only: bool = False  # sizes and headings are nominal, detected ones too
    bounded_by_truth: bool = False  # nobody stands beyond the area of the true boxes: it is all that the camera shows
    common_frame: bool = True  # all frames of a scene share one frame of reference; else each has its sensor's own
    has_ego: bool = True  # a vehicle carries the sensors; else the ego pose is a fixed place
    truth_complete: bool = True  # every object is known; else a simulated detector would not see the others
    view: float = 360.0  # degrees that a simulated detector sees where the card does not say it
    scene_seconds: float | None = None  # length of every scene, where it is the card that decides it


class KittiSource(Section):
    """KITTI tracking logs with stored detections."""

    name: Literal["kitti"]
    detector: str = "pointrcnn"  # folder under detections/
    detections_sha256: str | None = None  # of a folder that stands in for the detector's; see Card.with_detections
    detections_file: Place = None  # where that folder is
    split: Literal["train", "val"] = "val"
    ego_motion: bool = True  # False: every frame in its own camera frame, as without ego-motion compensation
    stride: Annotated[int, Field(ge=1)] = 1  # keep every n-th frame

    @property
    def traits(self) -> Traits:
        """What the source can do."""
        return Traits(
            stored_detector=self.detector,
            detection_file="a folder of KITTI text, one file per sequence",
            velocity_ahead=True,
            common_frame=self.ego_motion,
            view=90.0,  # of the labels' camera
        )


class SeedRanges(Section):
    """Seeds of the scenes of each split: the first, and the one after the last; no scene is in two splits."""

    train: SeedRange
    val: SeedRange
    test: SeedRange

    @model_validator(mode="after")
    def _apart(self) -> SeedRanges:
        ranges = sorted((self.train, self.val, self.test))
        if any(end > first for (_, end), (first, _) in itertools.pairwise(ranges)):
            raise ValueError("expected splits without a common seed")
        return self


class HighwaySource(Section):
    """Simulated traffic on highway-env roads, one scene per seed; needs a ``[detector]``."""

    name: Literal["highway"]
    generator: Generator = GENERATOR  # version of the simulated content: a change of the traffic gets a new number
    scenario: Literal["intersection", "roundabout", "merge", "highway"]
    split: Literal["train", "val", "test"] = "val"
    sensor: Literal["ego", "roadside"] = "ego"  # on a moving vehicle, or at a fixed place
    seconds: Annotated[float, Field(gt=0, le=600)] = 20.0
    vehicles: Annotated[int, Field(ge=2, le=200)]  # aimed at on the road
    pedestrians: Annotated[int, Field(ge=0, le=200)] = 0  # aimed at; only the intersection has crossings
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
        """What the source can do."""
        return Traits(
            simulated=True,
            without_detections="simulated traffic",
            has_ego=self.sensor == "ego",
            scene_seconds=self.seconds,
        )


class NuScenesSource(Section):
    """nuScenes logs (official v1.0 tables) with stored detections in the official submission form."""

    name: Literal["nuscenes"]
    version: Annotated[str, Field(pattern=r"^v1\.0-[A-Za-z0-9_.-]+$")] = "v1.0-trainval"  # folder of the tables
    detector: Annotated[str, Field(pattern=STORED_DETECTOR)] = "megvii"  # detections/<detector>*.json
    detections_sha256: str | None = None  # of a file that stands in for the detector's; see Card.with_detections
    detections_file: Place = None  # where that file is
    velocity: bool = False  # show the velocities of the detections, where the file has them
    split: Literal["train", "train_val", "val", "mini_train", "mini_val", "all"] = "val"
    truth: Literal["targets", "all"] = "all"
    # "targets": the official prediction split names the targets, and only those objects are known; "all": every box

    @property
    def traits(self) -> Traits:
        """What the source can do."""
        return Traits(
            stored_detector=self.detector,
            other_detections=True,
            detection_file="a JSON file in the official submission form",
            measured_velocity=self.velocity,
            truth_complete=self.truth == "all",
        )


class WildtrackSource(Section):
    """WILDTRACK: people on a square, seen by seven fixed cameras; real detections of the last 40 frames.

    The other frames have simulated detections, of the card's ``[detector]``.
    """

    name: Literal["wildtrack"]
    detector: Literal["mvdet"] | None = "mvdet"  # None: simulated detections everywhere
    split: Literal["train", "val", "test"] = "val"

    @property
    def traits(self) -> Traits:
        """What the source can do."""
        return Traits(
            stored_detector=self.detector or "",
            without_detections="most of WILDTRACK",
            mixed_detections=True,
            places_only=True,
            has_ego=False,
        )


class Mot3dSource(Section):
    """3DMOT2015: people on the ground plane, seen by a fixed camera, with stored detections."""

    name: Literal["mot3d"]
    sequence: Literal["PETS09-S2L1", "TUD-Stadtmitte"]
    detector: Literal["acf"] = "acf"  # det/det.txt
    split: Literal["train", "val"] = "val"
    stride: Annotated[int, Field(ge=1)] = 1  # keep every n-th frame
    scene_frames: Annotated[int, Field(ge=2)] = 140  # kept frames per scene, the last scene may have fewer
    train_scenes: Annotated[int, Field(ge=0)] = 2  # the first ones are for training, the others are "val"

    @property
    def traits(self) -> Traits:
        """What the source can do."""
        return Traits(stored_detector=self.detector, places_only=True, bounded_by_truth=True, has_ego=False)


class FilesSource(Section):
    """Own scenes: a folder of NPZ files and of tables in sub-folders (``docs/data/own.md``), or `Scene` objects."""

    name: Literal["files"]
    folder: Place = None  # of the scenes, relative to the card's file
    sha256: str | None = None  # of the scenes' content; filled in when the card is read
    scenes: Annotated[tuple[InstanceOf[Scene], ...] | None, Field(exclude=True)] = None  # in place of a folder
    split: Literal["all", "train", "val", "test"] = "all"  # "all": the folder itself, else its sub-folder
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


Source = Annotated[
    KittiSource | NuScenesSource | WildtrackSource | Mot3dSource | HighwaySource | FilesSource,
    Field(discriminator="name"),
]


def _name(profile: str) -> str:
    if profile.endswith(".toml"):  # a card would mean another file in another folder
        raise ValueError("expected the name of a shipped profile; a file's content belongs into [detector.noise]")
    return profile


def _model(content: object) -> str:
    """Which class of profiles the content is of; those of model 1 have no key ``model``."""
    of_model1 = "model" not in content if isinstance(content, dict) else isinstance(content, Profile1)
    return "Profile1" if of_model1 else "Profile"


Noise = Annotated[Annotated[Profile, Tag("Profile")] | Annotated[Profile1, Tag("Profile1")], Discriminator(_model)]


def _corners(area: tuple[float, float, float, float] | None) -> tuple[float, float, float, float] | None:
    if area is not None and not (area[0] < area[2] and area[1] < area[3]):
        raise ValueError("expected least x and y, then largest x and y")
    return area


class DetectorSection(Section):
    """A simulated detector in place of stored detections: a shipped profile by name, or ``noise`` of one's own."""

    profile: Annotated[str, AfterValidator(_name)] | None = None
    noise: Noise | None = None
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
    def resolved(self) -> Profile | Profile1:
        """The noise that is meant; raises CardError or UnknownNameError where it is not there."""
        if (self.profile is None) == (self.noise is None):
            raise CardError("[detector] has both or none of 'profile' and 'noise', expected one of them")
        noise = self.noise or load_profile(str(self.profile))
        if self.variant == "as_fitted":
            return noise
        from ..detector.variants import with_variant

        return with_variant(noise, self.variant)

"""Table ``[source]`` of a card: keys for each source, and its properties (`Traits`).

A source is a package ``mtp_bench.sources.<name>``. Its subclass of `SourceSection` is
registered by one line of `SOURCES` and imported when a card names it, so this package
does not depend on any source.
"""

import pkgutil
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, InstanceOf, ValidationInfo, field_validator

from ..core import CardError, Scene, Section, validate

SOURCES = {
    "kitti": "mtp_bench.sources.kitti:KittiSource",
    "nuscenes": "mtp_bench.sources.nuscenes:NuScenesSource",
    "wildtrack": "mtp_bench.sources.wildtrack:WildtrackSource",
    "mot3d": "mtp_bench.sources.mot3d:Mot3dSource",
    "people": "mtp_bench.sources.people:PeopleSource",
    "argoverse2": "mtp_bench.sources.argoverse2:Argoverse2Source",
    "highway": "mtp_bench.traffic.highway.world:HighwaySource",
    "gym": "mtp_bench.traffic.gym:GymSource",
    "files": "mtp_bench.cards.source:FilesSource",
}

STORED_DETECTOR = r"^[A-Za-z0-9][A-Za-z0-9_.-]*$"  # begins the names of files
# the digest of a card has the content of the files instead
LocalPath = Annotated[str | None, Field(exclude=True)]


@dataclass(frozen=True)
class Traits:
    """Properties of a source.

    Not keys of a card and not part of its digest.
    """

    simulated: bool = False  # there is a scene for any seed
    # name of the detector with stored detections; empty without one
    stored_detector: str = ""
    # the part without stored detections, so that the card needs a [detector]
    without_detections: str = ""
    # some scenes have stored detections, the others simulated ones
    mixed_detections: bool = False
    other_detections: bool = False  # other stored detections can be named
    # form of a file of a user's own detections; empty if none can be given
    detection_file: str = ""
    measured_velocity: bool = False  # stored detections carry a velocity
    # true velocities use the next frame too: agents must not see them
    velocity_ahead: bool = False
    places_only: bool = False  # sizes and headings are nominal, those of detections too
    # the camera shows the area of the true boxes and no more
    bounded_by_truth: bool = False
    # all frames of a scene share one frame of reference; else each has its sensor's own
    common_frame: bool = True
    # a vehicle carries the sensors; else the ego pose is a fixed place
    has_ego: bool = True
    # every object is known; else a simulated detector would miss the others
    truth_complete: bool = True
    lanes: bool = False  # scenes have a road map
    # degrees that a simulated detector sees unless the card says otherwise
    view: float = 360.0
    scene_seconds: float | None = None  # length of every scene, if the card decides it


class SourceSection(Section):
    """Keys of a card's table ``[source]``.

    Every source adds its own.
    """

    splits: ClassVar[tuple[str, ...]]

    name: str
    split: str = "val"

    @property
    def traits(self) -> Traits:
        """Properties of the source."""
        return Traits()

    @field_validator("split")
    @classmethod
    def _require_known_split(cls, split: str) -> str:
        if split not in cls.splits:
            raise ValueError(f"expected one of {', '.join(map(repr, cls.splits))}")
        return split


class FilesSource(SourceSection):
    """Own scenes: tables in sub-folders of a folder (``docs/data/own.md``), or `Scene` objects."""

    splits = ("all", "train", "val", "test")

    split: str = "all"  # "all": the folder itself, else its sub-folder
    folder: LocalPath = None  # folder of scenes, relative to the card's file
    # digest of the scenes' content; filled in when the card is read
    sha256: str | None = None
    # the scenes themselves, in place of a folder
    scenes: Annotated[tuple[InstanceOf[Scene], ...] | None, Field(exclude=True)] = None
    # name by which agents choose their settings: a detector that they know, a hyphen
    # and a word of one's own
    detector: Annotated[str, Field(pattern=STORED_DETECTOR)] = "megvii-own"
    # observations show the velocities of detections, if the files have them
    velocity: bool = False
    ego_motion: bool = True  # False: every frame is in its own sensor frame
    ego: bool = True  # False: no vehicle carries the sensors
    # "targets": objects exist that the truth does not have
    truth: Literal["all", "targets"] = "all"
    view: Annotated[float, Field(gt=0, le=360)] = (
        360.0  # degrees around the heading that the truth covers
    )
    # True if the source has the trait of this name; None: no, and the digest omits it
    velocity_ahead: bool | None = None
    places_only: bool | None = None  # the same
    bounded_by_truth: bool | None = None  # the same

    @property
    def traits(self) -> Traits:
        """Traits from the section's keys."""
        return Traits(
            stored_detector=self.detector,
            places_only=bool(self.places_only),
            bounded_by_truth=bool(self.bounded_by_truth),
            measured_velocity=self.velocity,
            velocity_ahead=bool(self.velocity_ahead),
            common_frame=self.ego_motion,
            has_ego=self.ego,
            truth_complete=self.truth == "all",
            lanes=True,
            view=self.view,
        )


class DataSection(Section):
    """Switch of the doctor for the recordings of a card."""

    # "off": the doctor does not examine them
    doctor: Literal["on", "off"] = "on"
    # why it is off
    reason: str = Field(default="", validate_default=True)

    @field_validator("reason")
    @classmethod
    def _require_reason(cls, reason: str, info: ValidationInfo) -> str:
        if info.data.get("doctor") == "off" and not reason.strip():
            raise ValueError("expected a sentence that says why the doctor is off")
        return reason


class DetectionsSection(SourceSection):
    """Keys of a source with detections that a user's own can replace.

    See `cards.with_detections`.
    """

    detections_sha256: str | None = None
    detections: LocalPath = None


def source_class(name: str) -> type[SourceSection]:
    """Return the class of the section of a registered source."""
    section: type[SourceSection] = pkgutil.resolve_name(SOURCES[name])
    return section


def read_source(content: Any, where: str) -> SourceSection:
    """Return the section of the table ``content``.

    Raises CardError naming ``where``, the key, what was got and expected.
    """
    if not isinstance(content, dict):
        raise CardError(f"{where}: expected a table [source]")
    name = content.get("name")
    if not isinstance(name, str) or name not in SOURCES:
        raise CardError(
            f"{where}: source.name: got {name!r}, "
            f"expected one of {', '.join(map(repr, SOURCES))}"
        )
    return validate(source_class(name), content, f"{where}, [source]", CardError)

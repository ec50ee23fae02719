"""Interface of every source of scenes, and the checks of cards that several sources share."""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..cards import (
    TEXTS,
    Card,
    DetectionsSection,
    SourceSection,
    folder_digest,
    known_digest,
)
from ..core import (
    NO_ROWS,
    CardError,
    DataError,
    Detections,
    Floats,
    Ints,
    Lane,
    MissingDataError,
    Scene,
    Truth,
    nearest,
    require_known,
)
from .dataset import DataRoot as DataRoot, Dataset, DataStatus
from .text import SMALLEST, refuse_shared_place

HALF_LANE = 1.75  # m
SectionT = TypeVar("SectionT", bound=SourceSection)


class SceneSource(Protocol):
    """Named scenes that are read one by one."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the scenes, in the order of the split."""
        ...

    def load(self, name: str) -> Scene:
        """Read one scene of `names`; DataError names the file and line that is wrong."""
        ...


@dataclass(frozen=True)
class ChangedScenes:
    """The scenes of another source, each changed when it is read."""

    source: SceneSource
    change: Callable[[Scene], Scene]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the scenes, as in the source."""
        return self.source.names

    def load(self, name: str) -> Scene:
        """Read one scene and change it; raises UnknownNameError for a name that the source does not have."""
        require_known("scene", name, self.source.names)
        return self.change(self.source.load(name))


@dataclass(frozen=True, eq=False)
class CameraImage:
    """One image of a recording, found but not read; shown beside events, and used for nothing else."""

    frame: int
    camera: str  # such as "CAM_FRONT"
    path: Path
    size: tuple[int, int]  # pixels, width and height, that ``projection`` is for
    projection: Floats  # [3, 4] from the scene's frame of reference, homogeneous, to pixels; its third row gives metres


Work = tuple[
    int, Iterable[str]
]  # number of pieces of work, and their names, each when it is done
ReadTracks = Callable[[Scene], Scene]  # with ``tracks`` and ``track_names``


@dataclass(frozen=True)
class TrackForm:
    """A form in which other programs store tracks of a dataset."""

    name: str  # in words, for errors
    fits: Callable[[Path], bool]
    open: Callable[[Card, DataRoot, Path], ReadTracks]


@dataclass(frozen=True)
class SourcePackage:
    """Functions of the package of a source, its ``PACKAGE``; `mtp_bench.sources` finds it by the card's section."""

    open: Callable[[Card, DataRoot], SceneSource]
    dataset: Dataset  # such as its licence
    locate: Callable[
        [Card, DataRoot], DataStatus
    ]  # where the files are, see `Dataset.status`
    tracks: TrackForm | None = (
        None  # in which trackers store their tracks of this dataset
    )
    prepare: Callable[[Card, DataRoot, int | None, int], Work] = (
        lambda card, data, scenes, workers: (0, ())
    )
    discard: Callable[[Card], None] = lambda card: (
        None
    )  # removes simulated scenes of the card's split from the cache
    # lets no other user of this machine read the simulated scenes of the card, or their names, which hold the seeds
    keep_private: Callable[[Card], None] = lambda card: None
    lanes: Callable[[Card, DataRoot, Scene], Sequence[Lane]] = (
        lambda card, data, scene: scene.lanes
    )
    images: Callable[[Card, DataRoot, Scene], Sequence[CameraImage]] = (
        lambda card, data, scene: ()
    )  # for pictures


def section_of(card: Card, kind: type[SectionT]) -> SectionT:
    """The card's source section, which must be of ``kind``; raises CardError for that of another source."""
    if not isinstance(card.source, kind):
        raise CardError(
            f"{card.id}: source is {card.source.name!r}, expected the section of {kind.__name__}"
        )
    return card.source


def own_detections(card: Card) -> Path | None:
    """A user's file or folder of detections that replaces the detector's; None if the card names none.

    Raises DataError if it is missing, or has another content than when the card was made.
    """
    section = card.source
    if not isinstance(section, DetectionsSection):
        return None
    expected = section.detections_sha256
    if section.detections is None:
        if expected is None:
            return None
        raise DataError(
            f"{card.id} has the detections with sha256 {expected}: name their file or folder, --detections"
        )
    path = Path(section.detections).expanduser()
    if not path.exists():
        raise MissingDataError(
            f"no file or folder {path}, expected {section.traits.detection_file}"
        )
    digest = folder_digest(path, TEXTS) if path.is_dir() else known_digest(path)
    if expected not in (None, digest):
        raise DataError(
            f"{path} has the sha256 {digest}, expected {expected}: the detections of {card.id}"
        )
    return path


def require_classes(card: Card, dataset: str, known: Collection[str]) -> None:
    """Raise CardError for a class of the task that the dataset does not have."""
    for name in card.task.classes:
        if name not in known:
            raise CardError(
                f"{card.id}: {dataset} has no class {name!r}{nearest(name, known)}"
            )


def require_rate(card: Card, dataset: str, rate: float, stride: int = 1) -> None:
    """Raise CardError unless every ``stride``-th frame of a dataset with ``rate`` Hz gives the rate of the task."""
    if not np.isclose(card.task.rate * stride, rate):
        thinned = (
            f", which with stride {stride} gives {rate / stride:g} Hz"
            if stride > 1
            else ""
        )
        raise CardError(
            f"{card.id}: task.rate is {card.task.rate:g} Hz, but {dataset} has {rate:g} Hz{thinned}"
        )


def class_ids(known: Sequence[str], classes: Sequence[str]) -> Ints:
    """Index of each of the ``known`` classes of a dataset among those of a task, -1 for a class that is not in it."""
    return np.array(
        [classes.index(name) if name in classes else -1 for name in known],
        dtype=np.int64,
    )


def names_by_number(number: Ints, name: NDArray[Any]) -> dict[int, str]:
    """Name in the files of each number, where they differ; ``number`` and ``name`` ``[R]``."""
    numbers, row = np.unique(number, return_index=True)
    names = zip(numbers.tolist(), name[row].astype(np.str_).tolist(), strict=True)
    return {one: word for one, word in names if word != str(one)}


def lane_around(center: Floats, junction: bool) -> Lane:
    """Lane with borders at `HALF_LANE` from its middle line ``center`` ``[n, 2]``, of two points or more."""
    step = np.gradient(center, axis=0)
    aside = HALF_LANE * np.stack([-step[:, 1], step[:, 0]], axis=1)
    aside /= np.maximum(np.linalg.norm(step, axis=1), 1e-9)[:, None]
    return Lane(center, center + aside, center - aside, junction=junction)


def no_detections(frames: int) -> Detections:
    """Detections of a scene of ``frames`` frames without any."""
    start = np.zeros(frames + 1, dtype=np.int64)
    return Detections(start, np.zeros((0, 7)), np.zeros((0, 2)), NO_ROWS, np.zeros(0))


def usable(scene: Scene) -> Scene:
    """The scene without detected and tracked boxes of size 0 or below; tracks without a score (NaN) have 1.

    ``skipped`` counts both. Raises DataError for true objects at one place.
    """
    require_separate(scene.truth, f"scene {scene.name!r}")
    changes: dict[str, Any] = {}
    skipped = Counter(scene.skipped)
    for name, kind in (("detections", "detection"), ("tracks", "track")):
        boxes: Detections | None = getattr(scene, name)
        if boxes is None:
            continue
        sized = np.all(boxes.box[:, 4:7] >= SMALLEST, axis=1)
        unscored = np.isnan(boxes.score) & sized
        skipped[f"{kind} size not above 0"] += int((~sized).sum())
        skipped[f"{kind} without a score, taken as 1"] += int(unscored.sum())
        changes[name] = replace(
            boxes, score=np.where(unscored, 1.0, boxes.score)
        ).select(sized)
    counted = dict(+skipped)
    return (
        replace(scene, skipped=counted, **changes)
        if counted != scene.skipped
        else scene
    )


def require_separate(truth: Truth, where: str) -> None:
    """Raise DataError if objects of a frame have one and the same x and y: their places were not measured."""
    frame = truth.frame_of_rows
    refuse_shared_place(
        frame,
        truth.box[:, :2],
        truth.object_id,
        lambda row: f"{where}, frame {frame[row]}",
    )

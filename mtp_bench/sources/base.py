"""Interface of every source of scenes, and the checks that several sources share."""

from collections import Counter
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..cards import (
    Card,
    DetectionsSection,
    SourceSection,
    instead_of_stored,
    path_digest,
)
from ..core import (
    NO_ROWS,
    Bools,
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
    select,
    starts_of_sorted,
    toml_beside,
)
from .dataset import DataRoot as DataRoot, Dataset, DataStatus
from .tables import SMALLEST_SIDE_M, refuse, refuse_shared_place

HALF_LANE = 1.75  # m
_USUAL_SIZE_M = toml_beside(__file__, "sizes.toml")
SectionT = TypeVar("SectionT", bound=SourceSection)
KeyT = TypeVar("KeyT", bound=Hashable)


class SceneSource(Protocol):
    """Named scenes that are read one by one."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the scenes, in the order of the split."""
        ...

    def load(self, name: str) -> Scene:
        """Read a scene of `names`.

        DataError names the file and line that is wrong.
        """
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
        """Read one scene and change it.

        Raises UnknownNameError for an unknown name.
        """
        require_known("scene", name, self.source.names)
        return self.change(self.source.load(name))


@dataclass(frozen=True, eq=False)
class CameraImage:
    """One image of a recording, found but not read; only shown beside events."""

    frame: int
    camera: str  # such as "CAM_FRONT"
    path: Path
    size: tuple[int, int]  # pixels, width and height, that ``projection`` is for
    # [3, 4] from the scene's frame of reference, homogeneous, to pixels; its third row
    # gives metres
    projection: Floats


def require_focal_lengths(camera: Floats, where: Callable[[int], str]) -> None:
    """Raise DataError for the first camera whose focal lengths are not above 0.

    ``camera`` [R, 3, n]: rows of intrinsics, pixels; ``where``: name of a row.
    """
    focal_px = camera[:, (0, 1), (0, 1)]
    refuse(
        ~(focal_px > 0).all(axis=1),
        lambda row: (
            f"{where(row)}: the focal lengths are {focal_px[row].tolist()} pixels, "
            "expected numbers above 0"
        ),
    )


# number of pieces of work, and their names, each when it is finished
Work = tuple[int, Iterable[str]]
ReadTracks = Callable[[Scene], Scene]  # with ``tracks`` and ``track_names``


@dataclass(frozen=True)
class TrackForm:
    """A form in which other programs store tracks of a dataset."""

    name: str  # in words, for errors
    fits: Callable[[Path], bool]
    open: Callable[[Card, DataRoot, Path], ReadTracks]


@dataclass(frozen=True, eq=False)
class StoredForecasts:
    """Forecasts of a scene by another program: R objects with K samples of S steps.

    Objects are in any order, coordinates in the scene's frame of reference. NaN stands
    for a number that the file lacks.
    """

    frame: Ints  # [R]
    class_name: NDArray[np.str_]  # [R] as in the card, else of no class of the task
    box: Floats  # [R, 7]
    confidence: Floats  # [R] that the object is there
    path: Floats  # [R, K, S, 2] m, places after 1, 2, .. periods of the form
    log_weight: Floats  # [R, K], -inf: no such sample
    identity: NDArray[np.str_]  # [R] name of the track; empty: none
    notes: Mapping[str, int]  # what was counted
    others: int  # frames in the file of scenes that were not read so far

    def select(self, rows: Bools) -> Self:
        """Return some of the objects."""
        return select(self, rows)


ReadForecasts = Callable[[Scene], StoredForecasts]


@dataclass(frozen=True)
class ForecastForm:
    """A form in which other programs store forecasts."""

    rate: float | None  # Hz, of the steps; None: that of the task
    open: Callable[[Card, DataRoot, Path], ReadForecasts]


@dataclass(frozen=True)
class SourcePackage:
    """Functions of a source, its ``PACKAGE``, found by the section of a card."""

    open: Callable[[Card, DataRoot], SceneSource]
    dataset: Dataset  # such as its licence
    # where the files are, see `Dataset.status`
    locate: Callable[[Card, DataRoot], DataStatus]
    # form in which trackers store their tracks of this dataset
    tracks: TrackForm | None = None
    # by name: forms of forecasts of this dataset
    forecasts: Mapping[str, ForecastForm] = field(default_factory=dict)
    # as `opening.prepare`; by default there is no work
    prepare: Callable[[Card, DataRoot, int | None, int], Work] = (
        lambda card, data, scenes, workers: (0, ())
    )
    # removes simulated scenes of the card's split from the cache
    discard: Callable[[Card], None] = lambda card: None
    # lets no other user of this machine read the simulated scenes of the card, or their
    # names, which hold the seeds
    keep_private: Callable[[Card], None] = lambda card: None
    lanes: Callable[[Card, DataRoot, Scene], Sequence[Lane]] = (
        lambda card, data, scene: scene.lanes
    )
    # shown in pictures of a scene
    images: Callable[[Card, DataRoot, Scene], Sequence[CameraImage]] = (
        lambda card, data, scene: ()
    )


def section_of(card: Card, kind: type[SectionT]) -> SectionT:
    """Return the card's source section.

    Raises CardError if it is not of ``kind``.
    """
    if not isinstance(card.source, kind):
        raise CardError(
            f"{card.id}: source is {card.source.name!r}, expected the section of "
            f"{kind.__name__}"
        )
    return card.source


def own_detections(card: Card) -> Path | None:
    """Return a user's file or folder of detections.

    None if the card names none. Raises DataError if it is missing, or has another
    content than when the card was made.
    """
    section = card.source
    if not isinstance(section, DetectionsSection):
        return None
    expected = section.detections_sha256
    if section.detections is None:
        if expected is None:
            return None
        raise DataError(
            f"{card.id} has the detections with sha256 {expected}: name their file or "
            "folder, --detections"
        )
    path = Path(section.detections).expanduser()
    if not path.exists():
        form = section.traits.detection_file
        raise MissingDataError(f"no file or folder {path}, expected {form}")
    digest = path_digest(path)
    if expected not in (None, digest):
        raise DataError(
            f"{path} has the sha256 {digest}, expected {expected}: the detections of "
            f"{card.id}"
        )
    return path


def detections_folder(root: Path, card: Card, dataset: Dataset) -> Path:
    """Return the folder of stored detections.

    Raises MissingDataError without one.
    """
    folder = root / "detections"
    if not folder.is_dir():
        raise MissingDataError(
            f"no folder {folder}{instead_of_stored(card)}; to get them: "
            f"{dataset.how_to_get}"
        )
    return folder


def stored_label(detector: str) -> str:
    """Return the `Scene.detector` of stored detections.

    Empty without a detector.
    """
    return f"{detector}, stored detections" if detector else ""


def require_classes(card: Card, dataset: str, known_names: Collection[str]) -> None:
    """Raise CardError for a class of the task that the dataset does not have."""
    for name in card.task.classes:
        if name not in known_names:
            raise CardError(
                f"{card.id}: {dataset} has no class "
                f"{name!r}{nearest(name, known_names)}"
            )


def require_rate(card: Card, dataset: str, rate_hz: float, stride: int = 1) -> None:
    """Raise CardError unless every ``stride``-th frame gives the rate of the task."""
    if np.isclose(card.task.rate * stride, rate_hz):
        return
    message = f"task.rate is {card.task.rate:g} Hz, but {dataset} has {rate_hz:g} Hz"
    if stride > 1:
        message += f", which with stride {stride} gives {rate_hz / stride:g} Hz"
    raise CardError(f"{card.id}: {message}")


def class_ids(known_names: Sequence[str], classes: Sequence[str]) -> Ints:
    """Return the index among ``classes`` of each known name, -1 if missing."""
    class_index = {name: number for number, name in enumerate(classes)}
    return np.array([class_index.get(name, -1) for name in known_names], dtype=np.int64)


def usual_sizes(classes: Sequence[str]) -> Floats:
    """Return the usual length, width and height [C, 3] m of classes, else NaN."""
    unknown = (np.nan,) * 3
    return np.array([_USUAL_SIZE_M.get(name, unknown) for name in classes])


def names_by_number(number: Ints, name: NDArray[Any]) -> dict[int, str]:
    """Name each object whose name differs from its number.

    ``number`` and ``name`` [R]: those of the object in each row, in its file.
    """
    numbers, rows = np.unique(number, return_index=True)
    words = name[rows].astype(np.str_).tolist()
    pairs = zip(numbers.tolist(), words, strict=True)
    return {number: word for number, word in pairs if word != str(number)}


def lane_around(center: Floats, junction: bool) -> Lane:
    """Return the lane with borders at `HALF_LANE` from its middle line.

    ``center`` [n, 2], of two points or more.
    """
    point_step = np.gradient(center, axis=0)
    border_offset = HALF_LANE * np.stack([-point_step[:, 1], point_step[:, 0]], axis=1)
    # repeated points have no direction
    border_offset /= np.maximum(np.linalg.norm(point_step, axis=1), 1e-9)[:, None]
    return Lane(
        center, center + border_offset, center - border_offset, junction=junction
    )


def link_lanes(
    lanes: Mapping[KeyT, Lane], successors: Mapping[KeyT, Iterable[KeyT]]
) -> tuple[Lane, ...]:
    """Return lanes with the numbers of their successors.

    A number is a place among ``lanes``; other successors are left out.
    """
    lane_number = {key: index for index, key in enumerate(lanes)}
    linked_lanes: list[Lane] = []
    for key, lane in lanes.items():
        following = tuple(
            lane_number[name] for name in successors[key] if name in lane_number
        )
        linked_lanes.append(replace(lane, following=following))
    return tuple(linked_lanes)


def is_near(lane: Lane, places: Floats, reach_m: float) -> bool:
    """Return True if the middle line passes one of the places [F, 2] within reach."""
    offset = lane.center - places[:, None]
    return bool((np.linalg.norm(offset, axis=2) <= reach_m).any())


def sorted_rows(frame: Ints, used: Bools) -> Ints:
    """Return the ``used`` rows [R], sorted by frame and otherwise in their order."""
    used_rows = np.flatnonzero(used)
    return used_rows[np.argsort(frame[used_rows], kind="stable")]


def detections_by_frame(
    frames: int,
    frame: Ints,
    box: Floats,
    class_id: Ints,
    score: Floats,
    velocity: Floats | None = None,
) -> Detections:
    """Return the detections of R rows in any order, of ``frames`` frames.

    ``velocity``: None if it is not measured.
    """
    if velocity is None:
        velocity = np.full((len(frame), 2), np.nan)
    row_order = np.argsort(frame, kind="stable")
    row_start = starts_of_sorted(frame[row_order], frames)
    return Detections(
        row_start,
        box[row_order],
        velocity[row_order],
        class_id[row_order],
        score[row_order],
    )


def no_detections(frames: int) -> Detections:
    """Return detections of a scene without any."""
    start = np.zeros(frames + 1, dtype=np.int64)
    return Detections(start, np.zeros((0, 7)), np.zeros((0, 2)), NO_ROWS, np.zeros(0))


def usable(scene: Scene) -> Scene:
    """Return the scene without detected and tracked boxes of size 0 or below.

    Tracks without a score (NaN) get 1. ``skipped`` counts both. Raises DataError for
    true objects at one place.
    """
    require_separate(scene.truth, f"scene {scene.name!r}")
    changes: dict[str, Any] = {}
    skipped = Counter(scene.skipped)
    for name, kind in (("detections", "detection"), ("tracks", "track")):
        rows: Detections | None = getattr(scene, name)
        if rows is None:
            continue
        has_size = np.all(rows.box[:, 4:7] >= SMALLEST_SIDE_M, axis=1)
        is_unscored = np.isnan(rows.score) & has_size
        skipped[f"{kind} size not above 0"] += int((~has_size).sum())
        skipped[f"{kind} without a score, taken as 1"] += int(is_unscored.sum())
        scored = replace(rows, score=np.where(is_unscored, 1.0, rows.score))
        changes[name] = scored.select(has_size)
    # + drops counts of 0
    if +skipped == scene.skipped:
        return scene
    return replace(scene, skipped=dict(+skipped), **changes)


def require_separate(truth: Truth, where: str) -> None:
    """Raise DataError if objects of a frame have the same x and y."""
    frame = truth.frame_of_rows

    def place_of(row: int) -> str:
        return f"{where}, frame {frame[row]}"

    refuse_shared_place(frame, truth.box[:, :2], truth.object_id, place_of)

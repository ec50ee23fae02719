"""WILDTRACK: people on a square, seen by seven fixed cameras.

The last 40 frames have stored detections, MVDet's.
"""

from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np

from ...cards import Card, SourceSection, Traits, instead_of_stored
from ...core import (
    DataError,
    Detections,
    Floats,
    Ints,
    MissingDataError,
    Scene,
    Truth,
)
from ..base import DataRoot, SourcePackage, require_classes, require_rate, section_of
from ..dataset import Dataset
from ..motion import people_detections, people_scene, people_truth
from ..readers import read_table
from ..tables import repeated
from ..text import read_json

ANNOTATIONS = "annotations_positions"
DETECTIONS = "detections/mvdet_test.txt"
RATE_HZ = 2.0
# frames are numbered 0, 5, ..., 1995, as in the video at 10 Hz
FRAME_STEP = 5
SCENE_FRAMES = 40  # 20 s, the length of a nuScenes scene
_SCENE_STEP = SCENE_FRAMES * FRAME_STEP  # between the first frames of two scenes
SCENES = {f"wildtrack-{n:04d}": n for n in range(0, 2000, _SCENE_STEP)}  # first frame
# MVDet's test frames, the only ones with stored detections
STORED = "wildtrack-1800"
SPLITS = {"train": tuple(SCENES)[:6], "val": tuple(SCENES)[6:], "test": (STORED,)}
GRID = (480, 1440)  # cells of the annotated area along x and y
CELL_M = 0.025
CORNER = (-3.0, -9.0)  # m, x and y of cell (0, 0)
DATASET = Dataset.of(__file__)


class WildtrackSource(SourceSection):
    """WILDTRACK: people on a square, with real detections of the last 40 frames.

    The other frames have simulated detections, of the card's ``[detector]``.
    """

    splits = ("train", "val", "test")

    # None: simulated detections everywhere
    detector: Literal["mvdet"] | None = "mvdet"

    @property
    def traits(self) -> Traits:
        """Abilities of the source."""
        return Traits(
            stored_detector=self.detector or "",
            without_detections="most of WILDTRACK",
            mixed_detections=True,
            places_only=True,
            has_ego=False,
        )


class Wildtrack:
    """Scenes of 40 frames (20 s at 2 Hz), named by the number of their first frame.

    The world is WILDTRACK's ground plane in metres, the ground at z = 0. People are
    upright boxes of one nominal size with yaw 0: only their places are annotated.
    Without an ego vehicle, the ego state is the middle of the annotated area in all frames.
    Velocities are backward differences, NaN if a person was absent in the frame before.
    Seven cameras all around see everybody: no line of sight from one point counts.
    """

    def __init__(self, card: Card, data: DataRoot = None) -> None:
        """Find the scenes.

        Raises CardError for other classes or another rate, and DataError if files are
        missing.
        """
        self.card = card
        self.section = section_of(card, WildtrackSource)
        require_classes(card, DATASET.name, ("pedestrian",))
        require_rate(card, DATASET.name, RATE_HZ)
        self.root = DATASET.find(data, ANNOTATIONS)
        self.names = SPLITS[self.section.split]
        path = self.root / DETECTIONS
        if any(map(self._is_stored, self.names)) and not path.is_file():
            raise MissingDataError(
                f"no file {path}, detections of {STORED}{instead_of_stored(card)}; to "
                f"get them: {DATASET.how_to_get}"
            )

    def _is_stored(self, name: str) -> bool:
        return name == STORED and self.section.detector is not None

    def load(self, name: str) -> Scene:
        """Read one scene.

        If it has no stored detections, ``detector`` is empty.
        """
        frame_numbers = SCENES[name] + FRAME_STEP * np.arange(SCENE_FRAMES)
        time = np.arange(SCENE_FRAMES) / RATE_HZ
        truth = _read_truth(self.root / ANNOTATIONS, frame_numbers, time)
        reference_point = np.zeros(4)
        reference_point[:2] = np.array(CORNER) + CELL_M * np.array(GRID) / 2
        stored = None
        if self._is_stored(name):
            detections = read_detections(self.root / DETECTIONS, frame_numbers)
            stored = detections, str(self.section.detector)
        return people_scene(name, "wildtrack", time, reference_point, truth, stored)


def _read_truth(folder: Path, frame_numbers: Ints, time: Floats) -> Truth:
    paths = [folder / f"{frame_number:08d}.json" for frame_number in frame_numbers]
    people, places = zip(*map(read_annotations, paths), strict=True)
    frame = np.repeat(np.arange(len(paths)), [len(person) for person in people])
    place = np.concatenate(places)
    return people_truth(frame, place, np.concatenate(people), time, 1 / RATE_HZ)


def read_detections(path: Path, frame_numbers: Ints) -> Detections:
    """Read MVDet's detections, sorted by frame, otherwise in the order of the file.

    Its rows are ``frame gx gy``, on the grid of the annotations. DataError names the
    line that is wrong.
    """
    table = read_table(path, "frame gx gy")
    row_frame = table.whole_numbers("frame")
    cell = table.matrix("gx gy")
    is_outside = ((cell < 0) | (cell >= GRID)).any(axis=1)
    grid = f"is off the grid of {GRID[0]} x {GRID[1]}"
    table.refuse(
        is_outside, lambda row: f"cell {cell[row, 0]:g} {cell[row, 1]:g} {grid}"
    )
    is_repeated = repeated(row_frame, *cell.T)
    table.refuse(is_repeated, "a second detection at the place of an earlier line")
    problem = "is not among the annotated test frames"
    expected = f"{frame_numbers[0]}, {frame_numbers[1]}, ..., {frame_numbers[-1]}"
    table.refuse(
        ~np.isin(row_frame, frame_numbers),
        lambda row: f"frame {row_frame[row]} {problem}, {expected}",
    )
    frame = np.searchsorted(frame_numbers, row_frame)
    score = np.ones(len(frame))  # the file has no scores
    return people_detections(frame, metres(cell), score, len(frame_numbers))


class _Person(msgspec.Struct):
    id: Annotated[int, msgspec.Meta(ge=-(10**9), le=10**9)] = msgspec.field(
        name="personID"
    )
    # the cell
    position: Annotated[int, msgspec.Meta(ge=0, lt=GRID[0] * GRID[1])] = msgspec.field(
        name="positionID"
    )


def read_annotations(path: Path) -> tuple[Ints, Floats]:
    """Read ids [M] of the people of one frame and their places [M, 2], m.

    DataError names the wrong person.
    """
    people = read_json(path, list[_Person])
    person = np.array([entry.id for entry in people], dtype=np.int64)
    names, count = np.unique(person, return_counts=True)
    repeated_names = names[count > 1]
    if len(repeated_names):
        raise DataError(
            f"{path}: person {repeated_names[0]} is there twice, expected once per "
            "frame"
        )
    cell = np.array([entry.position for entry in people], dtype=np.int64)
    return person, metres(np.column_stack([cell % GRID[0], cell // GRID[0]]))


def metres(cell: Floats | Ints) -> Floats:
    """Return places [..., 2] in metres of grid cells [..., 2]."""
    return np.asarray(np.array(CORNER) + CELL_M * cell)


PACKAGE = SourcePackage(
    open=Wildtrack,
    dataset=DATASET,
    locate=lambda card, data: DATASET.status(data, ANNOTATIONS),
)

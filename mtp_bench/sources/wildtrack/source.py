"""WILDTRACK: people on a square, seen by seven fixed cameras; stored detections of the last 40 frames."""

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
    Ragged,
    Scene,
    Truth,
    starts_of,
)
from ..base import DataRoot, no_detections, require_classes, require_rate, section_of
from ..dataset import Dataset
from ..motion import people_detections, people_truth
from ..text import RowTable, read_json, read_table

ANNOTATIONS = "annotations_positions"
DETECTIONS = "detections/mvdet_test.txt"
RATE = 2.0  # Hz
STEP = 5  # frames are numbered 0, 5, ..., 1995, as in the video at 10 Hz
SCENE_FRAMES = 40  # 20 s, the length of a nuScenes scene
FRAMES = 400
SCENES = {
    f"wildtrack-{first:04d}": first
    for first in range(0, FRAMES * STEP, SCENE_FRAMES * STEP)
}  # first frame
STORED = "wildtrack-1800"  # MVDet's test frames, the only ones with stored detections
SPLITS = {"train": tuple(SCENES)[:6], "val": tuple(SCENES)[6:], "test": (STORED,)}
GRID = 480, 1440  # cells of the annotated area along x and y
CELL = 0.025  # m
CORNER = -3.0, -9.0  # m, x and y of cell (0, 0)
MIDDLE = tuple(
    start + CELL * cells / 2 for start, cells in zip(CORNER, GRID, strict=True)
)  # m, of the annotated area
DATASET = Dataset.of(__file__)


class WildtrackSource(SourceSection):
    """WILDTRACK: people on a square, seen by seven fixed cameras; real detections of the last 40 frames.

    The other frames have simulated detections, of the card's ``[detector]``.
    """

    splits = ("train", "val", "test")

    detector: Literal["mvdet"] | None = "mvdet"  # None: simulated detections everywhere

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

    The world is WILDTRACK's ground plane in metres, the ground at z = 0. People are upright boxes of one nominal size
    with yaw 0: only their places are annotated. There is no ego vehicle: the ego state is the middle of the annotated
    area in all frames. Velocities are backward differences, NaN if a person was absent in the frame before.
    """

    def __init__(self, card: Card, data: DataRoot = None) -> None:
        """Find the scenes; raises CardError for other classes or another rate, and DataError if files are missing."""
        self.card = card
        self.section = section_of(card, WildtrackSource)
        require_classes(card, DATASET.name, ("pedestrian",))
        require_rate(card, DATASET.name, RATE)
        self.root = DATASET.find(data, ANNOTATIONS)
        self.names = SPLITS[self.section.split]
        stored = self.section.detector is not None and STORED in self.names
        if stored and not (self.root / DETECTIONS).is_file():
            lost = f"no file {self.root / DETECTIONS}, detections of {STORED}{instead_of_stored(card)}"
            raise MissingDataError(f"{lost}; to get them: {DATASET.how_to_get}")

    def load(self, name: str) -> Scene:
        """Read one scene; if it has no stored detections, ``detector`` is empty."""
        truth = _truth(
            self.root / ANNOTATIONS, SCENES[name] + STEP * np.arange(SCENE_FRAMES)
        )
        time, ego = (
            np.arange(SCENE_FRAMES) / RATE,
            np.tile([*MIDDLE, 0.0, 0.0], (SCENE_FRAMES, 1)),
        )
        stored = name == STORED and self.section.detector is not None
        detections = (
            _detections(self.root / DETECTIONS)
            if stored
            else no_detections(SCENE_FRAMES)
        )
        label = f"{self.section.detector}, stored detections" if stored else ""
        visible = np.ones(
            len(truth.box)
        )  # seven cameras all around: no line of sight from one point counts
        return Scene(
            name,
            time,
            ego,
            truth,
            detections,
            detector=label,
            visible=visible,
            recording="wildtrack",
        )


def _truth(folder: Path, numbers: Ints) -> Truth:
    frames = [read_annotations(folder / f"{number:08d}.json") for number in numbers]
    rows = Ragged(starts_of([len(person) for person, _ in frames]))
    person, place = (np.concatenate(parts) for parts in zip(*frames, strict=True))
    return people_truth(
        rows.frame_of_rows, place, person, np.arange(len(frames)) / RATE, 1 / RATE
    )


def _detections(path: Path) -> Detections:
    """MVDet's detections, sorted by frame, otherwise in the order of the file."""
    table, number, place = read_detections(path)
    frame, beside = np.divmod(number - SCENES[STORED], STEP)
    expected = f"{SCENES[STORED]}, {SCENES[STORED] + STEP}, ..., {SCENES[STORED] + STEP * (SCENE_FRAMES - 1)}"
    other = (beside != 0) | (frame < 0) | (frame >= SCENE_FRAMES)
    table.refuse(
        other,
        lambda row: (
            f"frame {number[row]} is not among the annotated test frames, {expected}"
        ),
    )
    order = np.argsort(frame, kind="stable")
    return people_detections(
        frame[order], place[order], np.ones(len(frame)), SCENE_FRAMES
    )  # the file has no scores


class _Person(msgspec.Struct):
    id: Annotated[int, msgspec.Meta(ge=-(10**9), le=10**9)] = msgspec.field(
        name="personID"
    )
    position: Annotated[int, msgspec.Meta(ge=0, lt=GRID[0] * GRID[1])] = msgspec.field(
        name="positionID"
    )  # the cell


def read_annotations(path: Path) -> tuple[Ints, Floats]:
    """Ids [M] of the people of one frame and their places [M, 2] on the ground, m; DataError names the wrong person."""
    people = read_json(path, list[_Person])
    person = np.array([each.id for each in people], dtype=np.int64)
    known, count = np.unique(person, return_counts=True)
    if (count > 1).any():
        raise DataError(
            f"{path}: person {known[np.argmax(count > 1)]} is there twice, expected once per frame"
        )
    cell = np.array([each.position for each in people], dtype=np.int64)
    return person, metres(np.column_stack([cell % GRID[0], cell // GRID[0]]))


def read_detections(path: Path) -> tuple[RowTable, Ints, Floats]:
    """Detections, rows ``frame gx gy`` on the grid of the annotations; DataError names the line that is wrong.

    The table, the number [R] of the annotation file of each row, and its place [R, 2] on the ground plane, m.
    """
    table = read_table(path, "frame gx gy")
    frame, cell = table.whole("frame"), table.matrix("gx gy")
    off = np.asarray(
        ~((cell >= 0) & (cell < GRID)).all(axis=1)
    )  # NaN is off the grid, too
    table.refuse(
        off,
        lambda row: (
            f"cell {cell[row, 0]:g} {cell[row, 1]:g} is off the grid of {GRID[0]} x {GRID[1]}"
        ),
    )
    _, first, place = np.unique(
        table.matrix("frame gx gy"), axis=0, return_index=True, return_inverse=True
    )
    original = first[place.reshape(-1)]
    second = original < np.arange(len(original))
    table.refuse(
        second,
        lambda row: (
            f"a second detection at the place of line {table.line[original[row]]}"
        ),
    )
    return table, frame, metres(cell)


def metres(cell: Floats | Ints) -> Floats:
    """Places ``[..., 2]`` in metres of grid cells ``[..., 2]``."""
    return np.asarray(np.array(CORNER) + CELL * cell)

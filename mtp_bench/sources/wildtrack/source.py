"""WILDTRACK: people on a square, seen by seven fixed cameras; stored detections of the last 40 frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...cards import Card, WildtrackSource
from ...errors import CardError, DataError, UnknownNameError, nearest
from ...types import Detections, Ints, Scene, Truth
from ..base import no_detections
from ..motion import backward_velocity
from ..people import person_boxes
from ..roots import candidates
from .files import CELL, CORNER, GRID, read_annotations, read_detections

FOLDERS = ("wildtrack", "Wildtrack_dataset")  # the second is the name in the published archive
ANNOTATIONS = "annotations_positions"
DETECTIONS = "detections/mvdet_test.txt"
HOW_TO_GET = (
    "download Wildtrack_dataset_full.zip from https://www.epfl.ch/labs/cvlab/data/data-wildtrack and unpack it into "
    f"{FOLDERS[0]}/ of the data root (the images are not needed); detections: run the test of "
    "https://github.com/hou-yz/MVDet on WILDTRACK and put its test.txt (rows 'frame gx gy' on the annotations' grid) "
    f"at {FOLDERS[0]}/{DETECTIONS}"
)
RATE = 2.0  # Hz
STEP = 5  # frames are numbered 0, 5, ..., 1995, as in the video at 10 Hz
SCENE_FRAMES = 40  # 20 s, the length of a nuScenes scene
FRAMES = 400
SCENES = {f"wildtrack-{first:04d}": first for first in range(0, FRAMES * STEP, SCENE_FRAMES * STEP)}  # first frame
STORED = "wildtrack-1800"  # MVDet's test frames, the only ones with stored detections
SPLITS = {"train": tuple(SCENES)[:6], "val": tuple(SCENES)[6:], "test": (STORED,)}
MIDDLE = tuple(start + CELL * cells / 2 for start, cells in zip(CORNER, GRID, strict=True))  # m, of the annotated area


class Wildtrack:
    """Scenes of 40 frames (20 s at 2 Hz), named by the number of their first frame.

    The world is WILDTRACK's ground plane in metres, the ground at z = 0. People are upright boxes of one nominal size
    with yaw 0: only their places are annotated. There is no ego vehicle: the ego state is the middle of the annotated
    area in all frames. Velocities are backward differences, NaN where a person was not there in the frame before.
    """

    def __init__(self, card: Card, data: str | Path | None = None) -> None:
        """Raises CardError for other classes or another rate, DataError where the data is not there."""
        self.card = card
        self.section = section_of(card)
        for name in card.task.classes:
            if name != "pedestrian":
                raise CardError(f"{card.id}: WILDTRACK has no class {name!r}{nearest(name, ('pedestrian',))}")
        if not np.isclose(card.task.rate, RATE):
            raise CardError(f"{card.id}: task.rate is {card.task.rate} Hz, but WILDTRACK is annotated at {RATE} Hz")
        self.root = find_root(data)
        self.names = SPLITS[self.section.split]
        if needs_detections(card) and not (self.root / DETECTIONS).is_file():
            raise DataError(f"no file {self.root / DETECTIONS}, detections of {STORED}; {HOW_TO_GET}")

    def load(self, name: str) -> Scene:
        """Read one scene; without stored detections it has none, and an empty ``detector``."""
        if name not in self.names:
            raise UnknownNameError("scene", name, self.names)
        truth = _truth(self.root / ANNOTATIONS, SCENES[name] + STEP * np.arange(SCENE_FRAMES))
        stored = name == STORED and self.section.detector is not None
        return Scene(
            name=name,
            time=np.arange(SCENE_FRAMES) / RATE,
            ego=np.tile([*MIDDLE, 0.0, 0.0], (SCENE_FRAMES, 1)),
            truth=truth,
            detections=_detections(self.root / DETECTIONS) if stored else no_detections(SCENE_FRAMES),
            detector=f"{self.section.detector}, stored detections" if stored else "",
            visible=np.ones(len(truth.box)),  # seven cameras all around: from one point, nobody hides anybody
        )


def section_of(card: Card) -> WildtrackSource:
    """The card's source section; raises CardError where it is another source's."""
    if not isinstance(card.source, WildtrackSource):
        raise CardError(f"{card.id}: source is {card.source.name!r}, expected 'wildtrack'")
    return card.source


def needs_detections(card: Card) -> bool:
    """True if a scene of the card's split has stored detections and the card wants them."""
    section = section_of(card)
    return section.detector is not None and STORED in SPLITS[section.split]


def searched(data: str | Path | None) -> tuple[tuple[Path, ...], str]:
    """Folders in which WILDTRACK may lie, best first; and where the data root's name comes from."""
    found, origin = zip(*(candidates(data, folder) for folder in FOLDERS), strict=True)
    return tuple(dict.fromkeys([folders[0] for folders in found] + [folders[1] for folders in found])), origin[0]


def find_root(data: str | Path | None) -> Path:
    """The folder that holds the annotations: ``wildtrack`` or ``Wildtrack_dataset`` in the data root, or the root."""
    folders, origin = searched(data)
    for folder in folders:
        if (folder / ANNOTATIONS).is_dir():
            return folder
    looked = ", ".join(str(folder) for folder in folders)
    raise DataError(
        f"no WILDTRACK data: {ANNOTATIONS} is in none of {looked} ({origin}); "
        f"name another root with --data or MTP_BENCH_DATA, or get the data: {HOW_TO_GET}"
    )


def _truth(folder: Path, numbers: Ints) -> Truth:
    frames = [read_annotations(folder / f"{number:08d}.json") for number in numbers]
    person = np.concatenate([frame.person for frame in frames])
    box = person_boxes(np.concatenate([frame.place for frame in frames]))
    count = [len(frame.person) for frame in frames]
    frame, time = np.repeat(np.arange(len(frames)), count), np.arange(len(frames)) / RATE
    everyone = np.ones(len(person), dtype=bool)
    return Truth(
        start=np.concatenate([[0], np.cumsum(count)]),
        box=box,
        velocity=backward_velocity(frame, person, box[:, :2], time),
        class_id=np.zeros(len(person), dtype=np.int64),
        object_id=person,
        eligible=everyone,
        neutral=~everyone,
    )


def _detections(path: Path) -> Detections:
    """MVDet's detections, sorted by frame, otherwise in the order of the file."""
    rows = read_detections(path)
    frame, beside = np.divmod(rows.frame - SCENES[STORED], STEP)
    bad = (beside != 0) | (frame < 0) | (frame >= SCENE_FRAMES)
    if bad.any():
        at, first = int(np.argmax(bad)), SCENES[STORED]
        raise DataError(
            f"{path}, line {rows.line[at]}: frame {rows.frame[at]} is not among the annotated test frames, "
            f"{first}, {first + STEP}, ..., {first + STEP * (SCENE_FRAMES - 1)}"
        )
    order = np.argsort(frame, kind="stable")
    return Detections(
        start=np.searchsorted(frame[order], np.arange(SCENE_FRAMES + 1)),
        box=person_boxes(rows.place[order]),
        velocity=np.full((len(frame), 2), np.nan),
        class_id=np.zeros(len(frame), dtype=np.int64),
        score=np.ones(len(frame)),  # the file has none
    )

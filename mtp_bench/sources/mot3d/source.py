"""3DMOT2015: people on the ground plane with stored ACF detections, one sequence cut into scenes; its card section."""

import configparser
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
from pydantic import Field

from ...cards import Card, SourceSection, Traits, instead_of_stored
from ...core import CardError, DataError, Floats, Ints, MissingDataError, Scene
from ..base import DataRoot, no_detections, require_classes, require_rate, section_of
from ..dataset import Dataset
from ..motion import middle, people_detections, people_truth
from ..text import RowTable, read_table, read_text

DATASET = Dataset.of(__file__)
SEQINFO, TRUTH, DETECTIONS = (
    "seqinfo.ini",
    "gt/gt.txt",
    "det/det.txt",
)  # inside train/<sequence>
COLUMNS = "frame id left top width height confidence X Y Z"


class SequenceInfo(msgspec.Struct, frozen=True):
    """Content of the section [Sequence] of ``seqinfo.ini``."""

    rate: Annotated[float, msgspec.Meta(gt=0, le=1e6)] = msgspec.field(
        name="frameRate"
    )  # Hz
    length: Annotated[int, msgspec.Meta(gt=0, le=10**6)] = msgspec.field(
        name="seqLength"
    )  # frames


class Mot3dSource(SourceSection):
    """3DMOT2015: people on the ground plane, seen by a fixed camera, with stored detections."""

    splits = ("train", "val")

    sequence: Literal["PETS09-S2L1", "TUD-Stadtmitte"]
    detector: Literal["acf"] = "acf"  # det/det.txt
    stride: Annotated[int, Field(ge=1)] = 1  # keep every n-th frame
    scene_frames: Annotated[int, Field(ge=2)] = (
        140  # kept frames per scene, the last scene may have fewer
    )
    train_scenes: Annotated[int, Field(ge=0)] = (
        2  # the first ones are for training, the others are "val"
    )

    @property
    def traits(self) -> Traits:
        """Abilities of the source."""
        return Traits(
            stored_detector=self.detector,
            places_only=True,
            bounded_by_truth=True,
            has_ego=False,
        )


def folder_of(card: Card) -> str:
    """The folder of the card's sequence, relative to the root."""
    return f"train/{section_of(card, Mot3dSource).sequence}"


class Mot3d:
    """Scenes of one sequence of 3DMOT2015, cut from it one after the other into ``scene_frames`` kept frames.

    Neighbouring scenes show partly the same people, so intervals over them are narrower than over recordings.

    Frame of reference: the ground plane of the files, in metres. Boxes are nominal, with yaw 0. There is no ego
    vehicle: the ego state is the middle of all true positions of the sequence in whole metres. Time is (official
    frame - 1) / frame rate. Truth rows with confidence 0 are neutral. Raises CardError or DataError.
    """

    def __init__(self, card: Card, data: DataRoot = None) -> None:
        self.card = card
        self.section = section_of(card, Mot3dSource)
        require_classes(card, DATASET.name, ("pedestrian",))
        folder = folder_of(card)
        self.folder = DATASET.find(data, folder) / folder
        self._info = read_sequence_info(self.folder / SEQINFO)
        require_rate(card, self.section.sequence, self._info.rate, self.section.stride)
        for name in (SEQINFO, TRUTH, *([DETECTIONS] if card.detector is None else [])):
            if not (self.folder / name).is_file():
                advice = instead_of_stored(card) if name == DETECTIONS else ""
                raise MissingDataError(f"no file {self.folder / name}{advice}")
        self._kept = split_frames(card, self._info.length)
        self.names = tuple(
            self._kept
        )  # the sequence and the official number of the scene's first frame

    def load(self, name: str) -> Scene:
        """Read one scene; all its frames count, also those without people or detections."""
        kept, section = self._kept[name], self.section
        people = read_rows(self.folder / TRUTH, self._info.length)
        if not len(people.frame):
            raise DataError(
                f"{self.folder / TRUTH} has no rows, expected one per person and frame"
            )
        people.table.refuse_second_box(
            people.frame, people.object_id, np.arange(len(people.frame))
        )
        stored = section.detector if self.card.detector is None else None
        detections = no_detections(len(kept))
        if stored:
            found = read_rows(self.folder / DETECTIONS, self._info.length)
            row, frame = _select(found, kept)
            detections = people_detections(
                frame, found.ground[row, :2], found.confidence[row], len(kept)
            )
        time = (kept - 1) / self._info.rate
        row, frame = _select(people, kept)
        period, neutral = (
            1 / self._info.rate * section.stride,
            people.confidence[row] == 0,
        )
        truth = people_truth(
            frame, people.ground[row, :2], people.object_id[row], time, period, neutral
        )
        ego, visible = (
            np.tile(middle(people.ground), (len(kept), 1)),
            np.ones(len(truth.box)),
        )
        label = f"{stored}, stored detections" if stored else ""
        return Scene(
            name,
            time,
            ego,
            truth,
            detections,
            detector=label,
            visible=visible,
            recording=section.sequence,
        )


def split_frames(card: Card, length: int) -> dict[str, Ints]:
    """Official numbers (from 1) of the kept frames of each scene of the card's split, by the scene's name.

    The first ``train_scenes`` scenes are "train", the others "val". Raises CardError for a split without scenes.
    """
    section, shortest = section_of(card, Mot3dSource), card.task.past + card.task.future
    if section.scene_frames < shortest:
        expected = f"expected at least {shortest}: task.past and task.future"
        raise CardError(
            f"{card.id}: source.scene_frames is {section.scene_frames}, {expected}"
        )
    kept = np.arange(1, length + 1, section.stride)
    cut = [
        kept[first : first + section.scene_frames]
        for first in range(0, len(kept), section.scene_frames)
    ]
    scenes = [frames for frames in cut if len(frames) >= shortest]
    chosen = (
        scenes[: section.train_scenes]
        if section.split == "train"
        else scenes[section.train_scenes :]
    )
    if not chosen:
        raise CardError(
            f"{card.id}: split {section.split!r} has no scenes: {section.sequence} has {len(scenes)} of "
            f"{section.scene_frames} frames, and source.train_scenes is {section.train_scenes}"
        )
    return {f"{section.sequence}-{frames[0]:04d}": frames for frames in chosen}


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of ``gt.txt`` or ``det.txt`` in the order of the file."""

    table: RowTable
    frame: Ints  # [R] from 1
    object_id: Ints  # [R] -1 for detections
    confidence: Floats  # [R] detections: score; truth: 0 = not to be evaluated
    ground: Floats  # [R, 3] m, X Y Z of the foot point


def _select(rows: Rows, kept: Ints) -> tuple[Ints, Ints]:
    """Rows ``[n]`` of the kept frames, sorted by frame, and the index of each row's frame ``[n]``."""
    row = np.flatnonzero(np.isin(rows.frame, kept))
    row = row[np.argsort(rows.frame[row], kind="stable")]
    return row, np.searchsorted(kept, rows.frame[row])


def read_sequence_info(path: Path) -> SequenceInfo:
    """Frame rate and number of frames; DataError names the key that is missing or wrong."""
    parser = configparser.RawConfigParser()
    parser.optionxform = str  # type: ignore[assignment, method-assign]  # keys keep their capitals
    try:
        parser.read_string(read_text(path), source=str(path))
        return msgspec.convert(
            dict(parser.items("Sequence")), SequenceInfo, strict=False
        )
    except (configparser.Error, msgspec.ValidationError) as error:
        raise DataError(
            f"{path} cannot be read: {' '.join(str(error).split())}"
        ) from None


def read_rows(path: Path, length: int) -> Rows:
    """Rows of either file in a sequence of ``length`` frames; an empty file gives no rows.

    DataError names the line that is wrong. Sequences of the 2D benchmark have these names, but no ground coordinates.
    """
    table = read_table(path, COLUMNS, ",")
    table.refuse_not_finite(COLUMNS)
    frame = table.whole("frame")
    outside = (frame < 1) | (frame > length)
    table.refuse(
        outside,
        lambda row: (
            f"frame {frame[row]}, expected 1 to {length}, the seqLength of {SEQINFO}"
        ),
    )
    ground = table.matrix("X Y Z")
    flat = (
        "X, Y and Z are -1, as in the 2D benchmark (2DMOT2015), expected metres on the ground; get the file of 3D MOT "
        "2015, https://motchallenge.net/data/3D_MOT_2015"
    )
    table.refuse((ground == -1).all(axis=1), flat)
    return Rows(table, frame, table.whole("id"), table["confidence"], ground)

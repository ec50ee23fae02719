"""3DMOT2015: people on the ground plane with stored ACF detections; its card section.

One sequence is cut into scenes.
"""

import configparser
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
from pydantic import Field

from ...cards import Card, SourceSection, Traits, instead_of_stored
from ...core import CardError, DataError, Ints, MissingDataError, Scene
from ..base import (
    DataRoot,
    SourcePackage,
    require_classes,
    require_rate,
    section_of,
    sorted_rows,
)
from ..dataset import Dataset
from ..motion import middle, people_detections, people_scene, people_truth
from ..readers import read_table
from ..tables import RowTable
from ..text import read_text

DATASET = Dataset.of(__file__)
# inside train/<sequence>
SEQINFO = "seqinfo.ini"
TRUTH = "gt/gt.txt"
DETECTIONS = "det/det.txt"
COLUMNS = "frame id left top width height confidence X Y Z"


class SequenceInfo(msgspec.Struct, frozen=True, rename="camel"):
    """Content of the section [Sequence] of ``seqinfo.ini``."""

    frame_rate: Annotated[float, msgspec.Meta(gt=0, le=1e6)]  # Hz
    seq_length: Annotated[int, msgspec.Meta(gt=0, le=10**6)]  # frames


class Mot3dSource(SourceSection):
    """3DMOT2015: people seen by a fixed camera, with stored detections."""

    splits = ("train", "val")

    sequence: Literal["PETS09-S2L1", "TUD-Stadtmitte"]
    detector: Literal["acf"] = "acf"  # det/det.txt
    stride: Annotated[int, Field(ge=1)] = 1  # keep every n-th frame
    # kept frames per scene, the last scene may have fewer
    scene_frames: Annotated[int, Field(ge=2)] = 140
    # the first ones are for training, the others are "val"
    train_scenes: Annotated[int, Field(ge=0)] = 2

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
    """Return the folder of the card's sequence, relative to the root."""
    return f"train/{section_of(card, Mot3dSource).sequence}"


class Mot3d:
    """Scenes of one sequence of 3DMOT2015, cut one after the other.

    A scene has ``scene_frames`` kept frames. Neighbouring scenes show partly the same
    people, so intervals over them are narrower than over recordings.

    Frame of reference: the ground plane of the files, in metres. Boxes are nominal,
    with yaw 0. There is no ego vehicle: the ego state is the middle of all true
    positions of the sequence in whole metres. Time is (official frame - 1) / frame
    rate. Truth rows with confidence 0 are neutral. Raises CardError or DataError.
    """

    def __init__(self, card: Card, data: DataRoot = None) -> None:
        self.card = card
        self.section = section_of(card, Mot3dSource)
        require_classes(card, DATASET.name, ("pedestrian",))
        folder = folder_of(card)
        self.folder = DATASET.find(data, folder) / folder
        self._info = read_sequence_info(self.folder / SEQINFO)
        rate_hz = self._info.frame_rate
        require_rate(card, self.section.sequence, rate_hz, self.section.stride)
        if not (self.folder / TRUTH).is_file():
            raise MissingDataError(f"no file {self.folder / TRUTH}")
        if card.detector is None and not (self.folder / DETECTIONS).is_file():
            advice = instead_of_stored(card)
            raise MissingDataError(f"no file {self.folder / DETECTIONS}{advice}")
        self._frames = split_frames(card, self._info.seq_length)
        # the sequence and the official number of the scene's first frame
        self.names = tuple(self._frames)

    def load(self, name: str) -> Scene:
        """Read one scene, all its frames, also those without people."""
        frame_numbers = self._frames[name]
        people = read_rows(self.folder / TRUTH, self._info.seq_length)
        if not len(people):
            raise DataError(
                f"{people.source} has no rows, expected one per person and frame"
            )
        people.refuse_second_box(
            people.whole_numbers("frame"), people.whole_numbers("id")
        )
        shown, frame = _select(people, frame_numbers)
        rate_hz = self._info.frame_rate
        time = (frame_numbers - 1) / rate_hz
        truth = people_truth(
            frame,
            shown.matrix("X Y"),
            shown.whole_numbers("id"),
            time,
            period=1 / rate_hz * self.section.stride,
            neutral=shown["confidence"] == 0,
        )
        stored = None
        if self.card.detector is None:
            boxes = read_rows(self.folder / DETECTIONS, self._info.seq_length)
            shown, frame = _select(boxes, frame_numbers)
            place = shown.matrix("X Y")
            score = shown["confidence"]
            detections = people_detections(frame, place, score, len(frame_numbers))
            stored = detections, self.section.detector
        reference_point = middle(people.matrix("X Y"))
        sequence = self.section.sequence
        return people_scene(name, sequence, time, reference_point, truth, stored)


def split_frames(card: Card, length: int) -> dict[str, Ints]:
    """Return the official numbers (from 1) of the kept frames of each scene by name.

    The first ``train_scenes`` scenes are "train", the others "val". Raises CardError
    for a split without scenes.
    """
    section = section_of(card, Mot3dSource)
    size = section.scene_frames
    min_frames = card.task.past + card.task.future
    if size < min_frames:
        raise CardError(
            f"{card.id}: source.scene_frames is {size}, expected at least "
            f"{min_frames}: task.past and task.future"
        )
    frames = np.arange(1, length + 1, section.stride)
    scene_parts = np.split(frames, range(size, len(frames), size))
    scenes = [
        scene_frames for scene_frames in scene_parts if len(scene_frames) >= min_frames
    ]
    if section.split == "train":
        chosen = scenes[: section.train_scenes]
    else:
        chosen = scenes[section.train_scenes :]
    if not chosen:
        raise CardError(
            f"{card.id}: split {section.split!r} has no scenes: {section.sequence} has "
            f"{len(scenes)} of {size} frames, and source.train_scenes is "
            f"{section.train_scenes}"
        )
    return {
        f"{section.sequence}-{scene_frames[0]:04d}": scene_frames
        for scene_frames in chosen
    }


def _select(table: RowTable, frame_numbers: Ints) -> tuple[RowTable, Ints]:
    """Return the rows in a scene's frames, sorted, and the frame of each.

    ``frame_numbers`` [F]: official numbers of the scene's frames, which count from 0.
    """
    number = table.whole_numbers("frame")
    rows = sorted_rows(number, np.isin(number, frame_numbers))
    return table.select(rows), np.searchsorted(frame_numbers, number[rows])


def read_sequence_info(path: Path) -> SequenceInfo:
    """Read frame rate and number of frames.

    DataError names the wrong key.
    """
    parser = configparser.RawConfigParser()
    # keys keep their capitals
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    try:
        parser.read_string(read_text(path), source=str(path))
        section = dict(parser.items("Sequence"))
        # strict=False: the values are texts
        return msgspec.convert(section, SequenceInfo, strict=False)
    except (configparser.Error, msgspec.ValidationError) as error:
        problem = " ".join(str(error).split())  # in one line
        raise DataError(f"{path} cannot be read: {problem}") from None


def read_rows(path: Path, length: int) -> RowTable:
    """Read the rows of `TRUTH` or `DETECTIONS` of a sequence.

    Frames count from 1 to ``length``. The id of detections is -1, and their confidence
    is the score; true people with confidence 0 are not to be evaluated. X, Y and Z are
    metres of the foot point. An empty file gives no rows. DataError names the line that
    is wrong. Sequences of the 2D benchmark have these names, but no ground coordinates.
    """
    table = read_table(path, COLUMNS, ",")
    frame = table.whole_numbers("frame")
    expected = f"expected 1 to {length}, the seqLength of {SEQINFO}"
    is_outside = (frame < 1) | (frame > length)
    table.refuse(is_outside, lambda row: f"frame {frame[row]}, {expected}")
    ground = table.matrix("X Y Z")
    table.refuse(
        (ground == -1).all(axis=1),
        "X, Y and Z are -1, as in the 2D benchmark (2DMOT2015), expected metres on the "
        "ground; get the file of 3D MOT 2015, "
        "https://motchallenge.net/data/3D_MOT_2015",
    )
    return table


PACKAGE = SourcePackage(
    open=Mot3d,
    dataset=DATASET,
    locate=lambda card, data: DATASET.status(data, folder_of(card)),
)

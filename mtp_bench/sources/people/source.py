"""ETH/UCY: eight recordings of people on the ground plane, cut into scenes; their detections are simulated."""

from pathlib import Path

import numpy as np

from ...cards import Card, SourceSection, Traits
from ...core import DataError, Floats, Ints, Scene
from ..base import DataRoot, no_detections, require_classes, require_rate, section_of
from ..dataset import Dataset
from ..motion import middle, people_truth
from ..text import read_table

RATE, STEP = 2.5, 10  # Hz; frames are numbered in steps of ten
SCENE_FRAMES = 100  # 40 s; the last scene of a recording, and one with holes, has fewer
TESTS = {
    "eth": ("biwi_eth",),
    "hotel": ("biwi_hotel",),
    "univ": ("students001", "students003"),
    "zara1": ("crowds_zara01",),
    "zara2": ("crowds_zara02",),
}
TRAINING = ("crowds_zara03", "uni_examples")  # never held out
RECORDINGS = (*sum(TESTS.values(), ()), *TRAINING)
SPLITS = {
    "val": RECORDINGS[: -len(TRAINING)],
    "train": TRAINING,
    **TESTS,
    **{
        f"train-{name}": tuple(each for each in RECORDINGS if each not in held)
        for name, held in TESTS.items()
    },
}
DATASET = Dataset.of(__file__)


class PeopleSource(SourceSection):
    """ETH/UCY: people on the ground plane; the detections are simulated.

    Splits: ``"eth"`` holds out ETH, and ``"train-eth"`` has all other recordings; ``"hotel"``, ``"univ"``, ``"zara1"``
    and ``"zara2"`` alike. ``"val"``: all that are held out; ``"train"``: the two that never are.
    """

    splits = tuple(SPLITS)

    @property
    def traits(self) -> Traits:
        """Abilities of the source."""
        return Traits(
            without_detections="ETH/UCY",
            places_only=True,
            bounded_by_truth=True,
            has_ego=False,
        )


def files_of(card: Card) -> tuple[str, ...]:
    """Files of the recordings of the card's split."""
    return tuple(
        f"{recording}.txt" for recording in SPLITS[section_of(card, PeopleSource).split]
    )


class People:
    """Scenes of at most 40 s, named by recording and number of the first frame.

    Frame of reference: the ground plane of the recording's file, in metres. Boxes are nominal, with yaw 0. Frames
    without people are not in the files: a hole in time, which no past and no future crosses. There is no ego vehicle:
    the ego state is the middle of the recording's positions in whole metres. Raises CardError or DataError.
    """

    def __init__(self, card: Card, data: DataRoot = None) -> None:
        require_classes(card, DATASET.name, ("pedestrian",))
        require_rate(card, DATASET.name, RATE)
        files = files_of(card)
        root = DATASET.find(data, files[0])
        least = card.task.past + card.task.future
        self._scenes: dict[str, tuple[Path, Ints]] = {}
        for path in (root / file for file in files):
            frames = np.unique(read_recording(path)[0])
            scene = (frames - frames[:1]) // (STEP * SCENE_FRAMES)
            for part in np.split(frames, np.flatnonzero(np.diff(scene)) + 1):
                if len(part) >= least:
                    self._scenes[f"{path.stem}-{part[0]:05d}"] = path, part
        if not self._scenes:
            raise DataError(
                f"{root} has no scene of at least {least} frames: task.past and task.future"
            )
        self.names = tuple(self._scenes)

    def load(self, name: str) -> Scene:
        """Read one scene; DataError names the file and line that is wrong."""
        path, frames = self._scenes[name]
        frame, person, place = read_recording(path)
        row = np.isin(frame, frames)
        time, index = frames / STEP / RATE, np.searchsorted(frames, frame[row])
        truth = people_truth(index, place[row], person[row], time, 1 / RATE)
        ego, visible = np.tile(middle(place), (len(frames), 1)), np.ones(len(truth.box))
        return Scene(
            name,
            time,
            ego,
            truth,
            no_detections(len(frames)),
            visible=visible,
            recording=path.stem,
        )


def read_recording(path: Path) -> tuple[Ints, Ints, Floats]:
    """Frame [R], sorted, person [R] and place [R, 2], m, of each row; DataError names the line that is wrong."""
    table = read_table(path, "frame id x y")
    table.refuse_not_finite("x y")
    frame, person = table.whole("frame"), table.whole("id")
    table.refuse(
        frame % STEP != 0,
        lambda row: f"frame {frame[row]}, expected a multiple of {STEP}: {RATE:g} Hz",
    )
    table.refuse_second_box(frame, person, np.arange(len(frame)))
    order = np.argsort(frame, kind="stable")
    return frame[order], person[order], table.matrix("x y")[order]

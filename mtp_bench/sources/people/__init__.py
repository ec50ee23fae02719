"""ETH/UCY: eight recordings of people on the ground plane, cut into scenes.

Their detections are simulated.
"""

from pathlib import Path

import numpy as np

from ...cards import Card, SourceSection, Traits
from ...core import DataError, Floats, Ints, Scene
from ..base import DataRoot, SourcePackage, require_classes, require_rate, section_of
from ..dataset import Dataset
from ..motion import middle, people_scene, people_truth
from ..readers import read_table

RATE_HZ = 2.5
FRAME_STEP = 10  # between the numbers of two frames
# 40 s; the last scene of a recording, and one with holes, has fewer
SCENE_FRAMES = 100
TESTS = {
    "eth": ("biwi_eth",),
    "hotel": ("biwi_hotel",),
    "univ": ("students001", "students003"),
    "zara1": ("crowds_zara01",),
    "zara2": ("crowds_zara02",),
}
TRAINING = ("crowds_zara03", "uni_examples")  # never held out
_HELD_OUT = sum(TESTS.values(), ())
RECORDINGS = (*_HELD_OUT, *TRAINING)
SPLITS = {"val": _HELD_OUT, "train": TRAINING, **TESTS}
for _name, _tests in TESTS.items():
    SPLITS[f"train-{_name}"] = tuple(r for r in RECORDINGS if r not in _tests)
DATASET = Dataset.of(__file__)


class PeopleSource(SourceSection):
    """ETH/UCY: people on the ground plane; the detections are simulated.

    Splits: ``"eth"`` holds out ETH, and ``"train-eth"`` has all other recordings;
    ``"hotel"``, ``"univ"``, ``"zara1"`` and ``"zara2"`` alike. ``"val"``: all that are
    held out; ``"train"``: the two that never are.
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
    """Return the files of the recordings of the card's split."""
    recordings = SPLITS[section_of(card, PeopleSource).split]
    return tuple(f"{recording}.txt" for recording in recordings)


class People:
    """Scenes of at most 40 s, named by recording and number of the first frame.

    Frame of reference: the ground plane of the recording's file, in metres. Boxes are
    nominal, with yaw 0. Frames without people are not in the files: a hole in time,
    which no past and no future crosses. There is no ego vehicle: the ego state is the
    middle of the recording's positions in whole metres. Raises CardError or DataError.
    """

    def __init__(self, card: Card, data: DataRoot = None) -> None:
        require_classes(card, DATASET.name, ("pedestrian",))
        require_rate(card, DATASET.name, RATE_HZ)
        files = files_of(card)
        root = DATASET.find(data, files[0])
        min_frames = card.task.past + card.task.future
        # file and frame numbers of each scene
        self._scenes: dict[str, tuple[Path, Ints]] = {}
        for file in files:
            path = root / file
            row_frame, _, _ = read_recording(path)
            file_frames = np.unique(row_frame)
            # [:1] as the file may have no frames
            scene_index = (file_frames - file_frames[:1]) // (FRAME_STEP * SCENE_FRAMES)
            scene_starts = np.flatnonzero(np.diff(scene_index)) + 1
            for scene_frames in np.split(file_frames, scene_starts):
                if len(scene_frames) >= min_frames:
                    self._scenes[f"{path.stem}-{scene_frames[0]:05d}"] = (
                        path,
                        scene_frames,
                    )
        if not self._scenes:
            raise DataError(
                f"{root} has no scene of at least {min_frames} frames: task.past and "
                "task.future"
            )
        self.names = tuple(self._scenes)

    def load(self, name: str) -> Scene:
        """Read one scene.

        DataError names the file and line that is wrong.
        """
        path, scene_frames = self._scenes[name]
        row_frame, person, place = read_recording(path)
        is_shown = np.isin(row_frame, scene_frames)
        time = scene_frames / FRAME_STEP / RATE_HZ
        frame = np.searchsorted(scene_frames, row_frame[is_shown])
        truth = people_truth(
            frame, place[is_shown], person[is_shown], time, 1 / RATE_HZ
        )
        return people_scene(name, path.stem, time, middle(place), truth)


def read_recording(path: Path) -> tuple[Ints, Ints, Floats]:
    """Read frame number [R], sorted, person [R] and place [R, 2], m, of each row.

    DataError names the line that is wrong.
    """
    table = read_table(path, "frame id x y")
    frame_number = table.whole_numbers("frame")
    person = table.whole_numbers("id")
    expected = f"expected a multiple of {FRAME_STEP}: {RATE_HZ:g} Hz"
    is_between = frame_number % FRAME_STEP != 0
    table.refuse(is_between, lambda row: f"frame {frame_number[row]}, {expected}")
    table.refuse_second_box(frame_number, person)
    order = np.argsort(frame_number, kind="stable")
    return frame_number[order], person[order], table.matrix("x y")[order]


PACKAGE = SourcePackage(
    open=People,
    dataset=DATASET,
    locate=lambda card, data: DATASET.status(data, files_of(card)[0]),
)

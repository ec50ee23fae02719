"""Import of scenes and tracks: KITTI text as scenes, and any scenes as a folder of own scenes with a card."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..cards import Card, FilesSource, card_text, with_files
from ..errors import DataError, MtpBenchError
from ..files import new_folder, write_text
from ..types import Scene
from .base import SceneSource, no_detections
from .files.checks import check_period
from .files.frames import MOST_FRAMES
from .files.save import TableForm, box_columns, save_scene
from .files.table import write_table
from .kitti.files import SENSOR_FROM_CAMERA, read_imu_to_camera, read_labels, read_odometry, read_oxts
from .kitti.layout import TYPES
from .kitti.poses import FRAME_PERIOD, Poses, integrated_poses
from .kitti.source import Frames, detections_of, stored_rows, truth_of
from .motion import looking_back
from .stored_tracks import table_path


@dataclass(frozen=True)
class KittiText:
    """Folders of KITTI text with a file for each sequence, ``0001.txt``.

    Attributes:
        labels: True boxes with ids, as in ``label_02``.
        detections: Rows of the same columns and a score, or AB3DMOT's ``Car/0001.txt``.
        oxts: Rows of the GPS/IMU unit, one per frame; needs ``calib``.
        calib: Calibrations from the GPS/IMU unit to the camera.
        poses: Poses of the camera, rows of 12 numbers, as in KITTI's odometry benchmark.
        period: Seconds between frames; KITTI's own by default.
    """

    labels: Path
    detections: Path | None = None
    oxts: Path | None = None
    calib: Path | None = None
    poses: Path | None = None
    period: float = FRAME_PERIOD

    @property
    def posed(self) -> bool:
        """True if all frames of a scene share one frame of reference."""
        return self.oxts is not None or self.poses is not None


def kitti_scenes(text: KittiText, classes: Sequence[str]) -> Iterator[Scene]:
    """Scenes of KITTI text, sorted by name; DontCare regions are dropped.

    Without poses every frame is in its own sensor frame, x forward, y left, z up. Raises DataError that names the file
    and the line that is wrong.
    """
    if (text.oxts is None) != (text.calib is None):
        raise MtpBenchError("GPS/IMU data and its calibration belong together: name both --oxts and --calib")
    if text.oxts is not None and text.poses is not None:
        raise MtpBenchError("poses are given twice, by --oxts and by --poses: name one of them")
    names = sorted(path.stem for path in text.labels.glob("*.txt"))
    if not names:
        raise DataError(f"{text.labels} has no labels, expected a file for each sequence, such as 0001.txt")
    return (_kitti_scene(text, name, tuple(classes)) for name in names)


def import_scenes(
    scenes: Iterator[Scene],
    card: Card,
    folder: Path,
    posed: bool = True,
    form: TableForm = "csv",
    done: Callable[[str], object] = lambda _: None,
) -> tuple[int, Path]:
    """Write scenes of the classes of ``card`` and a card for them into ``folder``; returns their number and its path.

    ``card``: gives the new card its task, sizes and detector. ``posed``: the frames of a scene share one frame of
    reference. Raises MtpBenchError if the folder is not empty or frames do not have the rate of the card; it then
    writes no file.
    """
    folder = folder.expanduser().absolute()
    name = re.sub(r"[^A-Za-z0-9_.-]", "-", folder.name) or "own"
    count, detected = 0, False
    with new_folder(folder) as part:
        for scene in scenes:
            check_period(scene.time, card, f"scene {scene.name!r}")
            save_scene(scene, part, card.task.classes, form)
            detected |= bool(scene.detector)
            count += 1
            done(scene.name)
        own = with_files(card, part)
        assert isinstance(own.source, FilesSource)
        source = own.source.model_copy(update={"folder": ".", "sha256": None, "ego_motion": posed})
        update = {"id": name, "summary": f"own scenes under the rules of {card.id}", "source": source}
        if detected:  # otherwise a simulated detector would replace these detections
            update["detector"] = None
        write_text(part / f"{name}.toml", card_text(own.model_copy(update=update)))
    return count, folder / f"{name}.toml"


def import_tracks(
    source: SceneSource,
    names: Sequence[str],
    card: Card,
    folder: Path,
    done: Callable[[str], object] = lambda _: None,
) -> tuple[int, int]:
    """Write the stored tracks of the scenes ``names`` of ``source`` into ``folder``, a table for each scene.

    Returns the numbers of scenes and of boxes. Raises DataError for wrong tracks, and MtpBenchError if the folder is
    not empty; it then writes no file.
    """
    boxes = count = 0
    classes = np.array(card.task.classes, dtype=np.str_)
    with new_folder(folder.expanduser().absolute()) as part:
        for scene in map(source.load, names):
            tracks = scene.tracks
            if tracks is None:
                continue
            columns = box_columns(tracks, classes)
            table = {"frame": columns["frame"], "id": tracks.object_id, **columns, "score": tracks.score}
            write_table(table_path(part, scene.name), table)
            count, boxes = count + 1, boxes + len(tracks.box)
            done(scene.name)
    return count, boxes


def _kitti_scene(text: KittiText, name: str, classes: tuple[str, ...]) -> Scene:
    labels = read_labels(text.labels / f"{name}.txt")
    poses = _poses(text, name)
    last = int(labels.frame.max(initial=-1))
    length = _length(text, name, last, classes) if poses is None else len(poses.position)
    frames = Frames(length, 1, poses, text.period)
    frames.check(labels)
    detections, skipped, label = no_detections(length), dict[str, int](), ""
    if text.detections is not None:
        detections, skipped = detections_of(text.detections, name, classes, frames)
        label = f"{text.detections.name}, stored detections"
    time = np.arange(length) * text.period
    ego = np.zeros((length, 4)) if poses is None else poses.ego()
    truth = looking_back(truth_of(labels, classes, frames), time)
    return Scene(name, time, ego, truth, detections, detector=label, skipped=skipped)


def _poses(text: KittiText, name: str) -> Poses | None:
    if text.oxts is not None and text.calib is not None:
        to_camera = read_imu_to_camera(text.calib / f"{name}.txt")
        return integrated_poses(read_oxts(text.oxts / f"{name}.txt"), to_camera, text.period)
    if text.poses is None:
        return None
    camera = read_odometry(text.poses / f"{name}.txt")
    rotation = SENSOR_FROM_CAMERA @ camera[:, :, :3] @ SENSOR_FROM_CAMERA.T
    return Poses(rotation, camera[:, :, 3] @ SENSOR_FROM_CAMERA.T)


def _length(text: KittiText, name: str, last: int, classes: tuple[str, ...]) -> int:
    """Number of frames of a sequence without poses: up to the last frame of any row."""
    path = text.labels / f"{name}.txt"
    for kind in classes if text.detections is not None else ():
        path = text.detections or path
        last = max(last, int(stored_rows(path, name, *TYPES[kind]).frame.max(initial=-1)))
    if not 0 <= last < MOST_FRAMES:
        raise DataError(f"{path}: the last frame of {name} is {last}, expected 0 to {MOST_FRAMES - 1}")
    return last + 1

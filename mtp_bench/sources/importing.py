"""Text of KITTI's tracking benchmark as scenes, and any scenes as a folder of own scenes with a card."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..cards import Card, FilesSource, card_text, with_files
from ..errors import DataError, MtpBenchError
from ..files import new_folder, write_text
from ..types import ImageField, Scene
from .base import SceneSource, no_detections
from .files.content import require_period
from .files.writing import Form, save_scene
from .kitti.files import SENSOR_FROM_CAMERA, Labels, read_imu_to_camera, read_labels, read_odometry, read_oxts
from .kitti.image import image_field, known_camera
from .kitti.layout import TYPES
from .kitti.poses import FRAME_PERIOD, Poses, integrated_poses
from .kitti.source import Frames, detections_of, stored_rows, truth_of
from .motion import looking_back
from .tracks.table import table_path, write_table_of_tracks

MOST_FRAMES = 1_000_000  # of a scene


@dataclass(frozen=True)
class KittiText:
    """Folders of KITTI text, with a file for each sequence, ``0001.txt``; what is None is not there.

    Attributes:
        labels: True boxes with ids, as in ``label_02``.
        detections: Rows of the same columns and a score, or AB3DMOT's ``Car/0001.txt``.
        oxts: The GPS/IMU unit, one row per frame; needs ``calib``.
        calib: Calibrations, from the GPS/IMU unit to the camera.
        poses: Poses of the camera, rows of 12 numbers, as in KITTI's odometry benchmark.
        period: Seconds between frames; KITTI's own unless stated.
        image: Whether scenes keep what the image can confirm, such as DontCare regions; no table can hold it.
    """

    labels: Path
    detections: Path | None = None
    oxts: Path | None = None
    calib: Path | None = None
    poses: Path | None = None
    period: float = FRAME_PERIOD
    image: bool = True

    @property
    def posed(self) -> bool:
        """Whether all frames of a scene share one frame of reference."""
        return self.oxts is not None or self.poses is not None


def kitti_scenes(text: KittiText, classes: Sequence[str]) -> Iterator[Scene]:
    """The scenes of KITTI text, in the order of their names.

    Without poses every frame is in its own sensor frame, x forward, y left, z up. Raises DataError that names the file
    and the line that is wrong.
    """
    if (text.oxts is None) != (text.calib is None):
        raise MtpBenchError("GPS/IMU data needs the calibration, and nothing else does: name both --oxts and --calib")
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
    form: Form = "npz",
    done: Callable[[str], object] = lambda _: None,
) -> tuple[int, Path]:
    """Write scenes of the classes of ``card`` into ``folder``, beside a card for them; their number and its path.

    ``card``: its task, sizes and detector are those of the new card; a simulated detector is left out if
    the scenes have detections. ``posed``: the frames of a scene share one frame
    of reference. Raises MtpBenchError, also where the folder holds anything, and where frames are not as far apart as
    the card says; nothing is written then.
    """
    folder = folder.expanduser().absolute()
    name = re.sub(r"[^A-Za-z0-9_.-]", "-", folder.name) or "own"
    count, detected = 0, False
    with new_folder(folder) as part:
        for scene in scenes:
            require_period(scene.time, card, f"scene {scene.name!r}")
            save_scene(scene, part, card.task.classes, form)
            count, detected = count + 1, detected or bool(scene.detector)
            done(scene.name)
        own = with_files(card, part)
        assert isinstance(own.source, FilesSource)
        source = own.source.model_copy(update={"folder": ".", "sha256": None, "ego_motion": posed})
        update = {"id": name, "summary": f"own scenes under the rules of {card.id}", "source": source}
        if detected:  # else a simulated detector would stand in for these detections
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

    Returns the numbers of scenes and of boxes. Raises DataError where the tracks are wrong, and MtpBenchError where the
    folder holds anything; nothing is written then.
    """
    boxes = count = 0
    with new_folder(folder.expanduser().absolute()) as part:
        for scene in map(source.load, names):
            tracks = scene.tracks
            if tracks is None:
                continue
            kinds = [card.task.classes[place] for place in tracks.class_id]
            known = tracks.velocity.astype(object)
            known[np.isnan(tracks.velocity)] = None
            columns = (tracks.frame_of_rows.tolist(), tracks.object_id.tolist(), kinds, *tracks.box.T.tolist())
            rows = zip(*columns, tracks.score.tolist(), *known.T.tolist(), strict=True)
            write_table_of_tracks(table_path(part, scene.name), rows)
            count, boxes = count + 1, boxes + len(kinds)
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
    return Scene(
        name=name,
        time=time,
        ego=np.zeros((length, 4)) if poses is None else poses.ego(),
        truth=looking_back(truth_of(labels, classes, frames), time),
        detections=detections,
        detector=label,
        skipped=skipped,
        image=_image(text, name, labels, frames, classes, skipped),
    )


def _image(
    text: KittiText, name: str, labels: Labels, frames: Frames, classes: tuple[str, ...], skipped: dict[str, int]
) -> ImageField | None:
    """What the image can confirm, as of KITTI's own scenes; None without one of its cameras and where that was."""
    region, start = frames.regions(labels)
    path = text.calib / f"{name}.txt" if text.calib is not None and text.image else None
    if path is not None and frames.poses is not None and known_camera(path):
        return image_field(path, frames.poses, True, region, start, classes)
    if len(region):
        skipped["truth of type 'DontCare', which needs --oxts, --calib of a camera of KITTI and NPZ"] = len(region)
    return None


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
    """Frames of a sequence without poses: up to the last that a row is of."""
    path = text.labels / f"{name}.txt"
    for kind in classes if text.detections is not None else ():
        path = text.detections or path
        last = max(last, int(stored_rows(path, name, *TYPES[kind]).frame.max(initial=-1)))
    if not 0 <= last < MOST_FRAMES:
        raise DataError(f"{path}: the last frame of {name} is {last}, expected 0 to {MOST_FRAMES - 1}")
    return last + 1

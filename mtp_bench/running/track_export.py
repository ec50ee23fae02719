"""The tracks of a stored run in the forms of other programs, for their evaluations or to be read back."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..cards import Card
from ..errors import CardError
from ..files import new_folder, whole_file
from ..parallel import NO_PROGRESS, Progress
from ..sources.kitti.layout import TYPES
from ..sources.kitti.section import KittiSource
from ..sources.kitti.tracks import poses_of, result_lines
from ..sources.nuscenes.section import NuScenesSource
from ..sources.nuscenes.source import NuScenes
from ..sources.nuscenes.tracks import submission_box
from ..sources.tracks.table import SCORED, table_path, write_table_of_tracks
from ..types import Floats, Ints, Rollout, Scene, starts_of_sorted
from .opened import OpenedRun

_FILES = (".json", ".csv", ".txt")  # names that end so are of files: nobody wants a folder of such a name


@dataclass(frozen=True, eq=False)
class TrackRows:
    """Tracks of a scene, R boxes sorted by frame, in its frame of reference."""

    frame: Ints  # [R]
    track_id: Ints  # [R]
    class_id: Ints  # [R]
    box: Floats  # [R, 7]
    score: Floats  # [R]


def track_rows(rollout: Rollout, scene: Scene, card: Card) -> TrackRows:
    """The tracks of the heaviest hypothesis of each frame.

    A rollout has no scores of tracks. As in the files of other trackers it is the score of the detection at the place
    of the track (the nearest of its class within the forecast gate), or of the last one; 0 before there was any.
    """
    frame = rollout.tracks.frame_of_rows
    heaviest = rollout.hypothesis_log_weight.argmax(axis=1)
    kept = rollout.member[np.arange(len(frame)), heaviest[frame]] & (rollout.track_class >= 0)
    box, class_id, track_id = rollout.track_box.astype(np.float64), rollout.track_class, rollout.track_id
    rows = TrackRows(frame[kept], track_id[kept], class_id[kept], box[kept], np.zeros(int(kept.sum())))
    gate = np.array(card.per_class(card.task.forecast_gate))
    return replace(rows, score=_scores(rows, scene, gate))


def _scores(rows: TrackRows, scene: Scene, gate: Floats) -> Floats:
    """Scores [R]; ``gate`` [C] m."""
    score, last = np.zeros(len(rows.frame)), dict[int, float]()
    start = starts_of_sorted(rows.frame, scene.frames)
    for t in range(scene.frames):
        seen, mine = scene.detections.rows(t), slice(start[t], start[t + 1])
        apart = np.linalg.norm(rows.box[mine, None, :2] - scene.detections.box[None, seen, :2], axis=-1)
        apart[rows.class_id[mine, None] != scene.detections.class_id[None, seen]] = np.inf
        near = apart.min(axis=1, initial=np.inf) <= gate[rows.class_id[mine]]
        for at, found, distance in zip(range(start[t], start[t + 1]), near.tolist(), apart, strict=True):
            if found:
                last[int(rows.track_id[at])] = float(scene.detections.score[seen][distance.argmin()])
            score[at] = last.get(int(rows.track_id[at]), 0.0)
    return score


def export_tracks(opened: OpenedRun, path: str | Path, table: bool = False, progress: Progress = NO_PROGRESS) -> int:
    """Write the tracks of a stored run to ``path``; how many boxes that are. ``progress`` is told each scene.

    nuScenes: a .json file in the submission form of the tracking task. KITTI: a folder of the benchmark's results. With
    ``table``, and of every other source: a folder of tables (`sources.tracks.table`). Raises CardError where a path
    does not fit, and MtpBenchError for a folder that is not empty.
    """
    card, scenes = opened.card, ((rollout, opened.recorded(rollout.scene)) for rollout in opened.run.rollouts)

    def rows() -> Iterator[tuple[Scene, TrackRows]]:
        for rollout, scene in scenes:
            yield scene, track_rows(rollout, scene, card)
            progress.done(rollout.scene)

    progress.started(len(opened.run.rollouts))
    return write_tracks(rows(), card, opened.data, Path(path).absolute(), table)


def write_tracks(
    rows: Iterable[tuple[Scene, TrackRows]], card: Card, data: str | None, path: Path, table: bool = False
) -> int:
    """Write the tracks of scenes of ``card``; see `export_tracks`."""
    if isinstance(card.source, NuScenesSource) and not table:
        if path.suffix != ".json":
            raise CardError(
                f"{path}: the tracking task of nuScenes takes a .json file; for a folder of tables say --table"
            )
        return _write_submission(rows, card, data, path)
    of_kitti = isinstance(card.source, KittiSource) and not table
    if path.suffix in _FILES:
        what = "KITTI's results" if of_kitti else "tables"
        raise CardError(f"{path}: {card.id} is written as {what}: name a folder, not a {path.suffix} file")
    write = _write_result if of_kitti else _write_table
    count = 0
    with new_folder(path) as part:
        for scene, found in rows:
            write(scene, found, card, data, part)
            count += len(found.frame)
    return count


def _write_result(scene: Scene, rows: TrackRows, card: Card, data: str | None, folder: Path) -> None:
    assert isinstance(card.source, KittiSource)
    frame = rows.frame * card.source.stride
    types = [TYPES[card.task.classes[c]][0] for c in rows.class_id]
    lines = result_lines(frame, rows.track_id, types, rows.box, rows.score, poses_of(card, data, scene.name))
    (folder / f"{scene.name}.txt").write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


def _write_table(scene: Scene, rows: TrackRows, card: Card, data: str | None, folder: Path) -> None:
    names = [card.task.classes[c] for c in rows.class_id]
    columns = (rows.frame.tolist(), rows.track_id.tolist(), names, rows.box.tolist(), rows.score.tolist())
    every = ([t, i, name, *box, score] for t, i, name, box, score in zip(*columns, strict=True))
    write_table_of_tracks(table_path(folder, scene.name), every, SCORED)


def _write_submission(rows: Iterable[tuple[Scene, TrackRows]], card: Card, data: str | None, path: Path) -> int:
    tables, count = NuScenes(card, data).tables, 0
    with whole_file(path) as part, part.open("w", encoding="utf-8") as file:
        meta = dict.fromkeys(("use_camera", "use_lidar", "use_radar", "use_map", "use_external"), False)
        file.write(f'{{"meta": {json.dumps(meta)}, "results": {{')
        between = ""
        for scene, found in rows:
            for token, boxes in _samples(scene, found, card, tables.arrays(scene.name)["sample"].tolist()):
                file.write(f"{between}\n{json.dumps(token)}: {json.dumps(boxes)}")
                between, count = ",", count + len(boxes)
        file.write("\n}}\n")
    return count


def _samples(
    scene: Scene, rows: TrackRows, card: Card, tokens: list[str]
) -> Iterator[tuple[str, list[dict[str, object]]]]:
    """The boxes of each sample; velocities are those from the box before of the same track."""
    before: dict[int, tuple[float, Floats]] = {}
    start = starts_of_sorted(rows.frame, scene.frames)
    for t, token in enumerate(tokens):
        boxes: list[dict[str, object]] = []
        for at in range(start[t], start[t + 1]):
            identity, box = int(rows.track_id[at]), rows.box[at]
            last, place = before.get(identity, (float(scene.time[t]), box[:2]))
            passed = float(scene.time[t]) - last
            velocity = (box[:2] - place) / passed if passed else np.zeros(2)
            before[identity] = float(scene.time[t]), box[:2]
            name = card.task.classes[rows.class_id[at]]
            boxes.append(submission_box(token, box, velocity, name, str(identity), float(rows.score[at])))
        yield token, boxes

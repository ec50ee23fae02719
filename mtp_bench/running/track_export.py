"""Export of the tracks of a stored run in the file formats of other programs."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..cards import Card
from ..core import (
    CardError,
    Floats,
    Ints,
    Rollout,
    Scene,
    long_work,
    new_folder,
    starts_of_sorted,
    whole_file,
)
from ..sources import (
    BOX_COLUMNS,
    KITTI_TYPES,
    Argoverse2Source,
    KittiSource,
    NuScenes,
    NuScenesSource,
    poses_of,
    result_lines,
    submission_box,
    table_path,
    tracking_submission,
    write_table,
)
from .stored import OpenedRun

# Suffixes of files: a folder of such a name is a mistake.
_FILE_SUFFIXES = (".json", ".csv", ".txt", ".feather")


@dataclass(frozen=True, eq=False)
class TrackRows:
    """Tracks of a scene, R boxes sorted by frame, in its frame of reference."""

    frame: Ints  # [R]
    track_id: Ints  # [R]
    class_id: Ints  # [R]
    box: Floats  # [R, 7]
    score: Floats  # [R]


def track_rows(rollout: Rollout, scene: Scene, card: Card) -> TrackRows:
    """Return the tracks of the heaviest hypothesis of each frame.

    A rollout has no scores of tracks. As in the files of other trackers, the score of a
    track is that of its detection: the nearest of its class within the forecast gate,
    or the last one; 0 before the first.
    """
    frame = rollout.tracks.frame_of_rows
    heaviest = rollout.hypothesis_log_weight.argmax(axis=1)
    is_member = rollout.member[np.arange(len(frame)), heaviest[frame]]
    track_row = np.flatnonzero(is_member & (rollout.track_class >= 0))
    scene_rows = TrackRows(
        frame[track_row],
        rollout.track_id[track_row],
        rollout.track_class[track_row],
        rollout.track_box[track_row].astype(np.float64),
        np.zeros(len(track_row)),
    )
    gate_m = np.array(card.per_class(card.task.forecast_gate))
    return replace(scene_rows, score=_scores(scene_rows, scene, gate_m))


def _scores(rows: TrackRows, scene: Scene, gate_m: Floats) -> Floats:
    """Return scores [R] of tracks; ``gate_m`` [C]."""
    track_scores = np.zeros(len(rows.frame))
    last_score: dict[int, float] = {}  # by track
    detections = scene.detections
    start = starts_of_sorted(rows.frame, scene.frames)
    for t in range(scene.frames):
        detected = detections.rows(t)
        tracks = slice(start[t], start[t + 1])
        offset_m = rows.box[tracks, None, :2] - detections.box[None, detected, :2]
        distance_m = np.linalg.norm(offset_m, axis=-1)
        class_id = rows.class_id[tracks]
        distance_m[class_id[:, None] != detections.class_id[None, detected]] = np.inf
        is_near = distance_m.min(axis=1, initial=np.inf) <= gate_m[class_id]
        for i, track_id in enumerate(rows.track_id[tracks].tolist()):
            if is_near[i]:
                nearest = distance_m[i].argmin()
                last_score[track_id] = float(detections.score[detected][nearest])
            track_scores[start[t] + i] = last_score.get(track_id, 0.0)
    return track_scores


def export_tracks(opened: OpenedRun, path: str | Path, table: bool = False) -> int:
    """Write the tracks of a stored run to ``path`` and return the number of boxes.

    nuScenes: a .json file in the submission form of the tracking task; Argoverse 2: a
    .feather file in its form. KITTI: a folder of the benchmark's results. With
    ``table``, and for every other source: a folder of tables
    (`sources.stored_tracks`). Raises CardError for a path that does not fit the format,
    and MtpBenchError for a folder that is not empty.
    """
    rollouts = opened.run.rollouts
    with long_work("exporting tracks") as progress:
        progress.started(len(rollouts))

        def rows() -> Iterator[tuple[Scene, TrackRows]]:
            for rollout in rollouts:
                scene = opened.recorded(rollout.scene)
                yield scene, track_rows(rollout, scene, opened.card)
                progress.done(rollout.scene)

        target = Path(path).absolute()
        return write_tracks(rows(), opened.card, opened.data, target, table)


def write_tracks(
    rows: Iterable[tuple[Scene, TrackRows]],
    card: Card,
    data: str | None,
    path: Path,
    table: bool = False,
) -> int:
    """Write the tracks of scenes of ``card``; see `export_tracks`."""
    for source, dataset_name, suffix, write_file in _SUBMISSIONS:
        if isinstance(card.source, source) and not table:
            if path.suffix != suffix:
                raise CardError(
                    f"{path}: the task of {dataset_name} takes a {suffix} file; "
                    "for a folder of tables pass --table"
                )
            return write_file(rows, card, data, path)
    write_scene, form = _write_table, "tables"
    if isinstance(card.source, KittiSource) and not table:
        write_scene, form = _write_result, "KITTI's results"
    if path.suffix in _FILE_SUFFIXES:
        raise CardError(
            f"{path}: {card.id} is written as {form}: "
            f"name a folder, not a {path.suffix} file"
        )
    boxes = 0
    with new_folder(path) as folder:
        for scene, tracks in rows:
            write_scene(scene, tracks, card, data, folder)
            boxes += len(tracks.frame)
    return boxes


def _write_result(
    scene: Scene, rows: TrackRows, card: Card, data: str | None, folder: Path
) -> None:
    """Write one text file of KITTI's tracking results."""
    assert isinstance(card.source, KittiSource)
    lines = result_lines(
        rows.frame * card.source.stride,
        rows.track_id,
        [KITTI_TYPES[card.task.classes[class_id]][0] for class_id in rows.class_id],
        rows.box,
        rows.score,
        poses_of(card, data, scene.name),
    )
    text = "".join(f"{line}\n" for line in lines)
    (folder / f"{scene.name}.txt").write_text(text, encoding="utf-8")


def _write_table(
    scene: Scene, rows: TrackRows, card: Card, data: str | None, folder: Path
) -> None:
    columns = {
        "frame": rows.frame,
        "id": rows.track_id,
        "class": np.array(card.task.classes)[rows.class_id],
        **dict(zip(BOX_COLUMNS, rows.box.T, strict=True)),
        "score": rows.score,
    }
    write_table(table_path(folder, scene.name), columns)


def _write_submission(
    rows: Iterable[tuple[Scene, TrackRows]], card: Card, data: str | None, path: Path
) -> int:
    """Write a tracking submission of nuScenes; return the number of boxes."""
    tables = NuScenes(card, data).tables
    modalities = ("camera", "lidar", "radar", "map", "external")
    meta = {f"use_{modality}": False for modality in modalities}
    count = 0
    separator = ""
    with whole_file(path) as part, part.open("w", encoding="utf-8") as file:
        file.write(f'{{"meta": {json.dumps(meta)}, "results": {{')
        for scene, tracks in rows:
            tokens = tables.sample_tokens(scene.name)
            for token, boxes in _samples(scene, tracks, card, tokens):
                file.write(f"{separator}\n{json.dumps(token)}: {json.dumps(boxes)}")
                separator = ","
                count += len(boxes)
        file.write("\n}}\n")
    return count


def _samples(
    scene: Scene, rows: TrackRows, card: Card, tokens: list[str]
) -> Iterator[tuple[str, list[dict[str, object]]]]:
    """Yield the boxes of each sample.

    A box has the mean velocity since the previous box of its track.
    """
    previous: dict[int, tuple[float, Floats]] = {}  # by track: time and position
    start = starts_of_sorted(rows.frame, scene.frames)
    for t, token in enumerate(tokens):
        boxes: list[dict[str, object]] = []
        time_s = float(scene.time[t])
        for track_row in range(start[t], start[t + 1]):
            track_id = int(rows.track_id[track_row])
            track_box = rows.box[track_row]
            last_time_s, position = previous.get(track_id, (time_s, track_box[:2]))
            velocity = np.zeros(2)
            if time_s > last_time_s:
                velocity = (track_box[:2] - position) / (time_s - last_time_s)
            previous[track_id] = time_s, track_box[:2]
            class_name = card.task.classes[rows.class_id[track_row]]
            score = float(rows.score[track_row])
            boxes.append(
                submission_box(
                    token, track_box, velocity, class_name, str(track_id), score
                )
            )
        yield token, boxes


def _write_feather(
    rows: Iterable[tuple[Scene, TrackRows]], card: Card, data: str | None, path: Path
) -> int:
    """Write a tracking submission of Argoverse 2; return the number of boxes."""
    from pyarrow import concat_tables, feather, table

    classes = np.array(card.task.classes)
    tables = []
    for scene, tracks in rows:
        columns = tracking_submission(
            card,
            data,
            scene,
            tracks.frame,
            tracks.track_id,
            classes[tracks.class_id],
            tracks.box,
            tracks.score,
        )
        tables.append(table(columns))
    with whole_file(path) as part:
        feather.write_feather(concat_tables(tables), part)
    return sum(map(len, tables))


_SUBMISSIONS = (
    (NuScenesSource, "nuScenes", ".json", _write_submission),
    (Argoverse2Source, "Argoverse 2", ".feather", _write_feather),
)

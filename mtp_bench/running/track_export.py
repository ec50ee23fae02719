"""Export of the tracks of a stored run in the file formats of other programs."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..cards import Card
from ..core import (
    CardError,
    Floats,
    Rollout,
    Scene,
    StoredTracks,
    long_work,
    new_folder,
    starts_of,
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

Sample = tuple[str, list[dict[str, Any]]]  # token and boxes of a frame of nuScenes
# Suffixes of files: a folder of such a name is a mistake.
_FILE_SUFFIXES = (".json", ".csv", ".txt", ".feather")


def stated_tracks(rollout: Rollout, scene: Scene, card: Card) -> StoredTracks:
    """Return the tracks of the heaviest hypothesis of each frame.

    A rollout has no scores of tracks. As in the files of other trackers, the score of a
    track is that of its detection: the nearest of its class within the forecast gate,
    or the last one; 0 before the first.
    """
    frame = rollout.tracks.frame_of_rows
    heaviest = rollout.hypothesis_log_weight.argmax(axis=1)
    is_member = rollout.member[np.arange(len(frame)), heaviest[frame]]
    is_stated = is_member & (rollout.track_class >= 0)
    box = rollout.track_box[is_stated].astype(np.float64)
    tracks = StoredTracks(
        start=starts_of(is_stated)[rollout.track_start],
        box=box,
        velocity=np.full((len(box), 2), np.nan),
        class_id=rollout.track_class[is_stated],
        score=np.zeros(len(box)),
        object_id=rollout.track_id[is_stated],
    )
    gate_m = np.array(card.per_class(card.task.forecast_gate))
    return replace(tracks, score=_scores(tracks, scene, gate_m))


def _scores(tracks: StoredTracks, scene: Scene, gate_m: Floats) -> Floats:
    """Return the score [R] of each box of ``tracks``, as in `stated_tracks`.

    ``gate_m`` [C]: forecast gate per class.
    """
    track_scores = np.zeros(len(tracks.box))
    last_score: dict[int, float] = {}  # by track
    detections = scene.detections
    for t in range(scene.frames):
        detected = detections.rows(t)
        rows = tracks.rows(t)
        offset_m = tracks.box[rows, None, :2] - detections.box[None, detected, :2]
        distance_m = np.linalg.norm(offset_m, axis=-1)
        class_id = tracks.class_id[rows]
        distance_m[class_id[:, None] != detections.class_id[None, detected]] = np.inf
        is_near = distance_m.min(axis=1, initial=np.inf) <= gate_m[class_id]
        for i, track_id in enumerate(tracks.object_id[rows].tolist()):
            if is_near[i]:
                nearest = distance_m[i].argmin()
                last_score[track_id] = float(detections.score[detected][nearest])
            track_scores[rows.start + i] = last_score.get(track_id, 0.0)
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

        def scene_tracks() -> Iterator[tuple[Scene, StoredTracks]]:
            for rollout in rollouts:
                scene = opened.recorded(rollout.scene)
                yield scene, stated_tracks(rollout, scene, opened.card)
                progress.done(rollout.scene)

        target = Path(path).absolute()
        return write_tracks(scene_tracks(), opened.card, opened.data, target, table)


def write_tracks(
    scene_tracks: Iterable[tuple[Scene, StoredTracks]],
    card: Card,
    data: str | None,
    path: Path,
    table: bool = False,
) -> int:
    """Write the tracks of scenes of ``card``.

    See `export_tracks`.
    """
    for source, dataset_name, suffix, write_file in _SUBMISSIONS:
        if isinstance(card.source, source) and not table:
            if path.suffix != suffix:
                raise CardError(
                    f"{path}: the task of {dataset_name} takes a {suffix} file; "
                    "for a folder of tables pass --form table"
                )
            return write_file(scene_tracks, card, data, path)
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
        for scene, tracks in scene_tracks:
            write_scene(scene, tracks, card, data, folder)
            boxes += len(tracks.box)
    return boxes


def _write_result(
    scene: Scene, tracks: StoredTracks, card: Card, data: str | None, folder: Path
) -> None:
    """Write one text file of KITTI's tracking results."""
    assert isinstance(card.source, KittiSource)
    lines = result_lines(
        tracks.frame_of_rows * card.source.stride,
        tracks.object_id,
        [KITTI_TYPES[card.task.classes[class_id]][0] for class_id in tracks.class_id],
        tracks.box,
        tracks.score,
        poses_of(card, data, scene.name),
    )
    text = "".join(f"{line}\n" for line in lines)
    (folder / f"{scene.name}.txt").write_text(text, encoding="utf-8")


def _write_table(
    scene: Scene, tracks: StoredTracks, card: Card, data: str | None, folder: Path
) -> None:
    columns = {
        "frame": tracks.frame_of_rows,
        "id": tracks.object_id,
        "class": np.array(card.task.classes)[tracks.class_id],
        **dict(zip(BOX_COLUMNS, tracks.box.T, strict=True)),
        "score": tracks.score,
    }
    write_table(table_path(folder, scene.name), columns)


def _write_submission(
    scene_tracks: Iterable[tuple[Scene, StoredTracks]],
    card: Card,
    data: str | None,
    path: Path,
) -> int:
    """Write a tracking submission of nuScenes.

    Returns the number of boxes.
    """
    tables = NuScenes(card, data).tables

    def all_samples() -> Iterator[Sample]:
        for scene, tracks in scene_tracks:
            yield from _samples(scene, tracks, card, tables.sample_tokens(scene.name))

    return write_results(path, all_samples())


def write_results(path: Path, samples: Iterable[Sample]) -> int:
    """Write a file in nuScenes' form of results, and return the number of boxes."""
    modalities = ("camera", "lidar", "radar", "map", "external")
    meta = {f"use_{modality}": False for modality in modalities}
    count = 0
    separator = ""
    with whole_file(path) as part, part.open("w", encoding="utf-8") as file:
        file.write(f'{{"meta": {json.dumps(meta)}, "results": {{')
        for token, boxes in samples:
            file.write(f"{separator}\n{json.dumps(token)}: {json.dumps(boxes)}")
            separator = ","
            count += len(boxes)
        file.write("\n}}\n")
    return count


def _samples(
    scene: Scene, tracks: StoredTracks, card: Card, tokens: list[str]
) -> Iterator[Sample]:
    """Yield token and boxes of each sample, as nuScenes calls a frame.

    A box has the mean velocity since the previous box of its track.
    """
    previous: dict[int, tuple[float, Floats]] = {}  # by track: time and position
    for t, token in enumerate(tokens):
        boxes: list[dict[str, Any]] = []
        time_s = float(scene.time[t])
        rows = tracks.rows(t)
        for track_row in range(rows.start, rows.stop):
            track_id = int(tracks.object_id[track_row])
            track_box = tracks.box[track_row]
            last_time_s, position = previous.get(track_id, (time_s, track_box[:2]))
            velocity = np.zeros(2)
            if time_s > last_time_s:
                velocity = (track_box[:2] - position) / (time_s - last_time_s)
            previous[track_id] = time_s, track_box[:2]
            class_name = card.task.classes[tracks.class_id[track_row]]
            score = float(tracks.score[track_row])
            boxes.append(
                submission_box(
                    token, track_box, velocity, class_name, str(track_id), score
                )
            )
        yield token, boxes


def _write_feather(
    scene_tracks: Iterable[tuple[Scene, StoredTracks]],
    card: Card,
    data: str | None,
    path: Path,
) -> int:
    """Write a tracking submission of Argoverse 2.

    Returns the number of boxes.
    """
    from pyarrow import concat_tables, feather, table

    classes = np.array(card.task.classes)
    tables = []
    for scene, tracks in scene_tracks:
        columns = tracking_submission(
            card,
            data,
            scene,
            tracks.frame_of_rows,
            tracks.object_id,
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

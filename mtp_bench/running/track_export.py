"""Export of the tracks of a stored run in the file formats of other programs."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..cards import Card
from ..core import (
    NO_PROGRESS,
    CardError,
    Floats,
    Ints,
    Progress,
    Rollout,
    Scene,
    new_folder,
    starts_of_sorted,
    whole_file,
)
from ..sources import (
    BOX,
    TYPES,
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

_FILES = (
    ".json",
    ".csv",
    ".txt",
    ".feather",
)  # suffixes of files: a folder of such a name is a mistake


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

    A rollout has no scores of tracks. As in the files of other trackers, the score of a track is that of its detection:
    the nearest of its class within the forecast gate, or the last one; 0 before the first.
    """
    frame = rollout.tracks.frame_of_rows
    heaviest = rollout.hypothesis_log_weight.argmax(axis=1)
    kept = rollout.member[np.arange(len(frame)), heaviest[frame]] & (
        rollout.track_class >= 0
    )
    box, class_id, track_id = (
        rollout.track_box.astype(np.float64),
        rollout.track_class,
        rollout.track_id,
    )
    rows = TrackRows(
        frame[kept],
        track_id[kept],
        class_id[kept],
        box[kept],
        np.zeros(int(kept.sum())),
    )
    return replace(
        rows,
        score=_scores(rows, scene, np.array(card.per_class(card.task.forecast_gate))),
    )


def _scores(rows: TrackRows, scene: Scene, gate: Floats) -> Floats:
    """Scores [R]; ``gate`` [C] m."""
    score, last = np.zeros(len(rows.frame)), dict[int, float]()
    start = starts_of_sorted(rows.frame, scene.frames)
    for t in range(scene.frames):
        seen, own = scene.detections.rows(t), slice(start[t], start[t + 1])
        distance = np.linalg.norm(
            rows.box[own, None, :2] - scene.detections.box[None, seen, :2], axis=-1
        )
        distance[rows.class_id[own, None] != scene.detections.class_id[None, seen]] = (
            np.inf
        )
        near = distance.min(axis=1, initial=np.inf) <= gate[rows.class_id[own]]
        for i, row in enumerate(range(start[t], start[t + 1])):
            identity = int(rows.track_id[row])
            if near[i]:
                last[identity] = float(
                    scene.detections.score[seen][distance[i].argmin()]
                )
            score[row] = last.get(identity, 0.0)
    return score


def export_tracks(
    opened: OpenedRun,
    path: str | Path,
    table: bool = False,
    progress: Progress = NO_PROGRESS,
) -> int:
    """Write the tracks of a stored run to ``path`` and return the number of boxes; ``progress`` counts scenes.

    nuScenes: a .json file in the submission form of the tracking task; Argoverse 2: a .feather file in its form.
    KITTI: a folder of the benchmark's results. With ``table``, and for every other source: a folder of tables
    (`sources.stored_tracks`). Raises CardError for a path that does not fit the format, and MtpBenchError for a folder
    that is not empty.
    """
    card, scenes = (
        opened.card,
        ((rollout, opened.recorded(rollout.scene)) for rollout in opened.run.rollouts),
    )

    def rows() -> Iterator[tuple[Scene, TrackRows]]:
        for rollout, scene in scenes:
            yield scene, track_rows(rollout, scene, card)
            progress.done(rollout.scene)

    progress.started(len(opened.run.rollouts))
    return write_tracks(rows(), card, opened.data, Path(path).absolute(), table)


def write_tracks(
    rows: Iterable[tuple[Scene, TrackRows]],
    card: Card,
    data: str | None,
    path: Path,
    table: bool = False,
) -> int:
    """Write the tracks of scenes of ``card``; see `export_tracks`."""
    for source, name, suffix, write_file in _SUBMISSIONS:
        if isinstance(card.source, source) and not table:
            if path.suffix != suffix:
                raise CardError(
                    f"{path}: the task of {name} takes a {suffix} file; for a folder of tables pass --table"
                )
            return write_file(rows, card, data, path)
    of_kitti = isinstance(card.source, KittiSource) and not table
    if path.suffix in _FILES:
        form = "KITTI's results" if of_kitti else "tables"
        raise CardError(
            f"{path}: {card.id} is written as {form}: name a folder, not a {path.suffix} file"
        )
    write = _write_result if of_kitti else _write_table
    count = 0
    with new_folder(path) as part:
        for scene, tracks in rows:
            write(scene, tracks, card, data, part)
            count += len(tracks.frame)
    return count


def _write_result(
    scene: Scene, rows: TrackRows, card: Card, data: str | None, folder: Path
) -> None:
    assert isinstance(card.source, KittiSource)
    frame = rows.frame * card.source.stride
    types = [TYPES[card.task.classes[c]][0] for c in rows.class_id]
    lines = result_lines(
        frame,
        rows.track_id,
        types,
        rows.box,
        rows.score,
        poses_of(card, data, scene.name),
    )
    (folder / f"{scene.name}.txt").write_text(
        "".join(f"{line}\n" for line in lines), encoding="utf-8"
    )


def _write_table(
    scene: Scene, rows: TrackRows, card: Card, data: str | None, folder: Path
) -> None:
    columns = {
        "frame": rows.frame,
        "id": rows.track_id,
        "class": np.array(card.task.classes)[rows.class_id],
        **dict(zip(BOX, rows.box.T, strict=True)),
        "score": rows.score,
    }
    write_table(table_path(folder, scene.name), columns)


def _write_submission(
    rows: Iterable[tuple[Scene, TrackRows]], card: Card, data: str | None, path: Path
) -> int:
    tables, count = NuScenes(card, data).tables, 0
    with whole_file(path) as part, part.open("w", encoding="utf-8") as file:
        meta = dict.fromkeys(
            ("use_camera", "use_lidar", "use_radar", "use_map", "use_external"), False
        )
        file.write(f'{{"meta": {json.dumps(meta)}, "results": {{')
        separator = ""
        for scene, tracks in rows:
            for token, boxes in _samples(
                scene, tracks, card, tables.sample_tokens(scene.name)
            ):
                file.write(f"{separator}\n{json.dumps(token)}: {json.dumps(boxes)}")
                separator, count = ",", count + len(boxes)
        file.write("\n}}\n")
    return count


def _write_feather(
    rows: Iterable[tuple[Scene, TrackRows]], card: Card, data: str | None, path: Path
) -> int:
    from pyarrow import concat_tables, feather, table

    classes = np.array(card.task.classes)
    parts = [
        table(
            tracking_submission(
                card,
                data,
                scene,
                r.frame,
                r.track_id,
                classes[r.class_id],
                r.box,
                r.score,
            )
        )
        for scene, r in rows
    ]
    with whole_file(path) as part:
        feather.write_feather(concat_tables(parts), part)
    return sum(len(part) for part in parts)


def _samples(
    scene: Scene, rows: TrackRows, card: Card, tokens: list[str]
) -> Iterator[tuple[str, list[dict[str, object]]]]:
    """Boxes of each sample, with the velocity since the previous box of the track."""
    previous: dict[int, tuple[float, Floats]] = {}  # by track: time and position
    start = starts_of_sorted(rows.frame, scene.frames)
    for t, token in enumerate(tokens):
        boxes: list[dict[str, object]] = []
        now = float(scene.time[t])
        for row in range(start[t], start[t + 1]):
            identity, box = int(rows.track_id[row]), rows.box[row]
            time, position = previous.get(identity, (now, box[:2]))
            velocity = (
                (box[:2] - position) / (now - time) if now > time else np.zeros(2)
            )
            previous[identity] = now, box[:2]
            name = card.task.classes[rows.class_id[row]]
            boxes.append(
                submission_box(
                    token, box, velocity, name, str(identity), float(rows.score[row])
                )
            )
        yield token, boxes


_SUBMISSIONS = (
    (NuScenesSource, "nuScenes", ".json", _write_submission),
    (Argoverse2Source, "Argoverse 2", ".feather", _write_feather),
)

"""Tracks stored by other programs, read as `mtp_bench.core.StoredTracks`.

A ``.json`` file is a submission to nuScenes' tracking task, a ``.feather`` file one to
that of Argoverse 2; a folder of ``.txt`` has KITTI's result form (as AB3DMOT writes).
For every source: a folder with a ``.csv`` or ``.parquet`` for each scene, whose columns
are `sources.files.columns.TRACKS`. A slash in a scene's name is ``%2F`` in its file
name.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..core import (
    DataError,
    Floats,
    Ints,
    Scene,
    StoredTracks,
    file_stem,
    starts_of_sorted,
)
from .base import (
    DataRoot,
    ReadTracks,
    SourcePackage,
    TrackForm,
    names_by_number,
)
from .files.columns import FORMS, TRACKS, check_ranges
from .files.scene import (
    boxes_of,
    class_ids_of,
    find_table,
    ids_of,
    of_classes,
    require_spelling,
    scores_of,
    velocities_of,
)
from .readers import read_named_table
from .tables import RowTable

# advice if only some scenes have tracks
FEWER = "--scenes N (scenes= in Python) takes the first N alone"


def find_tracks(
    package: SourcePackage, card: Card, data: DataRoot, path: str | Path
) -> ReadTracks:
    """Return a function that reads the tracks at ``path`` for a scene of ``card``.

    Raises DataError if ``path`` does not exist, or has no form that the card's source
    knows.
    """
    path = Path(path).expanduser().absolute()
    if not path.exists():
        raise DataError(f"no file or folder {path}, expected stored tracks")
    forms = [TABLE] if package.tracks is None else [package.tracks, TABLE]
    for form in forms:
        if form.fits(path):
            return form.open(card, data, path)
    expected = " or ".join(form.name for form in forms)
    raise DataError(
        f"{path} holds no stored tracks that fit {card.id}, expected {expected}"
    )


def with_stored(
    scene: Scene,
    frame: Ints,
    identity: NDArray[Any],
    class_id: Ints,
    box: Floats,
    score: Floats,
    velocity: Floats,
) -> Scene:
    """Return the scene with stored tracks, from R rows in any order.

    ``frame`` [R], ``identity`` [R] as in the file, ``class_id`` [R] of the task,
    ``box`` [R, 7] in the scene's frame of reference, ``score`` [R], ``velocity`` [R, 2]
    m/s, NaN where unknown. An identity in two classes is two identities: some programs
    count per class.
    """
    row_order = np.argsort(frame, kind="stable")
    _, identity_index = np.unique(identity, return_inverse=True)
    _, track_number = np.unique(
        np.stack([identity_index, class_id]), axis=1, return_inverse=True
    )
    track_number = track_number.reshape(-1)
    tracks = StoredTracks(
        start=starts_of_sorted(frame[row_order], scene.frames),
        box=box[row_order],
        velocity=velocity[row_order],
        class_id=class_id[row_order],
        score=score[row_order],
        object_id=track_number[row_order],
    )
    return replace(
        scene, tracks=tracks, track_names=names_by_number(track_number, identity)
    )


def table_path(folder: Path, scene: str) -> Path:
    """Return the path of the table that is written for a scene."""
    return folder / f"{file_stem(scene)}.csv"


def read_track_table(path: Path, scene: Scene, classes: Sequence[str]) -> Scene:
    """Return the scene with the tracks in a table.

    DataError names the wrong line.
    """
    table = read_named_table(path, TRACKS)
    track_number = ids_of(table)
    class_id = class_ids_of(table, classes)
    frame = checked_frames(table, scene, classes)
    # an id in another class is another track
    table.refuse_second_box(frame, table["id"], table["class"])
    track_names = table["id"]
    identity = track_names
    # whole numbers keep their order as numbers: 10 comes after 9
    if np.array_equal(track_number.astype(np.str_), track_names):
        identity = track_number
    is_used, skipped = of_classes(table, "tracks", classes)
    return with_stored(
        replace(scene, skipped={**scene.skipped, **skipped}),
        frame[is_used],
        identity[is_used],
        class_id[is_used],
        boxes_of(table)[is_used],
        scores_of(table)[is_used],
        velocities_of(table)[is_used],
    )


def checked_frames(table: RowTable, scene: Scene, classes: Sequence[str]) -> Ints:
    """Return the frames [R] of the boxes in a table.

    Raises DataError for other frames than those of the scene, impossible boxes and
    misspelt classes.
    """
    frame = table.whole_numbers("frame")
    problem = f"but the scene has the frames 0 to {scene.frames - 1}"
    table.refuse(
        (frame < 0) | (frame >= scene.frames),
        lambda row: f"frame {frame[row]}, {problem}",
        "frame",
    )
    check_ranges(table, positive_sizes=False)
    require_spelling(table, classes)
    return frame


def _open(card: Card, data: DataRoot, folder: Path) -> ReadTracks:
    def read_tracks(scene: Scene) -> Scene:
        path = find_table(folder, file_stem(scene.name))
        if path is None:
            raise DataError(
                f"no file {table_path(folder, scene.name)}, expected the tracks of "
                f"each scene that is run; {FEWER}"
            )
        return read_track_table(path, scene, card.task.classes)

    return read_tracks


TABLE = TrackForm(
    name="a folder with a table <scene>.csv or <scene>.parquet for each scene",
    fits=lambda path: (
        path.is_dir() and any(any(path.glob(f"*.{form}")) for form in FORMS)
    ),
    open=_open,
)

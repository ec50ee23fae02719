"""Tracks stored by other programs, read as `mtp_bench.core.StoredTracks` of a scene.

A ``.json`` file is a submission to nuScenes' tracking task, a ``.feather`` file one to that of Argoverse 2; a folder of
``.txt`` has KITTI's result form (as AB3DMOT writes). For every source: a folder with a ``.csv`` or ``.parquet`` for
each scene, whose columns are `sources.files.columns.TRACKS`. A slash in a scene's name is ``%2F`` in its file name.
"""

from collections.abc import Callable, Sequence
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
    new_folder,
    starts_of_sorted,
)
from .base import (
    DataRoot,
    ReadTracks,
    SceneSource,
    SourcePackage,
    TrackForm,
    names_by_number,
)
from .files.checks import check_boxes
from .files.columns import FORMS
from .files.save import box_columns
from .files.scene import (
    boxes_of,
    class_ids_of,
    find_table,
    ids_of,
    scores_of,
    velocities_of,
)
from .files.table import read_table, write_table
from .text import RowTable, repeated

FEWER = "--scenes N (scenes= in Python) takes the first N alone"  # advice if only some scenes have tracks


def find_tracks(
    package: SourcePackage, card: Card, data: DataRoot, path: str | Path
) -> ReadTracks:
    """A function that reads the tracks at ``path`` for a scene of ``card``, in the form that they have.

    Raises DataError if ``path`` does not exist, or has no form that the card's source knows.
    """
    where = Path(path).expanduser().absolute()
    if not where.exists():
        raise DataError(f"no file or folder {where}, expected stored tracks")
    forms = [TABLE] if package.tracks is None else [package.tracks, TABLE]
    for form in forms:
        if form.fits(where):
            return form.open(card, data, where)
    known = " or ".join(form.name for form in forms)
    raise DataError(
        f"{where} holds no stored tracks that fit {card.id}, expected {known}"
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
    """The scene with stored tracks, from R rows in any order.

    ``frame`` [R], ``identity`` [R] as in the file, ``class_id`` [R] of the task, ``box`` [R, 7] in the scene's frame of
    reference, ``score`` [R], ``velocity`` [R, 2] m/s, NaN where unknown. An identity in two classes is two identities:
    some programs count per class.
    """
    order = np.argsort(frame, kind="stable")
    _, name = np.unique(identity, return_inverse=True)
    _, number = np.unique(np.stack([name, class_id]), axis=1, return_inverse=True)
    number = number.reshape(-1)
    start = starts_of_sorted(frame[order], scene.frames)
    tracks = StoredTracks(
        start, box[order], velocity[order], class_id[order], score[order], number[order]
    )
    return replace(scene, tracks=tracks, track_names=names_by_number(number, identity))


def table_path(folder: Path, scene: str) -> Path:
    """Path of the table that is written for a scene."""
    return folder / f"{file_stem(scene)}.csv"


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
            identity = np.array(
                [scene.track_names.get(i, str(i)) for i in tracks.object_id.tolist()],
                dtype=np.str_,
            )
            table = {
                "frame": columns["frame"],
                "id": identity,
                **columns,
                "score": tracks.score,
            }
            write_table(table_path(part, scene.name), table)
            count, boxes = count + 1, boxes + len(tracks.box)
            done(scene.name)
    return count, boxes


def read_track_table(path: Path, scene: Scene, classes: Sequence[str]) -> Scene:
    """The scene with the tracks in a table; DataError names the line that is wrong."""
    table = read_table(path, "tracks")
    frame, number, class_id = (
        table.whole("frame"),
        ids_of(table),
        class_ids_of(table, classes),
    )
    check_boxes(table, frame, scene.frames, true=False)
    _refuse_misspelt(table, classes)
    kind = table.words["class"]
    twice = repeated(frame, kind, number)  # an id in another class is another track
    table.refuse(
        twice,
        lambda row: f"a second box of this {kind[row]} in frame {frame[row]}",
        "id",
    )
    kept, words = class_id >= 0, table.words["id"]
    identity = number if np.array_equal(number.astype(np.str_), words) else words
    box, score, velocity = (
        boxes_of(table)[kept],
        scores_of(table)[kept],
        velocities_of(table)[kept],
    )
    return with_stored(
        scene, frame[kept], identity[kept], class_id[kept], box, score, velocity
    )


def _refuse_misspelt(table: RowTable, classes: Sequence[str]) -> None:
    """Raise DataError for a class that is one of the task's in other letters ("Cars", "vehicle.car")."""
    kind = table.words["class"]
    for got in np.unique(kind[~np.isin(kind, classes)]).tolist():
        word = got.lower().rsplit(".", maxsplit=1)[-1]
        meant = next(
            (
                name
                for name in classes
                if name.lower() in (word, word.removesuffix("s"))
            ),
            None,
        )
        if meant is not None:
            where = table.where(int(np.argmax(kind == got)), "class")
            raise DataError(
                f"{where}: {got!r} is not a class of the task; did you mean {meant!r}?"
            )


def _open(card: Card, data: DataRoot, folder: Path) -> ReadTracks:
    def read(scene: Scene) -> Scene:
        path = find_table(folder, file_stem(scene.name))
        if path is None:
            lost = table_path(folder, scene.name)
            raise DataError(
                f"no file {lost}, expected the tracks of each scene that is run; {FEWER}"
            )
        return read_track_table(path, scene, card.task.classes)

    return read


TABLE = TrackForm(
    "a folder with a table <scene>.csv or <scene>.parquet for each scene",
    lambda path: path.is_dir() and any(any(path.glob(f"*.{form}")) for form in FORMS),
    _open,
)

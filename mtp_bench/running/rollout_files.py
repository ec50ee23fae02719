"""Files of a run: a folder with ``run.json`` and one ``.npz`` per scene (see `packing`), each with its digest."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..env.rollouts import ARRAYS, digest
from ..errors import RolloutError
from ..files import (
    BROKEN_ARCHIVE,
    clean_text,
    describe_read_error,
    describe_write_error,
    file_stem,
    open_regular,
    require_replaceable,
    whole_folder,
)
from ..parallel import cores
from ..strict import Section, read_json, validate
from ..types import Rollout
from .packing import packed, unpacked

RUN_FILE = "run.json"
FORMAT: Literal[2] = 2
MOST_BYTES = 1 << 30  # of the arrays of a scene
MOST_RUN = 4 << 30  # of all scenes of a run
_LEVEL = 4  # of compression


class RunInfo(Section):
    """Origin of the rollouts of a run: enough to check them and to make them again."""

    env_id: str
    card_digest: str
    observe: str
    samples: int  # K
    split: str
    keywords: dict[str, Any]  # further settings of the env
    agent: str
    parameters: dict[str, Any]
    hypotheses: int | None = None  # as the submission declares; None: as many as the agent states
    submission_digest: str
    note: str = ""  # on training with scenes that are scored
    seed: int
    definitions: str  # version of the definitions that the run was made under
    versions: dict[str, str]  # of the libraries
    card: dict[str, Any] | None = None  # with its changes; None: not kept


@dataclass(frozen=True)
class Run:
    """One agent on the scenes of one env."""

    info: RunInfo
    rollouts: tuple[Rollout, ...]


class _Entry(Section):
    scene: str
    frames: int
    digest: str


class _RunFile(Section):
    format: Literal[2]
    info: RunInfo
    scenes: list[_Entry]


def save_run(folder: str | Path, info: RunInfo, rollouts: Iterable[Rollout]) -> None:
    """Write a run: complete or not at all. An earlier run in ``folder`` is replaced.

    Raises RolloutError if ``folder`` holds anything but a run, or cannot be written.
    """
    folder = Path(folder).absolute()
    require_run_folder(folder)
    try:
        with whole_folder(folder) as part:
            _write(part, info, rollouts)
    except OSError as error:
        raise RolloutError(f"{folder}: the run cannot be written: {describe_write_error(error, folder)}") from error


def load_run(folder: str | Path) -> Run:
    """Read a run and check every scene against its digest.

    Raises RolloutError if a file is missing, truncated or was changed.
    """
    path = Path(folder) / RUN_FILE
    content = read_json(path, RolloutError, f"no {RUN_FILE} there, expected a folder written by `mtp-bench run`")
    if content.get("format", FORMAT) != FORMAT:
        raise RolloutError(
            f"{path}: has the format {clean_text(str(content['format']), 20)}, and this version of the library reads "
            f"format {FORMAT}: run the agent again"
        )
    run = validate(_RunFile, content, str(path), RolloutError)
    rollouts: list[Rollout] = []
    size = 0
    for entry in run.scenes:
        rollout = _read_scene(Path(folder), entry)
        size += sum(getattr(rollout, name).nbytes for name in ARRAYS)
        if size > MOST_RUN:
            raise RolloutError(f"{folder}: its scenes hold more than {MOST_RUN >> 30} GiB, the limit")
        rollouts.append(rollout)
    return Run(run.info, tuple(rollouts))


def require_run_folder(folder: Path) -> None:
    """Raise RolloutError if writing a run to ``folder`` would delete something that is not a run."""
    if not folder.exists():
        return
    require_replaceable(folder)
    if not folder.is_dir():
        raise RolloutError(f"{folder} is a file, expected a new folder or that of an earlier run")
    names = {path.name for path in folder.iterdir()}
    foreign = sorted(name for name in names if name != RUN_FILE and not name.endswith(".npz"))
    if names and (RUN_FILE not in names or foreign):
        what = f"holds {foreign[0]!r}" if foreign else f"has no {RUN_FILE}"
        raise RolloutError(f"{folder} is not empty and {what}, so it is not a run: choose another folder")


def require_storable(info: RunInfo, scenes: Sequence[str]) -> None:
    """Raise RolloutError for content that RUN_FILE cannot hold, such as a path that is not UTF-8."""
    _text(info, [_Entry(scene=name, frames=0, digest="") for name in scenes])


def _scene_file(scene: str) -> str:
    return f"{file_stem(scene)}.npz"


def _write(folder: Path, info: RunInfo, rollouts: Iterable[Rollout]) -> None:
    def store(rollout: Rollout) -> _Entry:
        arrays = {name: np.asarray(getattr(rollout, name), dtype=dtype) for name, (dtype, _) in ARRAYS.items()}
        stored = {name: packed(name, array) for name, array in arrays.items()}
        _write_arrays(folder / _scene_file(rollout.scene), stored)
        return _Entry(scene=rollout.scene, frames=rollout.frames, digest=digest(rollout))

    rollouts = list(rollouts)
    scenes = [rollout.scene for rollout in rollouts]
    for scene in scenes:
        if scenes.count(scene) > 1:
            raise RolloutError(f"scene {scene!r} occurs twice among the rollouts of a run, expected once")
    require_storable(info, scenes)
    with ThreadPoolExecutor(cores()) as pool:  # zlib, which takes most of the time, releases the interpreter lock
        entries = list(pool.map(store, rollouts))
    (folder / RUN_FILE).write_bytes(_text(info, entries))


def _text(info: RunInfo, scenes: list[_Entry]) -> bytes:
    """The content of RUN_FILE. Raises RolloutError for content that JSON in UTF-8 cannot hold."""
    content = _RunFile(format=FORMAT, info=info, scenes=scenes).model_dump()
    try:
        return f"{json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False)}\n".encode()
    except (TypeError, ValueError) as error:  # also text that is not UTF-8, such as the name of a file
        raise RolloutError(f"the run of {info.agent!r} cannot be stored as JSON: {error}") from None


def _write_arrays(path: Path, arrays: dict[str, NDArray[Any]]) -> None:
    """Write an NPZ file: 2 % larger than by `numpy.savez_compressed`, which has no level, in 0.3 to 0.7 of its time."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=_LEVEL) as file:
        for name, array in arrays.items():
            with file.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, array, allow_pickle=False)


def _read_scene(folder: Path, entry: _Entry) -> Rollout:
    path = folder / _scene_file(entry.scene)
    try:
        with open_regular(path) as file, np.load(file, allow_pickle=False) as stored:
            if sum(entry.file_size for entry in stored.zip.infolist()) > MOST_BYTES:
                raise RolloutError(f"{path}: unpacks to more than {MOST_BYTES >> 20} MiB, the limit")
            arrays = {name: unpacked(name, stored[name], dtype) for name, (dtype, _) in ARRAYS.items()}
    except FileNotFoundError:
        raise RolloutError(f"{path} is missing, {RUN_FILE} names it; run the agent again") from None
    except KeyError as error:
        raise RolloutError(f"{path}: {error.args[0]}; run the agent again") from None
    except BROKEN_ARCHIVE as error:
        raise RolloutError(
            f"{path}: truncated or not a rollout ({describe_read_error(error)}); run the agent again"
        ) from None
    _check_arrays(path, arrays, entry.frames)
    rollout = Rollout(scene=entry.scene, **arrays)
    got = digest(rollout)
    if got != entry.digest:
        raise RolloutError(f"{path}: digest {got[:12]}, expected {entry.digest[:12]}: it was changed after the run")
    return rollout


def _check_arrays(path: Path, arrays: dict[str, NDArray[Any]], frames: int) -> None:
    """Raise RolloutError unless all arrays have the dtypes and the shapes of one rollout."""
    sizes: dict[str | int, int] = {"F": frames, "F1": frames + 1}  # the first array with a letter sets its size
    for name, (dtype, letters) in ARRAYS.items():
        array = arrays[name]
        if array.dtype != np.dtype(dtype):
            raise RolloutError(f"{path}: {name} has dtype {array.dtype}, expected {np.dtype(dtype)}")
        if array.ndim == len(letters):
            for letter, size in zip(letters, array.shape, strict=True):
                sizes.setdefault(letter, letter if isinstance(letter, int) else size)
        expected = tuple(sizes.get(letter, letter) for letter in letters)
        if array.shape != expected:
            raise RolloutError(f"{path}: {name} has shape {array.shape}, expected {expected}")
    for kind, rows in (("track", sizes["R"]), ("object", sizes["S"])):
        start = arrays[f"{kind}_start"]
        if start[0] != 0 or start[-1] != rows or (np.diff(start) < 0).any():
            raise RolloutError(f"{path}: {kind}_start does not divide the {rows} rows into frames")

"""Files of a run: a folder with ``run.json`` and one ``.npz`` per scene.

Each scene has its digest. Forecasts, most of a rollout, are stored as second
differences over time, which compress well: objects move steadily.
"""

import json
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ..core import (
    Rollout,
    RolloutError,
    Section,
    clean_text,
    cores,
    file_stem,
    open_regular,
    read_json,
    require_replaceable,
    validate,
    whole_folder,
)
from ..env import ROLLOUT_ARRAYS, digest, drive_arrays, drive_of
from ..sources import write_npz

RUN_FILE = "run.json"
FORMAT: Literal[3] = 3
MAX_SCENE_BYTES = 1 << 30  # of the arrays of a scene
MAX_RUN_BYTES = 4 << 30  # of all scenes of a run
_COMPRESSION_LEVEL = 4


class RunInfo(Section):
    """Origin of the rollouts of a run: enough to check them and to make them again."""

    env_id: str
    card_digest: str
    observe: str  # mode of the env; "file": the forecasts were read from a file
    samples: int  # K
    split: str
    keywords: dict[str, Any]  # further settings of the env
    agent: str
    folder: str = ""  # folder of its submission; empty: an object of a program
    parameters: dict[str, Any]
    # number that its manifest declares; None: as many as its actions have
    hypotheses: Annotated[int, Field(ge=0)] | None = None
    submission_digest: str
    note: str = ""  # on training with scenes that are scored
    seed: int
    definitions: str  # version of the definitions that the run was made under
    versions: dict[str, str]  # versions of the libraries
    card: dict[str, Any] | None = None  # with its changes; None: not kept


@dataclass(frozen=True)
class Run:
    """One agent on the scenes of one env."""

    info: RunInfo
    rollouts: tuple[Rollout, ...]


class _SceneEntry(Section):
    scene: str
    frames: int
    digest: str


class _RunFile(Section):
    format: Literal[3]
    info: RunInfo
    scenes: list[_SceneEntry]


def save_run(folder: str | Path, info: RunInfo, rollouts: Iterable[Rollout]) -> None:
    """Write a run, complete or not at all.

    An earlier run in ``folder`` is replaced. Raises RolloutError if ``folder`` holds
    anything but a run, for a scene that occurs twice, and for content that JSON in
    UTF-8 cannot hold; WriteError if the folder cannot be written.
    """
    folder = Path(folder).absolute()
    require_run_folder(folder)
    with whole_folder(folder) as part:
        by_scene: dict[str, Rollout] = {}
        for rollout in rollouts:
            if by_scene.setdefault(rollout.scene, rollout) is not rollout:
                raise RolloutError(
                    f"scene {rollout.scene!r} occurs twice among the rollouts of a "
                    "run, expected once"
                )
        # zlib, which takes most of the time, releases the interpreter lock
        with ThreadPoolExecutor(cores()) as pool:
            entries = pool.map(partial(_write_scene, part), by_scene.values())
            scenes = list(entries)
        content = _RunFile(format=FORMAT, info=info, scenes=scenes).model_dump()
        try:
            text = json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False)
            (part / RUN_FILE).write_bytes(f"{text}\n".encode())
        except (TypeError, ValueError) as error:
            # also text that is not UTF-8, such as the name of a file
            raise RolloutError(
                f"the run of {info.agent!r} cannot be stored as JSON: {error}"
            ) from None


def load_run(folder: str | Path) -> Run:
    """Read a run and check every scene against its digest.

    Raises RolloutError if a file is missing, truncated or was changed.
    """
    folder = Path(folder)
    path = folder / RUN_FILE
    advice = f"no {RUN_FILE} there, expected a folder written by `mtp-bench run`"
    content = read_json(path, RolloutError, advice)
    # `validate` reports a missing format
    if content.get("format", FORMAT) != FORMAT:
        raise RolloutError(
            f"{path}: has the format {clean_text(str(content['format']), 20)}, and "
            f"this version of the library reads format {FORMAT}: run the agent again"
        )
    run = validate(_RunFile, content, str(path), RolloutError)
    rollouts: list[Rollout] = []
    size = 0
    for entry in run.scenes:
        rollout = _read_scene(folder, entry)
        size += sum(
            getattr(rollout, array_name).nbytes for array_name in ROLLOUT_ARRAYS
        )
        if size > MAX_RUN_BYTES:
            raise RolloutError(
                f"{folder}: its scenes hold more than {MAX_RUN_BYTES >> 30} GiB, "
                "the limit"
            )
        rollouts.append(rollout)
    return Run(run.info, tuple(rollouts))


def require_run_folder(folder: Path) -> None:
    """Raise RolloutError if writing a run to ``folder`` would delete another file."""
    if not folder.exists():
        return
    require_replaceable(folder)
    if not folder.is_dir():
        raise RolloutError(
            f"{folder} is a file, expected a new folder or that of an earlier run"
        )
    file_names = {path.name for path in folder.iterdir()}
    foreign = {
        file_name for file_name in file_names if not file_name.endswith(".npz")
    } - {RUN_FILE}
    problem = ""
    if foreign:
        problem = f"holds {min(foreign)!r}"
    elif file_names and RUN_FILE not in file_names:
        problem = f"has no {RUN_FILE}"
    if problem:
        raise RolloutError(
            f"{folder} is not empty and {problem}, so it is not a run: "
            "choose another folder"
        )


def differences(forecast: NDArray[np.int16]) -> NDArray[np.int16]:
    """Return second differences over time [T, S, K, 2] of forecasts [S, K, T, 2].

    They wrap around on overflow.
    """
    by_time = np.moveaxis(forecast, 2, 0)
    zeros = np.zeros((2, *by_time.shape[1:]), by_time.dtype)
    return np.diff(by_time, n=2, axis=0, prepend=zeros)


def undone(steps: NDArray[np.int16]) -> NDArray[np.int16]:
    """Return the inverse of `differences`.

    ``steps`` is overwritten.
    """
    for _ in range(2):  # second differences
        for previous, current in pairwise(steps):
            np.add(previous, current, out=current)
    return np.ascontiguousarray(np.moveaxis(steps, 0, 2))


def _scene_file(scene: str) -> str:
    return f"{file_stem(scene)}.npz"


def _write_scene(folder: Path, rollout: Rollout) -> _SceneEntry:
    """Write the NPZ file of a scene.

    Its compression takes 0.3 to 0.7 of the time of `numpy.savez_compressed`, and the
    file is 2 % larger.
    """
    arrays: dict[str, NDArray[Any]] = {}
    for array_name, (dtype, _) in ROLLOUT_ARRAYS.items():
        arrays[array_name] = np.asarray(getattr(rollout, array_name), dtype=dtype)
    arrays["forecast"] = differences(arrays["forecast"])
    arrays |= drive_arrays(rollout.drive)
    write_npz(folder / _scene_file(rollout.scene), arrays, _COMPRESSION_LEVEL)
    return _SceneEntry(
        scene=rollout.scene, frames=rollout.frames, digest=digest(rollout)
    )


def _read_scene(folder: Path, entry: _SceneEntry) -> Rollout:
    """Read the file of a scene.

    Raises RolloutError.
    """
    path = folder / _scene_file(entry.scene)
    try:
        stored = _read_arrays(path)
        arrays = {array_name: stored.pop(array_name) for array_name in ROLLOUT_ARRAYS}
        arrays["forecast"] = undone(arrays["forecast"])
        drive = drive_of(stored)
    except FileNotFoundError:
        raise RolloutError(
            f"{path} is missing, {RUN_FILE} names it; run the agent again"
        ) from None
    except RolloutError:
        raise
    except Exception as error:  # NumPy raises many kinds for changed or missing bytes
        raise RolloutError(
            f"{path}: truncated or not a rollout ({error}); run the agent again"
        ) from None
    _check_arrays(path, arrays, entry.frames)
    rollout = Rollout(scene=entry.scene, **arrays, drive=drive)
    rollout_digest = digest(rollout)
    if rollout_digest != entry.digest:
        raise RolloutError(
            f"{path}: digest {rollout_digest[:12]}, expected {entry.digest[:12]}: "
            "it was changed after the run"
        )
    return rollout


def _read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Read all arrays of an NPZ file.

    Raises RolloutError if they are too large.
    """
    with open_regular(path) as file, np.load(file, allow_pickle=False) as stored:
        if sum(member.file_size for member in stored.zip.infolist()) > MAX_SCENE_BYTES:
            raise RolloutError(
                f"{path}: unpacks to more than {MAX_SCENE_BYTES >> 20} MiB, the limit"
            )
        # np.load gives bytes for odd members
        return {
            array_name: np.asarray(stored[array_name]) for array_name in stored.files
        }


def _check_arrays(path: Path, arrays: dict[str, NDArray[Any]], frames: int) -> None:
    """Raise RolloutError unless all arrays have the dtypes and shapes of a rollout."""
    # a letter stands for one size, which the first array with it sets; a number stands
    # for itself
    letter_sizes: dict[str | int, int] = {"F": frames, "F1": frames + 1}
    for array_name, (dtype, letters) in ROLLOUT_ARRAYS.items():
        scene_array = arrays[array_name]
        if scene_array.dtype != np.dtype(dtype):
            raise RolloutError(
                f"{path}: {array_name} has dtype {scene_array.dtype}, "
                f"expected {np.dtype(dtype)}"
            )
        if scene_array.ndim == len(letters):
            for letter, size in zip(letters, scene_array.shape, strict=True):
                if isinstance(letter, str):
                    letter_sizes.setdefault(letter, size)
        expected_shape = tuple(letter_sizes.get(letter, letter) for letter in letters)
        if scene_array.shape != expected_shape:
            raise RolloutError(
                f"{path}: {array_name} has shape {scene_array.shape}, "
                f"expected {expected_shape}"
            )
    _check_starts(path, "track_start", arrays["track_start"], letter_sizes["R"])
    _check_starts(path, "object_start", arrays["object_start"], letter_sizes["S"])


def _check_starts(path: Path, array_name: str, start: NDArray[Any], rows: int) -> None:
    """Raise RolloutError unless ``start`` divides the rows into frames."""
    if start[0] != 0 or start[-1] != rows or (np.diff(start) < 0).any():
        raise RolloutError(
            f"{path}: {array_name} does not divide the {rows} rows into frames"
        )

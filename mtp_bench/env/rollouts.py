"""Rollouts as records and on disk: a folder with ``run.json`` and one ``.npz`` per scene, each with its digest."""

from __future__ import annotations

import hashlib
import json
import secrets
import shutil
import zipfile
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from ..errors import RolloutError
from ..strict import Section, validate
from ..types import Ints, Rollout
from .decoding import Answer

RUN_FILE = "run.json"
_DTYPES = {  # of every array of a Rollout, in the order of the digest
    "track_start": "<i8",
    "track_id": "<i8",
    "track_box": "<f4",
    "track_class": "<i8",
    "member": "|b1",
    "hypothesis_log_weight": "<f4",
    "object_start": "<i8",
    "object_box": "<f4",
    "object_class": "<i8",
    "forecast": "<i2",
    "forecast_log_weight": "<f4",
    "invalid": "<i8",
    "dropped": "<i8",
    "seconds": "<f8",
}


class RunInfo(Section):
    """Where the rollouts of a run come from: enough to check them and to make them again."""

    env_id: str
    card_digest: str
    observe: str
    samples: int  # K
    split: str
    keywords: dict[str, Any]  # further settings of the env
    agent: str
    parameters: dict[str, Any]
    hypotheses: int | None = None  # as the submission declares; None: what the agent states
    submission_digest: str
    seed: int
    definitions: str  # version of the definitions that the run was made under
    versions: dict[str, str]  # of the libraries


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
    format: Literal[1]
    info: RunInfo
    scenes: list[_Entry]


def assemble(scene: str, answers: Sequence[Answer], dropped: Ints) -> Rollout:
    """Rollout of the recorded answers [F] of a scene; ``dropped`` [F] detections did not fit. Times are still zero."""

    def rows(name: str) -> NDArray[Any]:
        joined = np.concatenate([getattr(answer, name) for answer in answers])
        return joined.astype(_DTYPES[name], copy=False)

    def starts(counts: list[int]) -> Ints:
        return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)

    return Rollout(
        scene=scene,
        track_start=starts([len(answer.track_id) for answer in answers]),
        track_id=rows("track_id"),
        track_box=rows("track_box"),
        track_class=rows("track_class"),
        member=rows("member"),
        hypothesis_log_weight=np.stack([answer.hypothesis_log_weight for answer in answers]).astype(np.float32),
        object_start=starts([len(answer.object_class) for answer in answers]),
        object_box=rows("object_box"),
        object_class=rows("object_class"),
        forecast=rows("forecast"),
        forecast_log_weight=rows("forecast_log_weight"),
        invalid=np.stack([answer.invalid for answer in answers]),
        dropped=np.asarray(dropped, dtype=np.int64),
        seconds=np.zeros(len(answers)),
    )


def digest(rollout: Rollout) -> str:
    """Hex sha256 over the scene's name and all arrays but ``seconds``: equal answers, equal digest."""
    sha = hashlib.sha256(rollout.scene.encode())
    for name, dtype in _DTYPES.items():
        if name != "seconds":
            array = np.ascontiguousarray(getattr(rollout, name), dtype=dtype)
            if array.dtype.kind == "f":
                array = array + np.zeros((), dtype)  # -0.0 becomes 0.0
            sha.update(f"|{name}{list(array.shape)}".encode())
            sha.update(array.tobytes())
    return sha.hexdigest()


def save_run(folder: str | Path, info: RunInfo, rollouts: Iterable[Rollout]) -> None:
    """Write a run: complete or not at all. An earlier run in ``folder`` is replaced.

    Raises RolloutError if ``folder`` holds anything but a run, or cannot be written.
    """
    folder = Path(folder).absolute()
    require_run_folder(folder)
    partial = folder.with_name(f".{folder.name}.{secrets.token_hex(4)}.partial")
    try:
        partial.mkdir(parents=True)
        _write(partial, info, rollouts)
        _replace(folder, partial)
    except OSError as error:
        raise RolloutError(f"{folder}: the run cannot be written: {error.strerror or error}") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def load_run(folder: str | Path) -> Run:
    """Read a run and check every scene against its digest.

    Raises RolloutError if a file is missing, truncated or was changed.
    """
    path = Path(folder) / RUN_FILE
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise RolloutError(f"{folder}: no {RUN_FILE} there, expected a folder written by `mtp-bench run`") from None
    except (OSError, ValueError) as error:
        raise RolloutError(f"{path}: cannot be read: {error}; run the agent again") from None
    if not isinstance(content, dict):
        raise RolloutError(f"{path}: holds {type(content).__name__}, expected a table; run the agent again")
    run = validate(_RunFile, content, str(path), RolloutError)
    return Run(run.info, tuple(_read_scene(Path(folder), entry) for entry in run.scenes))


def _scene_file(scene: str) -> str:
    return quote(scene, safe="") + ".npz"  # names of scenes may have a slash


def _write(folder: Path, info: RunInfo, rollouts: Iterable[Rollout]) -> None:
    entries: list[_Entry] = []
    for rollout in rollouts:
        if any(entry.scene == rollout.scene for entry in entries):
            raise RolloutError(f"scene {rollout.scene!r} occurs twice among the rollouts of a run, expected once")
        arrays = {name: np.asarray(getattr(rollout, name), dtype=dtype) for name, dtype in _DTYPES.items()}
        np.savez_compressed(folder / _scene_file(rollout.scene), allow_pickle=False, **arrays)
        entries.append(_Entry(scene=rollout.scene, frames=rollout.frames, digest=digest(rollout)))
    content = _RunFile(format=1, info=info, scenes=entries).model_dump()
    try:
        text = json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False)
    except (TypeError, ValueError) as error:
        raise RolloutError(f"the parameters of {info.agent!r} cannot be stored as JSON: {error}") from None
    (folder / RUN_FILE).write_text(text + "\n", encoding="utf-8")


def require_run_folder(folder: Path) -> None:
    """Raise RolloutError if writing a run to ``folder`` would delete something that is not a run."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise RolloutError(f"{folder} is a file, expected a new folder or that of an earlier run")
    names = {path.name for path in folder.iterdir()}
    foreign = sorted(name for name in names if name != RUN_FILE and not name.endswith(".npz"))
    if names and (RUN_FILE not in names or foreign):
        what = f"holds {foreign[0]!r}" if foreign else f"has no {RUN_FILE}"
        raise RolloutError(f"{folder} is not empty and {what}, so it is no run: choose another folder")


def _replace(folder: Path, partial: Path) -> None:
    """Put ``partial`` in the place of ``folder``; the earlier run comes back if that fails."""
    if not folder.exists():
        partial.rename(folder)
        return
    earlier = partial.with_suffix(".earlier")
    folder.rename(earlier)
    try:
        partial.rename(folder)
    except OSError:
        earlier.rename(folder)
        raise
    shutil.rmtree(earlier, ignore_errors=True)


def _read_scene(folder: Path, entry: _Entry) -> Rollout:
    path = folder / _scene_file(entry.scene)
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in _DTYPES}
    except FileNotFoundError:
        raise RolloutError(f"{path} is missing, {RUN_FILE} names it; run the agent again") from None
    except KeyError as error:
        raise RolloutError(f"{path}: {error.args[0]}; run the agent again") from None
    except (OSError, TypeError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise RolloutError(f"{path}: truncated or not a rollout ({error}); run the agent again") from None
    _check_arrays(path, arrays, entry.frames)
    rollout = Rollout(scene=entry.scene, **arrays)
    got = digest(rollout)
    if got != entry.digest:
        raise RolloutError(f"{path}: digest {got[:12]}, expected {entry.digest[:12]}: it was changed after the run")
    return rollout


def _check_arrays(path: Path, arrays: dict[str, NDArray[Any]], frames: int) -> None:
    """Raise RolloutError unless all arrays have the dtypes and the shapes of one rollout."""
    for name, dtype in _DTYPES.items():
        if arrays[name].dtype != np.dtype(dtype):
            raise RolloutError(f"{path}: {name} has dtype {arrays[name].dtype}, expected {np.dtype(dtype)}")
    rows = {kind: len(arrays[f"{kind}_box"]) for kind in ("track", "object")}
    hypotheses = arrays["hypothesis_log_weight"].shape[-1]
    samples = arrays["forecast"].shape[1:] if arrays["forecast"].ndim == 4 else (0, 0, 2)
    expected = {
        "track_start": (frames + 1,),
        "track_id": (rows["track"],),
        "track_box": (rows["track"], 7),
        "track_class": (rows["track"],),
        "member": (rows["track"], hypotheses),
        "hypothesis_log_weight": (frames, hypotheses),
        "object_start": (frames + 1,),
        "object_box": (rows["object"], 7),
        "object_class": (rows["object"],),
        "forecast": (rows["object"], *samples[:2], 2),
        "forecast_log_weight": (rows["object"], samples[0]),
        "invalid": (frames, 3),
        "dropped": (frames,),
        "seconds": (frames,),
    }
    for name, shape in expected.items():
        if arrays[name].shape != shape:
            raise RolloutError(f"{path}: {name} has shape {arrays[name].shape}, expected {shape}")
    for kind, count in rows.items():
        start = arrays[f"{kind}_start"]
        if start[0] != 0 or start[-1] != count or (np.diff(start) < 0).any():
            raise RolloutError(f"{path}: {kind}_start does not divide the {count} rows into frames")

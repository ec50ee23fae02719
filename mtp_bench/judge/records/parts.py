"""Finished scenes of ``mtp-bench submit``, stored one by one.

An interrupted command can be resumed. Their folder lies beside the record and is
removed once the record is written. It also holds the plan of the runs: only a command
with the same plan can resume them.
"""

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core import (
    MtpBenchError,
    RecordError,
    Rollout,
    clean_text,
    describe_write_error,
    file_stem,
    locked,
    make_folder,
    read_json,
    remove_leftovers,
    write_text,
)
from ...env import ARRAYS, drive_arrays, drive_of
from ...sources import read_arrays, write_arrays
from ..gateway.limits import Isolation, SceneRun
from .storage import PARTS, ROLLOUTS, seed_folder

_PLAN = "plan.json"
_LOCK = "lock"
_OTHER_FIELDS = "run"  # array with the fields of a run beside its rollout


@dataclass(frozen=True)
class Parts:
    """Folder of the finished scenes of one record."""

    folder: Path

    def read(self, seed: int, scene: str) -> SceneRun | None:
        """Read a finished scene.

        None if it is missing, broken, or written by another version.
        """
        arrays: dict[str, Any] | None = read_arrays(self._path(seed, scene))
        if arrays is None or not {*ARRAYS, _OTHER_FIELDS} <= arrays.keys():
            return None
        fields = json.loads(str(arrays.pop(_OTHER_FIELDS)))
        drive = {name: arrays.pop(name) for name in arrays.keys() - ARRAYS.keys()}
        try:
            rollout = Rollout(scene, **arrays, drive=drive_of(drive))
            fields["isolation"] = Isolation(**fields["isolation"])
            return SceneRun(rollout, **fields)
        except (KeyError, TypeError, ValueError):  # other fields
            return None

    def write(self, seed: int, run: SceneRun) -> None:
        """Store a scene; raises MtpBenchError if that fails."""
        path = self._path(seed, run.rollout.scene)
        fields = {**vars(run), "isolation": run.isolation.model_dump()}
        del fields["rollout"]
        arrays = {
            name: np.asarray(getattr(run.rollout, name), dtype)
            for name, (dtype, _) in ARRAYS.items()
        }
        arrays |= drive_arrays(run.rollout.drive)
        arrays[_OTHER_FIELDS] = np.array(json.dumps(fields))
        try:
            path.parent.mkdir(exist_ok=True)
            write_arrays(path, arrays, level=0)  # kept for minutes
        except OSError as error:
            raise MtpBenchError(
                f"cannot write {path}: {describe_write_error(error)}"
            ) from None

    def _path(self, seed: int, scene: str) -> Path:
        return seed_folder(self.folder, seed) / f"{file_stem(scene)}.npz"


@contextmanager
def open_parts(target: Path, plan: dict[str, Any], resume: bool) -> Iterator[Parts]:
    """Open the finished scenes of the record at ``target``.

    The files of finished scenes are removed if the block ends without an error.
    ``plan``: all that is decided before the runs, as JSON. Raises MtpBenchError if
    another process writes this record, RecordError if finished scenes are left of an
    earlier command and not to ``resume``, or have another plan.
    """
    folder = target.with_suffix(PARTS)
    make_folder(folder)
    with locked(folder / _LOCK, str(target)):
        if not resume:
            require_new(target)
        remove_leftovers(target, target.with_suffix(ROLLOUTS))
        _require_plan(folder, plan)
        try:
            yield Parts(folder)
        except BaseException as error:
            if count_parts(target):
                error.add_note(
                    "the scenes finished before are kept: --resume continues"
                )
            else:
                _remove(folder)
            raise
        _remove(folder)


def require_new(target: Path) -> None:
    """Raise RecordError if an interrupted command left finished scenes."""
    count = count_parts(target)
    if count:
        folder = target.with_suffix(PARTS)
        raise RecordError(
            f"{folder} holds {count} finished scenes of an interrupted submit: continue "
            "it with --resume, or delete that folder"
        )


def count_parts(target: Path) -> int:
    """Count the finished scenes that an interrupted command left, over all seeds."""
    paths = target.with_suffix(PARTS).glob("seed-*/*.npz")
    return sum(not path.name.startswith(".") for path in paths)


def _remove(folder: Path) -> None:
    """Remove what a submit writes into the folder, which stays if it holds more."""
    for path in folder.glob("seed-*"):
        shutil.rmtree(path, ignore_errors=True)
    for name in (_PLAN, _LOCK):
        (folder / name).unlink(missing_ok=True)
    with suppress(OSError):
        folder.rmdir()


def _require_plan(folder: Path, plan: dict[str, Any]) -> None:
    """Store the plan; raises RecordError if a different one is stored."""
    path = folder / _PLAN
    plan_json = json.loads(json.dumps(plan))
    if not path.exists():
        write_text(path, json.dumps(plan_json, indent=1) + "\n")
        return
    stored = read_json(path, RecordError)
    for name in {**stored, **plan_json}:
        values = plan_json.get(name), stored.get(name)
        if values[0] != values[1]:
            got, expected = (clean_text(json.dumps(value), 100) for value in values)
            raise RecordError(
                f"{folder} was begun with another plan: {name} is now {got}, but was "
                f"{expected}; use the earlier submission and options, or delete that "
                "folder"
            )

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
from ...env import ROLLOUT_ARRAYS, drive_arrays, drive_of
from ...sources import read_arrays, write_arrays
from ..gateway.limits import Isolation, SceneRun
from .storage import PART_SUFFIX, ROLLOUTS_SUFFIX, seed_folder

_PLAN = "plan.json"
_LOCK = "lock"
_MAX_SHOWN = 100  # characters of a value in a message
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
        if arrays is None:
            return None
        try:
            run_fields = json.loads(str(arrays.pop(_OTHER_FIELDS)))
            # arrays that no rollout has are those of its drive
            drive = {
                name: arrays.pop(name) for name in arrays.keys() - ROLLOUT_ARRAYS.keys()
            }
            rollout = Rollout(scene, **arrays, drive=drive_of(drive))
            run_fields["isolation"] = Isolation(**run_fields["isolation"])
            return SceneRun(rollout, **run_fields)
        except (KeyError, TypeError, ValueError):  # other fields
            return None

    def write(self, seed: int, run: SceneRun) -> None:
        """Store a scene.

        Raises MtpBenchError if that fails.
        """
        scene_file = self._path(seed, run.rollout.scene)
        run_fields = {**vars(run), "isolation": run.isolation.model_dump()}
        del run_fields["rollout"]
        arrays = {
            name: np.asarray(getattr(run.rollout, name), dtype)
            for name, (dtype, _) in ROLLOUT_ARRAYS.items()
        }
        arrays |= drive_arrays(run.rollout.drive)
        arrays[_OTHER_FIELDS] = np.array(json.dumps(run_fields))
        try:
            scene_file.parent.mkdir(exist_ok=True)
            write_arrays(scene_file, arrays, level=0)  # kept for minutes
        except OSError as error:
            raise MtpBenchError(
                f"cannot write {scene_file}: {describe_write_error(error)}"
            ) from None

    def _path(self, seed: int, scene: str) -> Path:
        return seed_folder(self.folder, seed) / f"{file_stem(scene)}.npz"


@contextmanager
def open_parts(
    record_file: Path, plan: dict[str, Any], resume: bool
) -> Iterator[Parts]:
    """Open the finished scenes of the record at ``record_file``.

    The files of finished scenes are removed if the block ends without an error.
    ``plan``: all that is decided before the runs, as JSON. Raises MtpBenchError if
    another process writes this record, RecordError if finished scenes are left of an
    earlier command and not to ``resume``, or have another plan.
    """
    parts_folder = record_file.with_suffix(PART_SUFFIX)
    make_folder(parts_folder)
    with locked(parts_folder / _LOCK, str(record_file)):
        if not resume:
            require_new(record_file)
        remove_leftovers(record_file, record_file.with_suffix(ROLLOUTS_SUFFIX))
        _require_plan(parts_folder, plan)
        try:
            yield Parts(parts_folder)
        except BaseException as error:
            if count_parts(record_file):
                error.add_note(
                    "the scenes finished before are kept: --resume continues"
                )
            else:
                _remove(parts_folder)
            raise
        _remove(parts_folder)


def require_new(record_file: Path) -> None:
    """Raise RecordError if an interrupted command left finished scenes."""
    count = count_parts(record_file)
    if count:
        parts_folder = record_file.with_suffix(PART_SUFFIX)
        raise RecordError(
            f"{parts_folder} holds {count} finished scenes of an interrupted submit: "
            "continue "
            "it with --resume, or delete that folder"
        )


def count_parts(record_file: Path) -> int:
    """Count the finished scenes that an interrupted command left, over all seeds."""
    paths = record_file.with_suffix(PART_SUFFIX).glob("seed-*/*.npz")
    return sum(not path.name.startswith(".") for path in paths)


def _remove(parts_folder: Path) -> None:
    """Remove what a submit writes into the folder, which stays if it holds more."""
    for path in parts_folder.glob("seed-*"):
        shutil.rmtree(path, ignore_errors=True)
    for name in (_PLAN, _LOCK):
        (parts_folder / name).unlink(missing_ok=True)
    with suppress(OSError):
        parts_folder.rmdir()


def _require_plan(parts_folder: Path, plan: dict[str, Any]) -> None:
    """Store the plan.

    Raises RecordError if a different one is stored.
    """
    path = parts_folder / _PLAN
    plan_json = json.loads(json.dumps(plan))  # lists for tuples, as it is read again
    if not path.exists():
        write_text(path, json.dumps(plan_json, indent=1) + "\n")
        return
    stored = read_json(path, RecordError)
    for name in {**stored, **plan_json}:
        value = plan_json.get(name)
        stored_value = stored.get(name)
        if value != stored_value:
            got = clean_text(json.dumps(value), _MAX_SHOWN)
            expected = clean_text(json.dumps(stored_value), _MAX_SHOWN)
            raise RecordError(
                f"{parts_folder} was begun with another plan: {name} is now {got}, but was "
                f"{expected}; use the earlier submission and options, or delete that "
                "folder"
            )

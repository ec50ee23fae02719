"""What a submit has finished so far: every scene of every seed, stored as soon as it is done.

The folder lies beside the record and goes when the record is in place. A plan in it says what is run: only a submit of
the same plan goes on from it.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ..env.rollouts import ARRAYS
from ..errors import MtpBenchError, RecordError
from ..files import clean_text, describe_write_error, file_stem, locked, make_folder, remove_leftovers, write_text
from ..gateway import Isolation, SceneRun
from ..sources.cache import read_arrays, write_arrays
from ..strict import read_json
from ..types import Rollout
from .storage import PARTS, ROLLOUTS, seed_folder

Start = Literal["new", "resume", "fresh"]
_PLAN = "plan.json"
_LOCK = "lock"
_SAID = "said"  # name of the array with what is known of a run beside its rollout


@dataclass(frozen=True)
class Parts:
    """The finished scenes of one submit."""

    folder: Path

    def read(self, seed: int, scene: str) -> SceneRun | None:
        """A scene that was finished; None where it was not, its file is broken, or another version wrote it."""
        arrays = read_arrays(self._path(seed, scene))
        if arrays is None or arrays.keys() != {*ARRAYS, _SAID}:
            return None
        said = json.loads(str(arrays.pop(_SAID)))
        try:
            return SceneRun(Rollout(scene, **arrays), **{**said, "isolation": Isolation(**said["isolation"])})
        except TypeError:  # other fields
            return None

    def write(self, seed: int, run: SceneRun) -> None:
        """Store a scene as a whole; raises MtpBenchError where that fails."""
        path = self._path(seed, run.rollout.scene)
        said = {name: value for name, value in asdict(run).items() if name != "rollout"}
        arrays = {name: np.asarray(getattr(run.rollout, name), dtype) for name, (dtype, _) in ARRAYS.items()}
        try:
            path.parent.mkdir(exist_ok=True)
            write_arrays(path, {**arrays, _SAID: np.array(json.dumps(said))}, brief=True)
        except OSError as error:
            raise MtpBenchError(
                f"cannot write {path}: {describe_write_error(error, path)}; finished scenes stay: --resume continues"
            ) from None

    def _path(self, seed: int, scene: str) -> Path:
        return seed_folder(self.folder, seed) / f"{file_stem(scene)}.npz"


@contextmanager
def open_parts(target: Path, plan: dict[str, Any], start: Start = "new") -> Iterator[Parts]:
    """The parts of the record at ``target``, for one process at a time; they are removed when the block ends well.

    ``plan``: JSON that says what is run. Raises MtpBenchError where another process writes this record, RecordError
    where parts are there that a new submit would lose, or that are of another plan.
    """
    folder = target.with_suffix(PARTS)
    make_folder(folder)
    with locked(folder / _LOCK, str(target)):
        if start == "new":
            require_new(target)
        _require_parts(folder)
        remove_leftovers(target, target.with_suffix(ROLLOUTS))
        if start == "fresh":
            _discard(folder)
        _agree(folder, plan)
        try:
            yield Parts(folder)
        except BaseException:
            if not count_parts(target):  # nothing is lost
                shutil.rmtree(folder, ignore_errors=True)
            raise
        shutil.rmtree(folder, ignore_errors=True)


def require_new(target: Path) -> None:
    """Raise RecordError where the parts of an earlier submit lie beside the record at ``target``."""
    found = count_parts(target)
    if found:
        raise RecordError(
            f"{target.with_suffix(PARTS)} holds {found} finished scenes of a submit that did not end: go on from them "
            "with --resume, or discard them with --fresh"
        )


def count_parts(target: Path) -> int:
    """How many scenes, over all seeds, were finished for the record at ``target``, and are not in it yet."""
    return sum(not path.name.startswith(".") for path in target.with_suffix(PARTS).glob("seed-*/*.npz"))


def _require_parts(folder: Path) -> None:
    """Never remove what is something else."""
    foreign = sorted(path.name for path in folder.iterdir() if not _is_ours(path.name))
    if foreign:
        name = clean_text(foreign[0], 100)
        raise RecordError(f"{folder} holds {name!r}, so it is no part of a submit: choose another output, or rename it")


def _is_ours(name: str) -> bool:
    return name in (_PLAN, _LOCK) or name.startswith(("seed-", f".{Path(_PLAN).stem}."))


def _discard(folder: Path) -> None:
    for path in folder.glob("seed-*"):
        shutil.rmtree(path, ignore_errors=True)
    (folder / _PLAN).unlink(missing_ok=True)


def _agree(folder: Path, plan: dict[str, Any]) -> None:
    """Store the plan; raises RecordError where the one that is there says something else."""
    path, wanted = folder / _PLAN, json.loads(json.dumps(plan))
    if not path.exists():
        write_text(path, json.dumps(wanted, indent=1) + "\n")
        return
    there = read_json(path, RecordError)
    for name in {**there, **wanted}:
        if there.get(name) != wanted.get(name):
            got, expected = (clean_text(json.dumps(side.get(name)), 100) for side in (wanted, there))
            raise RecordError(
                f"{folder} was begun with another plan: {name} is {got}, there it is {expected}; submit as then, or "
                "discard it with --fresh"
            )

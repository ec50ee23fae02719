"""Rollouts that lie beside a record."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ..errors import RecordError
from ..running.rollout_files import load_run
from ..types import Rollout
from .record import Record
from .storage import rollouts_folder


def stored_rollouts(path: Path, record: Record) -> dict[int, list[Rollout]]:
    """The stored rollouts of each seed of the record at ``path``, in the order of ``per_scene``.

    Raises RecordError where they are missing, or were made with something else than the record says, RolloutError where
    a file is broken.
    """
    runs = {}
    for seed in record.seeds:
        folder = rollouts_folder(path, seed)
        if not folder.is_dir():
            raise RecordError(
                f"{path}: its rollouts of seed {seed} are not stored at {folder}; run the submission again with --rerun"
            )
        run = load_run(folder)
        for what, said, expected in (
            ("card", run.info.card_digest, record.env.card_digest),
            ("submission", run.info.submission_digest, record.submission.digest),
            ("seed", run.info.seed, seed),
            ("observe", run.info.observe, record.env.observe),
        ):
            if said != expected:
                raise RecordError(f"{folder}: made with {what} {said!r}, the record {path.name} says {expected!r}")
        runs[seed] = _in_order(record, {rollout.scene: rollout for rollout in run.rollouts}, folder)
    return runs


def _in_order(record: Record, found: Mapping[str, Rollout], where: Path) -> list[Rollout]:
    names = [scene.scene for scene in record.per_scene]
    if set(names) != set(found) or len(names) != len(set(names)):
        odd = sorted(set(names) ^ set(found))
        raise RecordError(
            f"{where}: its scenes are not those of the record: {', '.join(odd[:5]) or 'one occurs twice'}"
        )
    return [found[name] for name in names]

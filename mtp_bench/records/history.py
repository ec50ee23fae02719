"""Results under earlier definitions: shown as such, never ranked, not comparable with records."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import RecordError
from ..scoring.rows import Interval
from ..strict import Section, validate
from .storage import read_table, record_paths


@dataclass(frozen=True)
class OldResult:
    """What is shown of a record under earlier definitions."""

    path: Path
    definitions: str
    submission: str
    env: str
    split: str | None  # where it is not the env's
    error: float | None  # m, under those definitions, over all targets
    interval: tuple[float, float] | None
    coverage: float | None
    made: str


class _Submission(Section, extra="ignore"):
    name: str


class _Env(Section, extra="ignore"):
    id: str
    keywords: dict[str, Any]


class _Scorer(Section, extra="ignore"):
    definitions: str


class _Row(Section, extra="ignore"):
    missing_aware: float | None
    interval: Interval | None
    coverage: float | None


class _Record(Section, extra="ignore"):
    submission: _Submission
    env: _Env
    scorer: _Scorer
    rows: list[_Row]  # the first is over all targets
    made: str


def read_history(folder: Path) -> list[OldResult]:
    """The results in ``folder`` and below it by definitions, env and submission; none where there is no such folder.

    Raises RecordError, naming the file, where one cannot be read.
    """
    found = [_read(path) for path in record_paths(folder)]
    return sorted(found, key=lambda old: (old.definitions, old.env, old.split or "", old.submission))


def _read(path: Path) -> OldResult:
    old = validate(_Record, read_table(path, "no such file"), str(path), RecordError)
    if not old.rows:
        raise RecordError(f"{path}: rows is empty, expected one over all targets first")
    row, split = old.rows[0], old.env.keywords.get("split")
    return OldResult(
        path=path,
        definitions=old.scorer.definitions,
        submission=old.submission.name,
        env=old.env.id,
        split=None if split is None else str(split),
        error=row.missing_aware,
        interval=row.interval,
        coverage=row.coverage,
        made=old.made,
    )

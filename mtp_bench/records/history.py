"""Results under earlier definitions: shown as such, never ranked, not comparable with records."""

from __future__ import annotations

from pathlib import Path

from ..errors import RecordError
from ..scoring.rows import Interval
from ..strict import Section, validate
from .storage import read_table, record_paths


class OldResult(Section):
    """What is shown of a record under earlier definitions."""

    path: Path
    definitions: str
    submission: str
    env: str
    split: str | None  # where it is not the env's
    error: float | None  # m, under those definitions, over all targets
    interval: Interval | None
    coverage: float | None
    made: str


def read_history(folder: Path) -> list[OldResult]:
    """The results in ``folder`` and below it by definitions, env and submission; none where there is no such folder.

    Raises RecordError, naming the file, where one cannot be read.
    """
    found = [_read(path) for path in record_paths(folder)]
    return sorted(found, key=lambda old: (old.definitions, old.env, old.split or "", old.submission))


def _read(path: Path) -> OldResult:
    content = read_table(path, "no such file")
    try:
        row = content["rows"][0]  # over all targets
        shown = {
            "path": path,
            "definitions": content["scorer"]["definitions"],
            "submission": content["submission"]["name"],
            "env": content["env"]["id"],
            "split": content["env"]["keywords"].get("split"),
            "error": row["missing_aware"],
            "interval": row["interval"],
            "coverage": row["coverage"],
            "made": content["made"],
        }
    except (AttributeError, IndexError, KeyError, TypeError) as error:
        raise RecordError(f"{path}: no result under earlier definitions: {type(error).__name__}: {error}") from None
    return validate(OldResult, shown, str(path), RecordError)

"""The tables of a leaderboard as files for other programs: JSON and CSV."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from typing import Any

from ...records.evaluation import rounded
from ...scoring.definitions import DEFINITIONS
from .columns import COLUMNS
from .entries import Entry, by_env
from .overview import Overview

_FORMULA = ("=", "+", "-", "@", "'")  # how a text begins that a spreadsheet may run
_PAIRS = ("interval", "difference_interval")


def board_json(entries: Sequence[Entry]) -> dict[str, list[dict[str, Any]]]:
    """What the tables show: a list of rows per environment, None where nothing is known."""
    return {env_id: [row_of(entry) for entry in listed] for env_id, listed in by_env(entries).items()}


def table_files(env_id: str, entries: Sequence[Entry]) -> dict[str, str]:
    """The table of one environment, by the suffix of its file."""
    rows = [row_of(entry) for entry in entries]
    content = {"env": env_id, "definitions": DEFINITIONS, "rows": rows}
    return {"json": to_json(content), "csv": to_csv([_flat(row) for row in rows])}


def overview_files(overview: Overview) -> dict[str, str]:
    """The overview, a row per agent and environment, by the suffix of its file."""
    rows = [
        {"agent": name, "env": entry.env, "rank": entry.rank, "error": entry.error, "ranked": entry.rank is not None}
        for name, row in overview.rows
        for entry in row
        if entry is not None
    ]
    return {"json": to_json({"definitions": DEFINITIONS, "rows": rows}), "csv": to_csv(rows)}


def row_of(entry: Entry) -> dict[str, Any]:
    """One entry, for other programs."""
    kept = ("division", "status", "digest")
    difference = entry.difference()
    row: dict[str, Any] = {
        "rank": entry.rank,
        "submission": entry.name,
        "not_ranked_because": entry.why or None,
        "trained_on_scored": entry.trained_on_scored or None,
        "added": entry.added,
        "interval": list(entry.row.interval) if entry.row.interval else None,
        "difference_interval": list(difference.interval) if difference and difference.interval else None,
        "p": difference.p if difference else None,
        **{column.key: column.value(entry) for column in COLUMNS},
        **{name: getattr(entry.record, name) for name in kept},
        "level": entry.level,
        "checked": entry.checked or None,
        "made": entry.record.measured.made,
    }
    return {name: rounded(value) for name, value in row.items()}


def to_json(content: Mapping[str, Any]) -> str:
    """Readable JSON that is the same for equal content."""
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def to_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """CSV whose texts no spreadsheet takes for formulas; an empty cell where a number is not defined."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(rows[0] if rows else ())
    writer.writerows([[_cell(value) for value in row.values()] for row in rows])
    return text.getvalue()


def _flat(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row whose intervals are two columns each."""
    flat: dict[str, Any] = {}
    for name, value in row.items():
        if name in _PAIRS:
            flat[f"{name}_low"], flat[f"{name}_high"] = value or (None, None)
        else:
            flat[name] = value
    return flat


def _cell(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    text = " ".join(value.split())
    return f"'{text}" if text.startswith(_FORMULA) else text

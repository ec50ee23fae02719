"""Columns of a leaderboard: of rows, of records and of comparisons."""

import tomllib
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...core import Column, Table, Value, columns_of
from ...judge import rounded
from ...scoring import NAMES, DrivingRow, Row, Subset
from .entries import Entry

_DECLARED: dict[str, Any] = tomllib.loads(
    Path(__file__).with_name("columns.toml").read_text(encoding="utf-8")
)
_ROW_COLUMNS = {column.key: column for column in columns_of(Row)}
# keys of the columns of the page, each with the class of its cells
PAGE = _DECLARED.pop("page")


def _of_row(column: Column, subset: Subset = "all", **changes: Any) -> Column:
    """Return a column of report rows as one of entries; it is blank of drives.

    It reads the row of ``subset``.
    """

    def read(entry: Entry) -> Value:
        return column.value(entry.row_of(subset)) if entry.driving is None else None

    return replace(column, **{"read": read, **changes})


def _of_driving(column: Column) -> Column:
    return replace(
        column,
        key=f"drive_{column.key.removeprefix('drive_')}",
        optional=True,
        read=lambda entry: column.value(entry.driving),
    )


def _of(key: str, read: Callable[[Entry], Value], **further: Any) -> Column:
    return Column(key=key, read=read, **_DECLARED.get(key, {}), **further)


def _error_on(subset: Subset) -> Column:
    return _of_row(
        _ROW_COLUMNS["error"],
        subset,
        key=subset,
        heading=NAMES[subset],
        **_DECLARED[subset],
    )


def _turning_error(entry: Entry) -> Value:
    subset: Subset = "turning"
    return entry.row_of(subset).error if subset in entry.sums.subsets else None


def _displacements(subset: Subset, where: str) -> list[Column]:
    prefix = "" if subset == "all" else f"{subset}_"
    columns = []
    for name, distance in (("minADE", "Mean"), ("minFDE", "Final")):
        column = _of_row(
            _ROW_COLUMNS[name],
            subset,
            key=f"{prefix}{name}",
            heading=name,
            format=".2f",
            group=NAMES[subset],
            help=(
                f"{distance} distance of the best sample over {where} that have a "
                "forecast, metres."
            ),
        )
        columns.append(column)
    return columns


def _of_difference(name: str) -> Callable[[Entry], Value]:
    return lambda entry: getattr(entry.difference(), name, None)


def _gap_blank(entry: Entry) -> str | None:
    is_known = entry.standing.gaps.get("all") is not None
    return None if is_known else entry.standing.gap_blank


_NUMBERS: Sequence[Column] = (
    _of_row(_ROW_COLUMNS["error"], **_DECLARED["error"]),
    _of_row(_ROW_COLUMNS["interval"]),
    _of("difference", _of_difference("mean")),
    _of("difference_interval", _of_difference("interval"), interval=True),
    _of("public", lambda entry: entry.public_error),
    _error_on("ids"),
    _error_on("reacquired"),
    _of("turning", _turning_error),
    *_displacements("all", "all targets"),
    *_displacements(
        "paper_ids", "targets with an identity switch of stp, the paper's subset,"
    ),
    *_displacements(
        "paper_frag", "targets with a fragmentation of stp, the paper's subset,"
    ),
    _of("same_gap", lambda entry: entry.standing.own_gaps.get("all")),
    _of("association_gap", lambda entry: entry.standing.association_gaps.get("all")),
    _of_row(_ROW_COLUMNS["coverage"], **_DECLARED["coverage"]),
    _of("brier", lambda entry: entry.record.brier),
    _of("overconfidence", lambda entry: entry.record.overconfidence),
    _of("ms", lambda entry: entry.record.measured.ms_per_frame),
    _of("weights", lambda entry: entry.weights),
    _of("gap", lambda entry: entry.standing.gaps.get("all")),
    _of("hypotheses", lambda entry: entry.record.hypotheses),
    _of("samples", lambda entry: entry.record.samples),
    _of("p50", lambda entry: entry.record.measured.latency.p50_ms),
    _of("p95", lambda entry: entry.record.measured.latency.p95_ms),
    _of("memory", lambda entry: entry.record.measured.peak_memory_mib),
    *map(_of_driving, columns_of(DrivingRow)[1:]),
)
# the table of all data has the energy score among the further numbers of rows
COLUMN = {column.key: column for column in _NUMBERS} | {
    "energy_score": _of_row(_ROW_COLUMNS["energy_score"], **_DECLARED["energy_score"])
}
_FIRST_COLUMNS = (
    _of("env", lambda entry: entry.env),
    _of("definitions", lambda entry: entry.record.scorer.definitions),
    _of("place", lambda entry: entry.place),
    _of(
        "rank_range",
        lambda entry: entry.standing.places["all"].span,
        interval=True,
        format="d",
    ),
    _of("submission", lambda entry: entry.name),
    _of("not_ranked_because", lambda entry: entry.why or None),
    _of("trained_on_scored", lambda entry: entry.trained_on_scored or None),
    _of("added", lambda entry: entry.added),
)
_LAST_COLUMNS = (
    _of("p", _of_difference("p"), format=".3f"),
    _of("gap_blank_because", _gap_blank),
    _of("association_gap_blank_because", lambda entry: entry.association_blank("all")),
    _of("status", lambda entry: entry.record.status),
    _of("digest", lambda entry: entry.record.digest),
    _of("level", lambda entry: entry.level),
    _of("checked", lambda entry: entry.checked or None),
    _of("made", lambda entry: entry.record.measured.made),
)


def further_columns(entries: Collection[Entry]) -> list[Column]:
    """Return further numbers of rows: the optional columns of the scorer."""
    row_type = type(next(iter(entries)).row) if entries else Row
    return [column for column in columns_of(row_type) if column.optional]


def board_table(entries: Sequence[Entry], name: str) -> Table:
    """Return every number of the entries, rounded as records are, for other programs.

    A further number that no entry has is left out: records are older than a new metric.
    """
    further = map(_of_row, further_columns(entries))
    columns = []
    for column in (*_FIRST_COLUMNS, *_NUMBERS, *further, *_LAST_COLUMNS):
        values = (column.value(entry) for entry in entries)
        if not column.optional or any(value is not None for value in values):
            columns.append(replace(column, read=_rounded(column)))
    return Table(name, "Leaderboard", "", entries, columns)


def _rounded(column: Column) -> Callable[[Entry], Value]:
    return lambda entry: rounded(column.value(entry))


def board_json(entries: Sequence[Entry]) -> dict[str, list[dict[str, Value]]]:
    """Return the content of ``board --json``: a list of rows per environment.

    None stands for a missing value.
    """
    boards: dict[str, list[dict[str, Value]]] = {}
    for row in board_table(entries, "board").records:
        boards.setdefault(str(row.pop("env")), []).append(row)
    return boards


def best_text(column: Column, entries: Sequence[Entry]) -> str | None:
    """Return the text of the best value of the compared entries in a column.

    None if neither low nor high is better, and for fewer than two numbers.
    """
    values = [column.value(entry) for entry in entries if entry.compared]
    numbers = [value for value in values if isinstance(value, (int, float))]
    if not column.better or len(numbers) < 2:
        return None
    return column.text(min(numbers) if column.better == "lower" else max(numbers))

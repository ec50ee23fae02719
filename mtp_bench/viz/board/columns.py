"""Columns of a leaderboard: those of rows, as the scorer declares them, and those of records and comparisons."""

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
_ROW = {column.key: column for column in columns_of(Row)}
PAGE = _DECLARED.pop(
    "page"
)  # keys of the columns of the page, each with the class of its cells


def _of_row(column: Column, subset: Subset = "all", **changes: Any) -> Column:
    """A ``column`` of report rows as a column of entries, which reads their row of ``subset``; blank of drives."""

    def read(entry: Any) -> Any:
        return column.value(entry.row_of(subset)) if entry.driving is None else None

    return replace(column, **{"read": read, **changes})


def _of_driving(column: Column) -> Column:
    return replace(
        column,
        key=f"drive_{column.key.removeprefix('drive_')}",
        optional=True,
        read=lambda entry: column.value(entry.driving),
    )


def _of(key: str, read: Callable[[Entry], Value]) -> Column:
    return Column(key=key, read=read, **_DECLARED.get(key, {}))


def _event(subset: Subset) -> Column:
    return _of_row(
        _ROW["error"], subset, key=subset, heading=NAMES[subset], **_DECLARED[subset]
    )


def _paper(subset: Subset, where: str) -> list[Column]:
    prefix = "" if subset == "all" else f"{subset}_"
    return [
        _of_row(
            _ROW[name],
            subset,
            key=f"{prefix}{name}",
            heading=name,
            format=".2f",
            group=NAMES[subset],
            help=f"{distance} distance of the best sample over {where} that have a forecast, metres.",
        )
        for name, distance in (("minADE", "Mean"), ("minFDE", "Final"))
    ]


def _of_difference(name: str) -> Callable[[Entry], Value]:
    return lambda entry: getattr(entry.difference(), name, None)


_NUMBERS: Sequence[Column] = (
    _of_row(_ROW["error"], **_DECLARED["error"]),
    _of_row(_ROW["interval"]),
    _of("difference", _of_difference("mean")),
    Column(key="difference_interval", interval=True, read=_of_difference("interval")),
    _of("public", lambda e: e.public_error),
    _event("ids"),
    _event("reacquired"),
    _of(
        "turning",
        lambda e: e.row_of("turning").error if "turning" in e.sums.subsets else None,
    ),
    *_paper("all", "all targets"),
    *_paper("paper_ids", "targets with an identity switch of stp, the paper's subset,"),
    *_paper("paper_frag", "targets with a fragmentation of stp, the paper's subset,"),
    _of("same_gap", lambda e: e.same_predictor_gap("all")),
    _of("association_gap", lambda e: e.standing.association_gaps.get("all")),
    _of_row(_ROW["coverage"], **_DECLARED["coverage"]),
    _of("brier", lambda e: e.record.brier),
    _of("overconfidence", lambda e: e.record.overconfidence),
    _of("ms", lambda e: e.record.measured.ms_per_frame),
    _of("weights", lambda e: e.weights),
    _of("gap", lambda e: e.standing.gaps.get("all")),
    _of("hypotheses", lambda e: e.record.hypotheses),
    _of("samples", lambda e: e.record.samples),
    _of("p50", lambda e: e.record.measured.latency.p50_ms),
    _of("p95", lambda e: e.record.measured.latency.p95_ms),
    _of("memory", lambda e: e.record.measured.peak_memory_mib),
    *map(_of_driving, columns_of(DrivingRow)[1:]),
)
# the table of all data has the energy score among the further numbers of rows
COLUMN = {column.key: column for column in _NUMBERS} | {
    "energy_score": _of_row(_ROW["energy_score"], **_DECLARED["energy_score"])
}
_FIRST = (
    _of("definitions", lambda e: e.record.scorer.definitions),
    _of("place", lambda e: e.place),
    Column(
        key="rank_range",
        interval=True,
        format="d",
        read=lambda e: e.standing.places["all"].span,
    ),
    _of("submission", lambda e: e.name),
    _of("not_ranked_because", lambda e: e.why or None),
    _of("trained_on_scored", lambda e: e.trained_on_scored or None),
    _of("added", lambda e: e.added),
)
_LAST = (
    Column(key="p", format=".3f", read=_of_difference("p")),
    _of(
        "gap_blank_because",
        lambda e: (
            None if e.standing.gaps.get("all") is not None else e.standing.gap_blank
        ),
    ),
    _of("association_gap_blank_because", lambda e: e.association_blank("all")),
    _of("status", lambda e: e.record.status),
    _of("digest", lambda e: e.record.digest),
    _of("level", lambda e: e.level),
    _of("checked", lambda e: e.checked or None),
    _of("made", lambda e: e.record.measured.made),
)


def further_columns(entries: Collection[Entry]) -> list[Column]:
    """Further numbers of rows: the optional columns of the scorer."""
    kind = type(next(iter(entries)).row) if entries else Row
    return [column for column in columns_of(kind) if column.optional]


def board_table(entries: Sequence[Entry], name: str) -> Table:
    """Every number of the entries, rounded as records are, for CSV, JSON and other programs.

    A further number that no entry has is left out: records are older than a new metric.
    """
    env = _of("env", lambda e: e.env)
    columns = [env, *_FIRST, *_NUMBERS, *map(_of_row, further_columns(entries)), *_LAST]
    columns = [
        c
        for c in columns
        if not c.optional or any(c.value(entry) is not None for entry in entries)
    ]
    return Table(
        name,
        "Leaderboard",
        "",
        entries,
        [replace(c, read=_rounded(c)) for c in columns],
    )


def _rounded(column: Column) -> Callable[[Entry], Value]:
    return lambda entry: rounded(column.value(entry))


def board_json(entries: Sequence[Entry]) -> dict[str, list[dict[str, Value]]]:
    """The content of ``board --json``: a list of rows per environment, None where a value is missing."""
    boards: dict[str, list[dict[str, Value]]] = {}
    for record in board_table(entries, "board").records:
        boards.setdefault(str(record.pop("env")), []).append(record)
    return boards


def best_text(column: Column, entries: Sequence[Entry]) -> str | None:
    """Text of the best value of the compared entries in a column.

    None for a column in which neither low nor high is better, and for fewer than two numbers.
    """
    values = [column.value(entry) for entry in entries if entry.compared]
    numbers = [value for value in values if isinstance(value, (int, float))]
    if not column.better or len(numbers) < 2:
        return None
    return column.text(min(numbers) if column.better == "lower" else max(numbers))

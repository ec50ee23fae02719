"""The columns of a leaderboard beyond rank and name: what each shows, how it sorts, which direction is better."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from ...scoring.subsets import Subset
from ..terminal.output import NOTHING
from .entries import Entry

Value = Callable[[Entry], float | None]


@dataclass(frozen=True)
class Column:
    """A column that can be sorted."""

    key: str
    label: str
    title: str  # for those who hover or listen
    better: Literal["lower", "higher", ""]
    value: Value  # what it is sorted by
    text: Callable[[float], str]
    group: str = ""  # heading above several columns
    kind: str = ""  # class of its cells: "wide" and "mid" are left out on narrower screens

    @property
    def arrow(self) -> str:
        """The direction that is better."""
        return {"lower": "↓", "higher": "↑", "": ""}[self.better]


def fixed(digits: int) -> Callable[[float], str]:
    """Numbers with as many digits after the point."""
    return lambda value: f"{value:.{digits}f}"


def percent(value: float) -> str:
    """A share as a percentage."""
    return f"{round(100 * value)} %".replace("-", "−")  # round: a whole number has no -0


def _error_on(subset: Subset, targets: str) -> Column:
    title = f"error over targets that {targets}, weighted by how often, metres"
    group = "error where the reference tracker errs (m)"
    return Column(subset, subset, title, "lower", lambda entry: entry.row_of(subset).error, fixed(2), group, "mid")


def _covered(key: str, what: str, value: Value) -> Column:
    title = f"{what} of the best sample, over the targets that have a forecast, metres"
    return Column(key, key, title, "lower", value, fixed(3), "covered targets (m)", "wide")


def _time(key: str, title: str, value: Value) -> Column:
    return Column(key, key, title, "lower", value, fixed(1), "ms per frame", "wide")


def _count(key: str, label: str, title: str, value: Value) -> Column:
    return Column(key, label, title, "", value, fixed(0), "number of", "wide")


_ERROR = "error over all targets, averaged over how many false forecasts one allows, metres; this ranks"
_PUBLIC = "error on the scenes that everybody knows, where hidden ones rank, metres"
_PLAIN = "error with every forecast kept, however many are false, metres"
_COVERAGE = "targets that have a forecast"
_MEMORY = "peak of the agent's process"
_GAP = "how far towards prediction on true pasts (100 %), from the single-hypothesis pipeline (0 %)"

_P95 = "time within which 95 % of the frames are answered, milliseconds"

COLUMNS: Sequence[Column] = (
    Column("error", "error", _ERROR, "lower", lambda e: e.error, fixed(3), "ranked by: error (m)"),
    Column("public", "public", _PUBLIC, "lower", lambda e: e.public_error, fixed(3), "", "wide"),
    _error_on("ids", "change identity"),
    _error_on("reacquired", "are found again"),
    Column("plain", "plain", _PLAIN, "lower", lambda e: e.row.plain_error, fixed(2), "", "wide"),
    _covered("minADE", "mean distance", lambda e: e.row.minADE),
    _covered("minFDE", "final distance", lambda e: e.row.minFDE),
    Column("coverage", "covered", _COVERAGE, "higher", lambda e: e.row.coverage, percent, "", "mid"),
    Column("gap", "gap closed", _GAP, "higher", lambda e: e.standing.gaps.get("all"), percent, "", "mid"),
    _count("hypotheses", "H", "hypotheses of the tracker", lambda e: e.record.hypotheses),
    _count("samples", "K", "samples per object", lambda e: e.record.samples),
    _time("p50", "median time of one frame, milliseconds", lambda e: e.record.measured.latency.p50_ms),
    _time("p95", _P95, lambda e: e.record.measured.latency.p95_ms),
    Column("memory", "MiB", _MEMORY, "lower", lambda e: e.record.measured.peak_memory_mib, fixed(0), "memory", "wide"),
)


def shown(column: Column, entry: Entry) -> str:
    """The text of one cell."""
    value = column.value(entry)
    return NOTHING if value is None else column.text(value)


def best_texts(column: Column, entries: Sequence[Entry]) -> str | None:
    """What the best of the compared entries shows in a column; None where nothing is better or worse."""
    values = [value for entry in entries if entry.compared and (value := column.value(entry)) is not None]
    if not column.better or len(values) < 2:
        return None
    return column.text(min(values) if column.better == "lower" else max(values))

"""The columns of a leaderboard beyond rank and name: what each shows, how it sorts, which direction is better."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from .entries import LEVELS, Entry, finite

NOTHING = "–"


@dataclass(frozen=True)
class Column:
    """A column that can be sorted."""

    key: str
    label: str
    title: str  # for those who hover or listen
    better: Literal["lower", "higher", ""]
    value: Callable[[Entry], float | None]  # what it is sorted by
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


def _row(key: str, subset: str = "all") -> Callable[[Entry], float | None]:
    return lambda entry: entry.number(key, subset)


def _field(*path: str) -> Callable[[Entry], float | None]:
    def value(entry: Entry) -> float | None:
        found: Any = entry.record
        for name in path:
            found = found.get(name) if isinstance(found, dict) else None
        return finite(found)

    return value


def level(entry: Entry) -> float | None:
    """How far a record is verified, 0 to 3."""
    name = entry.record.get("verification")
    return float(LEVELS.index(name)) if name in LEVELS else None


def _subset(name: str, targets: str) -> Column:
    title = f"missing-aware error over {targets}, metres"
    group = "error where the reference tracker errs (m)"
    return Column(name, name, title, "lower", _row("missing_aware", name), fixed(2), group, "mid")


def _covered(key: str, what: str) -> Column:
    title = f"{what} of the best sample, over the targets that have a forecast, metres"
    return Column(key, key, title, "lower", _row(key), fixed(3), "covered targets (m)", "wide")


def _time(key: str, title: str) -> Column:
    return Column(key, key, title, "lower", _field("latency", f"{key}_ms"), fixed(1), "ms per frame", "wide")


_ERROR = "missing-aware error over all targets, metres; this ranks"
_GAP = "how far towards prediction on true pasts (100 %), from the single-hypothesis pipeline (0 %)"

COLUMNS: Sequence[Column] = (
    Column("error", "error", _ERROR, "lower", _row("missing_aware"), fixed(3), "ranked by: missing-aware error (m)"),
    _subset("ids", "targets whose track changes identity"),
    _subset("lost", "targets whose track is lost"),
    _subset("reacquired", "targets that are found again"),
    _subset("frag", "targets that are lost or found again"),
    _covered("minADE", "mean distance"),
    _covered("minFDE", "final distance"),
    Column("coverage", "covered", "targets that have a forecast", "higher", _row("coverage"), percent, "", "mid"),
    Column("gap", "gap closed", _GAP, "higher", _row("gap_closed"), percent, "", "mid"),
    Column("hypotheses", "H", "hypotheses of the tracker", "", _field("hypotheses"), fixed(0), "number of", "wide"),
    Column("samples", "K", "samples per object", "", _field("samples"), fixed(0), "number of", "wide"),
    _time("p50", "median time of one frame, milliseconds"),
    _time("p95", "time within which 95 % of the frames are answered, milliseconds"),
    Column(
        "memory", "MiB", "peak of the agent's process", "lower", _field("peak_memory_mib"), fixed(0), "memory", "wide"
    ),
)


def shown(column: Column, entry: Entry) -> str:
    """The text of one cell."""
    value = column.value(entry)
    return NOTHING if value is None else column.text(value)


def best_texts(column: Column, entries: Sequence[Entry]) -> str | None:
    """What the best ranked entry shows in a column; None where nothing is better or worse."""
    values = [value for entry in entries if entry.rank is not None and (value := column.value(entry)) is not None]
    if not column.better or len(values) < 2:
        return None
    return column.text(min(values) if column.better == "lower" else max(values))

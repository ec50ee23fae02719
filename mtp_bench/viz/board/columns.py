"""The columns of a leaderboard beyond rank and name: what each shows, how it sorts, which direction is better."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Literal

from ...scoring.subsets import Subset
from ..terminal.output import NOTHING
from .entries import Entry

Value = Callable[[Entry], float | None]


@dataclass(frozen=True)
class Column:
    """A column of numbers."""

    key: str
    label: str
    title: str  # for those who hover, focus or listen
    better: Literal["lower", "higher", ""]
    value: Value  # what it is sorted by
    text: Callable[[float], str]
    group: str = ""  # heading above several columns
    kind: str = ""  # class of its cells on the page: "wide" and "mid" are left out on narrower screens
    page: bool = True  # in the table of the page; the others are in its details and files

    @property
    def arrow(self) -> str:
        """The direction that is better."""
        return {"lower": "↓", "higher": "↑", "": ""}[self.better]


def fixed(digits: int) -> Callable[[float], str]:
    """Numbers with as many digits after the point."""
    return lambda value: f"{value:.{digits}f}"


def signed(value: float) -> str:
    """A difference with its sign and three digits."""
    text = f"{value:+.3f}".replace("-", "−")
    return text if float(f"{value:.3f}") else "0.000"


def percent(value: float) -> str:
    """A share as a percentage."""
    return f"{round(100 * value)} %".replace("-", "−")  # round: a whole number has no -0


def _difference(entry: Entry) -> float | None:
    found = entry.difference()
    return None if found is None else found.mean


def _error_on(subset: Subset, targets: str) -> Column:
    title = f"Error over targets that {targets}, weighted by how often that happens to the reference tracker, metres."
    group = "error where STP errs"
    return Column(subset, subset, title, "lower", lambda entry: entry.row_of(subset).error, fixed(2), group, "mid")


def _paper(subset: Subset, name: str, where: str) -> tuple[Column, Column]:
    """The two numbers of the paper on a subset."""
    prefix = "" if subset == "all" else f"{subset}_"
    title = f"{{}} of the best sample over {where} that have a forecast, metres."
    return (
        Column(f"{prefix}minADE", "minADE", title.format("Mean distance"), "lower",
               lambda entry: entry.row_of(subset).minADE, fixed(2), name, "wide"),
        Column(f"{prefix}minFDE", "minFDE", title.format("Final distance"), "lower",
               lambda entry: entry.row_of(subset).minFDE, fixed(2), name, "wide"),
    )  # fmt: skip


_ERROR = (
    "Error over all targets, averaged over how many false forecasts one allows; where it cannot be known which are "
    "false, as on nuScenes, over how many forecasts per frame. Metres. This ranks."
)
_DIFFERENCE = (
    "Error minus that of the single-hypothesis pipeline (stp) on the same targets, metres, with the 95 % interval of "
    "the paired difference over units of at most 20 s. Left of the line: better than stp."
)
_PUBLIC = "Error on the scenes that everybody knows, where hidden ones rank, metres."
_PLAIN = "Error with every forecast kept, however many are false, metres."
_COVERAGE = "Share of the targets that have a forecast."
_MEMORY = "Peak memory of the agent's process, MiB."
_GAP = "How far towards prediction on true pasts (100 %), from stp (0 %), with the predictor of stp at both ends."
_SAME_GAP = (
    "How far towards prediction on true pasts (100 %), from the single-hypothesis pipeline (0 %), both with the "
    "predictor of the entry itself."
)
_P50 = "Median time of one frame, milliseconds."
_P95 = "Time within which 95 % of the frames are answered, milliseconds."
_MS = "Mean time of one frame on the machine of whoever made the record, milliseconds."

COLUMNS: Sequence[Column] = (
    Column("error", "error", _ERROR, "lower", lambda e: e.error, fixed(3), "ranks (m)"),
    Column("difference", "to stp", _DIFFERENCE, "lower", _difference, signed, "difference to stp (m)"),
    Column("public", "public", _PUBLIC, "lower", lambda e: e.public_error, fixed(3), "", "wide"),
    _error_on("ids", "change identity"),
    _error_on("reacquired", "are lost and found again"),
    *_paper("all", "all targets", "all targets"),
    *_paper("paper_ids", "IDS", "targets with an identity switch of stp, the paper's subset,"),
    *_paper("paper_frag", "FRAG", "targets with a fragmentation of stp, the paper's subset,"),
    Column("same_gap", "same predictor", _SAME_GAP, "higher", lambda e: e.same_predictor_gap("all"), percent,
           "gap closed", "mid"),
    Column("coverage", "covered", _COVERAGE, "higher", lambda e: e.row.coverage, percent, "", "mid"),
    Column("ms", "ms", _MS, "lower", lambda e: e.record.measured.ms_per_frame, fixed(1), "", "wide"),
    Column("plain", "plain", _PLAIN, "lower", lambda e: e.row.plain_error, fixed(3), page=False),
    Column("gap", "gap closed", _GAP, "higher", lambda e: e.standing.gaps.get("all"), percent, page=False),
    Column("hypotheses", "H", "Hypotheses of the tracker.", "", lambda e: e.record.hypotheses, fixed(0), page=False),
    Column("samples", "K", "Samples per object.", "", lambda e: e.record.samples, fixed(0), page=False),
    Column("p50", "p50", _P50, "lower", lambda e: e.record.measured.latency.p50_ms, fixed(1), page=False),
    Column("p95", "p95", _P95, "lower", lambda e: e.record.measured.latency.p95_ms, fixed(1), page=False),
    Column("memory", "MiB", _MEMORY, "lower", lambda e: e.record.measured.peak_memory_mib, fixed(0), page=False),
)  # fmt: skip
COLUMN = {column.key: column for column in COLUMNS}


def columns_of(entries: Collection[Entry]) -> list[Column]:
    """The columns of the table of one environment: those in which an entry has a number."""
    return [column for column in COLUMNS if column.page and any(column.value(entry) is not None for entry in entries)]


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

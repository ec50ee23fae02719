"""Columns of a leaderboard: those of rows, as the scorer declares them, and those of records and comparisons."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Any

from ...records.canonical import rounded
from ...scoring.definitions import Subset
from ...scoring.main_table import NAMES
from ...scoring.rows import Row
from ...tables import Column, Table, Value, columns_of
from .entries import Entry

_ROW = {column.key: column for column in columns_of(Row)}
# Columns of the page, each with the class of its cells there: narrower screens leave out "widest", "wide" and "mid".
PAGE = {
    "error": "error", "difference": "difference", "public": "wide", "ids": "mid", "reacquired": "mid",
    "turning": "wide", "minADE": "wide", "minFDE": "wide", "paper_ids_minADE": "wide", "paper_ids_minFDE": "wide",
    "paper_frag_minADE": "widest", "paper_frag_minFDE": "widest", "same_gap": "mid", "coverage": "mid", "ms": "wide",
    "weights": "weights",
}  # fmt: skip


def _of_row(column: Column, subset: Subset = "all", **changes: Any) -> Column:
    """A ``column`` of report rows as a column of entries, which reads their row of ``subset``."""
    return replace(column, **{"read": lambda entry: column.value(entry.row_of(subset)), **changes})


def _of(key: str, heading: str, read: Callable[[Entry], Value], **declared: Any) -> Column:
    return Column(heading, key=key, read=read, **declared)


def _text(key: str, read: Callable[[Entry], Value]) -> Column:
    return Column(key=key, read=read)


def _event(subset: Subset, what: str) -> Column:
    title = f"Error over targets that {what}, weighted by how often that happens to the reference tracker, metres."
    heading, group = NAMES[subset], "bADE (m) by event"
    return _of_row(_ROW["error"], subset, key=subset, heading=heading, format=".2f", group=group, help=title)


def _paper(subset: Subset, where: str) -> list[Column]:
    """The two numbers of the paper on a subset."""
    prefix = "" if subset == "all" else f"{subset}_"
    return [
        _of_row(
            _ROW[name], subset, key=f"{prefix}{name}", heading=name, format=".2f", group=NAMES[subset],
            help=f"{distance} distance of the best sample over {where} that have a forecast, metres.",
        )
        for name, distance in (("minADE", "Mean"), ("minFDE", "Final"))
    ]  # fmt: skip


def _of_difference(name: str) -> Callable[[Entry], Value]:
    return lambda entry: getattr(entry.difference(), name, None)


_ERROR = (
    "Mean over all targets of min(minADE, c), c without a forecast, averaged over budgets of false forecasts. On "
    "nuScenes false ones are not known: budgets are forecasts per frame. Metres. It decides the rank."
)
_TURNING = "Error over targets whose heading changes by more than 0.5 rad over the future, metres: shown, not ranked."
_DIFFERENCE = (
    "bADE minus that of the single-hypothesis pipeline (stp) on the same targets, metres, with the 95 % interval of "
    "the paired difference over units of at most 20 s. Left of the line: better than stp."
)
_GAP = "Share of the way from stp (0 %) to prediction on ground-truth tracks (100 %), both with the predictor of stp."
_SAME_GAP = (
    "Of the gap between the single-hypothesis pipeline (0 %) and prediction on ground-truth tracks (GT, 100 %), both "
    "with the predictor of the entry itself. Below 0 %: worse than the pipeline."
)
_ASSOCIATION = (
    "Share of the way from one hypothesis with as many samples as 20 (0 %) to perfect association of the same "
    "detections (100 %), both with the predictor of the entry itself."
)
_MS = "Mean time of one frame on the machine that made the record, milliseconds."
_WEIGHTS = "Ships: it runs as it is. Train: a command in its details trains it first; minutes of nuScenes on two cores."
_P95 = "Time within which 95 % of the frames are answered, milliseconds."

_NUMBERS: Sequence[Column] = (
    _of_row(_ROW["error"], heading="all targets", format=".3f", group="bADE (m)", help=_ERROR),
    _of_row(_ROW["interval"]),
    _of("difference", "difference", _of_difference("mean"), unit="m", better="lower", format="+.3f",
        group="to stp (m)", help=_DIFFERENCE),
    Column(key="difference_interval", interval=True, read=_of_difference("interval")),
    _of("public", "public", lambda e: e.public_error, unit="m", better="lower", format=".3f",
        help="bADE on the public scenes, where hidden ones rank, metres."),
    _event("ids", "change identity"),
    _event("reacquired", "are lost and found again"),
    _of("turning", NAMES["turning"], lambda e: next((r.error for r in e.sums.rows if r.subset == "turning"), None),
        unit="m", better="lower", format=".2f", group="bADE (m)", optional=True, help=_TURNING),
    *_paper("all", "all targets"),
    *_paper("paper_ids", "targets with an identity switch of stp, the paper's subset,"),
    *_paper("paper_frag", "targets with a fragmentation of stp, the paper's subset,"),
    _of("same_gap", "gap to GT tracks closed", lambda e: e.same_predictor_gap("all"), unit="share", better="higher",
        help=_SAME_GAP),
    _of("association_gap", "association gap closed", lambda e: e.standing.association_gaps.get("all"), unit="share",
        better="higher", help=_ASSOCIATION),
    _of_row(_ROW["coverage"], heading="covered", help="Share of the targets that have a forecast."),
    _of("ms", "ms", lambda e: e.record.measured.ms_per_frame, unit="ms", better="lower", format=".1f", help=_MS),
    _of("weights", "weights", lambda e: e.weights, help=_WEIGHTS),
    _of("gap", "gap closed", lambda e: e.standing.gaps.get("all"), unit="share", better="higher", help=_GAP),
    _of("hypotheses", "H", lambda e: e.record.hypotheses, help="Hypotheses of the tracker."),
    _of("samples", "K", lambda e: e.record.samples, help="Samples per object."),
    _of("p50", "p50", lambda e: e.record.measured.latency.p50_ms, unit="ms", better="lower", format=".1f",
        help="Median time of one frame, milliseconds."),
    _of("p95", "p95", lambda e: e.record.measured.latency.p95_ms, unit="ms", better="lower", format=".1f", help=_P95),
    _of("memory", "memory", lambda e: e.record.measured.peak_memory_mib, unit="MiB", better="lower", format=".0f",
        help="Peak memory of the agent's process."),
)  # fmt: skip
COLUMN = {column.key: column for column in _NUMBERS}
_FIRST = (
    _text("definitions", lambda e: e.record.scorer.definitions),
    _text("place", lambda e: e.place),
    Column(key="rank_range", interval=True, format="d", read=lambda e: e.standing.places["all"].span),
    _text("submission", lambda e: e.name),
    _text("not_ranked_because", lambda e: e.why or None),
    _text("trained_on_scored", lambda e: e.trained_on_scored or None),
    _text("added", lambda e: e.added),
)
_LAST = (
    Column(key="p", format=".3f", read=_of_difference("p")),
    _text("gap_blank_because", lambda e: None if e.standing.gaps.get("all") is not None else e.standing.gap_blank),
    _text("association_gap_blank_because", lambda e: e.association_blank("all")),
    _text("status", lambda e: e.record.status),
    _text("digest", lambda e: e.record.digest),
    _text("level", lambda e: e.level),
    _text("checked", lambda e: e.checked or None),
    _text("made", lambda e: e.record.measured.made),
)


def further_columns(entries: Collection[Entry]) -> list[Column]:
    """Further numbers of rows: the optional columns of the scorer."""
    kind = type(next(iter(entries)).row) if entries else Row
    return [column for column in columns_of(kind) if column.optional]


def page_columns(entries: Collection[Entry]) -> list[Column]:
    """The columns of a table of the page: those in which an entry has a number."""
    return [COLUMN[key] for key in PAGE if any(COLUMN[key].value(entry) is not None for entry in entries)]


def data_table(entries: Sequence[Entry], name: str) -> Table:
    """Every number of the entries, rounded as records are, for CSV, JSON and other programs.

    A further number that no entry has is left out: records are older than a new metric.
    """
    env = _text("env", lambda e: e.env)
    columns = [env, *_FIRST, *_NUMBERS, *map(_of_row, further_columns(entries)), *_LAST]
    columns = [c for c in columns if not c.optional or any(c.value(entry) is not None for entry in entries)]
    return Table(name, "Leaderboard", "", entries, [replace(c, read=_rounded(c)) for c in columns])


def _rounded(column: Column) -> Callable[[Entry], Value]:
    return lambda entry: rounded(column.value(entry))


def board_json(entries: Sequence[Entry]) -> dict[str, list[dict[str, Value]]]:
    """The content of ``board --json``: a list of rows per environment, None where a value is missing."""
    boards: dict[str, list[dict[str, Value]]] = {}
    for record in data_table(entries, "board").records:
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

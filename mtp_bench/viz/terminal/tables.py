"""Reports as tables of at most 80 columns: the one that a comparison shows, and all others for who wants more."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from textwrap import wrap
from typing import TYPE_CHECKING

from ...running.sensitivity import AtCut
from ...scoring import Report
from ...scoring.definitions import RANKED_SUBSETS
from ...scoring.rank import NOT_CAUSAL
from ...scoring.rows import Details, Interval, PairedRow, Row
from ...scoring.subsets import SUBSETS, Subset
from ...scoring.weights import EVENTS
from .output import NOTHING, counted, number, short, slim_table
from .paper import PAPER_SUBSETS, paper_figures, shipped_env
from .verdict import SAW_TRUTH

if TYPE_CHECKING:
    from rich.table import Table

_EVENTS: tuple[Subset, ...] = ("ids", "reacquired", "lost", "frag")  # the first two may rank
_POINTS = 9  # of a curve that are shown


def main_table(report: Report) -> Table:
    """What an agent's forecasts are worth as in the paper, and by the number that ranks."""
    headings = (
        "agent", "H", "minADE/FDE\nall", "\nIDS", "\nFRAG", "\ncov.", "error\nall", "\n#", "error\nids", "\n#"
    )  # fmt: skip
    env = shipped_env(report)
    table = slim_table(f"{report.env}{'' if env else ', changed'}: m, less is better", headings)
    blocks = list(_by_setting(report))
    for rows in [block for block in blocks if block["all"].budget == "equal"] or blocks:
        first, paper = rows["all"], paper_figures(env, rows["all"])
        cells = []
        for subset, name in PAPER_SUBSETS.items():
            theirs = f"\n[dim]{short(paper[name][0])}/{short(paper[name][1])}[/dim]" if name in paper else ""
            cells.append(f"{short(rows[subset].minADE)}/{short(rows[subset].minFDE)}{theirs}")
        ranked = [cell for row in (first, rows["ids"]) for cell in (short(row.error), _count(row.rank))]
        table.add_row(_agent(first), str(first.hypotheses), *cells, _percent(first.coverage), *ranked)
    return table


def notes(report: Report) -> list[str]:
    """What the columns of the main table mean, and how many targets they are of."""
    allowed = "averaged over how many false forecasts are allowed, up to one per target or as many as STP makes"
    if report.condition.get("truth", "complete") != "complete":
        allowed = "averaged over budgets of forecasts per live frame"
    silence = next((detail.silence for detail in report.details), None)
    said = "" if silence is None else f" Saying nothing: {short(silence)}."
    env = shipped_env(report)
    paper = " Below ours, dim: the paper's." if any(paper_figures(env, row) for row in report.rows) else ""
    about = (
        f"minADE/FDE: of the targets with a forecast (cov.); IDS, FRAG: where plain STP has that event.{paper} error: "
        f"{allowed}; on ids as many as STP makes.{said} #: rank, {NOTHING} shown only. "
        f"Definitions {report.definitions}."
    )
    rows = next(iter(_by_setting(report)), {})
    lines = [about]
    names: dict[Subset, str] = {"all": "all", "paper_ids": "IDS", "paper_frag": "FRAG", "ids": "ids"}
    for subset, name in names.items() if rows else ():
        row = rows[subset]
        few = "" if subset != "ids" else f" ({row.effective_targets:.1f} and {row.effective_objects:.1f} effective)"
        on = f"{counted(row.targets, 'target')} on {counted(row.objects, 'object')}{few}"
        lines.append(f"{name}: {on} in {counted(row.scenes, 'scene')}")
    honest = [row for row in report.rows if row.subset == "all" and row.unranked_because != SAW_TRUTH]
    seen = [detail for detail in report.details if detail.agent in {row.agent for row in honest}]
    blind = not any(row.coverage for row in honest) and any(detail.forecasts_per_frame for detail in seen)
    if rows and not rows["all"].targets:
        lines.append("! nothing is measured: no object that may be a target is there for all past and future frames")
    elif rows and blind:
        lines.append("! no forecast is near a target: are detections and truth in one frame of reference, in metres?")
    unfair = dict.fromkeys(row.agent for row in report.rows if row.unranked_because == NOT_CAUSAL)
    lines += [f"{agent}: never ranked, {NOT_CAUSAL}" for agent in unfair]
    if dropped := max((detail.dropped_detections for detail in seen), default=0):
        lines.append(
            f"! {counted(dropped, 'detection')} not shown to agents: beyond the range or the number of the task"
        )
    for detail in report.details:
        if detail.guessed_parents:
            share = _percent(detail.guessed_parents)
            lines.append(
                f"* {detail.agent} states no parents: the lineage of own events is guessed in {share} of frames"
            )
        if rejected := sum(detail.invalid.values()):
            lines.append(rejected_line(detail.agent, rejected))
    return lines


def rejected_line(agent: str, rejected: int) -> str:
    """That so many rows of an agent's answers broke the contract."""
    return f"! {agent}: {counted(rejected, 'row')} rejected; `mtp-bench check` says what is wrong"


def full_tables(report: Report) -> Iterator[Table]:
    """Everything else."""
    yield _subset_table(report)
    yield _event_errors(report)
    yield _displacements(report)
    if report.paired:
        yield _paired_table(report)
    yield _grid(report, "What the error is made of (all targets, m)", _PARTS)
    yield _grid(report, "Other numbers (all targets; forecasts and false ones per live frame)", _OTHERS)
    yield _grid(report, "Tracking of the first seed", _TRACKING)
    if any(detail.reliability for detail in report.details):
        yield _reliability_table(report)
    if any(detail.curve for detail in report.details):
        yield _curve_table(report)
    yield from _bin_tables(report)


def sensitivity_table(cuts: Sequence[AtCut]) -> Table:
    """What the score cut of the input decides."""
    headings = ("cut", "switches\nof stp", "\non targets", "ids\nstp", "\nmtp", "all\nstp", "\nmtp")
    table = slim_table(
        "Detections above a score: errors (m), and mtp less its control (below: 95 %)",
        (*headings, "ids: less\nstp_same_budget", "all: less\nstp_same_budget"),
    )
    for at in cuts:
        errors = [short(errors.get(agent)) for errors in (at.ids, at.all) for agent in ("stp", "mtp")]
        less = [f"{_signed(at.beyond_control.get(s))}\n{_between(at.interval.get(s))}" for s in ("ids", "all")]
        table.add_row(f"{at.cut:g}", str(at.switches), str(at.switches_on_targets), *errors, *less)
    return table


def _subset_table(report: Report) -> Table:
    """How much is in each subset."""
    headings = ("subset", "events", "targets", "effective", "objects", "effective", "scenes", "units")
    table = slim_table("Subsets (units: effective number of blocks of at most 20 s)", headings)
    for row in next(iter(_by_setting(report)), {}).values():
        targets = str(row.targets), number(row.effective_targets, 1)
        objects = str(row.objects), number(row.effective_objects, 1)
        table.add_row(
            row.subset, number(row.events, 1), *targets, *objects, str(row.scenes), number(row.effective_units, 1)
        )
    return table


def _event_errors(report: Report) -> Table:
    """What ranks on all targets and on events, with intervals and ranks."""
    shown: tuple[Subset, ...] = ("all", *_EVENTS)
    table = slim_table("Error on events (m, # rank; below: 95 % interval)", ("agent", "H", "K", *shown))
    for rows in _by_setting(report):
        cells = []
        for row in (rows[subset] for subset in shown):
            rank = "" if row.rank is None else f" #{row.rank}"
            low, high = row.interval or (0.0, 0.0)
            cells.append(f"{short(row.error)}{rank}" + (f"\n{low:.3g} {high:.3g}" if row.interval else ""))
        table.add_row(*_name(rows["all"]), *cells)
    return table


def _displacements(report: Report) -> Table:
    table = slim_table("minADE/minFDE on events (m, of targets with a forecast)", ("agent", "H", "K", *_EVENTS))
    for rows in _by_setting(report):
        pairs = (f"{short(rows[subset].minADE)}/{short(rows[subset].minFDE)}" for subset in _EVENTS)
        table.add_row(*_name(rows["all"]), *pairs)
    return table


def _paired_table(report: Report) -> Table:
    """Differences to the controls."""
    headings = ("agent", "H", "less", "subset", "error", "interval", "p", "minADE")
    table = slim_table("Differences to the controls (m)", headings, left=("less", "subset"))
    shown = ("all", *RANKED_SUBSETS)
    known = [row for row in report.paired if row.error is not None and row.subset in shown]
    for row in sorted(known, key=lambda row: (row.other, SUBSETS.index(row.subset))):
        numbers = _signed(row.error), _between(row.interval), number(row.p), _signed(row.minADE)
        table.add_row(_agent(row), str(row.hypotheses), row.other, row.subset, *numbers)
    return table


def _signed(value: float | None) -> str:
    return NOTHING if value is None else f"{value:+.3f}"


def _between(interval: Interval | None) -> str:
    return NOTHING if interval is None else f"{interval[0]:+.3f} {interval[1]:+.3f}"


Cell = Callable[[Row, Details], str]
_PARTS: dict[str, Cell] = {
    "error": lambda row, _: short(row.error),
    "locali-\nsation": lambda row, _: short(row.localisation),
    "\nmissed": lambda row, _: short(row.missed),
    "plain\nerror": lambda row, _: short(row.plain_error),
    "fixed\nerror": lambda row, _: short(row.fixed_error),
    "by\nscore": lambda row, _: short(row.error_by_score),
    "energy\nscore": lambda row, _: short(row.energy_score),
}
_OTHERS: dict[str, Cell] = {
    "Brier": lambda _, detail: short(detail.brier),
    "EPA": lambda _, detail: short(detail.EPA),
    "AP_f": lambda _, detail: short(detail.AP_f),
    "MR": lambda _, detail: short(detail.miss_rate),
    "PI-ADE": lambda _, detail: short(detail.PI_ADE),
    "fore-\ncasts": lambda _, detail: f"{detail.forecasts_per_frame:.1f}",
    "\nfalse": lambda _, detail: number(detail.false_per_frame, 1),
    "ms per\nframe": lambda row, _: number(row.ms_per_frame, 1),
}
_TRACKING: dict[str, Cell] = {
    "MOTA": lambda _, detail: short(detail.tracking.all.MOTA),
    "IDF1": lambda _, detail: short(detail.tracking.all.IDF1),
    "HOTA": lambda _, detail: short(detail.tracking.all.HOTA),
    "CLEAR\nIDS": lambda _, detail: str(detail.tracking.all.IDS),
    "\nFRAG": lambda _, detail: str(detail.tracking.all.FRAG),
    "false\ntracks": lambda _, detail: _count(detail.tracking.false_tracks),
    "own ids/\nlost/reac.": lambda _, detail: _own_events(detail),
    "ids in\nall H": lambda _, detail: str(detail.own["all_h_ids"].targets),
}


def _own_events(detail: Details) -> str:
    """Own switches, losses and re-acquisitions; a star where the lineage of hypotheses was guessed, see `notes`."""
    return "/".join(str(detail.own_events[kind]) for kind in EVENTS) + ("*" if detail.guessed_parents else "")


def _grid(report: Report, title: str, columns: dict[str, Cell]) -> Table:
    """A row per setting."""
    table = slim_table(title, ("agent", "H", "K", *columns))
    for rows, detail in zip(_by_setting(report), report.details, strict=True):
        table.add_row(*_name(detail), *(cell(rows["all"], detail) for cell in columns.values()))
    return table


def _reliability_table(report: Report) -> Table:
    ranges = [f"{i / 10:g}-" for i in range(10)]
    table = slim_table("Share of forecasts that are of a true object, by confidence", ("agent", "H", *ranges))
    for detail in _details(report):
        share = {min(int(10 * part.confidence), 9): f"{part.matched:.2f}" for part in detail.reliability}
        table.add_row(*_name(detail)[:2], *(share.get(i, NOTHING) for i in range(10)))
    return table


def _curve_table(report: Report) -> Table:
    """The error over all targets at some budgets."""
    curve = next(detail.curve for detail in report.details if detail.curve)
    places = sorted({round(i * (len(curve) - 1) / (_POINTS - 1)) for i in range(_POINTS)})
    complete = report.condition.get("truth", "complete") == "complete"
    what = "false forecasts per target" if complete else "forecasts per live frame"
    table = slim_table(f"Error (m) by {what}", ("agent", "H", *(f"{curve[i][0]:.3g}" for i in places)))
    for detail in _details(report):
        table.add_row(*_name(detail)[:2], *(short(detail.curve[i][1]) for i in places))
    return table


def _bin_tables(report: Report) -> Iterator[Table]:
    """The error by distance, class and motion."""
    for by in ("distance", "class", "motion"):
        found = [[b for b in detail.bins if b.by == by] for detail in _details(report)]
        if found and found[0]:
            names = ["\n".join([*wrap(b.bin.replace("_", " "), 8), str(b.errors.targets)]) for b in found[0]]
            table = slim_table(f"Error (m) by {by}, targets", ("agent", "H", *names))
            for detail, bins in zip(_details(report), found, strict=True):
                table.add_row(*_name(detail)[:2], *(short(part.errors.error) for part in bins))
            yield table


def _details(report: Report) -> list[Details]:
    """Those with the task's number of samples; all of them where there is none."""
    return [detail for detail in report.details if detail.budget == "equal"] or report.details


def _by_setting(report: Report) -> Iterable[dict[Subset, Row]]:
    """The rows of one agent and setting after the other, by subset."""
    for i in range(0, len(report.rows), len(SUBSETS)):
        yield {row.subset: row for row in report.rows[i : i + len(SUBSETS)]}


def _name(row: Row | Details) -> Sequence[str]:
    return _agent(row), str(row.hypotheses), str(row.samples)


def _agent(row: Row | Details | PairedRow) -> str:
    from rich.markup import escape

    return escape(row.agent)


def _count(value: int | None) -> str:
    return NOTHING if value is None else str(value)


def _percent(share: float | None) -> str:
    return NOTHING if share is None else f"{100 * share:.0f}%"

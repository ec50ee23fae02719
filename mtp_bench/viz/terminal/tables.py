"""Reports as tables for the terminal."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...scoring import SUBSETS, Report
from ...scoring.definitions import MOST_FORECASTS
from ...scoring.rank import enough_objects
from ...scoring.rows import Details, RankRow, Row
from .output import NOTHING, counted, new_table, number

if TYPE_CHECKING:
    from rich.table import Table

NOT_MEASURABLE = "not measurable"
_SETTING = ("agent", "H", "K")
_PARTS = ("localisation", "missed", "false", "forecasts/frame", "false/frame", "EPA", "MOTA")
_OWN = ("own ids", "own lost", "ids in all H")


def error_table(report: Report, title: str) -> Table:
    """Missing-aware error per agent and subset with its 95 % interval, coverage, rank and time: what is ranked."""
    from rich.markup import escape

    headings = (*_SETTING, *SUBSETS, "gap closed ids / frag", "covered", "rank", "ms/frame")
    table = new_table(escape(title), headings, left=("agent",), whole=("agent",), caption=_caption(report))
    ranks = {_key(rank): rank.rank for rank in report.ranks if rank.subset == "all"}
    for rows in _by_agent(report.rows):
        first = rows["all"]
        rank = ranks.get(_key(first)) if first.budget == "equal" else None
        table.add_row(
            *_name(first),
            *(_with_interval(rows[subset]) for subset in SUBSETS),
            f"{number(rows['ids'].gap_closed, 2)} / {number(rows['frag'].gap_closed, 2)}",
            NOTHING if first.coverage is None else f"{100 * first.coverage:.1f} %",
            NOTHING if rank is None else str(rank),
            number(first.ms_per_frame, 1),
        )
    return table


def displacement_table(report: Report) -> Table:
    """Table of minADE / minFDE of the covered targets per agent and subset, with the paper's figures below them."""
    headings = (*_SETTING, *SUBSETS)
    table = new_table("minADE / minFDE (m) on covered targets", headings, left=("agent",), whole=headings)
    if report.env in _paper()["dataset"]:
        table.caption = (
            "[dim]Below ours: the figures of the paper[/dim], its FRAG beside lost and frag. Its predictor and its "
            "detections differ: compare relations."
        )
    for rows in _by_agent(report.rows):
        paper = paper_figures(report.env, rows["all"])
        cells = []
        for subset in SUBSETS:
            ours = f"{number(rows[subset].minADE)} / {number(rows[subset].minFDE)}"
            theirs = paper.get("frag" if subset == "lost" else subset)
            cells.append(ours + (f"\n[dim]{theirs[0]:.3f} / {theirs[1]:.3f}[/dim]" if theirs else ""))
        table.add_row(*_name(rows["all"]), *cells)
    return table


def parts_table(report: Report) -> Table:
    """How the missing-aware error of all targets adds up, and tracking figures of each agent."""
    title = "What the error is made of (all targets) and the agent's own tracking"
    headings = (*_SETTING, *_PARTS, *_OWN)
    table = new_table(title, headings, left=("agent",), whole=("agent",), caption=_parts_caption(report))
    unknown = NOTHING if measurable(report) else NOT_MEASURABLE
    for detail in report.details:
        table.add_row(
            *_name(detail),
            number(detail.parts.localisation),
            number(detail.parts.missed),
            number(detail.parts.false, absent=unknown),
            number(detail.forecasts_per_frame, 1),
            number(detail.spurious_per_frame, 2, unknown),
            number(detail.EPA, 2, unknown),
            number(detail.tracking.all.MOTA, 2, unknown),
            str(detail.own_events["ids"]),
            str(detail.own_events["lost"]),
            str(detail.own["all_h_ids"].targets),
        )
    return table


def _parts_caption(report: Report) -> str:
    if not measurable(report):
        return (
            "localisation + missed = missing-aware error. Objects outside the truth exist, so an unmatched forecast or "
            f"track is not called false: {NOT_MEASURABLE}.\nWhoever forecasts more than {MOST_FORECASTS:g} times the "
            "objects of stp is not ranked: repeating old forecasts costs nothing here."
        )
    return (
        "localisation + missed + false = missing-aware error. Every track is a forecast unless the agent withholds it: "
        "a detector's false positives are paid for here."
    )


def paper_figures(env_id: str, row: Row) -> dict[str, list[float]]:
    """The paper's [minADE, minFDE] per subset for the env and setting of ``row``; empty where it has none."""
    paper = _paper()
    figures: Any = paper.get(paper["dataset"].get(env_id, ""), {}).get(row.agent, {})
    if row.agent == "mtp":
        figures = figures.get(row.budget, {}).get(str(row.hypotheses), {})
    return dict(figures)


@cache
def _paper() -> dict[str, Any]:
    return tomllib.loads(Path(__file__).with_name("paper.toml").read_text(encoding="utf-8"))


def subset_line(report: Report) -> str:
    """Events, targets and objects of each subset, in words."""
    rows = {row.subset: row for row in report.rows[: len(SUBSETS)]}
    parts = [f"all: {targets_on_objects(rows['all'])}"]
    for subset in SUBSETS[1:]:
        row = rows[subset]
        few = "" if enough_objects(row.objects) else ", not ranked"
        where = f"{targets_on_objects(row)} in {counted(row.scenes, 'scene')}"
        parts.append(f"{subset}: {counted(row.events, 'event')}, {where}{few}")
    return "\n".join(parts)


def targets_on_objects(row: Row) -> str:
    """Targets and objects of a row, in words."""
    return f"{counted(row.targets, 'target')} on {counted(row.objects, 'object')}"


def measurable(report: Report) -> bool:
    """Whether false positives are known to be false: the truth is complete."""
    return report.condition.get("truth", "complete") == "complete"


def _caption(report: Report) -> str:
    false = (
        "'all' pays c/2 for every false forecast."
        if measurable(report)
        else "The truth holds prediction targets only, so nobody pays for false forecasts."
    )
    return (
        f"Missing-aware error in metres (lower is better) with 95 % bootstrap intervals over scenes. {false}\n"
        "H hypotheses, K samples per object; rows whose K is not the task's k are never ranked. "
        f"Definitions {report.definitions}.\n{subset_line(report)}"
    )


def _by_agent(rows: Sequence[Row]) -> Iterable[dict[str, Row]]:
    """The rows of one agent and setting after the other, by subset."""
    for i in range(0, len(rows), len(SUBSETS)):
        yield {row.subset: row for row in rows[i : i + len(SUBSETS)]}


def _key(row: Row | RankRow) -> tuple[str, int, int]:
    return row.agent, row.hypotheses, row.samples


def _name(row: Row | Details) -> tuple[str, str, str]:
    free = "" if row.budget == "equal" else " (all samples)"
    return f"{row.agent}{free}", str(row.hypotheses), str(row.samples)


def _with_interval(row: Row) -> str:
    value = number(row.missing_aware)
    return value if row.interval is None else f"{value}\n[dim]{row.interval[0]:.2f}–{row.interval[1]:.2f}[/dim]"

"""What figures say in the same words: n, and the colours of agents."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ...viz.terminal.output import counted
from ..findings import Findings
from ..plan import HEDGED, SAME_BUDGET
from .style import SERIES


def n_of(found: Findings, seeds: int | None = None) -> str:
    """Targets, objects, scenes and seeds in all; ``seeds``: where they are not those of what ranks."""
    row = found.row(found.subject.single, "all")
    runs = row.seeds if seeds is None else seeds
    parts = ((row.targets, "target"), (row.objects, "object"), (row.scenes, "scene"), (runs, "seed"))
    return ", ".join(counted(*part) for part in parts)


def colors_of(found: Findings) -> dict[str, str]:
    """Label of every agent -> name of its colour, the same in all figures."""
    first = found.subject
    known = {first.truth.label: "green", first.single.label: "blue", SAME_BUDGET: "orange", HEDGED: "purple"}
    if first.most.label not in known:
        known[first.most.label] = "vermillion"
    rest = [name for name in SERIES if name not in known.values()]
    others = [s.label for subject in found.plan.subjects[1:] for s in (subject.most, subject.single, subject.truth)]
    others += [subject.end.label for subject in found.plan.subjects]
    for label in dict.fromkeys(others):
        if label not in known:
            known[label] = rest.pop(0) if rest else "grey"
    return known


def where(rows: Iterable[Any], **fields: Any) -> list[Any]:
    """The rows whose fields have these values."""
    return [row for row in rows if all(getattr(row, name) == value for name, value in fields.items())]


def pick(rows: Iterable[Any], name: str) -> list[Any]:
    """A column."""
    return [getattr(row, name) for row in rows]


def agents(rows: Iterable[Any]) -> list[tuple[str, int]]:
    """Agents with their number of hypotheses, each once, in the order of the rows."""
    return list(dict.fromkeys((row.agent, row.H) for row in rows))


def called(agent: str, hypotheses: int) -> str:
    """What a legend calls an agent."""
    return f"{agent}, H = {hypotheses}" if hypotheses > 1 else agent

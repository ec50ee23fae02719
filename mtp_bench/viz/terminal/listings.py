"""Listings of environments and data for the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ...cards import Card
from ...sources import DataStatus
from .output import new_table

if TYPE_CHECKING:
    from rich.console import Group, RenderableType
    from rich.table import Table

WORDS = 28  # columns of text of a sentence, at least
FEW = 3  # classes that a cell names; `envs --json` names all


def env_table(cards: Sequence[Card]) -> Table:
    """One row per environment."""
    headings = ("id", "rate", "past / future", "k", "classes", "what")
    table = new_table("Environments", headings, left=headings, whole=("id", "past / future"))
    table.columns[-1].min_width = WORDS
    for card in cards:
        task = card.task
        classes = ", ".join(task.classes) if len(task.classes) <= FEW else str(len(task.classes))
        past_and_future = f"{task.past} / {task.future}"
        table.add_row(card.id, f"{task.rate:g} Hz", past_and_future, str(task.samples), classes, card.summary)
    return table


def data_report(statuses: Mapping[str, DataStatus]) -> Group:
    """A row per environment; then, per dataset, its folder, missing and wrong files, notes, licence and citation."""
    from rich.console import Group
    from rich.padding import Padding
    from rich.text import Text

    datasets: dict[str, dict[str, DataStatus]] = {}
    for env_id, status in statuses.items():
        datasets.setdefault(status.about.name, {})[env_id] = status
    parts: list[RenderableType] = [_status_table(statuses)]
    for name, members in datasets.items():
        parts.append(Text(f"\n{name}", style="bold"))
        parts += [Text(f"  {line}", no_wrap=True, overflow="ignore") for line in _lines(members)]  # a path stays whole
        parts += [Padding(Text(line), (0, 0, 0, 2)) for line in _about(members)]
    return Group(*parts)


def status_json(status: DataStatus) -> dict[str, Any]:
    """State of one environment's data for ``data --json``."""
    return {
        "dataset": status.about.name,
        "root": None if status.root is None else str(status.root),
        "searched": [str(path) for path in status.searched],
        "usable": status.usable,
        "verified": status.verified,
        "missing": status.missing,
        "problems": status.problems,
        "notes": status.notes,
        "checks": [{"what": check.what, "found": check.found, "known": check.expected} for check in status.checks],
    }


def _status_table(statuses: Mapping[str, DataStatus]) -> Table:
    headings = ("environment", "dataset", "state")
    table = new_table("Data", headings, left=headings, whole=("environment",))
    for env_id, status in statuses.items():
        table.add_row(env_id, status.about.name, _state(status))
    return table


def _lines(statuses: Mapping[str, DataStatus]) -> list[str]:
    """Findings about a dataset, each once; a line that does not hold for all of its environments names those."""
    envs: dict[str, list[str]] = {}
    for env_id, status in statuses.items():
        for line in _found(status):
            envs.setdefault(line, []).append(env_id)
    return [line if len(ids) == len(statuses) else f"{', '.join(ids)}: {line}" for line, ids in envs.items()]


def _found(status: DataStatus) -> list[str]:
    where = f"in {status.root}" if status.root else f"missing; looked in {', '.join(map(str, status.searched))}"
    counts = [f"{check.found} of {check.expected} {check.what}" for check in status.checks]
    return [
        where,
        *(f"missing: {line}" for line in status.missing),
        *(f"wrong: {line}" for line in status.problems),
        *(f"found: {', '.join(counts[i : i + 4])}" for i in range(0, len(counts), 4)),
        *status.notes,
    ]


def _state(status: DataStatus) -> str:
    if status.about.generated:
        return "[green]generated[/green]" if status.verified else "[green]made when used[/green]"
    if status.verified:
        return "[green]complete[/green]"
    if status.usable:
        return "[yellow]usable, counts differ[/yellow]"
    return "[red]missing[/red]" if status.root is None else "[red]incomplete[/red]"


def _about(statuses: Mapping[str, DataStatus]) -> list[str]:
    about = next(iter(statuses.values())).about
    lines = [f"licence: {about.licence}", f"please cite: {about.citation}"]
    if not all(status.usable for status in statuses.values()):
        lines += [f"how to get it: {about.how_to_get}", "expected layout:", *about.layout.splitlines()]
    return lines

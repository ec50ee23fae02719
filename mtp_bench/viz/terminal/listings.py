"""Listings of environments and data for the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ...cards import Card
from ...sources import DataStatus
from .output import new_table

if TYPE_CHECKING:
    from rich.console import Group
    from rich.table import Table


def env_table(cards: Sequence[Card]) -> Table:
    """One row per environment."""
    headings = ("id", "rate", "past / future", "k", "classes", "what")
    table = new_table("Environments", headings, left=headings, whole=("id",))
    for card in cards:
        task = card.task
        table.add_row(
            card.id,
            f"{task.rate:g} Hz",
            f"{task.past} / {task.future}",
            str(task.samples),
            ", ".join(task.classes),
            card.summary,
        )
    return table


def data_report(statuses: Mapping[str, DataStatus]) -> Group:
    """What each environment needs of its dataset: found, missing, checked; how to get it, licence and citation."""
    from rich.console import Group
    from rich.text import Text

    parts: list[Table | Text] = [_status_table(statuses)]
    shown: set[str] = set()
    for status in statuses.values():
        for line in (*status.missing, *status.problems, *status.notes):
            if line not in shown:
                shown.add(line)
                parts.append(Text(f"  {line}", no_wrap=True, overflow="ignore"))  # a path stays whole
        if status.about.name not in shown:
            shown.add(status.about.name)
            parts.append(Text(_about(status)))
    return Group(*parts)


def status_json(status: DataStatus) -> dict[str, Any]:
    """What was found of one environment's data, as a record that can be written as JSON."""
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
    from rich.markup import escape

    headings = ("environment", "dataset", "state", "root", "counts (found / known)")
    table = new_table("Data", headings, left=headings, whole=("environment",))
    shown: dict[str, str] = {}  # counts, and the environment beside which they stand
    for env_id, status in statuses.items():
        checks = "\n".join(
            f"{'' if check.ok else '[red]'}{check.what}: {check.found} / {check.expected}" for check in status.checks
        )
        beside = shown.setdefault(f"{status.root} {checks}", env_id)
        if checks and beside != env_id:
            checks = f"as {beside}"
        root = str(status.root) if status.root else "looked in " + ", ".join(map(str, status.searched))
        table.add_row(env_id, status.about.name, _state(status), escape(root), checks)
    return table


def _state(status: DataStatus) -> str:
    if status.about.generated:
        return "[green]generated[/green]" if status.verified else "[green]made when used[/green]"
    if status.verified:
        return "[green]complete[/green]"
    if status.usable:
        return "[yellow]usable, counts differ[/yellow]"
    return "[red]not found[/red]" if status.root is None else "[red]incomplete[/red]"


def _about(status: DataStatus) -> str:
    about = status.about
    missing = "" if status.usable else f"\nExpected layout:\n{about.layout}\n\nHow to get it: {about.how_to_get}"
    return f"\n{about.name}\nLicence: {about.licence}\nPlease cite: {about.citation}{missing}"

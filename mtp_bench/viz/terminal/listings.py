"""Listings of environments and data for the terminal."""

from collections.abc import Mapping, Sequence
from typing import Any

from ...cards import Card
from ...core import Column, Table
from ...sources import DataStatus

FEW = 3  # classes that a cell names; `envs --json` names all


def env_table(cards: Sequence[Card]) -> Table:
    """One row per environment."""
    columns = (
        Column(key="id"),
        Column(key="rate", read=lambda card: f"{card.task.rate:g} Hz"),
        Column(
            "past / future",
            key="frames",
            read=lambda card: f"{card.task.past} / {card.task.future}",
        ),
        Column("k", key="samples", read=lambda card: card.task.samples),
        Column(key="classes", read=_classes),
        Column(
            "what",
            key="summary",
            read=lambda card: "Closed loop. " * (card.drive is not None) + card.summary,
        ),
    )
    return Table("envs", "Environments", "", cards, columns)


def _classes(card: Card) -> str:
    names = card.task.classes
    return ", ".join(names) if len(names) <= FEW else str(len(names))


def status_table(statuses: Mapping[str, DataStatus]) -> Table:
    """State of the data of each environment."""
    rows = [
        {"env": env_id, "dataset": each.about.name, "state": _state(each)}
        for env_id, each in statuses.items()
    ]
    columns = (
        Column("environment", key="env"),
        Column(key="dataset"),
        Column(key="state"),
    )
    return Table("data", "Data", "", rows, columns)


def _state(status: DataStatus) -> str:
    if status.about.generated:
        return "made when used"
    return (
        "complete"
        if status.usable
        else "missing"
        if status.root is None
        else "incomplete"
    )


def data_lines(statuses: Mapping[str, DataStatus]) -> list[str]:
    """Per dataset: its folder, missing and wrong files, notes, licence, citation, and how to get it."""
    datasets: dict[str, dict[str, DataStatus]] = {}
    for env_id, status in statuses.items():
        datasets.setdefault(status.about.name, {})[env_id] = status
    return [
        line
        for name, members in datasets.items()
        for line in (
            "",
            name,
            *(f"  {text}" for text in (*_findings(members), *_about(members))),
        )
    ]


def status_json(status: DataStatus) -> dict[str, Any]:
    """State of one environment's data for ``data --json``."""
    root, searched = (
        None if status.root is None else str(status.root),
        [str(path) for path in status.searched],
    )
    found = {
        name: getattr(status, name)
        for name in ("usable", "missing", "problems", "notes")
    }
    return {
        "dataset": status.about.name,
        "root": root,
        "searched": searched,
        **found,
        "counts": dict(status.counts),
    }


def _findings(statuses: Mapping[str, DataStatus]) -> list[str]:
    """Findings about a dataset, each once; a line that does not hold for all of its environments names those."""
    envs: dict[str, list[str]] = {}
    for env_id, status in statuses.items():
        for line in _found(status):
            envs.setdefault(line, []).append(env_id)
    return [
        line if len(ids) == len(statuses) else f"{', '.join(ids)}: {line}"
        for line, ids in envs.items()
    ]


def _found(status: DataStatus) -> list[str]:
    where = (
        f"in {status.root}"
        if status.root
        else f"missing; looked in {', '.join(map(str, status.searched))}"
    )
    counts = ", ".join(f"{number} {what}" for what, number in status.counts.items())
    return [
        where,
        *(f"missing: {line}" for line in status.missing),
        *(f"wrong: {line}" for line in status.problems),
        *([f"found: {counts}"] if counts else []),
        *status.notes,
    ]


def _about(statuses: Mapping[str, DataStatus]) -> list[str]:
    about = next(iter(statuses.values())).about
    lines = [f"licence: {about.licence}", f"please cite: {about.citation}"]
    if not all(status.usable for status in statuses.values()):
        lines += [
            f"how to get it: {about.how_to_get}",
            "expected layout:",
            *about.layout.splitlines(),
        ]
    return lines

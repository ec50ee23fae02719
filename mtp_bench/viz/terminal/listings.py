"""Listings of environments and data for the terminal."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

from ...cards import Card
from ...core import Column, Table
from ...sources import DataStatus, package_of

MAX_NAMED_CLASSES = 3  # of a cell; `envs --json` names all


def env_table(cards: Sequence[Card]) -> Table:
    """Return one row per environment."""
    columns = (
        Column(key="id"),
        Column(key="rate", read=lambda card: f"{card.task.rate:g} Hz"),
        Column("past / future", key="frames", read=_frames),
        Column("k", key="samples", read=lambda card: card.task.samples),
        Column(key="classes", read=_classes),
        Column("what", key="summary", read=_summary),
    )
    return Table("envs", "Environments", "", cards, columns)


def _frames(card: Card) -> str:
    return f"{card.task.past} / {card.task.future}"


def _classes(card: Card) -> str:
    classes = card.task.classes
    if len(classes) > MAX_NAMED_CLASSES:
        return str(len(classes))
    return ", ".join(classes)


def _summary(card: Card) -> str:
    if fault := package_of(card).dataset.known_fault:
        return f"{card.summary}. {fault}"
    return card.summary if card.drive is None else f"Closed loop. {card.summary}"


def status_table(statuses: Mapping[str, DataStatus]) -> Table:
    """Return the state of the data, with a row per dataset and state."""
    env_ids: dict[tuple[str, str], list[str]] = defaultdict(list)
    for env_id, status in statuses.items():
        short_id = env_id.removeprefix("MTP-").removesuffix("-v0")
        env_ids[status.about.name, _state(status)].append(short_id)
    rows = [
        {"dataset": name, "state": state, "envs": ", ".join(ids)}
        for (name, state), ids in env_ids.items()
    ]
    columns = (
        Column(key="dataset"),
        Column(key="state"),
        Column("environments", key="envs"),
    )
    return Table("data", "Data", "", rows, columns)


def _state(status: DataStatus) -> str:
    if status.about.generated:
        return "made when used"
    if status.usable:
        return "complete"
    return "missing" if status.root is None else "incomplete"


def status_json(status: DataStatus) -> dict[str, Any]:
    """Return the state of one environment's data for ``data --json``."""
    return {
        "dataset": status.about.name,
        "root": None if status.root is None else str(status.root),
        "searched": [str(path) for path in status.searched],
        "usable": status.usable,
        "missing": status.missing,
        "problems": status.problems,
        "notes": status.notes,
        "counts": dict(status.counts),
    }


def data_lines(status: DataStatus) -> list[str]:
    """Return what is found and missing of an environment's data, licence and citation."""
    about = status.about
    lines = [about.name]
    if status.root:
        lines.append(f"in {status.root}")
    else:
        lines.append(f"missing; looked in {', '.join(map(str, status.searched))}")
    lines += [f"missing: {line}" for line in status.missing]
    lines += [f"wrong: {line}" for line in status.problems]
    if status.counts:
        counts = (f"{number} {noun}" for noun, number in status.counts.items())
        lines.append(f"found: {', '.join(counts)}")
    lines += status.notes
    lines += [f"licence: {about.licence}", f"please cite: {about.citation}"]
    if about.known_fault:
        lines.append(f"known fault: {about.known_fault}")
    if not status.usable:
        lines += [f"how to get it: {about.how_to_get}", "expected layout:"]
        lines += about.layout.splitlines()
    return lines

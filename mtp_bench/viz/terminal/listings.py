"""Listings of environments and data for the terminal."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
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
    """Return the state of the data of each environment."""
    columns = (
        Column("environment", key="env"),
        Column(key="dataset"),
        Column(key="state"),
    )
    rows = [
        {"env": env_id, "dataset": status.about.name, "state": _state(status)}
        for env_id, status in statuses.items()
    ]
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


def data_lines(statuses: Mapping[str, DataStatus]) -> list[str]:
    """Return lines per dataset, such as errors, licence and citation."""
    datasets: dict[str, dict[str, DataStatus]] = defaultdict(dict)
    for env_id, status in statuses.items():
        datasets[status.about.name][env_id] = status
    lines = []
    for name, by_env in datasets.items():
        lines += ["", name]
        lines += [f"  {text}" for text in (*_findings(by_env), *_about(by_env))]
    return lines


def _findings(statuses: Mapping[str, DataStatus]) -> Iterator[str]:
    """Yield each finding once, with the envs it is limited to."""
    env_ids: dict[str, list[str]] = defaultdict(list)
    for env_id, status in statuses.items():
        for line in _env_findings(status):
            env_ids[line].append(env_id)
    for line, ids in env_ids.items():
        if len(ids) == len(statuses):
            yield line
        else:
            yield f"{', '.join(ids)}: {line}"


def _env_findings(status: DataStatus) -> Iterator[str]:
    if status.root:
        yield f"in {status.root}"
    else:
        yield f"missing; looked in {', '.join(map(str, status.searched))}"
    for line in status.missing:
        yield f"missing: {line}"
    for line in status.problems:
        yield f"wrong: {line}"
    if status.counts:
        counts = (f"{number} {noun}" for noun, number in status.counts.items())
        yield f"found: {', '.join(counts)}"
    yield from status.notes


def _about(statuses: Mapping[str, DataStatus]) -> Iterator[str]:
    about = next(iter(statuses.values())).about
    yield f"licence: {about.licence}"
    yield f"please cite: {about.citation}"
    if about.known_fault:
        yield f"known fault: {about.known_fault}"
    if not all(status.usable for status in statuses.values()):
        yield f"how to get it: {about.how_to_get}"
        yield "expected layout:"
        yield from about.layout.splitlines()

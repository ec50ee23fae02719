"""Status of the data of an env after reading all its scenes: broken files, skipped rows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

from ..cards import Card
from ..errors import DataError
from ..sources import DataStatus, describe, open_source


def total_skipped(counts: Iterable[Mapping[str, int]]) -> dict[str, int]:
    """Sum of the ``skipped`` counts of scenes, by reason."""
    total: Counter[str] = Counter()
    for count in counts:
        total.update(count)
    return dict(sorted(total.items()))


def skipped_line(skipped: Mapping[str, int]) -> str | None:
    """One sentence for the user; None if no row was skipped."""
    if not skipped:
        return None
    count = sum(skipped.values())
    reasons = ", ".join(f"{reason} ({number})" for reason, number in skipped.items())
    return f"skipped {count} row{'' if count == 1 else 's'} of the data that cannot be used: {reasons}"


def read_status(card: Card, data: str | Path | None = None) -> DataStatus:
    """Status of the data of ``card``, with a problem for each broken file and a note on skipped rows."""
    status = describe(card, data)
    if status.root is None or status.missing or status.about.generated:
        return status
    skipped = []
    try:
        source = open_source(card, data)
    except DataError as error:
        status.add_problem(error)
        return status
    for name in source.names:
        try:
            skipped.append(source.load(name).skipped)
        except DataError as error:
            status.add_problem(error)
    line = skipped_line(total_skipped(skipped))
    status.notes += [] if line is None else [line]
    return status

"""Status of the data of an env after reading all its scenes: broken files, skipped rows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

from ..cards import Card
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
    return f"{count} {'row' if count == 1 else 'rows'} of the data skipped or completed: {reasons}"


def read_status(card: Card, data: str | Path | None = None) -> DataStatus:
    """Status of the data of ``card`` after reading all its scenes: broken files, counts, and a note on skipped rows."""
    status = describe(card, data)
    if not status.usable or status.about.generated:
        return status
    source, skipped = open_source(card, data), []
    for name in source.names:
        with status.noted():
            scene = source.load(name)
            skipped.append(scene.skipped)
            rows = {"true boxes": len(scene.truth.box), "detections": len(scene.detections.box)}
            status.counts.update({"scenes": 1, "frames": scene.frames, **rows})
    line = skipped_line(total_skipped(skipped))
    status.notes += [] if line is None else [line]
    return status

"""List of the worst moments of a run: object, span, cost and causes, and a command that shows it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...core import Column, Table
from ...scoring import by_fault, parts_text
from ..moment_list import Moment
from .event_table import Listed
from .output import counted

WORST_CAPTION = (
    "A moment is a time in which the blame of one object is above the run's mean. Blame is the error without the "
    "part below threshold, which depends on the confidence of all other forecasts. share: of all blame, by "
    "which moments are sorted. error: mean of its frames, m; fault: the part of the stack that causes most of it; "
    "causes: its parts, the largest by name, the rest as others."
)
CAPTION_BELOW = (
    "A moment is a time in which the part below threshold of one object is above the run's mean. share: of "
    "that part of the error of the run, by which moments are sorted. error: mean of its frames, m, and its parts."
)
UNSPLIT = "The error of forecasts is not split, but stands under rest: {}."


@dataclass(frozen=True)
class WorstRow(Listed):
    """One moment with its scene."""

    moment: Moment

    @property
    def fault(self) -> str:
        """The part of the stack at fault."""
        return self.moment.fault

    @property
    def error(self) -> float:
        """Mean error of its frames, m."""
        return sum(self.moment.parts.values())


def worst_table(rows: Sequence[WorstRow], total: float) -> Table:
    """One row per moment, to be shown with WORST_CAPTION below; ``total``: cost of all targets of the run, m."""
    several = len({row.scene.name for row in rows}) > 1
    columns = (
        *([Column("scene", read=lambda row: row.scene.name)] if several else []),
        Column("moment", read=lambda row: f"{row.class_name} {row.moment.at.name}"),
        Column(
            "seconds",
            read=lambda row: (
                f"{row.seconds(row.incident.first):.1f}–{row.seconds(row.incident.until):.1f}"
            ),
        ),
        Column(
            "to ego\n(m)",
            format=".0f",
            optional=True,
            read=lambda row: row.moment.distance,
        ),
        Column("share", unit="share", read=lambda row: row.moment.cost / total),
        Column("error\n(m)", format=".1f", read=lambda row: row.error),
        Column("fault", read=lambda row: row.fault),
        Column("causes", read=_causes),
    )
    return Table("worst", "Worst moments", "", rows, columns)


def worst_json(
    rows: Sequence[WorstRow],
    total: float,
    parts: Mapping[str, float],
    env_id: str,
    agent: str,
) -> dict[str, Any]:
    """Content of ``worst --json``; ``parts``: of the error of the run, m, by name."""
    run = {
        "error": sum(parts.values()),
        "parts": dict(parts),
        "faults": by_fault(parts),
        "cost": total,
    }
    return {
        "env": env_id,
        "agent": agent,
        **run,
        "moments": [_record(row) for row in rows],
    }


def run_line(parts: Mapping[str, float], scenes: int) -> str:
    """The error of all targets of the scenes listed, and its shares by the part of the stack."""
    error = sum(parts.values())
    shares = (
        f"{who} {size / error:.0%}"
        for who, size in by_fault(parts).items()
        if error and size
    )
    return f"All targets of {counted(scenes, 'scene')}: {error:.2f} m: {', '.join(shares) or 'nothing to blame'}."


def _causes(row: WorstRow) -> str:
    beside = (
        "\n(the detections there are of other objects)" if row.moment.borrowed else ""
    )
    return f"{parts_text(row.moment.parts, most=3)}{beside}"


def _record(row: WorstRow) -> dict[str, Any]:
    moment, at = row.moment, row.incident
    return row.record("first") | {
        "moment": at.name,
        "start": row.seconds(at.first),
        "end": row.seconds(at.until),
        "frames": moment.frames,
        "cost": moment.cost,
        "error": row.error,
        "fault": row.fault,
        "cause": moment.cause,
        "parts": moment.parts,
        "distance": moment.distance,
        "borrowed": moment.borrowed,
    }

"""List of the worst moments of a run, with causes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...core import Column, Table
from ...scoring import by_fault, parts_text
from ..moment_list import Moment
from .event_table import Listed
from .output import counted

WORST_CAPTION = (
    "A moment is a time in which the blame of one object is above the run's mean. "
    "Blame is the error without the part below threshold, which depends on the "
    "confidence of all other forecasts. share: of all blame, by which moments are "
    "sorted. error: mean of its frames, m; fault: the part of the stack that causes "
    "most of it; causes: its parts, the largest by name, the rest as others."
)
CAPTION_BELOW = (
    "A moment is a time in which the part below threshold of one object is above the "
    "run's mean. share: of that part of the error of the run, by which moments are "
    "sorted. error: mean of its frames, m, and its parts."
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

    @property
    def start(self) -> float:
        """First second of the moment."""
        return self.scene.seconds(self.incident.first)

    @property
    def end(self) -> float:
        """Last second of the moment."""
        return self.scene.seconds(self.incident.until)


def worst_table(rows: Sequence[WorstRow], total_cost_m: float) -> Table:
    """Return one row per moment, to be shown with WORST_CAPTION below.

    ``total_cost_m``: of all targets of the run.
    """
    cells = [_record(row) | _cells(row, total_cost_m) for row in rows]
    columns = [
        Column("moment", key="object"),
        Column(key="seconds"),
        Column("to ego\n(m)", key="distance", format=".0f", optional=True),
        Column(key="share", unit="share"),
        Column("error\n(m)", key="error", format=".1f"),
        Column(key="fault"),
        Column(key="causes"),
    ]
    if len({row.scene.name for row in rows}) > 1:
        columns.insert(0, Column(key="scene"))
    return Table("worst", "Worst moments", "", cells, columns)


def _cells(row: WorstRow, total_cost_m: float) -> dict[str, Any]:
    """Return the cells that the record of a row lacks."""
    causes = parts_text(row.moment.parts, most=3)
    if row.moment.borrowed:
        causes += "\n(the detections there are of other objects)"
    return {
        "object": f"{row.class_name} {row.incident.name}",
        "seconds": f"{row.start:.1f}–{row.end:.1f}",
        "share": row.moment.cost / total_cost_m,
        "causes": causes,
    }


def worst_json(
    rows: Sequence[WorstRow],
    total_cost_m: float,
    parts: Mapping[str, float],
    env_id: str,
    agent: str,
) -> dict[str, Any]:
    """Return the content of ``worst --json``.

    ``parts``: those of the run's error, m. ``total_cost_m``: of all targets.
    """
    return {
        "env": env_id,
        "agent": agent,
        "error": sum(parts.values()),
        "parts": dict(parts),
        "faults": by_fault(parts),
        "cost": total_cost_m,
        "moments": [_record(row) for row in rows],
    }


def _record(row: WorstRow) -> dict[str, Any]:
    moment = row.moment
    return {
        **row.record("first"),
        "moment": row.incident.name,
        "start": row.start,
        "end": row.end,
        "frames": moment.frames,
        "cost": moment.cost,
        "error": row.error,
        "fault": row.fault,
        "cause": moment.cause,
        "parts": moment.parts,
        "distance": moment.distance,
        "borrowed": moment.borrowed,
    }


def run_line(parts: Mapping[str, float], scenes: int) -> str:
    """Return the error of all targets, and its shares by fault, in a line.

    ``parts``: those of the error, m. ``scenes``: number of scenes.
    """
    error_m = sum(parts.values())
    shares = [
        f"{fault} {part_m / error_m:.0%}"
        for fault, part_m in by_fault(parts).items()
        if error_m and part_m
    ]
    text = ", ".join(shares) or "nothing to blame"
    return f"All targets of {counted(scenes, 'scene')}: {error_m:.2f} m: {text}."

"""List of the worst moments of a run: object, span, cost and causes, and a command that shows it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ...scoring.parts import parts_text
from ...tables import Column, Table
from ..moments import Moment, moments
from ..replay import Replay
from .output import command_line

CAPTION = (
    "A moment is a run of frames of one object whose error is above the run's mean. share: of the error of all targets "
    "of the run. error: mean of its frames, m, and its parts, which add up to bADE. Moments are sorted by their error "
    "without the part below threshold, which depends on the confidence of all other forecasts."
)


@dataclass(frozen=True)
class WorstRow:
    """One moment with its scene."""

    scene: str
    class_name: str
    object_name: str  # class, and id in the source
    object_id: str  # in the source
    start: float  # s, since the first frame of the scene
    end: float
    moment: Moment
    view: str  # the command that shows it

    @property
    def error(self) -> float:
        """Mean error of its frames, m."""
        return sum(self.moment.parts.values())


def worst_rows(
    replay: Replay, below: bool, folder: str, data: str | None = None, env: str | None = None
) -> list[WorstRow]:
    """The moments of a scene by falling cost; see `moments`.

    ``folder``, ``data`` and ``env``: arguments that name the run in the command that shows a moment.
    """
    scene, time = replay.scene, replay.scene.time - replay.scene.time[0]
    rows = []
    for moment in moments(replay, below):
        noun = replay.card.task.classes[moment.at.class_id]
        rows.append(
            WorstRow(
                scene=scene.name,
                class_name=noun,
                object_name=f"{noun} {scene.short_name(moment.at.object_id)}",
                object_id=scene.name_of(moment.at.object_id),
                start=float(time[moment.at.first]),
                end=float(time[moment.at.until]),
                moment=moment,
                view=command_line("view", folder, scene=scene.name, at=moment.at.name, data=data, env=env),
            )
        )
    return rows


def worst_table(rows: Sequence[WorstRow], total: float) -> Table:
    """One row per moment, to be shown with CAPTION below; ``total``: cost of all targets of the run, m."""
    several = len({row.scene for row in rows}) > 1
    columns = (
        *([Column(key="scene")] if several else []),
        Column("moment", read=lambda row: f"{row.class_name} {row.moment.at.name}"),
        Column("seconds", read=lambda row: f"{row.start:.1f}–{row.end:.1f}"),
        Column("to ego\n(m)", format=".0f", read=lambda row: row.moment.distance),
        Column("share", unit="share", read=lambda row: row.moment.cost / total),
        Column("error\n(m)", format=".1f", read=lambda row: row.error),
        Column("causes", read=lambda row: parts_text(row.moment.parts, most=3)),
    )
    return Table("worst", "Worst moments", "", rows, columns)


def worst_json(rows: Sequence[WorstRow], total: float, env_id: str, agent: str) -> dict[str, Any]:
    """Content of ``worst --json``."""
    return {"env": env_id, "agent": agent, "cost": total, "moments": [_record(row) for row in rows]}


def _record(row: WorstRow) -> dict[str, Any]:
    moment = row.moment
    return {
        "scene": row.scene,
        "moment": moment.at.name,
        "class": row.class_name,
        "object": moment.at.object_id,
        "object_id": row.object_id,
        "first": moment.at.first,
        "frame": moment.at.frame,
        "until": moment.at.until,
        "start": row.start,
        "end": row.end,
        "frames": moment.frames,
        "cost": moment.cost,
        "error": row.error,
        "cause": moment.cause,
        "parts": moment.parts,
        "distance": moment.distance,
        "minADE": moment.at.minADE,
        "confidence": moment.at.confidence,
        "view": row.view,
    }

"""List of the events of a run: time, object, tracks, error of the forecast, and a command that shows it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from ...core import BLANK, Column, Rollout, Scene, Table
from ...scoring import parts_text
from ..causes import cause_text, causes_of
from ..focus import Focus
from ..incident import INCIDENT_KINDS, Incident
from ..run_replay import Replay
from .output import command_line, counted, show_command, show_lines

ORDERS = ("time", "cost", "confidence", "length")
LONGEST = (
    3  # runs of false forecasts of a scene in the table, unless their kind is asked for
)
EVENT_CAPTION = (
    "minADE: of the forecast made then, metres; – where the object is not a target, or was not forecast. error: what "
    "it adds to bADE, and its parts. confidence: that of the forecast; of a run of false forecasts (spurious) the "
    "highest. *: the old track is still output, outside the gate."
)
_PICTURE = "with --png FILE.png it becomes a picture, without a screen:"
LOOK = f"To look at one, name its scene and event as for the first of them; {_PICTURE}"


@dataclass(frozen=True)
class Listed:
    """An incident with its scene."""

    scene: Scene
    class_name: str
    incident: Incident
    view: str  # the command that shows it
    cause: str = field(default="", kw_only=True)  # of a collision
    at_fault: bool | None = field(
        default=None, kw_only=True
    )  # of the ego in a collision

    @classmethod
    def of(cls, replay: Replay, at: Incident, *run: str | None, **further: Any) -> Self:
        """The row of an incident; ``run``: folder, data root and env that name the run in the command."""
        folder, data, env = run
        view = command_line(
            "view", str(folder), scene=replay.scene.name, at=at.name, data=data, env=env
        )
        if at.kind == "collision" and (drive := replay.rollout.drive):
            (cause,) = causes_of(Focus(replay, at))
            further |= {
                "cause": f"{cause.stage}: {cause_text(cause)}",
                "at_fault": drive.at_fault,
            }
        return cls(
            replay.scene, replay.card.task.classes[at.class_id], at, view, **further
        )

    @property
    def object_name(self) -> str:
        """Class and short id of the object."""
        known = self.incident.object_id >= 0
        return (
            f"{self.class_name} {self.scene.short_name(self.incident.object_id)}"
            if known
            else self.class_name
        )

    def seconds(self, t: int) -> float:
        """Time of frame ``t`` since the first frame of the scene."""
        return float(self.scene.time[t] - self.scene.time[0])

    def record(self, *names: str) -> dict[str, Any]:
        """Content of ``--json`` that all lists have, and fields of the incident by their ``names``."""
        at, numbers = self.incident, ("object_id", "old_id", "new_id")
        ids = {
            name: None if (number := getattr(at, name)) < 0 else number
            for name in numbers
        }
        tracks = {
            f"{name}_in_file": self.scene.track_names.get(getattr(at, name))
            for name in numbers[1:]
        }
        return {
            "scene": self.scene.name,
            "class": self.class_name,
            "object": ids["object_id"],
            **ids,
            **tracks,
            "object_id": None if at.object_id < 0 else self.scene.name_of(at.object_id),
            **{
                name: getattr(at, name)
                for name in ("frame", "until", "minADE", "confidence", *names)
            },
            "view": self.view,
        }


@dataclass
class Tally:
    """Counts of events over scenes, listed or not."""

    events: dict[str, int] = field(
        default_factory=lambda: dict.fromkeys(INCIDENT_KINDS, 0)
    )
    wrong: int = 0  # losses whose old track is still output
    forecasts: int = 0  # false ones
    scenes: int = 0
    complete: bool = True  # the truth: else no forecast is called false
    driven: bool = False  # in a closed loop

    def add(self, replay: Replay) -> None:
        """Count the events of a scene."""
        self.scenes += 1
        self.complete &= replay.scene.truth_complete
        self.driven |= replay.rollout.drive is not None
        self.forecasts += int(replay.forecast_false.sum())
        for incident in replay.incidents:
            self.events[incident.kind] += 1
            self.wrong += incident.wrong


def in_order(rows: Sequence[Listed], order: str) -> list[Listed]:
    """The rows by ``order`` of ORDERS, the largest first.

    "cost": by the error without the part below threshold, then by its rise since the frame before and by minADE; false
    forecasts, which have none, by confidence. Objects that are not targets cost nothing and come last.
    """
    return (
        sorted(rows, key=_ORDER[order], reverse=True) if order in _ORDER else list(rows)
    )


def _cost(row: Listed) -> tuple[float, ...]:
    event = row.incident
    if event.error is None:
        return -1.0, event.confidence or 0.0
    rise = 0.0 if event.error_before is None else event.error - event.error_before
    return event.blame, rise, event.minADE or 0.0


_ORDER: dict[str, Callable[[Listed], Any]] = {
    "cost": _cost,
    "confidence": lambda row: row.incident.confidence or 0.0,
    "length": lambda row: row.incident.until - row.incident.frame,
}


def longest_only(rows: Sequence[Listed]) -> list[Listed]:
    """The rows, with only the LONGEST longest runs of false forecasts of each scene."""
    runs = [row for row in rows if row.incident.kind == "spurious"]
    kept: dict[str, list[int]] = {}
    for row in sorted(runs, key=lambda row: row.incident.frame - row.incident.until):
        kept.setdefault(row.scene.name, []).append(id(row))
    return [
        row
        for row in rows
        if row.incident.kind != "spurious" or id(row) in kept[row.scene.name][:LONGEST]
    ]


def event_table(rows: Sequence[Listed]) -> Table:
    """One row per event, to be shown with EVENT_CAPTION below."""
    return Table(
        "events", "Events of the best hypothesis, along its lineage", "", rows, _COLUMNS
    )


def tally_line(tally: Tally, all_listed: bool) -> str:
    """Numbers of events, with a note where not all of them are listed."""
    count = tally.events
    text = (
        f"{counted(count['ids'], 'identity switch', 'es')}, {count['lost']} lost ({tally.wrong} of them with their "
        f"track elsewhere), {count['reacquired']} reacquired; "
    )
    if tally.complete:
        text += f"{counted(tally.forecasts, 'false forecast')} in {counted(count['spurious'], 'run')}"
    else:
        text += "false forecasts are not known, as there are objects outside the truth"
    text += f"; {counted(count['collision'], 'collision')}" if tally.driven else ""
    text += f"; {counted(tally.scenes, 'scene')}"
    if not all_listed and count["spurious"]:
        longest = (
            f"The {LONGEST} longest runs of false forecasts of each scene are listed"
        )
        text += f"\n{longest}; all of them: --kind spurious"
    return text


def show_collisions(
    rows: Sequence[Listed], rollouts: Sequence[Rollout], shown: str = ""
) -> None:
    """Print a line per collision of a closed loop, those at fault first, then of the fastest ego.

    Below it the command that shows the first, unless it is ``shown`` above.
    """
    drives, end = (
        {each.scene: each.drive for each in rollouts if each.drive is not None},
        ("not at fault", "at fault"),
    )
    hits = [(drives[row.scene.name], row) for row in rows if row.cause]
    hits.sort(
        key=lambda hit: (
            not hit[0].at_fault,
            -np.hypot(*np.diff(hit[0].plan[-1, :2], axis=0)[0]),
        )
    )
    for drive, row in hits:
        what = f"collision at {drive.seconds:.1f} s with {row.object_name}, {end[drive.at_fault]}; {row.cause}"
        show_lines([f"scene {row.scene.name}: {what}"])
    if hits and hits[0][1].view != shown:
        show_lines([f"To look at the first collision; {_PICTURE}"])
        show_command(hits[0][1].view)


def events_json(
    rows: Sequence[Listed], tally: Tally, env_id: str, agent: str
) -> dict[str, Any]:
    """Content of ``events --json``."""
    return {
        "env": env_id,
        "agent": agent,
        "scenes": tally.scenes,
        "counts": tally.events
        | {"wrong": tally.wrong, "spurious_forecasts": tally.forecasts},
        "truth_complete": tally.complete,
        "events": [_record(row) for row in rows],
    }


def _record(row: Listed) -> dict[str, Any]:
    event = row.incident
    own = {
        "time": row.seconds(event.frame),
        "event": event.name,
        "position": list(event.position),
    }
    collision = {"cause": row.cause or None, "at_fault": row.at_fault}
    return (
        own | row.record("kind", "wrong", "error", "parts", "error_before") | collision
    )


def _track(row: Listed) -> str:
    old, new = (
        BLANK if each < 0 else str(each)
        for each in (row.incident.old_id, row.incident.new_id)
    )
    return new if row.incident.kind == "spurious" else f"{old} → {new}"


_COLUMNS = (
    Column("scene", read=lambda row: row.scene.name),
    Column(
        key="frame",
        read=lambda row: "–".join(
            map(str, dict.fromkeys([row.incident.frame, row.incident.until]))
        ),
    ),
    Column(
        key="event",
        read=lambda row: row.incident.name + ("*" if row.incident.wrong else ""),
    ),
    Column(key="object", read=lambda row: row.object_name),
    Column(key="track", read=_track),
    Column(key="minADE", format=".2f", read=lambda row: row.incident.minADE),
    Column(key="error", format=".2f", read=lambda row: row.incident.error),
    Column(
        key="parts",
        read=lambda row: row.incident.parts and parts_text(row.incident.parts, most=2),
    ),
    Column(
        "confi-\ndence",
        key="confidence",
        format=".2f",
        read=lambda row: row.incident.confidence,
    ),
)

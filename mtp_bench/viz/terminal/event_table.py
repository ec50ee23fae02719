"""List of the events of a run: time, object, tracks, error of the forecast, and a command that shows it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ...scoring.parts import parts_text
from ...tables import BLANK, Column, Table
from ..replay import KINDS, Incident, Replay
from .output import command_line, counted

ORDERS = ("time", "cost", "confidence", "length")
LONGEST = 3  # runs of false forecasts of a scene in the table, unless their kind is asked for
CAPTION = (
    "minADE: of the forecast made then, metres; – where the object is not a target, or was not forecast. error: what "
    "it adds to bADE, and its parts. confidence: that of the forecast; of a run of false forecasts (spurious) the "
    "highest. *: the old track is still output, outside the gate."
)
LOOK = (
    "To look at one, name its scene and event as for the first of them; with --png FILE.png it becomes a picture, "
    "without a screen:"
)


@dataclass(frozen=True)
class EventRow:
    """One event with its scene."""

    scene: str
    seconds: float  # since the first frame
    class_name: str
    incident: Incident
    object_name: str  # class, and id in the source
    object_id: str | None  # in the source; None: of no object
    view: str  # the command that shows it
    track_names: Mapping[int, str] = field(default_factory=dict)  # of stored tracks: see `Scene`


@dataclass
class Tally:
    """Counts of events over scenes, listed or not."""

    events: dict[str, int] = field(default_factory=lambda: dict.fromkeys(KINDS, 0))
    wrong: int = 0  # losses whose old track is still output
    forecasts: int = 0  # false ones
    scenes: int = 0
    complete: bool = True  # the truth: else no forecast is called false

    def add(self, replay: Replay) -> None:
        """Count the events of a scene."""
        self.scenes += 1
        self.complete &= replay.scene.truth_complete
        self.forecasts += int(replay.forecast_false.sum())
        for incident in replay.incidents:
            self.events[incident.kind] += 1
            self.wrong += incident.wrong


def event_rows(
    replay: Replay, kinds: Sequence[str], folder: str, data: str | None = None, env: str | None = None
) -> list[EventRow]:
    """The events of a scene that are of these ``kinds``, in the order of frames.

    ``folder``, ``data`` and ``env``: arguments that name the run in the command that shows an event.
    """
    scene, time, classes = replay.scene.name, replay.scene.time, replay.card.task.classes
    return [
        EventRow(
            scene=scene,
            seconds=float(time[incident.frame] - time[0]),
            class_name=(noun := classes[incident.class_id]),
            incident=incident,
            object_name=noun if incident.object_id < 0 else f"{noun} {replay.scene.short_name(incident.object_id)}",
            object_id=None if incident.object_id < 0 else replay.scene.name_of(incident.object_id),
            track_names=replay.scene.track_names,
            view=command_line("view", folder, scene=scene, at=incident.name, data=data, env=env),
        )
        for incident in replay.incidents
        if incident.kind in kinds
    ]


def in_order(rows: Sequence[EventRow], order: str) -> list[EventRow]:
    """The rows by ``order`` of ORDERS, the largest first.

    "cost": by the error without the part below threshold, then by its rise since the frame before and by minADE; false
    forecasts, which have none, by confidence. Objects that are not targets cost nothing and come last.
    """
    return sorted(rows, key=_ORDER[order], reverse=True) if order in _ORDER else list(rows)


def _cost(row: EventRow) -> tuple[float, ...]:
    event = row.incident
    if event.error is None:
        return -1.0, event.confidence or 0.0
    rise = 0.0 if event.error_before is None else event.error - event.error_before
    return event.blame, rise, event.minADE or 0.0


def _length(row: EventRow) -> float:
    return row.incident.until - row.incident.frame


_ORDER: dict[str, Callable[[EventRow], Any]] = {
    "cost": _cost, "confidence": lambda row: row.incident.confidence or 0.0, "length": _length,
}  # fmt: skip


def longest_only(rows: Sequence[EventRow]) -> list[EventRow]:
    """The rows, with only the LONGEST longest runs of false forecasts of each scene."""
    runs = [row for row in rows if row.incident.kind == "spurious"]
    kept: dict[str, list[int]] = {}
    for row in sorted(runs, key=lambda row: row.incident.frame - row.incident.until):
        kept.setdefault(row.scene, []).append(id(row))
    return [row for row in rows if row.incident.kind != "spurious" or id(row) in kept[row.scene][:LONGEST]]


def event_table(rows: Sequence[EventRow]) -> Table:
    """One row per event, to be shown with CAPTION below."""
    return Table("events", "Events of the best hypothesis, along its lineage", "", rows, _COLUMNS)


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
    text += f"; {counted(tally.scenes, 'scene')}"
    if not all_listed and count["spurious"]:
        text += (
            f"\nThe {LONGEST} longest runs of false forecasts of each scene are listed; all of them: --kind spurious"
        )
    return text


def events_json(rows: Sequence[EventRow], tally: Tally, env_id: str, agent: str) -> dict[str, Any]:
    """Content of ``events --json``."""
    return {
        "env": env_id,
        "agent": agent,
        "scenes": tally.scenes,
        "counts": tally.events | {"wrong": tally.wrong, "spurious_forecasts": tally.forecasts},
        "truth_complete": tally.complete,
        "events": [_record(row) for row in rows],
    }


def _record(row: EventRow) -> dict[str, Any]:
    event = row.incident
    same = ("frame", "until", "kind", "wrong", "minADE", "error", "parts", "error_before", "confidence")
    tracks = {"old_id": event.old_id, "new_id": event.new_id}
    ids = {"object": event.object_id, **tracks}
    return {
        "scene": row.scene,
        "time": row.seconds,
        "event": event.name,
        "class": row.class_name,
        **{name: None if identity < 0 else identity for name, identity in ids.items()},
        "object_id": row.object_id,
        **{f"{name}_in_file": row.track_names[track] for name, track in tracks.items() if track in row.track_names},
        "position": list(event.position),
        **{name: getattr(event, name) for name in same},
        "view": row.view,
    }


def _frames(row: EventRow) -> str:
    event = row.incident
    return str(event.frame) if event.until == event.frame else f"{event.frame}–{event.until}"


def _track(row: EventRow) -> str:
    old, new = (BLANK if each < 0 else str(each) for each in (row.incident.old_id, row.incident.new_id))
    return new if row.incident.kind == "spurious" else f"{old} → {new}"


_COLUMNS = (
    Column(key="scene"),
    Column(key="frame", read=_frames),
    Column(key="event", read=lambda row: row.incident.name + ("*" if row.incident.wrong else "")),
    Column(key="object", read=lambda row: row.object_name),
    Column(key="track", read=_track),
    Column(key="minADE", format=".2f", read=lambda row: row.incident.minADE),
    Column(key="error", format=".2f", read=lambda row: row.incident.error),
    Column(key="parts", read=lambda row: row.incident.parts and parts_text(row.incident.parts, most=2)),
    Column("confi-\ndence", key="confidence", format=".2f", read=lambda row: row.incident.confidence),
)

"""List of the events of a run: object, tracks and error."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from ...core import BLANK, Column, Drive, Scene, Table
from ...scoring import EVENT_KINDS, parts_text
from ..causes import cause_text, causes_of
from ..focus import Focus
from ..incident import INCIDENT_KINDS, Incident
from ..run_replay import Replay
from .output import command_line, counted, show_command, show_lines

ORDERS = ("time", "cost")
LONGEST = 3  # runs of false forecasts per scene that are listed, if not asked for
EVENT_CAPTION = (
    "minADE: of the forecast made then, metres; – where the object is not a target, or "
    "was not forecast. error: what it adds to bADE, and its parts. confidence: that of "
    "the forecast; of a run of false forecasts (spurious) the highest. *: the old "
    "track is still output, outside the gate."
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
    # of the ego, in a collision
    drive: Drive | None = field(default=None, kw_only=True)

    @classmethod
    def of(
        cls,
        replay: Replay,
        incident: Incident,
        folder: str,
        data: str | None,
        **fields: Any,
    ) -> Self:
        """Return the row of an incident.

        ``folder`` and ``data`` root name the run in the command; ``fields``:
        further ones of a subclass.
        """
        options = {"scene": replay.scene.name, "at": incident.name}
        view = command_line("view", folder, **options, data=data)
        drive = replay.rollout.drive
        if incident.kind == "collision" and drive is not None:
            (cause,) = causes_of(Focus(replay, incident))  # a collision has one
            fields["cause"] = f"{cause.stage}: {cause_text(cause)}"
            fields["drive"] = drive
        class_name = replay.card.task.classes[incident.class_id]
        return cls(replay.scene, class_name, incident, view, **fields)

    @property
    def object_name(self) -> str:
        """Class and short id of the object."""
        object_id = self.incident.object_id
        if object_id < 0:
            return self.class_name
        return f"{self.class_name} {self.scene.short_name(object_id)}"

    def record(self, *names: str) -> dict[str, Any]:
        """Return the fields of ``--json`` that events and moments share.

        ``names``: further fields of the incident.
        """
        incident = self.incident
        track_names = self.scene.track_names
        object_name = None
        if incident.object_id >= 0:
            object_name = self.scene.name_of(incident.object_id)
        names = ("frame", "until", "minADE", "confidence", *names)
        return {
            "scene": self.scene.name,
            "class": self.class_name,
            "object": _id_or_none(incident.object_id),
            "object_id": object_name,
            "old_id": _id_or_none(incident.old_id),
            "new_id": _id_or_none(incident.new_id),
            "old_id_in_file": track_names.get(incident.old_id),
            "new_id_in_file": track_names.get(incident.new_id),
            **{name: getattr(incident, name) for name in names},
            "view": self.view,
        }


def _id_or_none(number: int) -> int | None:
    return None if number < 0 else number


@dataclass
class Tally:
    """Counts of events over scenes, listed or not."""

    has_tracks: bool  # in any scene of the run: else no track has an event
    events: Counter[str] = field(
        default_factory=lambda: Counter(dict.fromkeys(INCIDENT_KINDS, 0))
    )
    wrong: int = 0  # losses whose old track is still output
    forecasts: int = 0  # false ones
    scenes: int = 0
    complete: bool = True  # truth of all scenes: else no forecast is called false
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
    """Sort rows by ``order`` of ORDERS, the largest first.

    "time" keeps the order of the rows.

    "cost": by the error without the part below threshold, then by its rise since the
    frame before and by minADE. False forecasts have no error, and come last by
    confidence, as do objects that are not targets.
    """
    if order == "time":
        return list(rows)
    return sorted(rows, key=_cost, reverse=True)


def _cost(row: Listed) -> tuple[float, ...]:
    """Return the sort key of "cost", see `in_order`."""
    event = row.incident
    if event.error is None:
        return -1.0, event.confidence or 0.0
    rise_m = 0.0
    if event.error_before is not None:
        rise_m = event.error - event.error_before
    return event.blame, rise_m, event.minADE or 0.0


def _length(row: Listed) -> int:
    return row.incident.until - row.incident.frame


def longest_only(rows: Sequence[Listed]) -> list[Listed]:
    """Keep only the longest runs of false forecasts of each scene."""
    runs: dict[str, list[Listed]] = defaultdict(list)
    for row in sorted(rows, key=_length, reverse=True):
        if row.incident.kind == "spurious":
            runs[row.scene.name].append(row)
    dropped = {id(row) for of_scene in runs.values() for row in of_scene[LONGEST:]}
    return [row for row in rows if id(row) not in dropped]


def event_table(rows: Sequence[Listed]) -> Table:
    """Return one row per event, to be shown with EVENT_CAPTION below."""
    title = "Events of the best hypothesis, along its lineage"
    columns = (
        Column(key="scene"),
        Column("frame", key="frames"),
        Column(key="event"),
        Column("object", key="object_name"),
        Column(key="track"),
        Column(key="minADE", format=".2f"),
        Column(key="error", format=".2f"),
        Column("parts", key="parts_text"),
        Column("confi-\ndence", key="confidence", format=".2f"),
    )
    return Table("events", title, "", [_cells(row) for row in rows], columns)


def _cells(row: Listed) -> dict[str, Any]:
    """Return the record of an event, and its table texts."""
    event = row.incident
    # one number if both are the same
    frames = dict.fromkeys(map(str, (event.frame, event.until)))
    old_id, new_id = (
        BLANK if track_id < 0 else str(track_id)
        for track_id in (event.old_id, event.new_id)
    )
    track = new_id if event.kind == "spurious" else f"{old_id} → {new_id}"
    name = event.name
    if event.wrong:
        name += "*"
    return {
        **_record(row),
        "frames": "–".join(frames),
        "event": name,
        "object_name": row.object_name,
        "track": track,
        "parts_text": event.parts and parts_text(event.parts, most=2),
    }


def tally_line(tally: Tally, all_listed: bool) -> str:
    """Return the numbers of events, and how to list those left out."""
    count = tally.events
    tracks = (
        f"{BLANK} identity switches, {BLANK} lost, {BLANK} reacquired, as no track is "
        "stated"
    )
    runs = ""
    if tally.has_tracks:
        tracks = (
            f"{counted(count['ids'], 'identity switch', 'es')}, {count['lost']} lost "
            f"({tally.wrong} of them with their track elsewhere), "
            f"{count['reacquired']} reacquired"
        )
        runs = f" in {counted(count['spurious'], 'run')}"
    texts = [tracks]
    if tally.complete:
        texts.append(f"{counted(tally.forecasts, 'false forecast')}{runs}")
    else:
        texts.append(
            "false forecasts are not known, as there are objects outside the truth"
        )
    if tally.driven:
        texts.append(counted(count["collision"], "collision"))
    texts.append(counted(tally.scenes, "scene"))
    line = "; ".join(texts)
    if all_listed or not count["spurious"]:
        return line
    return (
        f"{line}\nThe {LONGEST} longest runs of false forecasts of each scene are "
        "listed; all of them: --kind spurious"
    )


def show_collisions(rows: Sequence[Listed], shown_command: str = "") -> None:
    """Print a line per collision, and the command of the first.

    Those at fault come first, then those of the fastest ego. The command is left out
    if it is the ``shown_command`` above.
    """
    collisions = [(row.drive, row) for row in rows if row.drive is not None]
    # the last step, of .1 s, grows with the speed
    collisions.sort(
        key=lambda pair: (not pair[0].at_fault, -np.diff(pair[0].station)[-1])
    )
    for drive, row in collisions:
        fault = "at fault" if drive.at_fault else "not at fault"
        collision = f"collision at {drive.seconds:.1f} s with {row.object_name}"
        show_lines([f"scene {row.scene.name}: {collision}, {fault}; {row.cause}"])
    if collisions and collisions[0][1].view != shown_command:
        show_lines([f"To look at the first collision; {_PICTURE}"])
        show_command(collisions[0][1].view)


def events_json(
    rows: Sequence[Listed], tally: Tally, env_id: str, agent: str
) -> dict[str, Any]:
    """Return the content of ``events --json``."""
    counts: dict[str, int | None] = {**tally.events, "wrong": tally.wrong}
    if not tally.has_tracks:
        counts |= dict.fromkeys((*EVENT_KINDS, "wrong", "spurious"))
    counts["spurious_forecasts"] = tally.forecasts
    return {
        "env": env_id,
        "agent": agent,
        "scenes": tally.scenes,
        "counts": counts,
        "truth_complete": tally.complete,
        "events": [_record(row) for row in rows],
    }


def _record(row: Listed) -> dict[str, Any]:
    event = row.incident
    return {
        "time": row.scene.seconds(event.frame),
        "event": event.name,
        "position": list(event.position),
        **row.record("kind", "wrong", "error", "parts", "error_before"),
        "cause": row.cause or None,
        "at_fault": row.drive and row.drive.at_fault,
    }

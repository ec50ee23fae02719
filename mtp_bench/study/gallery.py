"""The costliest events of each kind, as pictures, with the command that opens each in the viewer."""

import os
from base64 import b64encode
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .. import notice
from ..cards import Card
from ..parallel import parallel_map
from ..running.rollout_files import load_run
from ..running.stored import open_run
from ..sources import open_source
from ..types import Rollout
from ..viz.drawing.report import save_report
from ..viz.framing import focuses_of
from ..viz.replay import Incident, replay
from ..viz.sentence import sentence
from ..viz.terminal.output import command_line
from .findings import Findings

KINDS = ("ids", "lost", "reacquired")
EACH = 3  # events of a kind


@dataclass(frozen=True)
class EventPicture:
    """Picture of one event: with one hypothesis, and below it with the most."""

    title: str
    path: Path  # PNG
    sentence: str
    command: str  # that opens it

    @property
    def base64(self) -> str:
        """The picture as text, for a page."""
        return b64encode(self.path.read_bytes()).decode("ascii")


@dataclass(frozen=True)
class CostlyEvent:
    """One event of the agent with one hypothesis."""

    scene: str
    incident: Incident
    cost: float  # m, beyond the error from ground-truth tracks


def draw_worst_events(findings: Findings, folder: Path) -> list[EventPicture]:
    """Draw the costliest events of each kind into ``folder``."""
    count, pictures = dict.fromkeys(KINDS, 0), []
    events = worst_events(findings)
    with notice.work("drawing the costliest events") as work:
        work.started(len(events))
        for event in events:
            kind = event.incident.kind
            count[kind] += 1
            pictures.append(_draw(findings, event, folder / f"{kind}-{count[kind]}.png"))
            work.done(event.scene)
    return pictures


def worst_events(findings: Findings) -> list[CostlyEvent]:
    """The costliest events of each kind of the subject with one hypothesis, of different objects."""
    subject, bench = findings.subject, findings.bench
    truth, single = (load_run(findings.of(s).folders[0]).rollouts for s in (subject.truth, subject.single))
    calls = [(bench.card, bench.options.data, *pair) for pair in zip(truth, single, strict=True)]
    events = [event for each in parallel_map(_costs, calls, bench.options.workers) for event in each]
    events.sort(key=lambda event: -event.cost)
    chosen = []
    for kind in KINDS:
        first: dict[tuple[str, int], CostlyEvent] = {}
        for event in events:
            if event.incident.kind == kind:
                first.setdefault((event.scene, event.incident.object_id), event)
        chosen += list(first.values())[:EACH]
    return chosen


def _costs(card: Card, data: str | None, truth: Rollout, single: Rollout) -> list[CostlyEvent]:
    """The events of a scene at targets."""
    scene = open_source(card, data).load(single.scene)
    ideal = np.nan_to_num(replay(scene, truth, card).worth[:, 0])
    events = replay(scene, single, card).events
    return [CostlyEvent(single.scene, e, float(e.error - ideal[e.row])) for e in events if e.error is not None]


def _draw(findings: Findings, event: CostlyEvent, path: Path) -> EventPicture:
    bench, notes = findings.bench, list[str]()
    settings = {findings.of(s).folders[0]: s for s in (findings.subject.single, findings.subject.most)}
    replays = []
    for folder, setting in settings.items():
        run = open_run(folder, bench.options.data, bench.card)
        name = setting.label if (setting.hypotheses or 1) == 1 else f"{setting.label}, H = {setting.hypotheses}"
        replays.append(replay(run.drawn(event.scene, notes.append), run.first(event.scene), run.card, name))
    focuses = focuses_of(replays, event.incident)
    save_report(path, *focuses)
    sentences = "; ".join(f"{focus.replay.agent}: {sentence(focus)}" for focus in focuses)
    return EventPicture(
        title=f"{event.incident.kind}: {focuses[0].named}, scene {event.scene}, {event.cost:+.2f} m",
        path=path,
        sentence=sentences + ("; the road is not drawn, for its map is broken" if notes else ""),
        command=command_of(findings, event),
    )


def command_of(findings: Findings, event: CostlyEvent) -> str:
    """The command that opens an event, with one hypothesis and with the most side by side."""
    settings = (findings.subject.single, findings.subject.most)
    folders = dict.fromkeys(os.path.relpath(findings.of(setting).folders[0]) for setting in settings)
    data = findings.bench.options.data
    return command_line("view", *folders, scene=event.scene, at=event.incident.name, data=data)

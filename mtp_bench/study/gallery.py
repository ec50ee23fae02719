"""The costliest events of each kind, as pictures, with the command that opens each in the viewer."""

from __future__ import annotations

import os
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from PIL import Image

from ..cards import Card
from ..geometry import bev_corners
from ..parallel import parallel_map
from ..running.rollout_files import load_run
from ..running.stored import open_run
from ..sources import open_source
from ..types import Floats, Rollout
from ..viz.case import Case, ObjectForecast, counterpart
from ..viz.drawing.report import report
from ..viz.focus import Focus
from ..viz.replay import Incident, Replay, replay
from ..viz.terminal.output import command_line
from .drawing import Drawing, draw, hex_color
from .findings import Findings
from .panels import Panel, Series, draw_panels

KINDS = ("ids", "lost", "reacquired")
EACH = 3  # events of a kind
TRAIL = 8  # frames of a past that are shown
_LEAST, _MOST = 6.0, 45.0  # m, half of what a panel shows


@dataclass(frozen=True)
class EventPicture:
    """Pictures of one event."""

    figure: Drawing  # the forecasts from each kind of past beside each other
    focus: bytes  # PNG: the event with one hypothesis alone, as `mtp-bench view --png` draws it
    sentence: str  # of the focus picture
    command: str  # that opens it

    @property
    def base64(self) -> str:
        """The focus picture as text, for a page."""
        return b64encode(self.focus).decode("ascii")


@dataclass(frozen=True, eq=False)
class AgentMoment:
    """An agent's track and forecast of the object at the moment."""

    label: str
    trail: Floats  # [n, 2] m, of the track that follows the object; empty without one
    forecast: ObjectForecast | None  # None if no forecast is matched to the object
    error: float | None  # m, minADE; None if the object is not covered

    @property
    def worth(self) -> str:
        """The error in words."""
        return "no forecast" if self.error is None else f"{self.error:.2f} m"


@dataclass(frozen=True, eq=False)
class Moment:
    """One event of the agent with one hypothesis, and all agents at that moment."""

    scene: str
    incident: Incident
    cost: float  # m, beyond the error from ground-truth tracks
    object_name: str
    past: Floats  # [n, 2] m, of the object, now last
    future: Floats  # [T, 2] m
    box: Floats  # [7] the true box
    others: Floats  # [m, 7] all other true boxes of the frame
    agents: tuple[AgentMoment, ...]  # on GT tracks, with one hypothesis, with the most


def gallery(findings: Findings) -> list[EventPicture]:
    """Pictures of the costliest events of each kind."""
    count = dict.fromkeys(KINDS, 0)
    pictures = []
    for moment in worst_moments(findings):
        count[moment.incident.kind] += 1
        figure = picture_of(moment, f"{moment.incident.kind}-{count[moment.incident.kind]}")
        pictures.append(EventPicture(figure, *_focus(findings, moment), command_of(findings, moment)))
    return pictures


def worst_moments(findings: Findings) -> list[Moment]:
    """The costliest events of each kind of the subject with one hypothesis, of different objects."""
    subject, bench = findings.subject, findings.bench
    settings = [subject.truth, subject.single, *([subject.most] if subject.most != subject.single else [])]
    labels = ("GT tracks", "one hypothesis", f"{subject.most.hypotheses or 1} hypotheses")[: len(settings)]
    runs = [load_run(findings.of(setting).folders[0]).rollouts for setting in settings]
    calls = [
        (bench.card, bench.options.data, name, tuple(run[i] for run in runs), labels)
        for i, name in enumerate(bench.scenes)
    ]
    moments: list[Moment] = [m for each in parallel_map(_of_scene, calls, bench.options.workers) for m in each]
    chosen = []
    for kind in KINDS:
        first: dict[tuple[str, int], Moment] = {}
        for moment in sorted((m for m in moments if m.incident.kind == kind), key=lambda m: -m.cost):
            first.setdefault((moment.scene, moment.incident.object_id), moment)
        chosen += list(first.values())[:EACH]
    return chosen


def _of_scene(
    card: Card, data: str | None, name: str, rollouts: Sequence[Rollout], labels: Sequence[str]
) -> list[Moment]:
    """The costliest events of a scene, some of each kind."""
    scene = open_source(card, data).load(name)
    truth, single = (replay(scene, rollout, card) for rollout in rollouts[:2])
    priced = [(i.error - np.nan_to_num(truth.worth[i.row, 0]), i) for i in single.incidents if i.error is not None]
    chosen: list[tuple[float, Incident]] = []
    for kind in KINDS:
        mine = [pair for pair in priced if pair[1].kind == kind]
        chosen += sorted(mine, key=lambda pair: -pair[0])[: 2 * EACH]
    runs = [truth, single, *(replay(scene, rollout, card) for rollout in rollouts[2:] if chosen)]
    return [_moment(runs, labels, incident, float(cost)) for cost, incident in chosen]


def _moment(runs: Sequence[Replay], labels: Sequence[str], incident: Incident, cost: float) -> Moment:
    case, truth, t = Case(runs[1], incident), runs[1].scene.truth, incident.frame
    here = truth.rows(t)
    return Moment(
        scene=runs[1].scene.name,
        incident=incident,
        cost=cost,
        object_name=f"{case.noun} {incident.object_id}",
        past=case.path(t, t - TRAIL + 1)[::-1],
        future=case.future(t)[1:],
        box=truth.box[incident.row],
        others=truth.box[np.setdiff1d(np.arange(here.start, here.stop), incident.row)],
        agents=tuple(
            _agent_moment(label, Case(run, counterpart(run, incident))) for label, run in zip(labels, runs, strict=True)
        ),
    )


def _agent_moment(label: str, case: Case) -> AgentMoment:
    at = case.at
    matched = case.replay.truth_forecast[at.row] >= 0
    trail = case.trail(at.new_id, at.frame, TRAIL)
    return AgentMoment(label, trail, case.forecast(at.frame) if matched else None, at.minADE)


def _focus(findings: Findings, moment: Moment) -> tuple[bytes, str]:
    """The focus picture of a moment with one hypothesis, and its sentence."""
    bench, single = findings.bench, findings.subject.single
    run = open_run(findings.of(single).folders[0], bench.options.data, bench.card)
    notes: list[str] = []
    scene = run.drawn(moment.scene, notes.append)
    focus = Focus.of(replay(scene, run.first(moment.scene), run.card, single.label), moment.incident)
    content = BytesIO()
    report(focus).quantize(128, dither=Image.Dither.NONE).save(content, "PNG", optimize=True)
    return content.getvalue(), focus.sentence + ("; the road is not drawn, for its map is broken" if notes else "")


def command_of(findings: Findings, moment: Moment) -> str:
    """The command that opens a moment, with one hypothesis and with the most side by side."""
    subject, bench = findings.subject, findings.bench
    settings = dict.fromkeys(findings.of(setting).folders[0] for setting in (subject.single, subject.most))
    folders = map(os.path.relpath, settings)
    return command_line("view", *folders, scene=moment.scene, at=moment.incident.name, data=bench.options.data)


def picture_of(moment: Moment, name: str) -> Drawing:
    """An event: the forecasts from GT tracks, with one hypothesis and with the most."""
    incident, place = moment.incident, moment.box[:2]
    best = [each.forecast.nearest_path for each in moment.agents if each.forecast is not None]
    points = np.concatenate([moment.past, moment.future, *best])
    low, high = points.min(axis=0), points.max(axis=0)
    center, half = (low + high) / 2 - place, float(np.clip((high - low).max() * 0.58, _LEAST, _MOST))
    limits = {axis: (center[i] - half, center[i] + half) for i, axis in enumerate("xy")}
    panels = [
        Panel(
            _series(moment, each, with_trail=i > 0),
            "x from the object, m",
            "y from the object, m" if i == 0 else "",
            title=f"{each.label}: {each.worth}",
            limits=limits,
            square=True,
        )
        for i, each in enumerate(moment.agents)
    ]
    return draw(
        name,
        f"{incident.kind}: {moment.object_name}",
        sentence_of(moment),
        f"1 event; scene {moment.scene}, frame {incident.frame}",
        lambda *axes: draw_panels(axes, panels, 5),
        panels=len(panels),
        size=(3.1 * len(panels), 3.5),
    )


def sentence_of(moment: Moment) -> str:
    """The event in words, and the error of each forecast."""
    incident, name = moment.incident, moment.object_name
    elsewhere = ", for that track is elsewhere" if incident.wrong else ""
    happened = {
        "ids": f"{name} was track {incident.old_id} and is now track {incident.new_id}",
        "lost": f"{name} was track {incident.old_id} and is now without a track{elsewhere}",
        "reacquired": f"{name} was without a track and is found again as track {incident.new_id}",
    }[incident.kind]
    worth = "; ".join(f"{each.label} {each.worth}" for each in moment.agents)
    return f"{happened[0].upper()}{happened[1:]}. The best forecast is off by: {worth}."


def _series(moment: Moment, agent: AgentMoment, with_trail: bool) -> list[Series]:
    """True boxes, the forecast of one agent, past and future of the object and its track, in metres from the object."""

    def path(points: Floats, name: str, label: str = "", **style: Any) -> Series:
        x, y = (points - moment.box[:2]).T.tolist()
        style = {"marker": "", "color": hex_color(name), "linestyle": "-", "markersize": 3, **style}
        return Series(label, x, y, name, style=style)

    outlines = [(box, "grey", 0.8) for box in moment.others] + [(moment.box, "green", 1.6)]
    series = []
    for box, name, width in outlines:
        corners = bev_corners(box)
        series.append(path(np.concatenate([corners, corners[:1]]), name, linewidth=width))
    if agent.forecast is not None:
        series += [path(each, "vermillion", linewidth=0.7, alpha=0.35) for each in agent.forecast.path]
        best = agent.forecast.path[agent.forecast.nearest]
        series.append(path(best, "vermillion", "best forecast", linewidth=2.0))
    series.append(path(moment.past, "green", "true past", linewidth=1.6, linestyle=":", marker="o"))
    series.append(path(moment.future, "green", "true future", linewidth=2.0, linestyle="--"))
    if len(agent.trail) and with_trail:  # the first agent's track is the true past
        series.append(path(agent.trail, "blue", "track", linewidth=1.4, marker="s"))
    return series

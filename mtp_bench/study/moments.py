"""The worst events of a study: found by what they cost, with what every kind of past made of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..cards import Card
from ..parallel import parallel_map
from ..running.rollout_files import load_run
from ..sources import open_source
from ..types import Floats, Rollout
from ..viz.case import Case, Forecast
from ..viz.counterpart import counterpart
from ..viz.replay import Incident, Replay, replay
from .findings import Findings

KINDS = ("ids", "lost", "reacquired")
EACH = 3  # events of a kind
TRAIL = 8  # frames of a past that are shown


@dataclass(frozen=True, eq=False)
class Said:
    """What one agent said of the object at the moment."""

    label: str
    trail: Floats  # [n, 2] m, of the track that follows it; empty where none does
    forecast: Forecast | None  # None: the judge holds none for it
    error: float | None  # m, minADE; None where the object is not covered


@dataclass(frozen=True, eq=False)
class Moment:
    """One event."""

    scene: str
    incident: Incident
    cost: float  # m, beyond the error from the true past
    class_name: str
    past: Floats  # [n, 2] m, the true one, now last
    future: Floats  # [T, 2] m
    box: Floats  # [7] the true box
    others: Floats  # [m, 7] all other true boxes of the frame
    said: tuple[Said, ...]  # on true pasts, with one hypothesis, with the most


def worst_moments(found: Findings) -> list[Moment]:
    """The events of each kind of the subject with one hypothesis that cost most, of different objects."""
    subject, bench = found.subject, found.bench
    settings = [subject.truth, subject.single, *([subject.most] if subject.most != subject.single else [])]
    labels = ("true past", "one hypothesis", f"{subject.most.hypotheses or 1} hypotheses")[: len(settings)]
    runs = [load_run(found.of(setting).folders[0]).rollouts for setting in settings]
    calls = [
        (bench.card, bench.options.data, name, tuple(run[i] for run in runs), labels)
        for i, name in enumerate(bench.scenes)
    ]
    every: list[Moment] = [m for each in parallel_map(_of_scene, calls, bench.options.workers) for m in each]
    chosen = []
    for kind in KINDS:
        seen: set[tuple[str, int]] = set()
        for moment in sorted((m for m in every if m.incident.kind == kind), key=lambda m: -m.cost):
            who = moment.scene, moment.incident.object_id
            if who not in seen and len(seen) < EACH:
                seen.add(who)
                chosen.append(moment)
    return chosen


def _of_scene(
    card: Card, data: str | None, name: str, rollouts: Sequence[Rollout], labels: Sequence[str]
) -> list[Moment]:
    """The costliest events of a scene, some of each kind."""
    scene = open_source(card, data).load(name)
    truth, single = (replay(scene, rollout, card) for rollout in rollouts[:2])
    priced = [(_cost(truth, each), each) for each in single.incidents if each.kind in KINDS and each.error is not None]
    chosen: list[tuple[float, Incident]] = []
    for kind in KINDS:
        mine = [pair for pair in priced if pair[1].kind == kind]
        chosen += sorted(mine, key=lambda pair: -pair[0])[: 2 * EACH]
    runs = [truth, single, *(replay(scene, rollout, card) for rollout in rollouts[2:] if chosen)]
    return [_moment(runs, labels, incident, cost) for cost, incident in chosen]


def _cost(truth: Replay, incident: Incident) -> float:
    """What the error exceeds that from the true past, m."""
    ideal = float(truth.worth[incident.row, 0])
    return float(incident.error or 0.0) - (0.0 if np.isnan(ideal) else ideal)


def _moment(runs: Sequence[Replay], labels: Sequence[str], incident: Incident, cost: float) -> Moment:
    case, truth, t = Case(runs[1], incident), runs[1].scene.truth, incident.frame
    here = truth.rows(t)
    return Moment(
        scene=runs[1].scene.name,
        incident=incident,
        cost=cost,
        class_name=case.noun,
        past=case.path(t, t - TRAIL + 1)[::-1],
        future=case.future(t)[1:],
        box=truth.box[incident.row],
        others=truth.box[[row for row in range(here.start, here.stop) if row != incident.row]],
        said=tuple(
            _said(label, Case(run, counterpart(run, incident))) for label, run in zip(labels, runs, strict=True)
        ),
    )


def _said(label: str, case: Case) -> Said:
    at = case.at
    held = case.replay.truth_forecast[at.row] >= 0
    trail = case.trail(at.new_id, at.frame, TRAIL)
    return Said(label, trail, case.forecast(at.frame) if held else None, at.minADE)

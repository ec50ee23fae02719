"""The worst events of a study: found by what they cost, with what every kind of past made of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..cards import Card
from ..parallel import parallel_map
from ..running.rollout_files import load_run
from ..running.settings import Setting
from ..scoring.forecasts import Forecasts, candidates, final_errors, grow
from ..scoring.lineage import Hypotheses, hypotheses
from ..scoring.neutral import evaluated
from ..scoring.targets import find_targets, live_frames
from ..sources import open_source
from ..types import Floats, Ints, Rollout, Scene
from ..viz.replay import Incident, replay
from .findings import Findings

KINDS = ("ids", "lost", "reacquired")
EACH = 3  # events of a kind
TRAIL = 8  # frames of a past that are shown


@dataclass(frozen=True, eq=False)
class Said:
    """What one agent said of the object at the moment."""

    label: str
    trail: Floats  # [n, 2] m, of the track that holds it; empty where none does
    paths: Floats  # [K, T, 2] m; empty where nothing is forecast
    best: int  # the sample nearest to the truth
    error: float | None  # m, minADE; None without a forecast
    confidence: float | None


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
    runs = [load_run(found.of(setting).folders[0]).rollouts for setting in settings]
    calls = [
        (bench.card, bench.options.data, name, tuple(run[i] for run in runs), _labels(settings))
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


def _labels(settings: Sequence[Setting]) -> tuple[str, ...]:
    names = ("true past", "one hypothesis", f"{settings[-1].hypotheses or 1} hypotheses")
    return names[: len(settings)]


def _of_scene(
    card: Card, data: str | None, name: str, rollouts: Sequence[Rollout], labels: Sequence[str]
) -> list[Moment]:
    """The costliest events of a scene, some of each kind."""
    scene = evaluated(open_source(card, data).load(name))
    incidents = [i for i in replay(scene, rollouts[1], card).incidents if i.kind in KINDS and i.error is not None]
    views = [_View.of(scene, rollout, card) for rollout in rollouts]
    moments = []
    for kind in KINDS:
        mine = [(_cost(views[0], incident), incident) for incident in incidents if incident.kind == kind]
        for cost, incident in sorted(mine, key=lambda pair: -pair[0])[: 2 * EACH]:
            moments.append(_moment(scene, card, views, labels, incident, cost))
    return moments


@dataclass(frozen=True, eq=False)
class _View:
    """A rollout with the forecast of each true box."""

    rollout: Rollout
    forecasts: Forecasts
    forecast: Ints  # [R] row of the forecast of each true box, -1 none
    error: Floats  # [R] m, minADE; inf where there is none, NaN where the box is no target
    hypotheses: Hypotheses

    @classmethod
    def of(cls, scene: Scene, rollout: Rollout, card: Card) -> _View:
        targets, forecasts = find_targets(scene, card), Forecasts.of(rollout)
        found = candidates(scene, targets, forecasts, live_frames(scene, card), card)
        errors, forecast = final_errors(found, grow(found, forecasts.confidence))
        error = np.full(len(scene.truth.box), np.nan)
        error[targets.row] = errors.min_ade
        return cls(rollout, forecasts, forecast, error, hypotheses(rollout, card))


def _cost(truth: _View, incident: Incident) -> float:
    """What the error exceeds that from the true past, m."""
    ideal = float(truth.error[incident.row])
    return float(incident.error or 0.0) - (ideal if np.isfinite(ideal) else 0.0)


def _moment(
    scene: Scene, card: Card, views: Sequence[_View], labels: Sequence[str], incident: Incident, cost: float
) -> Moment:
    truth, t = scene.truth, incident.frame
    own = np.flatnonzero(truth.object_id == incident.object_id)
    frame = truth.frame_of_rows[own]
    xy = np.asarray(truth.box[own, :2], dtype=np.float64)
    here = truth.rows(t)
    rest = [row for row in range(here.start, here.stop) if row != incident.row]
    future = xy[(frame > t) & (frame <= t + card.task.future)]
    return Moment(
        scene=scene.name,
        incident=incident,
        cost=cost,
        class_name=card.task.classes[incident.class_id].replace("_", " "),
        past=xy[(frame <= t) & (frame > t - TRAIL)],
        future=future,
        box=truth.box[incident.row],
        others=truth.box[rest],
        said=tuple(_said(view, label, incident, future) for view, label in zip(views, labels, strict=True)),
    )


def _said(view: _View, label: str, incident: Incident, future: Floats) -> Said:
    row = int(view.forecast[incident.row])
    if row < 0:
        return Said(label, np.zeros((0, 2)), np.zeros((0, *future.shape)), -1, None, None)
    paths = view.forecasts.paths(np.array([row]))[0][view.forecasts.weights(np.array([row]))[0] > 0]
    best = int(np.linalg.norm(paths - future, axis=-1).mean(axis=1).argmin())
    place = view.forecasts.box[row, :2]
    error = float(view.error[incident.row])
    return Said(
        label, _trail(view, incident.frame, place), paths, best, error if np.isfinite(error) else None,
        float(view.forecasts.confidence[row]),
    )  # fmt: skip


def _trail(view: _View, t: int, place: Floats) -> Floats:
    """The past of the track of the best hypothesis that stands at ``place`` [2] in frame ``t``, now last.

    It is followed through the hypotheses that this one descends from, as identities are in the scorer.
    """
    rollout, hypothesis = view.rollout, view.hypotheses.seen_from(t)
    rows = np.arange(*rollout.tracks.rows(t).indices(len(rollout.track_id)))
    rows = rows[rollout.member[rows, hypothesis[t]]] if rollout.member.shape[1] else rows
    if not len(rows):
        return np.zeros((0, 2))
    track = rollout.track_id[rows[np.hypot(*(rollout.track_box[rows, :2] - place).T).argmin()]]
    places = []
    for s in range(max(0, t - TRAIL + 1), t + 1):
        held = np.arange(*rollout.tracks.rows(s).indices(len(rollout.track_id)))
        held = held[(rollout.track_id[held] == track) & rollout.member[held, hypothesis[s]]]
        places += [rollout.track_box[held[0], :2]] if len(held) else []
    return np.array(places, dtype=np.float64).reshape(-1, 2)

"""One frame of a scene as it is drawn: from a scored run, or from an episode while it is played."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..cards import Card
from ..scoring.forecasts import sample_weights
from ..scoring.lineage import Hypotheses
from ..types import Bools, Floats, Ints, Lane, Rollout, to_metres
from .drawing.camera import Camera, camera
from .drawing.canvas import Viewport
from .replay import Incident, Replay

TRAIL_SECONDS = 3.0
EVENT_SECONDS = 1.5  # how long an event stays in the picture
LOG = 10  # events that are listed


@dataclass(frozen=True, eq=False)
class Said:
    """What an agent said of a frame; boxes in the frame of reference of the scene."""

    hypotheses: int  # that are alive
    best: int  # number of the heaviest
    weight: float  # of it, 0 to 1
    track_box: Floats  # [N, 7] of the best hypothesis
    track_id: Ints  # [N]
    trails: Sequence[Floats]  # N of [n, 2], the newest place last
    other_box: Floats  # [n, 7] tracks that only other hypotheses hold
    object_box: Floats  # [O, 7]
    forecast: Floats  # [O, K, T, 2] m, x y of the scene
    forecast_weight: Floats  # [O, K] 0 to 1


@dataclass(frozen=True, eq=False)
class Judged:
    """What the judge made of a frame."""

    truth_missed: Bools  # [M] true boxes without a track of the best hypothesis
    detection_false: Bools  # [D]
    track_false: Bools  # [N]
    spurious: Bools  # [O] forecasts of nothing
    complete: bool  # the truth; else nothing is known to be false
    counts: tuple[int, int, int]  # tracked, missed, false
    marked: tuple[tuple[Incident, Floats], ...]  # the newest event of each object lately, and where it is [2] now
    log: tuple[Incident, ...]  # the last events, the newest first


@dataclass(frozen=True, eq=False)
class FrameView:
    """What a picture shows of one frame; boxes in the frame of reference of the scene."""

    env_id: str
    agent: str
    scene: str
    frame: int
    frames: int
    seconds: float  # since the first frame
    viewport: Viewport
    lanes: tuple[Lane, ...]
    ego: Floats | None  # [4]; None where no vehicle carries the sensors
    truth_box: Floats | None  # [M, 7]; None: the truth is not shown
    detection_box: Floats  # [D, 7]
    said: Said | None  # None: nothing yet
    judged: Judged | None  # None: not compared with the truth


def replay_camera(replay: Replay) -> Camera:
    """The camera for all frames of a scored run."""
    scene = replay.scene
    seen = scene.detections
    if len(seen.box) == 0:  # an agent on true boxes needs no detections
        return camera(replay.card.has_ego, scene.ego, scene.truth.box[:, :2], scene.truth.frame_of_rows)
    return camera(replay.card.has_ego, scene.ego, seen.box[:, :2], seen.frame_of_rows)


def replay_view(replay: Replay, t: int, seen_by: Camera | None = None, at: Incident | None = None) -> FrameView:
    """Frame ``t`` of a scored run, with the events of the last EVENT_SECONDS.

    Spurious runs are too many to be marked: only ``at``, as long as it lasts.
    """
    scene, rollout, card = replay.scene, replay.rollout, replay.card
    truth, detected = scene.truth.rows(t), scene.detections.rows(t)
    evaluated = ~scene.truth.neutral[truth]
    tracks, objects = rollout.tracks.rows(t), rollout.objects.rows(t)
    events = [i for i in replay.incidents if i.kind != "spurious" and i.frame <= t]
    return FrameView(
        env_id=card.id,
        agent=replay.agent,
        scene=scene.name,
        frame=t,
        frames=scene.frames,
        seconds=float(scene.time[t] - scene.time[0]),
        viewport=(seen_by or replay_camera(replay)).at(scene.ego[t]),
        lanes=scene.lanes,
        ego=scene.ego[t] if card.has_ego else None,
        truth_box=scene.truth.box[truth][evaluated],
        detection_box=scene.detections.box[detected],
        said=said(rollout, Hypotheses(replay.alive, replay.member, replay.best, replay.parent), t, card),
        judged=Judged(
            truth_missed=(replay.truth_track[truth] < 0)[evaluated],
            detection_false=replay.detection_false[detected],
            track_false=replay.track_false[tracks][replay.shown[tracks]],
            spurious=replay.spurious[objects],
            complete=scene.truth_complete,
            counts=(int(replay.true_positives[t]), int(replay.false_negatives[t]), int(replay.false_positives[t])),
            marked=(
                *_marked(replay, [i for i in events if i.frame > t - EVENT_SECONDS * card.task.rate], t),
                *_marked_run(replay, at, t),
            ),
            log=tuple(events[: -LOG - 1 : -1]),
        ),
    )


def _marked(replay: Replay, events: Sequence[Incident], t: int) -> tuple[tuple[Incident, Floats], ...]:
    """The newest event of each object, with the place [2] of the object now, or where it was."""
    truth, rows = replay.scene.truth, replay.scene.truth.rows(t)
    place = dict(zip(truth.object_id[rows].tolist(), truth.box[rows, :2], strict=True))
    newest = {event.object_id: event for event in events}
    return tuple((event, place.get(who, np.array([event.x, event.y]))) for who, event in newest.items())


def _marked_run(replay: Replay, run: Incident | None, t: int) -> tuple[tuple[Incident, Floats], ...]:
    """A spurious run with its place [2] at frame ``t``, if it lasts until then."""
    if run is None or run.kind != "spurious" or not run.frame <= t <= run.until:
        return ()
    rollout, rows = replay.rollout, replay.rollout.objects.rows(t)
    ids = np.append(rollout.track_id, -1)[replay.object_track[rows]]
    same = replay.spurious[rows] & (ids == run.new_id) & (rollout.object_class[rows] == run.class_id)
    if run.new_id < 0:  # a forecast without a track is a run of its own
        same = np.arange(rows.start, rows.stop) == run.row
    return tuple((run, xy) for xy in rollout.object_box[rows, :2][same].astype(np.float64)[:1])


def said(rollout: Rollout, found: Hypotheses, t: int, card: Card) -> Said:
    """What ``rollout`` says at frame ``t``; trails follow the lineage of the best hypothesis."""
    rows, objects, best = rollout.tracks.rows(t), rollout.objects.rows(t), int(found.best[t])
    member = found.member[rows]
    held = member[:, best]
    center = rollout.object_box[objects, None, None, :2].astype(np.float64)
    weight = rollout.hypothesis_log_weight[t]
    return Said(
        hypotheses=int(np.isfinite(weight).sum()),
        best=best,
        weight=float(np.exp(weight[best])) if len(weight) else 0.0,
        track_box=rollout.track_box[rows][held].astype(np.float64),
        track_id=rollout.track_id[rows][held],
        trails=_trails(rollout, found, t, max(1, round(TRAIL_SECONDS * card.task.rate))),
        other_box=rollout.track_box[rows][member.any(axis=1) & ~held].astype(np.float64),
        object_box=rollout.object_box[objects].astype(np.float64),
        forecast=center + to_metres(rollout.forecast[objects]),
        forecast_weight=sample_weights(rollout.forecast_log_weight[objects]),
    )


def _trails(rollout: Rollout, found: Hypotheses, t: int, length: int) -> list[Floats]:
    """Places of the tracks of the best hypothesis of frame ``t`` in the frames before, along its lineage."""
    hypothesis = int(found.best[t])
    rows = _held(rollout, found, t, hypothesis)
    ids = rollout.track_id[rows]
    trails = [[xy] for xy in rollout.track_box[rows, :2].astype(np.float64)]
    for s in range(t - 1, max(-1, t - 1 - length), -1):
        hypothesis = int(found.parent[s + 1, hypothesis])
        rows = _held(rollout, found, s, hypothesis)
        _, now, then = np.intersect1d(ids, rollout.track_id[rows], assume_unique=True, return_indices=True)
        for i, xy in zip(now, rollout.track_box[rows[then], :2].astype(np.float64), strict=True):
            trails[i].append(xy)
    return [np.array(trail[::-1]) for trail in trails]


def _held(rollout: Rollout, found: Hypotheses, t: int, hypothesis: int) -> Ints:
    """Rows of the tracks that a hypothesis holds at frame ``t``."""
    rows = rollout.tracks.rows(t)
    return np.arange(rows.start, rows.stop)[found.member[rows, hypothesis]]


def event_text(incident: Incident) -> str:
    """An event in as few words as a marker has room for."""
    match incident.kind:
        case "ids":
            return f"ids {incident.old_id} > {incident.new_id}"
        case "lost":
            return f"lost {incident.old_id}"
        case "reacquired":
            same = incident.old_id == incident.new_id
            return f"again {incident.new_id}" if same else f"again {incident.old_id} > {incident.new_id}"
        case _:
            return f"spurious {incident.new_id}" if incident.new_id >= 0 else "spurious"

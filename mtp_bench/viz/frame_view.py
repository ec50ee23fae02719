"""Content of a bird's-eye picture of one frame: of a scored run, or of an episode while it is played."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..cards import Card
from ..scoring.forecasts import sample_weights
from ..types import Bools, Floats, Ints, Scene, to_metres
from .answers import Answers
from .focus import TRAIL_SECONDS
from .replay import Incident, Replay

EVENT_SECONDS = 1.5  # time that an event stays in the picture
LOG = 10  # events that are listed
EGO_SIZE = (4.6, 1.9, 1.6)  # m, l w h of a usual car: sources do not state the size of their vehicle


@dataclass(frozen=True, eq=False)
class FrameAnswer:
    """Answer of an agent to a frame; boxes in the frame of reference of the scene."""

    hypotheses: int  # that are alive
    weight: float  # of the heaviest, 0 to 1
    track_box: Floats  # [N, 7] of the heaviest hypothesis
    track_id: Ints  # [N]
    track_confidence: Floats  # [N] of the forecast of each, NaN without one
    trails: Sequence[Floats]  # N of [n, 2], the newest place last
    other_box: Floats  # [n, 7] tracks that only other hypotheses hold
    object_box: Floats  # [O, 7]
    forecast: Floats  # [O, K, T, 2] m, x y of the scene
    forecast_weight: Floats  # [O, K] 0 to 1


@dataclass(frozen=True, eq=False)
class FrameJudgement:
    """Judgement of a frame by the scorer."""

    tracked: Bools  # [M] true boxes with a track of the best hypothesis
    detection_false: Bools  # [D]
    track_false: Bools  # [N]
    forecast_false: Bools  # [O]
    counts: tuple[int, int, int]  # true positives, false negatives, false positives
    marked: tuple[tuple[Incident, Floats], ...]  # the newest event of each object lately, and its place [2] now
    log: tuple[Incident, ...]  # the last events, the newest first


@dataclass(frozen=True, eq=False)
class FrameView:
    """Content of a picture of one frame; boxes in the frame of reference of the scene."""

    scene: Scene
    card: Card
    frame: int
    answer: FrameAnswer | None  # None before the first answer
    judgement: FrameJudgement | None = None  # None: not compared with the truth
    agent: str = ""
    truth_shown: bool = True

    @property
    def truth_box(self) -> Floats:
        """True boxes [M, 7] of the evaluated classes."""
        truth, rows = self.scene.truth, self.scene.truth.rows(self.frame)
        return truth.box[rows][~truth.neutral[rows]]

    @property
    def detection_box(self) -> Floats:
        """Detected boxes [D, 7]."""
        return self.scene.detections.box[self.scene.detections.rows(self.frame)]

    @property
    def ego(self) -> Floats | None:
        """Pose [4] of the vehicle that carries the sensors; None without a vehicle."""
        return self.scene.ego[self.frame] if self.card.has_ego else None


def ego_boxes(ego: Floats) -> Floats:
    """Boxes [F, 7] of the vehicle at the poses ``ego`` [F, 4]."""
    return np.concatenate([ego, np.broadcast_to(EGO_SIZE, (len(ego), 3))], axis=1)


def replay_view(replay: Replay, t: int) -> FrameView:
    """Frame ``t`` of a scored run, with the events of the last EVENT_SECONDS, but not the many false forecasts."""
    scene, rows = replay.scene, replay.scene.truth.rows(t)
    truth, tracks = scene.truth, replay.rollout.tracks.rows(t)
    tp, fn, fp = (int(series[t]) for series in replay.counts.values())
    place = dict(zip(truth.object_id[rows].tolist(), truth.box[rows, :2], strict=True))
    recent = replay.recent(t, EVENT_SECONDS * replay.card.task.rate)
    judgement = FrameJudgement(
        tracked=(replay.truth_track[rows] >= 0)[~truth.neutral[rows]],
        detection_false=replay.detection_false[scene.detections.rows(t)],
        track_false=replay.track_false[tracks][replay.answers.shown[tracks]],
        forecast_false=replay.forecast_false[replay.rollout.objects.rows(t)],
        counts=(tp, fn, fp),
        marked=tuple((event, place.get(event.object_id, np.array(event.position[:2]))) for event in recent),
        log=tuple(event for event in reversed(replay.events) if event.frame <= t)[:LOG],
    )
    return FrameView(scene, replay.card, t, answer_at(replay.answers, t), judgement, replay.agent)


def answer_at(answers: Answers, t: int) -> FrameAnswer:
    """The answer to frame ``t`` of ``answers``; trails follow the lineage of the best hypothesis."""
    rollout, hypotheses = answers.rollout, answers.hypotheses
    rows, objects, best = rollout.tracks.rows(t), rollout.objects.rows(t), int(hypotheses.best[t])
    shown, member = answers.shown[rows], hypotheses.member[rows]
    center = rollout.object_box[objects, None, None, :2].astype(np.float64)
    weight = rollout.hypothesis_log_weight[t]
    length = max(1, round(TRAIL_SECONDS * answers.card.task.rate))
    past = answers.past(rows.start + np.flatnonzero(shown), best, min(t, length))
    return FrameAnswer(
        hypotheses=int(np.isfinite(weight).sum()),
        weight=float(np.exp(weight[best])) if len(weight) else 0.0,
        track_box=rollout.track_box[rows][shown].astype(np.float64),
        track_id=rollout.track_id[rows][shown],
        track_confidence=answers.track_confidence[rows][shown],
        trails=[rollout.track_box[np.unique(row), :2].astype(np.float64) for row in past],
        other_box=rollout.track_box[rows][member.any(axis=1) & ~shown].astype(np.float64),
        object_box=rollout.object_box[objects].astype(np.float64),
        forecast=center + to_metres(rollout.forecast[objects]),
        forecast_weight=sample_weights(rollout.forecast_log_weight[objects]),
    )


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
            return f"false forecast {incident.new_id}" if incident.new_id >= 0 else "false forecast"


def track_text(track_id: int, confidence: float) -> str:
    """The number of a track, and the confidence of its object if there is one below 99.5 %."""
    return f"{track_id} {100 * confidence:.0f}%" if confidence < 0.995 else str(track_id)

"""A scored run of one scene, row by row: the input of every drawing.

It has the scorer's own matching and events.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..core import Bools, Floats, Ints, Rollout, RolloutError, Scene, require_known
from ..doubts import Doubt
from ..env import LiveEpisode, true_ids
from ..scoring import (
    EVENT_KINDS,
    PART_NAMES,
    PARTS,
    Candidates,
    RecordedForecasts,
    SceneParts,
    absent_causes,
    blame,
    check_rollout,
    evaluated,
    event_pairs,
    find_targets,
    gated_pairs,
    keep_columns,
    lineage_events,
    live_frames,
    match_by_confidence,
    match_hypotheses,
    match_neutral_last,
    named_parts,
    object_history,
    pieces,
    plain_parts,
    separated_truth,
    unlabelled,
)
from ..sources import CameraImage
from .answers import Answers
from .doubted import blamed_parts, doubt_numbers
from .incident import MOMENT, Incident, numbered

# m, l w h of a usual car: only drives state the size of their vehicle
EGO_SIZE = (4.6, 1.9, 1.6)


@dataclass(frozen=True, eq=False)
class Replay:
    """The answers of an agent on a scene, beside their judgement by the scorer.

    Rows are those of ``scene.truth`` [R], ``scene.detections`` [D], the rollout's
    tracks [N] and forecast objects [O], over all frames. Boxes are matched in ``frame``
    mode inside the gates of the card, evaluated truth first. Neutral truth may take the
    rest, which is then neither right nor wrong. Forecasts are false in live frames
    alone, and not where labels cannot confirm objects. Without complete truth nothing
    is false.
    """

    scene: Scene
    answers: Answers
    truth_track: Ints  # [R] row of the best hypothesis's track of each true box, or -1
    track_false: Bools  # [N] in the best hypothesis, and of no true object
    detection_false: Bools  # [D] false positives, by the event gate
    forecast_false: Bools  # [O] by the forecast gate, every forecast kept
    truth_forecast: Ints  # [R] row of the forecast matched to each true box, or -1
    # [R, 2] minADE (m) and confidence of the forecast of each true box, or NaN
    worth: Floats
    # [R, len(PARTS)] m, parts of the error of each true box; NaN: not a target
    part: Floats
    doubts: Sequence[Doubt] = ()  # about the data of the scene, the gravest first
    mean_blame_m: float = 0.0  # m, mean blame of a target of the run
    unsplit: str = ""  # why the error of forecasts is "rest"; empty: it is split
    thresholds: Floats | None = None  # [b] least confidence that each budget keeps
    incidents: tuple[Incident, ...] = ()  # in the order of frames
    agent: str = ""  # name
    images: tuple[CameraImage, ...] = ()  # of the cameras, for pictures of events
    first: int = 0  # frame of the scene in which the answers begin
    judged: bool = True  # False: the answers are not compared with the truth

    @classmethod
    def of_episode(cls, episode: LiveEpisode, back: int) -> "Replay":
        """Return the last ``back`` + 1 frames of an episode, without judgement."""
        first = max(0, episode.frame - back)
        scene = episode.scene
        rollout = episode.rollout(first)
        # 0, not -1: boxes that are not compared are not drawn as missed
        unjudged = np.zeros(len(scene.truth.box), dtype=np.int64)
        return cls(
            scene=scene,
            answers=Answers(rollout, episode.card),
            truth_track=unjudged,
            track_false=np.zeros(len(rollout.track_id), dtype=bool),
            detection_false=np.zeros(len(scene.detections.box), dtype=bool),
            forecast_false=np.zeros(len(rollout.object_box), dtype=bool),
            truth_forecast=unjudged,
            worth=np.full((len(unjudged), 2), np.nan),
            part=np.full((len(unjudged), len(PARTS)), np.nan),
            first=first,
            judged=False,
        )

    @property
    def rollout(self) -> Rollout:
        """The answers as a rollout."""
        return self.answers.rollout

    @property
    def card(self) -> Card:
        """The rules."""
        return self.answers.card

    def class_noun(self, class_id: int) -> str:
        """Return the name of a class in words."""
        return self.card.task.classes[class_id].replace("_", " ")

    def object_name(self, object_id: int, class_id: int) -> str:
        """Return the name of an object: "car 8" or "car c1958768"."""
        return f"{self.class_noun(class_id)} {self.scene.short_name(object_id)}"

    @property
    def frames(self) -> int:
        """Number of frames F."""
        return self.scene.frames

    @property
    def ego_boxes(self) -> Floats:
        """Boxes [F, 7] of the vehicle."""
        size_m = np.tile(EGO_SIZE, (self.frames, 1))
        if self.rollout.drive is not None:
            size_m[:, :2] = self.rollout.drive.size
        return np.concatenate([self.scene.ego, size_m], axis=1)

    @cached_property
    def matched(self) -> NDArray[np.intp]:
        """Row [R, H] of the track of each true box, by hypothesis.

        It is -1 without one and for neutral boxes.
        """
        member = self.answers.hypotheses.member
        return match_hypotheses(self.scene.truth, self.rollout, member, self.card)

    @cached_property
    def detected(self) -> Ints:
        """Id [D] of the true object of each detection, or -1.

        Both are matched one-to-one, inside the forecast gate.
        """
        table = self.scene.detections
        return true_ids(
            self.scene, table.frame_of_rows, table.box, table.class_id, self.card
        )

    @cached_property
    def events(self) -> tuple[Incident, ...]:
        """The incidents that are events of a true object."""
        return tuple(event for event in self.incidents if event.kind != "spurious")

    def incident(self, name: str) -> Incident:
        """Return the incident of this name.

        Raises UnknownNameError without it.
        """
        incidents = {incident.name: incident for incident in self.incidents}
        kind = f"event of scene {self.scene.name}"
        require_known(kind, name, incidents, "`mtp-bench events` lists them")
        return incidents[name]

    @cached_property
    def previous(self) -> Ints:
        """Row [R] of each object in the frame before.

        It is -1 without one and across a hole in time.
        """
        truth = separated_truth(self.scene, self.card)
        return object_history(truth, self.scene.annotated_place).previous()

    def moment(self, row: int) -> Incident:
        """Return a true box as an incident without an event."""
        truth = self.scene.truth
        track_ids = np.append(self.rollout.track_id, -1)
        frame = int(np.searchsorted(truth.start, row, side="right")) - 1
        object_id = int(truth.object_id[row])
        row_before = int(self.previous[row])
        old_id = -1
        error_before = None
        if row_before >= 0:
            old_id = int(track_ids[self.truth_track[row_before]])
            error_before = _finite(self.part[row_before].sum())
        is_target = np.isfinite(self.part[row, 0])
        return Incident(
            kind=MOMENT,
            frame=frame,
            until=frame,
            row=row,
            class_id=int(truth.class_id[row]),
            position=_position(truth.box[row]),
            name=f"{self.scene.short_name(object_id)}@{frame}",
            object_id=object_id,
            old_id=old_id,
            new_id=int(track_ids[self.truth_track[row]]),
            minADE=_finite(self.worth[row, 0]),
            parts=named_parts(self.part[row]) if is_target else None,
            error_before=error_before,
            confidence=_finite(self.worth[row, 1]),
        )

    def ego_distance(self, t: int, place: Floats) -> float | None:
        """Return the distance of a ``place`` [2] to the ego, m.

        None without an ego.
        """
        if not self.card.has_ego:
            return None
        return float(np.hypot(*(place - self.scene.ego[t, :2])))

    def recent(self, t: int, frames: float) -> list[Incident]:
        """Return each object's newest event in the ``frames`` until ``t``."""
        newest = {}
        for event in self.events:
            if t - frames < event.frame <= t:
                newest[event.object_id] = event
        return list(newest.values())


def replay(
    scene: Scene,
    rollout: Rollout,
    card: Card,
    agent: str = "",
    parts: SceneParts | None = None,
    doubts: Sequence[Doubt] = (),
) -> Replay:
    """Return the run of a scene with its judgement.

    ``parts``: those of the errors of its targets, in their order. If None, those of
    forecasts are not split. ``doubts`` about the scene take the blame of targets that
    they touch. Raises RolloutError for a rollout of another scene or another number of
    frames or classes.
    """
    check_rollout(scene, rollout, card)
    scene = evaluated(scene)
    truth = scene.truth
    detections = scene.detections
    answers = Answers(rollout, card)
    chosen = np.flatnonzero(answers.shown)
    track_pairs = event_pairs(truth, rollout, card)
    track_pairs = keep_columns(track_pairs, chosen, len(answers.shown))
    track_matches = match_neutral_last(track_pairs, truth.neutral, len(chosen))
    detection_pairs = gated_pairs(
        truth, detections.start, detections.box, detections.class_id, card
    )
    detection_matches = match_neutral_last(
        detection_pairs, truth.neutral, len(detections.box)
    )
    worth, parts, truth_forecast, forecast_false = _forecasts(
        scene, rollout, card, parts
    )
    doubt = doubt_numbers(doubts, card, truth.frame_of_rows, truth.object_id)
    track_false = answers.shown & ~unlabelled(
        scene, rollout.tracks.frame_of_rows, rollout.track_box[:, :2]
    )
    track_false[chosen] &= track_matches.unmatched
    detection_false = detection_matches.unmatched & ~unlabelled(
        scene, detections.frame_of_rows, detections.box[:, :2]
    )
    judged = Replay(
        scene=scene,
        answers=answers,
        agent=agent,
        truth_track=np.append(chosen, -1)[track_matches.object_of_truth],
        track_false=track_false & scene.truth_complete,
        detection_false=detection_false & scene.truth_complete,
        forecast_false=forecast_false & scene.truth_complete,
        truth_forecast=truth_forecast,
        worth=worth,
        part=blamed_parts(parts.part, doubt >= 0),
        doubts=doubts,
        mean_blame_m=parts.usual,
        unsplit=parts.unsplit,
        thresholds=parts.thresholds,
    )
    incidents = [*_identity_events(judged), *_false_runs(judged), *_collisions(judged)]
    return replace(judged, incidents=numbered(incidents))


def _forecasts(
    scene: Scene, rollout: Rollout, card: Card, parts: SceneParts | None
) -> tuple[Floats, SceneParts, Ints, Bools]:
    """Judge the forecasts of a rollout.

    Returns worth [R, 2], parts and row [R] of the forecast of each true box, and the
    false forecasts [O]. Raises RolloutError if ``parts`` are of other targets.
    """
    targets = find_targets(scene, card)
    recorded = RecordedForecasts.of(rollout)
    pairs = Candidates.of(scene, targets, recorded, live_frames(scene, card), card)
    matching = match_by_confidence(pairs, rollout.object_confidence)
    errors, forecast = pairs.final_errors(matching)
    if parts is None:
        max_error = np.asarray(card.per_class(card.task.miss_error))[targets.class_id]
        cause = np.where(errors.covered, -1, absent_causes(scene, targets, card))
        plain_part = plain_parts(np.minimum(errors.min_ade, max_error), cause)
        mean_blame_m = float(blame(plain_part).mean()) if len(plain_part) else 0.0
        parts = SceneParts(plain_part, mean_blame_m, targets.distance)
    if not np.array_equal(parts.distance, targets.distance):
        raise RolloutError(
            f"scene {scene.name!r} has other targets than when its run was scored: run "
            "the agent again"
        )
    worth = np.full((len(scene.truth.box), 2), np.nan)
    worth[targets.row, 0] = np.where(errors.covered, errors.min_ade, np.nan)
    worth[:, 1] = np.append(rollout.object_confidence, np.nan)[forecast]
    part = np.full((len(scene.truth.box), len(PART_NAMES)), np.nan)
    part[targets.row] = parts.part
    if not len(rollout.object_box):  # no other stage is to blame
        missed_m = blame(part)
        part[targets.row] = 0.0
        part[:, list(PART_NAMES).index("no_forecast")] = missed_m
    return worth, parts._replace(part=part), forecast, matching.false


def _identity_events(judged: Replay) -> list[Incident]:
    """List switches, losses and re-acquisitions."""
    rollout = judged.rollout
    hypotheses = judged.answers.hypotheses
    frame = judged.scene.truth.frame_of_rows
    truth = separated_truth(judged.scene, judged.card)
    annotated = judged.scene.annotated_frames
    lineage = lineage_events(truth, rollout, hypotheses, judged.matched, annotated)
    events = lineage.of(hypotheses.best[frame])
    track_ids = np.append(rollout.track_id, -1)  # row -1: no track
    incidents = []
    for kind in EVENT_KINDS:
        for row in np.flatnonzero(getattr(events, kind)[:, 0]).tolist():
            old_id = int(track_ids[events.old[row, 0]])
            wrong = bool(events.wrong[row, 0])
            event = replace(judged.moment(row), kind=kind, old_id=old_id, wrong=wrong)
            incidents.append(event)
    return incidents


def _false_runs(judged: Replay) -> list[Incident]:
    """List runs of false forecasts of one track.

    A forecast without a track stands alone.
    """
    rollout = judged.rollout
    frame = rollout.objects.frame_of_rows
    track_id = judged.answers.object_track_id
    row = np.flatnonzero(judged.forecast_false)
    row = row[np.lexsort((frame[row], track_id[row], rollout.object_class[row]))]
    classes = rollout.object_class[row]
    tracks = track_id[row]
    frames = frame[row]
    # over a hole in time a step is more than 1
    scene = judged.scene
    step = np.diff(scene.annotated_place[frames])
    step += np.diff(pieces(scene, judged.card)[frames])
    same_track = (np.diff(tracks) == 0) & (tracks[1:] >= 0)
    is_break = ~same_track | (np.diff(classes) != 0) | (step != 1)
    runs = np.split(np.arange(len(row)), np.flatnonzero(is_break) + 1)
    return [
        Incident(
            kind="spurious",
            frame=int(frames[span[0]]),
            until=int(frames[span[-1]]),
            row=int(row[span[0]]),
            class_id=int(classes[span[0]]),
            position=_position(rollout.object_box[row[span[0]]]),
            new_id=int(tracks[span[0]]),
            confidence=float(rollout.object_confidence[row[span]].max()),
        )
        for span in runs
        if len(span)
    ]


def _collisions(judged: Replay) -> list[Incident]:
    """List the collision of the ego, in the last frame before it."""
    drive = judged.rollout.drive
    if drive is None:
        return []
    rows = np.flatnonzero(judged.scene.truth.object_id == drive.hit)[-1:]
    return [replace(judged.moment(row), kind="collision") for row in rows.tolist()]


def _position(box: Floats) -> tuple[float, float, float]:
    return float(box[0]), float(box[1]), float(box[2])


def _finite(value: float) -> float | None:
    return None if np.isnan(value) else float(value)

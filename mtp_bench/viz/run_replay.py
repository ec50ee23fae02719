"""A scored run of one scene, row by row, with the scorer's own matching and events: the input of every drawing."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..core import Bools, Floats, Ints, Rollout, RolloutError, Scene, require_known
from ..env import LiveEpisode, true_ids
from ..scoring import (
    PARTS,
    Candidates,
    RecordedForecasts,
    SceneParts,
    absent_causes,
    blame,
    capped_error,
    check_rollout,
    evaluated,
    event_pairs,
    find_targets,
    gated_pairs,
    lineage_events,
    live_frames,
    match_by_confidence,
    match_hypotheses,
    match_neutral_last,
    named_parts,
    object_history,
    of_columns,
    pieces,
    plain_parts,
    separated_truth,
)
from ..sources import CameraImage
from .answers import Answers
from .incident import MOMENT, Incident, named

EGO_SIZE = (
    4.6,
    1.9,
    1.6,
)  # m, l w h of a usual car: sources do not state the size of their vehicle


@dataclass(frozen=True, eq=False)
class Replay:
    """The answers of an agent on a scene, beside their judgement by the scorer.

    Rows are those of ``scene.truth`` [R], ``scene.detections`` [D], the rollout's tracks [N] and forecast objects [O],
    over all frames. Boxes are matched in ``frame`` mode inside the gates of the card, evaluated truth first; neutral
    truth may take the rest, which is then neither right nor wrong. Forecasts are false in live frames alone, and not
    where labels cannot confirm objects. Without complete truth nothing is false.
    """

    scene: Scene
    answers: Answers
    truth_track: Ints  # [R] track of the best hypothesis matched to each true box, -1 without one
    track_false: Bools  # [N] in the best hypothesis, and of no true object
    detection_false: Bools  # [D] false positives, by the event gate
    forecast_false: Bools  # [O] by the forecast gate, every forecast kept
    truth_forecast: Ints  # [R] forecast object matched to each true box, every forecast kept, -1 without one
    worth: Floats  # [R, 2] minADE (m) and confidence of the forecast of each true box, or NaN
    part: Floats  # [R, len(PARTS)] m, of the error of each true box; NaN: not a target
    usual: float = 0.0  # m, mean blame of a target of the run
    unsplit: str = ""  # reason why the error of forecasts is "rest"; empty: it is split
    thresholds: Floats | None = (
        None  # [b] least confidence that each budget of the run keeps; None: not known
    )
    incidents: tuple[Incident, ...] = ()  # in the order of frames
    agent: str = ""  # name
    images: tuple[CameraImage, ...] = ()  # of the cameras, for pictures of events
    first: int = 0  # frame of the scene in which the answers begin
    judged: bool = True  # False: the answers are not compared with the truth

    @classmethod
    def of_episode(cls, episode: LiveEpisode, back: int) -> "Replay":
        """The last ``back`` + 1 frames of an episode while it is played, which are not compared with the truth."""
        first = max(0, episode.frame - back)
        scene, rollout = episode.scene, episode.rollout(first)
        truth = np.zeros(len(scene.truth.box), dtype=np.int64)
        return cls(
            scene=scene,
            answers=Answers(rollout, episode.card),
            truth_track=truth,
            track_false=np.zeros(len(rollout.track_id), dtype=bool),
            detection_false=np.zeros(len(scene.detections.box), dtype=bool),
            forecast_false=np.zeros(len(rollout.object_box), dtype=bool),
            truth_forecast=truth,
            worth=np.full((len(truth), 2), np.nan),
            part=np.full((len(truth), len(PARTS)), np.nan),
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

    @property
    def frames(self) -> int:
        """Number of frames F."""
        return self.scene.frames

    @cached_property
    def matched(self) -> NDArray[np.intp]:
        """Track [R, H] of every hypothesis matched to each true box, -1 without one and for neutral boxes."""
        return match_hypotheses(
            self.scene.truth, self.rollout, self.answers.hypotheses.member, self.card
        )

    @cached_property
    def detected(self) -> Ints:
        """True object [D] that each detection is matched to, one-to-one inside the forecast gate, -1 for none."""
        seen = self.scene.detections
        return true_ids(
            self.scene, seen.frame_of_rows, seen.box, seen.class_id, self.card
        )

    @cached_property
    def events(self) -> tuple[Incident, ...]:
        """The incidents that are events of a true object, not runs of false forecasts."""
        return tuple(
            incident for incident in self.incidents if incident.kind != "spurious"
        )

    @cached_property
    def counts(self) -> dict[str, Ints]:
        """True positives, false negatives and false positives of the best hypothesis in each frame: TP, FN, FP [F]."""
        evaluated, tracked = ~self.scene.truth.neutral, self.truth_track >= 0
        frame, track_frame = (
            self.scene.truth.frame_of_rows,
            self.rollout.tracks.frame_of_rows,
        )
        rows = (
            frame[evaluated & tracked],
            frame[evaluated & ~tracked],
            track_frame[self.track_false],
        )
        counts = [np.bincount(each, minlength=self.frames) for each in rows]
        return dict(zip(("TP", "FN", "FP"), counts, strict=True))

    def incident(self, name: str) -> Incident:
        """The incident of this name; raises UnknownNameError."""
        incidents = {incident.name: incident for incident in self.incidents}
        require_known(
            f"event of scene {self.scene.name}",
            name,
            incidents,
            "`mtp-bench events` lists them",
        )
        return incidents[name]

    @cached_property
    def previous(self) -> Ints:
        """Row [R] of the same object in the frame before each true box, -1 without one or across a hole in time."""
        return object_history(separated_truth(self.scene, self.card)).previous()

    def moment(self, row: int) -> Incident:
        """The object of a true box in its frame, without an event."""
        truth, track_id, before = (
            self.scene.truth,
            np.append(self.rollout.track_id, -1),
            int(self.previous[row]),
        )
        frame, object_id = (
            int(np.searchsorted(truth.start, row, side="right")) - 1,
            int(truth.object_id[row]),
        )
        error_before = self.part[before].sum() if before >= 0 else np.nan
        return Incident(
            kind=MOMENT,
            frame=frame,
            until=frame,
            row=row,
            class_id=int(truth.class_id[row]),
            position=_position(truth.box[row]),
            name=f"{self.scene.short_name(object_id)}@{frame}",
            object_id=object_id,
            old_id=int(track_id[self.truth_track[before]]) if before >= 0 else -1,
            new_id=int(track_id[self.truth_track[row]]),
            minADE=known(self.worth[row, 0]),
            parts=None if np.isnan(self.part[row, 0]) else named_parts(self.part[row]),
            error_before=known(error_before),
            confidence=known(self.worth[row, 1]),
        )

    def recent(self, t: int, frames: float) -> list[Incident]:
        """The newest event of each object in the last ``frames`` frames until frame ``t``."""
        return list(
            {e.object_id: e for e in self.events if t - frames < e.frame <= t}.values()
        )


def replay(
    scene: Scene,
    rollout: Rollout,
    card: Card,
    agent: str = "",
    parts: SceneParts | None = None,
) -> Replay:
    """The run of a scene with its judgement.

    ``parts``: of the errors of its targets, in their order; None: of their plain errors, without references.
    Raises RolloutError for a rollout of another scene or another number of frames or classes.
    """
    check_rollout(scene, rollout, card)
    scene = evaluated(scene)
    truth, detected = scene.truth, scene.detections
    answers = Answers(rollout, card)
    chosen = np.flatnonzero(answers.shown)
    of_track = match_neutral_last(
        of_columns(event_pairs(truth, rollout, card), chosen, len(answers.shown)),
        truth.neutral,
        len(chosen),
    )
    detection_pairs = gated_pairs(
        truth, detected.start, detected.box, detected.class_id, card
    )
    of_detection = match_neutral_last(detection_pairs, truth.neutral, len(detected.box))
    worth, parts, truth_forecast, forecast_false = _forecasts(
        scene, rollout, card, parts
    )
    track_false = answers.shown.copy()
    track_false[chosen] = of_track.unmatched
    run = Replay(
        scene=scene,
        answers=answers,
        agent=agent,
        truth_track=np.append(chosen, -1)[of_track.object_of_truth],
        track_false=track_false & scene.truth_complete,
        detection_false=of_detection.unmatched & scene.truth_complete,
        forecast_false=forecast_false & scene.truth_complete,
        truth_forecast=truth_forecast,
        worth=worth,
        part=parts.part,
        usual=parts.usual,
        unsplit=parts.unsplit,
        thresholds=parts.thresholds,
    )
    return replace(
        run,
        incidents=named([*_identity_incidents(run), *_runs(run), *_collisions(run)]),
    )


def ego_boxes(ego: Floats) -> Floats:
    """Boxes [F, 7] of the vehicle at the poses ``ego`` [F, 4]."""
    return np.concatenate([ego, np.broadcast_to(EGO_SIZE, (len(ego), 3))], axis=1)


def _forecasts(
    scene: Scene, rollout: Rollout, card: Card, parts: SceneParts | None
) -> tuple[Floats, SceneParts, Ints, Bools]:
    """Worth [R, 2], parts and row [R] of the forecast of each true box, and the false forecasts [O].

    Raises RolloutError if ``parts`` are of other targets.
    """
    targets = find_targets(scene, card)
    pairs = Candidates.of(
        scene, targets, RecordedForecasts.of(rollout), live_frames(scene, card), card
    )
    matching = match_by_confidence(pairs, rollout.object_confidence)
    errors, forecast = pairs.final_errors(matching)
    if parts is None:
        worst = np.asarray(card.per_class(card.task.miss_error))[targets.class_id]
        cause = np.where(errors.covered, -1, absent_causes(scene, targets, card))
        plain = plain_parts(capped_error(errors.min_ade, worst), cause)
        parts = SceneParts(
            plain, float(blame(plain).mean()) if len(plain) else 0.0, targets.distance
        )
    if not np.array_equal(parts.distance, targets.distance):
        raise RolloutError(
            f"scene {scene.name!r} has other targets than when its run was scored: run the agent again"
        )
    worth, part = (
        np.full((len(scene.truth.box), size), np.nan) for size in (2, len(PARTS))
    )
    worth[targets.row, 0] = np.where(errors.covered, errors.min_ade, np.nan)
    worth[:, 1] = np.append(rollout.object_confidence, np.nan)[forecast]
    part[targets.row] = parts.part
    return worth, parts._replace(part=part), forecast, matching.false


def _identity_incidents(run: Replay) -> list[Incident]:
    """Switches, losses and re-acquisitions."""
    truth, rollout, hypotheses = run.scene.truth, run.rollout, run.answers.hypotheses
    frame, separate = truth.frame_of_rows, separated_truth(run.scene, run.card)
    events = lineage_events(separate, rollout, hypotheses, run.matched).of(
        hypotheses.best[frame]
    )
    track_id = np.append(rollout.track_id, -1)  # row -1: no track
    return [
        replace(
            run.moment(int(row)),
            kind=kind,
            old_id=int(track_id[events.old[row, 0]]),
            wrong=bool(events.wrong[row, 0]),
        )
        for kind in ("ids", "lost", "reacquired")
        for row in np.flatnonzero(getattr(events, kind)[:, 0])
    ]


def _runs(run: Replay) -> list[Incident]:
    """Runs of false forecasts: of one track in consecutive frames; a forecast without a track stands alone."""
    rollout = run.rollout
    frame, track_id = rollout.objects.frame_of_rows, run.answers.object_track_id
    row = np.flatnonzero(run.forecast_false)
    row = row[np.lexsort((frame[row], track_id[row], rollout.object_class[row]))]
    classes, tracks, frames = rollout.object_class[row], track_id[row], frame[row]
    step = np.diff(frames) + np.diff(
        pieces(run.scene, run.card)[frames]
    )  # over a hole in time more than 1
    continues = (
        (np.diff(classes) == 0)
        & (np.diff(tracks) == 0)
        & (step == 1)
        & (tracks[1:] >= 0)
    )
    first = np.flatnonzero(np.append(True, ~continues)[: len(row)])
    last = np.append(first[1:], len(row))[: len(first)] - 1
    return [
        Incident(
            kind="spurious",
            frame=int(frames[i]),
            until=int(frames[j]),
            row=int(row[i]),
            class_id=int(classes[i]),
            position=_position(rollout.object_box[row[i]]),
            new_id=int(tracks[i]),
            confidence=float(rollout.object_confidence[row[i : j + 1]].max()),
        )
        for i, j in zip(first, last, strict=True)
    ]


def _collisions(run: Replay) -> list[Incident]:
    """The collision of the ego of a closed loop, in the last frame before it."""
    truth, drive = run.scene.truth, run.rollout.drive
    rows = (
        []
        if drive is None
        else np.flatnonzero(truth.object_id == drive.hit)[-1:].tolist()
    )
    return [replace(run.moment(row), kind="collision") for row in rows]


def _position(box: Floats) -> tuple[float, float, float]:
    return float(box[0]), float(box[1]), float(box[2])


def known(value: float) -> float | None:
    """A number, with None for NaN."""
    return None if np.isnan(value) else float(value)

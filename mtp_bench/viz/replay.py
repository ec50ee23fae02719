"""A scored run of one scene, row by row: what every drawing reads, with the judge's own matching and events."""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import replace as changed

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..errors import UnknownNameError
from ..scoring.definitions import FALSE_FORECAST_SHARE
from ..scoring.forecasts import ForecastErrors, forecast_errors, match_neutral_last, match_objects
from ..scoring.lineage import LineageEvents, event_pairs, gated_pairs, hypotheses, lineage_events, match_hypotheses
from ..scoring.matching import columns_to_rows, match
from ..scoring.pairs import Rows, box_pairs, of_columns
from ..scoring.score import check_rollout
from ..scoring.targets import Targets, find_targets
from ..types import Bools, Floats, Ints, Rollout, Scene

KINDS = ("ids", "lost", "reacquired", "spurious")


@dataclass(frozen=True)
class Incident:
    """One event of the best hypothesis along its lineage, or a run of forecasts of nothing by one track."""

    name: str  # kind and number within the scene, in the order of frames: "ids-0"
    kind: str  # of KINDS
    frame: int
    until: int  # last frame: that of the event itself, but of a spurious run its end
    row: int  # of the truth; a spurious run: of its first forecast object
    object_id: int  # -1 for a spurious run
    class_id: int
    old_id: int  # track that matched the object last, before this frame; -1 none
    new_id: int  # track that matches it now; of a spurious run its own track; -1 none
    x: float  # m, of the true box or of the first spurious forecast, frame of the scene
    y: float
    z: float
    wrong: bool  # a loss whose old track is still output, but outside the gate
    error: float | None  # m, minADE of the target's forecast at this frame; None: no target, or not covered
    capped: float | None  # m, min(minADE, c), c if not covered; a spurious run: c/2 per frame; None: no target


@dataclass(frozen=True, eq=False)
class Replay:
    """What an agent said on a scene, beside what the judge made of it.

    Rows are those of ``scene.truth`` [R], ``scene.detections`` [D], ``rollout``'s tracks [N] and forecast objects [O],
    over all frames. Boxes are matched in ``frame`` mode inside the gates of the card, evaluated truth first; neutral
    truth may take what is left over, which is then neither right nor wrong. Nothing is false where the truth is not
    complete.
    """

    scene: Scene
    rollout: Rollout
    card: Card
    agent: str
    best: Ints  # [F] heaviest hypothesis of each frame
    alive: Bools  # [F, H]
    member: Bools  # [N, H] tracks of alive hypotheses
    parent: Ints  # [F, H] hypothesis of the frame before; 0 in frame 0
    shown: Bools  # [N] tracks of the best hypothesis of their frame
    matched: Ints  # [R, H] track matched to each evaluated true box in every hypothesis, -1 none
    truth_track: Ints  # [R] track of the best hypothesis matched to each true box, -1 none
    track_truth: Ints  # [N] true box of each track of the best hypothesis, -1 none
    track_false: Bools  # [N] in the best hypothesis, and of nothing
    detection_truth: Ints  # [D] true box matched to each detection inside the event gate, -1 none
    detection_false: Bools  # [D]
    object_truth: Ints  # [O] true box matched to each forecast object inside the forecast gate, -1 none
    object_track: Ints  # [O] track of the best hypothesis at the place of each forecast object, -1 none
    spurious: Bools  # [O] forecasts of nothing
    true_positives: Ints  # [F] tracks of the best hypothesis on evaluated truth
    false_negatives: Ints  # [F] evaluated true boxes without such a track
    false_positives: Ints  # [F] tracks of the best hypothesis of nothing
    targets: Targets
    errors: ForecastErrors  # per target
    incidents: tuple[Incident, ...]  # in the order of frames

    @property
    def frames(self) -> int:
        """Number of frames F."""
        return self.scene.frames

    def incident(self, name: str) -> Incident:
        """The incident of this name; raises UnknownNameError."""
        for incident in self.incidents:
            if incident.name == name:
                return incident
        raise UnknownNameError(
            f"event of scene {self.scene.name}", name, [i.name for i in self.incidents], "`mtp-bench events` lists them"
        )


def replay(scene: Scene, rollout: Rollout, card: Card, agent: str = "") -> Replay:
    """The run of a scene beside the judge's view of it.

    Raises RolloutError where the rollout is of another scene or another number of frames or classes.
    """
    check_rollout(scene, rollout, card)
    truth = scene.truth
    found = hypotheses(rollout, card)
    matched = match_hypotheses(truth, rollout, found.member, card)
    track_frame = rollout.tracks.frame_of_rows
    shown = found.member[np.arange(len(track_frame)), found.best[track_frame]]
    truth_track = _best_tracks(scene, rollout, card, shown)
    track_truth = columns_to_rows(truth_track, len(shown))
    detected = scene.detections
    detection_pairs = gated_pairs(truth, detected.start, detected.box, detected.class_id, card)
    of_detection = match_neutral_last(detection_pairs, truth.neutral, len(detected.box))
    object_frame = rollout.objects.frame_of_rows
    of_object = match_objects(truth, object_frame, rollout.object_box, rollout.object_class, card)
    spurious = of_object.unmatched & scene.truth_complete
    targets = find_targets(scene, card)
    errors = forecast_errors(targets, of_object, rollout)
    frame = truth.frame_of_rows
    events = lineage_events(truth, rollout, found, matched).of(found.best[frame])
    object_track = object_tracks(rollout, card, shown)
    false_track = shown & (track_truth < 0) & scene.truth_complete
    right = ~truth.neutral & (truth_track >= 0)
    return Replay(
        scene=scene,
        rollout=rollout,
        card=card,
        agent=agent,
        best=found.best,
        alive=found.alive,
        member=found.member,
        parent=found.parent,
        shown=shown,
        matched=matched,
        truth_track=truth_track,
        track_truth=track_truth,
        track_false=false_track,
        detection_truth=columns_to_rows(of_detection.object_of_truth, len(detected.box)),
        detection_false=of_detection.unmatched & scene.truth_complete,
        object_truth=columns_to_rows(of_object.object_of_truth, len(object_frame)),
        object_track=object_track,
        spurious=spurious,
        true_positives=np.bincount(frame[right], minlength=scene.frames),
        false_negatives=np.bincount(frame[~truth.neutral & ~right], minlength=scene.frames),
        false_positives=np.bincount(track_frame[false_track], minlength=scene.frames),
        targets=targets,
        errors=errors,
        incidents=_named(
            [
                *_identity_incidents(scene, rollout, events, truth_track, _target_errors(scene, card, targets, errors)),
                *_spurious_incidents(rollout, card, spurious, object_track),
            ]
        ),
    )


def _best_tracks(scene: Scene, rollout: Rollout, card: Card, shown: Bools) -> Rows:
    """Track [R] of the best hypothesis matched to each true box, -1 none; neutral boxes get what is left over."""
    chosen = np.flatnonzero(shown)
    pairs = of_columns(event_pairs(scene.truth, rollout, card), chosen, len(shown))
    place = match_neutral_last(pairs, scene.truth.neutral, len(chosen)).object_of_truth
    return _rows_at(chosen, place)


def object_tracks(rollout: Rollout, card: Card, shown: Bools) -> Rows:
    """Track [O] of the best hypothesis nearest to each forecast object, one-to-one inside the forecast gate; -1 none.

    An action does not say which track a forecast belongs to; drawings and lists only name it.
    """
    chosen = np.flatnonzero(shown)
    pairs = box_pairs(
        rollout.objects.frame_of_rows,
        rollout.object_box,
        rollout.object_class,
        rollout.tracks.frame_of_rows[chosen],
        rollout.track_box[chosen],
        rollout.track_class[chosen],
        "center_distance",
        card.per_class(card.task.forecast_gate),
    )
    return _rows_at(chosen, match(pairs, len(rollout.object_box)))


def _rows_at(chosen: Rows, place: Rows) -> Rows:
    """Rows at the places of ``chosen``, -1 for the place -1."""
    return np.append(chosen, -1)[place]


def _target_errors(scene: Scene, card: Card, targets: Targets, errors: ForecastErrors) -> NDArray[np.float64]:
    """MinADE and its capped form of each true box [R, 2]; NaN where it is no target, minADE also where not covered."""
    worst = np.asarray(card.per_class(card.task.miss_error))[targets.class_id]
    table = np.full((len(scene.truth.box), 2), np.nan)
    table[targets.row, 0] = np.where(errors.covered, errors.min_ade, np.nan)
    table[targets.row, 1] = np.minimum(errors.min_ade, worst)
    return table


def _identity_incidents(
    scene: Scene, rollout: Rollout, events: LineageEvents, truth_track: Ints, error: Floats
) -> list[Incident]:
    """Switches, losses and re-acquisitions; ``events`` [R, 1] of the best hypothesis, ``error`` [R, 2]."""
    truth, frame = scene.truth, scene.truth.frame_of_rows
    track_id = np.append(rollout.track_id, -1)  # row -1: no track
    return [
        Incident(
            name="",
            kind=kind,
            frame=int(frame[row]),
            until=int(frame[row]),
            row=int(row),
            object_id=int(truth.object_id[row]),
            class_id=int(truth.class_id[row]),
            old_id=int(track_id[events.old[row, 0]]),
            new_id=int(track_id[truth_track[row]]),
            x=float(truth.box[row, 0]),
            y=float(truth.box[row, 1]),
            z=float(truth.box[row, 2]),
            wrong=bool(events.wrong[row, 0]),
            error=_known(error[row, 0]),
            capped=_known(error[row, 1]),
        )
        for kind in ("ids", "lost", "reacquired")
        for row in np.flatnonzero(getattr(events, kind)[:, 0])
    ]


def _spurious_incidents(rollout: Rollout, card: Card, spurious: Bools, object_track: Ints) -> list[Incident]:
    """Runs of forecasts of nothing: of one track in consecutive frames; a forecast without a track stands alone."""
    cost = FALSE_FORECAST_SHARE * np.asarray(card.per_class(card.task.miss_error))
    frame, track_id = rollout.objects.frame_of_rows, np.append(rollout.track_id, -1)[object_track]
    row = np.flatnonzero(spurious)
    row = row[np.lexsort((frame[row], track_id[row], rollout.object_class[row]))]
    kind, who, when = rollout.object_class[row], track_id[row], frame[row]
    goes_on = (np.diff(kind) == 0) & (np.diff(who) == 0) & (np.diff(when) == 1) & (who[1:] >= 0)
    first = np.flatnonzero(np.append(True, ~goes_on)[: len(row)])
    last = np.append(first[1:], len(row))[: len(first)] - 1
    return [
        Incident(
            name="",
            kind="spurious",
            frame=int(when[i]),
            until=int(when[j]),
            row=int(row[i]),
            object_id=-1,
            class_id=int(kind[i]),
            old_id=-1,
            new_id=int(who[i]),
            x=float(rollout.object_box[row[i], 0]),
            y=float(rollout.object_box[row[i], 1]),
            z=float(rollout.object_box[row[i], 2]),
            wrong=False,
            error=None,
            capped=float(cost[kind[i]] * (j - i + 1)),
        )
        for i, j in zip(first, last, strict=True)
    ]


def _known(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def _named(incidents: list[Incident]) -> tuple[Incident, ...]:
    """The incidents in the order of frames, kinds and rows, each with its name."""
    ordered = sorted(incidents, key=lambda i: (i.frame, KINDS.index(i.kind), i.row))
    count: dict[str, int] = dict.fromkeys(KINDS, 0)
    named = []
    for incident in ordered:
        named.append(changed(incident, name=f"{incident.kind}-{count[incident.kind]}"))
        count[incident.kind] += 1
    return tuple(named)

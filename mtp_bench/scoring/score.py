"""Score of one scene: arrays per target and counts, small enough to send between processes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..cards import Card
from ..errors import RolloutError
from ..types import Bools, Floats, Ints, Rollout, Scene
from .error import capped_error, false_forecast_error
from .forecasts import ForecastErrors, forecast_errors, match_objects
from .lineage import hypotheses, lineage_events, match_hypotheses
from .stream import StreamCounts, stream_counts
from .subsets import event_keys
from .targets import find_targets

KINDS = ("ids", "lost", "wrong", "reacquired")


@dataclass(frozen=True, eq=False)
class SceneScore(ForecastErrors):
    """One rollout of one scene: errors of its forecasts and what else is known, in the order of `find_targets`."""

    scene: str
    frames: int
    hypotheses: int  # the most that were stated in a frame
    samples: int  # K
    truth_complete: bool
    detections: str  # what made them, in words
    classes: tuple[str, ...]
    frame: Ints  # [n]
    object_id: Ints  # [n]
    class_id: Ints  # [n]
    key: Ints  # [n] name of (env, scene, object, frame), see subsets
    distance: Floats  # [n] m to the ego
    approach: Floats  # [n] m, nearest to the ego in the future
    moving: Bools  # [n]
    miss_error: Floats  # [n] m, c
    capped: Floats  # [n] m, min(min_ade, c), c where not covered
    own_ids: Bools  # [n] along the lineage of the best hypothesis
    own_frag: Bools  # [n]
    all_h_ids: Bools  # [n] in every hypothesis
    all_h_frag: Bools  # [n]
    truth_key: Ints  # [rows] of all evaluated true boxes, targets or not
    events: dict[str, Ints]  # own events on all true boxes, by KINDS; "wrong" are among the "lost": keys [E]
    forecasts: int  # objects that were forecast, over all frames
    false_forecasts: Ints  # [F] those that match no true object
    false_of_class: Ints  # [C] the same per class
    false_error: float  # m, c/2 summed over them; 0 where the truth is not complete
    counts: StreamCounts
    invalid: Ints  # [3] rows rejected: tracks, hypotheses, objects
    dropped: int  # detections that did not fit into the observation
    skipped: dict[str, int]  # rows of the scene that could not be read, by reason
    seconds: float  # per frame, mean; the first frame, in which code is loaded, is left out of it

    def __len__(self) -> int:
        return len(self.frame)


def score_scene(scene: Scene, rollout: Rollout, card: Card) -> SceneScore:
    """Score ``rollout`` of ``scene`` under the rules of ``card``.

    Raises RolloutError where the rollout is of another scene or another number of frames or classes.
    """
    check_rollout(scene, rollout, card)
    truth, targets = scene.truth, find_targets(scene, card)
    object_frame = rollout.objects.frame_of_rows
    matched = match_objects(truth, object_frame, rollout.object_box, rollout.object_class, card)
    errors = forecast_errors(targets, matched, rollout)
    lineage = hypotheses(rollout, card)
    events = lineage_events(truth, rollout, lineage, match_hypotheses(truth, rollout, lineage.member, card))
    frame = truth.frame_of_rows
    of_best = events.of(lineage.best[frame])
    absent = ~lineage.alive[frame]
    every_ids = (events.ids | absent).all(axis=1)
    every_frag = (events.frag | absent).all(axis=1)
    key = event_keys(card.id, scene.name, truth.object_id, frame)
    miss_error = np.asarray(card.per_class(card.task.miss_error))
    of_targets = miss_error[targets.class_id]
    false_class = rollout.object_class[matched.unmatched]
    return SceneScore(
        scene=scene.name,
        frames=scene.frames,
        hypotheses=int(np.isfinite(rollout.hypothesis_log_weight).sum(axis=1).max(initial=0)),
        samples=rollout.forecast.shape[1],
        truth_complete=scene.truth_complete,
        detections=scene.detector,
        classes=card.task.classes,
        frame=targets.frame,
        object_id=targets.object_id,
        class_id=targets.class_id,
        key=key[targets.row],
        distance=targets.distance,
        approach=targets.approach,
        moving=targets.moving,
        miss_error=of_targets,
        **vars(errors),
        capped=capped_error(errors.min_ade, of_targets),
        own_ids=of_best.ids[targets.row, 0],
        own_frag=of_best.frag[targets.row, 0],
        all_h_ids=np.asarray(every_ids)[targets.row],
        all_h_frag=np.asarray(every_frag)[targets.row],
        truth_key=key[~truth.neutral],
        events={kind: key[getattr(of_best, kind)[:, 0]] for kind in KINDS},
        forecasts=len(rollout.object_box),
        false_forecasts=np.bincount(object_frame[matched.unmatched], minlength=scene.frames),
        false_of_class=np.bincount(false_class, minlength=len(miss_error)),
        false_error=false_forecast_error(miss_error[false_class], scene.truth_complete),
        counts=stream_counts(truth, rollout, lineage, card),
        invalid=np.asarray(rollout.invalid).sum(axis=0),
        dropped=int(np.asarray(rollout.dropped).sum()),
        skipped=scene.skipped,
        seconds=float(np.mean(rollout.seconds[len(rollout.seconds) > 1 :])) if len(rollout.seconds) else 0.0,
    )


def check_rollout(scene: Scene, rollout: Rollout, card: Card) -> None:
    """Raise RolloutError where ``rollout`` is of another scene or another number of frames or classes."""
    if rollout.scene != scene.name:
        raise RolloutError(f"rollout is of scene {rollout.scene!r}, expected {scene.name!r}")
    if rollout.frames != scene.frames:
        raise RolloutError(
            f"rollout of scene {scene.name!r} has {rollout.frames} frames, the scene {scene.frames}; was it run on "
            "another card?"
        )
    horizon = rollout.forecast.shape[2]
    if horizon != card.task.future:
        raise RolloutError(f"rollout of scene {scene.name!r} forecasts {horizon} frames, expected {card.task.future}")
    for name, ids in (("track", rollout.track_class), ("object", rollout.object_class)):
        if len(ids) and int(ids.max()) >= len(card.task.classes):
            raise RolloutError(
                f"{name} class {int(ids.max())} in the rollout of scene {scene.name!r}, expected less than "
                f"{len(card.task.classes)}"
            )

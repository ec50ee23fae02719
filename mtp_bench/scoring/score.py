"""Score of one scene: arrays per target and counts, small enough to send between processes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..errors import RolloutError
from ..types import Bools, Floats, Ints, Rollout, Scene
from .definitions import SPURIOUS_SHARE
from .forecasts import forecast_errors, match_objects
from .lineage import hypotheses, lineage_events, match_hypotheses
from .stream import StreamCounts, stream_counts
from .subsets import event_keys
from .targets import find_targets, frame_of_rows

KINDS = ("ids", "lost", "wrong", "reacquired")


@dataclass(frozen=True, eq=False)
class SceneScore:
    """One rollout of one scene; arrays per target [n] in the order of `find_targets`."""

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
    covered: Bools  # [n]
    min_ade: Floats  # [n] m, inf where not covered, as min_fde and energy_score
    min_fde: Floats  # [n] m
    miss: Bools  # [n] True where not covered
    energy_score: Floats  # [n] m
    capped: Floats  # [n] m, min(min_ade, c), c where not covered
    curve: Floats  # [n, len(ks)] m, expected minADE of k samples
    ks: tuple[int, ...]
    own_ids: Bools  # [n] along the lineage of the best hypothesis
    own_frag: Bools  # [n]
    all_h_ids: Bools  # [n] in every hypothesis
    all_h_frag: Bools  # [n]
    truth_key: Ints  # [rows] of all evaluated true boxes, targets or not
    events: dict[str, Ints]  # own events on all true boxes, by KINDS; "wrong" are among the "lost": keys [E]
    forecasts: int  # objects that were forecast, over all frames
    spurious: Ints  # [F] forecasts of nothing
    spurious_of_class: Ints  # [C]
    spurious_error: float  # m, c/2 summed over them; 0 where the truth is not complete
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
    object_frame = frame_of_rows(rollout.object_start)
    found = match_objects(truth, object_frame, rollout.object_box, rollout.object_class, card)
    errors = forecast_errors(targets, found, rollout)
    alive = hypotheses(rollout, card)
    happened = lineage_events(truth, rollout, alive, match_hypotheses(truth, rollout, alive.member, card))
    frame = frame_of_rows(truth.start)
    own = happened.of(alive.best[frame])
    silent = ~alive.alive[frame]
    every_ids = (happened.ids | silent).all(axis=1)
    every_frag = (happened.frag | silent).all(axis=1)
    key = event_keys(card.id, scene.name, truth.object_id, frame)
    worst = np.asarray(card.per_class(card.task.miss_error))
    nothing = object_frame[found.spurious], rollout.object_class[found.spurious]
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
        miss_error=worst[targets.class_id],
        covered=errors.covered,
        min_ade=errors.min_ade,
        min_fde=errors.min_fde,
        miss=errors.miss,
        energy_score=errors.energy_score,
        capped=np.minimum(errors.min_ade, worst[targets.class_id]),
        curve=errors.curve,
        ks=errors.ks,
        own_ids=own.ids[targets.row, 0],
        own_frag=own.frag[targets.row, 0],
        all_h_ids=np.asarray(every_ids)[targets.row],
        all_h_frag=np.asarray(every_frag)[targets.row],
        truth_key=key[~truth.neutral],
        events={kind: key[getattr(own, kind)[:, 0]] for kind in KINDS},
        forecasts=len(rollout.object_box),
        spurious=np.bincount(nothing[0], minlength=scene.frames),
        spurious_of_class=np.bincount(nothing[1], minlength=len(worst)),
        spurious_error=SPURIOUS_SHARE * float(worst[nothing[1]].sum()) if scene.truth_complete else 0.0,
        counts=stream_counts(truth, rollout, alive, card),
        invalid=np.asarray(rollout.invalid).sum(axis=0),
        dropped=int(np.asarray(rollout.dropped).sum()),
        skipped=scene.skipped,
        seconds=_mean(rollout.seconds),
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


def _mean(seconds: NDArray[np.floating]) -> float:
    return float(np.mean(seconds[1:] if len(seconds) > 1 else seconds)) if len(seconds) else 0.0

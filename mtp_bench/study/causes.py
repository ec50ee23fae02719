"""Causes of the remaining error: parts of the ranking error, which add up to it.

A target without a forecast has all of its error for the first cause that applies: ``undetected`` (no detection of its
class inside the forecast gate), ``below_threshold`` (of the confidence), ``not_forecast``. That of one with a forecast
is a sum of signed parts: ``gt_tracks`` (the same predictor on ground-truth tracks), ``localisation`` (the part that
moving the forecast to the true place takes away), and the remainder: ``switched`` if the reference tracker ever
switches the identity there, else ``rest``. Parts are taken at each budget of false forecasts, and averaged like the
error. What is known of each target for that are its `Circumstances`: detected or not, the age of its track, the
time since its last identity error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..scoring.events import object_history
from ..scoring.forecasts import RecordedForecasts, candidates, centred, cuts, match_by_confidence, near_truth
from ..scoring.lineage import hypotheses, in_all, lineage_events, match_hypotheses
from ..scoring.neutral import evaluated
from ..scoring.ranking_error import Budgets, Cuts, at_budgets
from ..scoring.score import SceneScore
from ..scoring.targets import find_targets, live_frames
from ..types import Bools, Floats, Ints, Rollout, Scene, Truth

CAUSES = ("undetected", "below_threshold", "not_forecast", "gt_tracks", "localisation", "switched", "rest")
KINDS = ("ids", "lost", "reacquired", "frag")  # the last: lost or reacquired


@dataclass(frozen=True, eq=False)
class Circumstances:
    """Circumstances of one rollout of one scene; targets [n] in the order of `find_targets`."""

    centred: Cuts  # of its forecasts, moved to the true places of their objects
    seen: Bools  # [n] a detection of the class lies inside the forecast gate
    age: Ints  # [n] frames since the track that holds it first appeared; -1: not held in the best hypothesis
    since: dict[str, Ints]  # [n] by KINDS: frames since the last event of the object, 0 for now; -1: none so far
    own: dict[str, int]  # by KINDS: events along the lineage of the best hypothesis, on targets or not
    shared: dict[str, int]  # by KINDS: events that every hypothesis has
    objects: int  # evaluated true objects
    frames: int


def circumstances(scene: Scene, rollout: Rollout, card: Card) -> Circumstances:
    """Circumstances of the targets of ``scene``; the rollout is one that `score_scene` takes."""
    scene = evaluated(scene)
    truth, targets = scene.truth, find_targets(scene, card)
    forecasts = RecordedForecasts.of(rollout)
    pairs = candidates(scene, targets, forecasts, live_frames(scene, card), card)
    miss_error = np.asarray(card.per_class(card.task.miss_error))[targets.class_id]
    lineage = hypotheses(rollout, card)
    matched = match_hypotheses(truth, rollout, lineage.member, card)
    events = lineage_events(truth, rollout, lineage, matched)
    best = lineage.best[truth.frame_of_rows]
    own = {kind: getattr(events.of(best), kind)[:, 0] for kind in KINDS}
    track = np.take_along_axis(matched, best[:, None], axis=1)[:, 0]
    matching = match_by_confidence(pairs, forecasts.confidence)
    return Circumstances(
        centred=cuts(centred(pairs), matching, forecasts.confidence, miss_error),
        seen=_seen(scene, card)[targets.row],
        age=_ages(rollout, track)[targets.row],
        since={kind: _since(truth, rows)[targets.row] for kind, rows in own.items()},
        own={kind: int(rows.sum()) for kind, rows in own.items()},
        shared={kind: int(in_all(truth, lineage, events, kind).sum()) for kind in KINDS},
        objects=len(np.unique(truth.object_id[~truth.neutral])),
        frames=scene.frames,
    )


def _seen(scene: Scene, card: Card) -> Bools:
    """True boxes [R] with a detection of their class inside the forecast gate."""
    table = scene.detections
    pairs = near_truth(scene.truth, table.frame_of_rows, table.box, table.class_id, card)
    return np.bincount(pairs.row, minlength=len(scene.truth.box)) > 0


def _ages(rollout: Rollout, track: Ints) -> NDArray[np.int64]:
    """Frames [R] since the id of each ``track`` first appeared; -1 without a track."""
    frame = rollout.tracks.frame_of_rows
    _, first, number = np.unique(rollout.track_id, return_index=True, return_inverse=True)
    age = np.append(frame - frame[first][number], -1)  # row -1: no track
    return np.asarray(age[track], dtype=np.int64)


def _since(truth: Truth, happened: Bools) -> NDArray[np.int64]:
    """Frames since the last row of the same object that ``happened`` [R], 0 for the row itself; -1 without any."""
    past = object_history(truth)
    own, place = happened[past.order], np.arange(len(past.order))
    last = np.maximum.accumulate(np.where(own, place, -1)) if len(place) else place
    begin = np.maximum.accumulate(np.where(past.follows, 0, place)) if len(place) else place
    since = np.full(len(place), -1, dtype=np.int64)
    known = last >= begin
    since[past.order[known]] = past.frame[known] - past.frame[last[known]]
    return since


def causes_at(cuts: Cuts, around: Circumstances, from_truth: Floats, switched: Bools, least: float) -> Floats:
    """Parts [len(CAUSES), n] of the error of each target at the confidence threshold ``least``, m.

    ``from_truth`` [n]: m, the plain error from ground-truth tracks, at most c; ``switched`` [n]: the event weight is
    above 0.
    """
    error, missed = cuts.at(least)
    without_place = around.centred.at(least)[0]
    absent, ever = missed > 0, cuts.at(-np.inf)[1] == 0
    remains = without_place - from_truth
    parts = (
        (absent & ~around.seen, error),
        (absent & around.seen & ever, error),
        (absent & around.seen & ~ever, error),
        (~absent, from_truth),
        (~absent, error - without_place),
        (~absent & switched, remains),
        (~absent & ~switched, remains),
    )
    return np.stack([np.where(where, value, 0.0) for where, value in parts])


def causes(
    seeds: Sequence[Sequence[SceneScore]],
    around: Sequence[Sequence[Circumstances]],
    budgets: Budgets,
    from_truth: Floats,
    switched: Bools,
    subsets: bool = False,
) -> Floats:
    """Parts [len(CAUSES), n] of the ranking error per target, mean over seeds, m; they add up to it.

    ``around``: of the same scenes and seeds; ``from_truth`` and ``switched`` [n] as in `causes_at`, over all scenes;
    ``subsets``: at the budget of the event subsets, else the mean over those of "all".
    """
    first = np.cumsum([0, *(len(score) for score in seeds[0])])
    rows = [slice(low, high) for low, high in pairwise(first.tolist())]  # targets of each scene
    allowed = [budgets.subsets] if subsets else budgets.all
    runs = []
    for scores, near in zip(seeds, around, strict=True):

        def parts(scene: int, least: float, scores=scores, near=near) -> Floats:  # type: ignore[no-untyped-def]
            own = rows[scene]
            return causes_at(scores[scene].cuts, near[scene], from_truth[own], switched[own], least)

        live = None if budgets.false_known else sum(score.live for score in scores)
        runs.append(at_budgets([score.cuts for score in scores], allowed, parts, live).mean(axis=0))
    return np.asarray(np.mean(runs, axis=0), dtype=np.float64)

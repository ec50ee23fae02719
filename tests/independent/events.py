"""Events of the best hypothesis against its stated parent, in frame mode."""

import functools
import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np

from mtp_bench.cards import Card
from mtp_bench.core import Bools, Rollout, Scene
from mtp_bench.core.geometry import iou_3d

from .matching import Keys, best_pairs
from .targets import after_hole, neutral_rows

Event = tuple[int, int, int, int | None, int | None]  # scene, object, frame, old id, new id
Matched = dict[int, int | None]  # object -> id of its track, None: unmatched


def own_events(scenes: Sequence[Scene], rollouts: Sequence[Rollout], card: Card) -> dict[str, list[Event]]:
    """Events by kind; a missing id is None.

    Reading: `reacquired` needs an earlier matched frame of the same unbroken run of true frames, each frame seen by the
    ancestor of the best hypothesis; where a parent is not stated, or after a hole in time, history begins.
    """
    found: dict[str, list[Event]] = {"ids": [], "lost": [], "reacquired": []}
    for s, (scene, rollout) in enumerate(zip(scenes, rollouts, strict=True)):
        neutral = neutral_rows(scene)
        matched_ids = functools.cache(functools.partial(_matched_ids, scene, neutral, rollout, card))
        for t in range(1, scene.frames):
            line = _lineage(rollout, t, matched_ids, lambda u: after_hole(scene, card, u))  # noqa: B023
            if len(line) < 2:
                continue
            for g, new in line[0].items():
                past = [frame[g] for frame in itertools.takewhile(lambda frame: g in frame, line[1:])]  # noqa: B023
                if not past:
                    continue
                known = [i for i in past if i is not None]
                if new is not None and past[0] is not None and new != past[0]:
                    found["ids"].append((s, g, t, past[0], new))
                elif new is None and past[0] is not None:
                    found["lost"].append((s, g, t, past[0], None))
                elif new is not None and past[0] is None and known:
                    found["reacquired"].append((s, g, t, known[0], new))
    return found


def _lineage(
    rollout: Rollout, t: int, matched_ids: Callable[[int, int], Matched], begins: Callable[[int], bool]
) -> list[Matched]:
    """Matched ids of each true object at t, t - 1, ... along the ancestors of the best hypothesis of t."""
    h = _best(rollout, t)
    line = []
    while t >= 0 and h >= 0:
        line.append(matched_ids(t, h))
        if begins(t):
            break
        h = _parent(rollout, t, h)
        t -= 1
    return line


def _best(rollout: Rollout, t: int) -> int:
    return int(np.argmax(rollout.hypothesis_log_weight[t]))


def _parent(rollout: Rollout, t: int, h: int) -> int:
    """The hypothesis of t - 1 that h of t descends from, -1 for none.

    Reading: where no hypothesis is stated there is one without tracks, number 0. It descends from the best of the frame
    before, and all that follow it descend from it: saying nothing ends no history.
    """
    if t == 0:
        return -1
    silent = np.asarray(~np.isfinite(rollout.hypothesis_log_weight).any(axis=1))
    if silent[t]:
        return _best(rollout, t - 1)
    alone = rollout.member.shape[1] == 1
    return 0 if alone or silent[t - 1] else int(rollout.hypothesis_parent[t, h])


def _matched_ids(scene: Scene, neutral: Bools, rollout: Rollout, card: Card, t: int, h: int) -> Matched:
    """a_t(g) of every object that is there and not neutral; None: unmatched. A track of class -1 fits every class."""
    truth = scene.truth
    there = [g for g in range(truth.start[t], truth.start[t + 1]) if not neutral[g]]
    tracks = [r for r in range(rollout.track_start[t], rollout.track_start[t + 1]) if rollout.member[r, h]]
    gate, limit = card.task.event_gate, card.per_class(card.task.event_gate.threshold)
    pairs: dict[tuple[int, int], Keys] = {}
    for r in tracks:
        for g in there:
            kind, a, b = int(truth.class_id[g]), rollout.track_box[r].astype(float), truth.box[g].astype(float)
            if rollout.track_class[r] not in (-1, kind):
                continue
            far = math.dist(a[:2], b[:2])
            inside = far <= limit[kind]
            if gate.measure == "iou_3d":
                overlap = float(iou_3d(a[None], b[None])[0])
                far, inside = 1 - overlap, overlap >= limit[kind]
            if inside:
                pairs[r, g] = (far, 0.0, 0.0)
    track_of = {g: r for r, g in best_pairs(pairs).items()}
    return {int(truth.object_id[g]): int(rollout.track_id[track_of[g]]) if g in track_of else None for g in there}

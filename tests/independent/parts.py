"""Parts of bADE: the cause of each missing forecast, and what each error of a covered target is made of."""

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mtp_bench.core import Floats

from .budgets import Cut, shares_at
from .displacement import numbers, stated
from .forecasts import Run, judge_frame
from .targets import after_hole

ABSENT = ("below_threshold", "no_forecast", "other_class", "off_place", "undetected_new", "undetected_seen")
COVERED = ("ground_truth", "localisation", "history", "association", "rest")


class Known(NamedTuple):
    """Errors of the references, of each target [n], NaN where missing."""

    associated: Floats  # p: perfect association
    moved: Floats  # p': its present place moved to the truth
    ground_truth: Floats  # g: ground-truth tracks


@functools.cache
def absent_cause(run: Run, i: int, covered: bool) -> str:
    """The first cause that holds of a target without a forecast; ``covered``: with every forecast kept it has one.

    Reading: "a forecast was there" if the target has one with every forecast kept. It was detected in an earlier frame
    if a detection of its class lay inside its gate there, after the last hole in time.
    """
    target, scene = run.targets[i], run.scenes[run.targets[i].scene]
    gate = run.gates[target.kind]
    own, others = distances(run, i, target.t)
    if covered:
        return "below_threshold"
    if any(far <= gate for far in own):
        return "no_forecast"
    if any(far <= gate for far in others):
        return "other_class"
    if any(far <= 2 * gate for far in own):
        return "off_place"
    t = target.t
    while t > 0 and not after_hole(scene, run.card, t):
        t -= 1
        if any(far <= gate for far in distances(run, i, t)[0]):
            return "undetected_seen"
    return "undetected_new"


def distances(run: Run, i: int, t: int) -> tuple[list[float], list[float]]:
    """From the target's object at t, if it is there, to the detections of its class, and to the others."""
    target, scene = run.targets[i], run.scenes[run.targets[i].scene]
    found: tuple[list[float], list[float]] = ([], [])
    for r in range(scene.truth.start[t], scene.truth.start[t + 1]):
        for d in range(scene.detections.start[t], scene.detections.start[t + 1]):
            if scene.truth.object_id[r] == target.object:
                far = math.dist(scene.detections.box[d, :2], scene.truth.box[r, :2])
                found[int(scene.detections.class_id[d] != target.kind)].append(far)
    return found


def covered_errors(runs: Sequence[Run]) -> tuple[Floats, Floats]:
    """Error of each target [n] with every forecast kept, and with the present place moved to the truth.

    The mean over the runs, one per seed, that cover the target; NaN where none does.
    """
    n = len(runs[0].targets)
    found: list[list[tuple[float, float]]] = [[] for _ in range(n)]
    for run in runs:
        for s, t in run.frames():
            for r, g in judge_frame(run, s, t).matched.items():
                if (s, g) in run.index:
                    target, c = run.targets[run.index[s, g]], run.miss_errors[run.targets[run.index[s, g]].kind]
                    moved = numbers(*stated(run.rollouts[s], r, run.scenes[s].truth.box[g, :2]), target.future)
                    pair = min(run.against(s, r, g).min_ade, c), min(moved.min_ade, c)
                    found[run.index[s, g]].append(pair)
    means = np.array([np.mean(pairs, axis=0) if pairs else (np.nan, np.nan) for pairs in found]).reshape(n, 2)
    return means[:, 0], means[:, 1]


def parts_at(run: Run, steps: Sequence[Cut], budgets: Sequence[float], known: Known | None) -> dict[str, Floats]:
    """Every part of the error of each target [n], averaged over the budgets; ``steps``: the cuts of the run."""
    covered = COVERED if known else COVERED[-1:]
    parts: dict[str, Floats] = {name: np.zeros(len(run.targets)) for name in (*ABSENT, *covered)}
    for share, cut in shares_at(steps, budgets):
        for i, e in enumerate(cut.error):
            if cut.missed[i]:
                parts[absent_cause(run, i, not steps[-1].missed[i])][i] += share * e
            elif known is None or np.isnan([known.associated[i], known.ground_truth[i]]).any():
                parts["rest"][i] += share * e
            else:
                p, moved, g = known.associated[i], known.moved[i], known.ground_truth[i]
                parts["ground_truth"][i] += share * g
                parts["localisation"][i] += share * (p - moved)
                parts["history"][i] += share * (moved - g)
                parts["association"][i] += share * (e - p)
    return parts

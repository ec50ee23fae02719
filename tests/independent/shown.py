"""Numbers that are shown and do not rank, of one run."""

import math

import numpy as np

from mtp_bench.core import Floats

from .displacement import Numbers
from .forecasts import Run, judge_frame

FREE_FORECASTS = 40  # per frame, where the truth holds targets only


def of_targets(run: Run, least: float = -math.inf) -> list[Numbers | None]:
    """Numbers of each target with the forecasts of at least this confidence; None where it is missing."""
    found: list[Numbers | None] = [None] * len(run.targets)
    for s, t in run.frames():
        for r, g in judge_frame(run, s, t, least).matched.items():
            if (s, g) in run.index:
                found[run.index[s, g]] = run.against(s, r, g)
    return found


def plain_errors(run: Run, least: float = -math.inf) -> Floats:
    """min(minADE, c), or c, of each target."""
    c = [run.miss_errors[target.kind] for target in run.targets]
    found = of_targets(run, least)
    return np.array([m if x is None else min(x.min_ade, m) for x, m in zip(found, c, strict=True)], dtype=float)


def fixed_error(run: Run) -> float:
    """Reading: malformed rows count here only, in live frames; with targets only they stand behind all forecasts.

    With targets only the most confident forecasts of a frame are the free ones.
    """
    price = [c / 2 for c in run.miss_errors]
    price.append(max(price))  # class not readable
    total = float(plain_errors(run, 0.5).sum())
    for s, t in run.frames():
        said, rows = run.rollouts[s], run.rows(s, t, 0.5)
        malformed = [price[c] for c in range(len(price)) for _ in range(int(said.malformed[t, c]))]
        if run.complete:
            false = judge_frame(run, s, t, 0.5).false
            total += sum(price[said.object_class[r]] for r in false) + sum(malformed)
        else:
            ordered = sorted(rows, key=lambda r: -said.object_confidence[r])
            total += sum([*(price[said.object_class[r]] for r in ordered), *malformed][FREE_FORECASTS:])
    return total / len(run.targets)


def false_per_frame(run: Run) -> float:
    """Unmatched forecasts that are not neutral, per live frame."""
    frames = run.frames()
    return sum(len(judge_frame(run, s, t).false) for s, t in frames) / len(frames)


def brier(run: Run) -> float | None:
    """Reading: over the forecasts of live frames that are not neutral; "matched" to any evaluated object."""
    squares = []
    for s, t in run.frames():
        verdict = judge_frame(run, s, t)
        said = run.rollouts[s].object_confidence
        squares += [(float(said[r]) - 1.0) ** 2 for r in verdict.matched]
        squares += [float(said[r]) ** 2 for r in verdict.false]
    return sum(squares) / len(squares) if squares else None


def planning_aware(run: Run, error: Floats) -> float | None:
    """Mean of ``error`` [n], weighted by how close the object will come to the ego."""
    closest = [min(math.dist(a, b) for a, b in zip(g.future, g.ego, strict=True)) for g in run.targets]
    weight = np.array([math.exp(-(d**2) / (2 * 3**2)) for d in closest])
    return float((weight * error).sum() / weight.sum()) if weight.sum() > 0 else None


def epa(run: Run) -> float:
    """(targets with minFDE <= 2 m - .5 false forecasts) / targets.

    Reading: matched inside the card's forecast gate, 2 m for vehicles; classes pooled; other true objects are neither.
    """
    hits, false = 0, 0
    for s, t in run.frames():
        verdict = judge_frame(run, s, t)
        false += len(verdict.false)
        hits += sum((s, g) in run.index and not run.against(s, r, g).miss for r, g in verdict.matched.items())
    return (hits - 0.5 * false) / len(run.targets)


def ap_f(run: Run) -> float:
    """Mean over the classes with targets of the area under precision over recall; right: a match with minFDE <= 4 m.

    Reading: the protocol's matching, inside the card's own gate, not a greedy one; a match of a true object that is no
    target, and what is neutral, is left out; equal confidences enter together; the area is that of nuScenes detection:
    precision at 101 recalls, joined by straight lines, 0 beyond the last one, recall and precision below .1 cut off.
    """
    verdicts: dict[int, list[tuple[float, bool]]] = {g.kind: [] for g in run.targets}
    for s, t in run.frames():
        verdict = judge_frame(run, s, t)
        said, class_of = run.rollouts[s].object_confidence, run.rollouts[s].object_class
        for r in verdict.false:
            verdicts.setdefault(int(class_of[r]), []).append((float(said[r]), False))
        for r, g in verdict.matched.items():
            if (s, g) in run.index:
                verdicts[int(class_of[r])].append((float(said[r]), run.against(s, r, g).min_fde <= 4.0))
    areas = []
    for kind in sorted({g.kind for g in run.targets}):
        wanted, points = sum(g.kind == kind for g in run.targets), []
        for least in sorted({confidence for confidence, _ in verdicts[kind]}, reverse=True):
            kept = [right for confidence, right in verdicts[kind] if confidence >= least]
            points.append((sum(kept) / wanted, sum(kept) / len(kept)))
        heights = [_precision_at(points, float(recall)) for recall in np.linspace(0, 1, 101)[11:]]
        areas.append(sum(max(0.0, height - 0.1) for height in heights) / len(heights) / 0.9)
    return sum(areas) / len(areas)


def _precision_at(points: list[tuple[float, float]], recall: float) -> float:
    """Precision on the line between the two (recall, precision) ``points`` around a recall, which rise."""
    if not points or recall > points[-1][0]:
        return 0.0
    below = [point for point in points if point[0] <= recall]  # of equal recalls the last
    if not below:
        return points[0][1]
    (r, p), above = below[-1], points[len(below) :]
    if r == recall or not above:
        return p
    return p + (recall - r) / (above[0][0] - r) * (above[0][1] - p)

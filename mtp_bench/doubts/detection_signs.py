"""Signs in the detections: alone, and beside the truth that is near them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.stats import mannwhitneyu

from ..core import Bools, Floats, Ints
from ..scoring import unlabelled
from .form_signs import LONG, heading_signs
from .recording import Places, RecordedScene, to_ego
from .signs import Sign, mean_of_others

_DIRECTIONS = (  # around the ego, counter-clockwise
    "ahead",
    "ahead left",
    "left",
    "behind left",
    "behind",
    "behind right",
    "right",
    "ahead right",
)
_MIN_PAIRS = 20  # below which a share says nothing
_MIN_OBJECTS = 4
_MIN_NEAR = 0.2  # share of true boxes, below which matches are accidents
_SURE_QUANTILE = 0.5  # of the scores of right detections


@dataclass(frozen=True, eq=False)
class _Pairs:
    """True boxes with a detection of any class within the gate."""

    truth: Ints  # [n] rows
    detection: Ints  # [n] rows, each once
    offset: Floats  # [n, 2] m, from truth to detection
    right: Bools  # [D] detections that have a true box


def detection_signs(recording: RecordedScene) -> Iterator[Sign]:
    """Yield the signs in the detections."""
    score = recording.detections.score
    if not len(score):
        return
    pairs = _matched(recording)
    if len(pairs.truth) < _MIN_PAIRS:
        return
    yaw = recording.detections.box[pairs.detection, 3]
    along = np.cos(yaw - recording.truth.box[pairs.truth, 3])
    long = recording.is_of(recording.truth.class_id[pairs.truth], LONG)
    object_id = recording.truth.object_id[pairs.truth]
    yield from heading_signs("detection", along[long], object_id[long])
    yield _height(recording, pairs)
    labelled = ~unlabelled(
        recording.scene,
        recording.detections.frame_of_rows,
        recording.detections.box[:, :2],
    )
    yield _moved_sector(recording, pairs)
    yield _late_sector(recording)
    # else no detection is surer than others, or those without truth may be right
    if np.ptp(score) > 0 and recording.scene.truth_complete:
        yield _scores(score[labelled], pairs.right[labelled])
        yield from _unlabelled(recording, pairs.right, labelled)


def class_signs(recording: RecordedScene) -> Iterator[Sign]:
    """Yield classes that detections exchange, or call by another name."""
    count = len(recording.card.task.classes)
    pairs = _matched(recording)
    few = max(_MIN_PAIRS, _MIN_NEAR * len(recording.truth.box))
    if count < 2 or len(pairs.truth) < few:
        return
    table = _class_votes(recording, pairs)
    wrong = table * (1.0 - np.eye(count))
    share = wrong / np.maximum(table.sum(axis=1), 2.0)[:, None]
    sign = _class_sign(recording, "classes_exchanged", np.minimum(share, share.T))
    first, second = (recording.card.task.classes.index(name) for name in sign.names)
    yield replace(sign, undo=partial(_exchanged, first, second))
    wrong[wrong < _MIN_OBJECTS] = 0.0
    yield _class_sign(recording, "class_renamed", wrong / table.sum())


def _class_votes(recording: RecordedScene, pairs: _Pairs) -> Floats:
    """Return how many objects of a class are mostly detected as another one [C, C]."""
    count = len(recording.card.task.classes)
    truth = recording.truth
    object_ids, number = np.unique(truth.object_id[pairs.truth], return_inverse=True)
    votes = np.zeros((len(object_ids), count))
    detected = recording.detections.class_id[pairs.detection]
    np.add.at(votes, (number, detected), 1.0)
    true_class = np.zeros(len(object_ids), dtype=np.int64)
    true_class[number] = truth.class_id[pairs.truth]
    table = np.zeros((count, count))
    np.add.at(table, (true_class, votes.argmax(axis=1)), 1.0)
    return table


def _matched(recording: RecordedScene) -> _Pairs:
    """Return each true box with its nearest detection, each detection once."""
    truth = recording.truth
    rows = recording.detections
    no_class = np.zeros(max(len(truth.box), len(rows.box)), dtype=np.int64)
    places = Places(rows.box[:, :2], rows.frame_of_rows, no_class[: len(rows.box)])
    distance, row = places.nearest(
        truth.box[:, :2],
        truth.frame_of_rows,
        no_class[: len(truth.box)],
        float(recording.gate.max()),
    )
    near = np.flatnonzero(distance <= recording.gate[truth.class_id])
    near = near[np.argsort(distance[near], kind="stable")]
    detection, first = np.unique(row[near], return_index=True)
    true_row = near[first]
    right = np.zeros(len(rows.box), dtype=bool)
    right[detection] = True
    offset = rows.box[detection, :2] - truth.box[true_row, :2]
    return _Pairs(true_row, detection, offset, right)


def _class_sign(recording: RecordedScene, kind: str, table: Floats) -> Sign:
    """Return the largest entry of a table of true and detected classes."""
    true, detected = np.unravel_index(table.argmax(), table.shape)
    names = recording.card.task.classes[true], recording.card.task.classes[detected]
    return Sign(kind, float(table.max()), names=names)


def _exchanged(first: int, second: int, recording: RecordedScene) -> RecordedScene:
    """Return detections in which two classes are exchanged."""
    rows = recording.detections
    other = np.arange(len(recording.card.task.classes))
    other[[first, second]] = second, first
    return recording.with_rows(replace(rows, class_id=other[rows.class_id]))


def _height(recording: RecordedScene, pairs: _Pairs) -> Sign:
    """Return how many heights detections are above truth in the median."""
    box = recording.truth.box[pairs.truth]
    lift = recording.detections.box[pairs.detection, 2] - box[:, 2]
    heights = float(np.median(lift / np.maximum(box[:, 6], 0.1)))
    return Sign("bottom", abs(heights), heights)


def _scores(score: Floats, right: Bools) -> Sign:
    """Return how often a false detection has a higher score than a right one."""
    pairs = right.sum() * (~right).sum()
    if min(right.sum(), (~right).sum()) < _MIN_PAIRS:
        return Sign("scores_order", 0.0)
    higher = mannwhitneyu(score[~right], score[right]).statistic
    return Sign("scores_order", float(higher / pairs))


def _moved_sector(recording: RecordedScene, pairs: _Pairs) -> Sign:
    """Return how far detections of a direction are off those of the others, m."""
    truth = recording.truth
    frame = truth.frame_of_rows[pairs.truth]
    heading = recording.ego[frame] * (0.0, 0.0, 0.0, 1.0)
    offset = to_ego(pairs.offset, heading)
    object_id = truth.object_id[pairs.truth]
    direction = _directions(recording, truth.box[pairs.truth, :2], frame)
    apart = []
    for number in range(len(_DIRECTIONS)):
        inside = direction == number
        apart.append(_certain_change(offset, object_id, inside))
    return Sign("sector_offset", max(apart), variant=_DIRECTIONS[np.argmax(apart)])


def _certain_change(offset: Floats, object_id: Ints, inside: Bools) -> float:
    """Return how far the medians of two parts are apart beyond chance, m."""
    middles = []
    variance = 0.0
    for part in (inside, ~inside):
        objects = len(np.unique(object_id[part]))
        if part.sum() < _MIN_PAIRS or objects < _MIN_OBJECTS:
            return 0.0
        middle = np.median(offset[part], axis=0)
        spread = 1.5 * np.median(np.hypot(*(offset[part] - middle).T))
        middles.append(middle)
        variance += spread**2 / objects
    change = float(np.hypot(*(middles[0] - middles[1])))
    return max(0.0, change - 2.0 * float(np.sqrt(variance)))


def _late_sector(recording: RecordedScene) -> Sign:
    """Return how much better a direction alone fits one frame before or after."""
    truth = recording.truth
    row = recording.sample
    frame = truth.frame_of_rows[row]
    class_id = truth.class_id[row]
    direction = _directions(recording, truth.box[row, :2], frame)
    losses = recording.losses(truth.box[row, :2], frame, class_id)
    sign = Sign("sector_late", 0.0)
    for late in (-1, 1):
        places = recording.motion.places(row, -float(late))
        gain = losses - recording.losses(places, frame, class_id)
        for number, name in enumerate(_DIRECTIONS):
            inside = direction == number
            if min(inside.sum(), (~inside).sum()) < _MIN_PAIRS:
                continue
            gain_inside = mean_of_others(gain[inside], truth.object_id[row[inside]])
            value = gain_inside - max(0.0, float(gain[~inside].mean()))
            if value > sign.value:
                sign = Sign("sector_late", value, late, variant=name)
    return sign


def _unlabelled(
    recording: RecordedScene, right: Bools, labelled: Bools
) -> Iterator[Sign]:
    """Yield by how much sure detections of a direction lack truth more than others."""
    rows = recording.detections
    sure = labelled & (rows.score >= np.quantile(rows.score[right], _SURE_QUANTILE))
    direction = _directions(recording, rows.box[:, :2], rows.frame_of_rows)
    shares = np.full(len(_DIRECTIONS), np.nan)
    for number in range(len(_DIRECTIONS)):
        inside = sure & (direction == number)
        if inside.sum() >= _MIN_PAIRS:
            shares[number] = (~right[inside]).mean()
    if np.isfinite(shares).sum() < 2:
        return
    worst = int(np.nanargmax(shares))
    others = np.nanmedian(np.delete(shares, worst))
    more = float(shares[worst] - others)
    yield Sign("unlabelled", more, variant=_DIRECTIONS[worst])


def _directions(recording: RecordedScene, xy: Floats, frame: Ints) -> Ints:
    """Return the directions [n] of places as seen from the ego, 0 right ahead."""
    x, y = to_ego(xy, recording.ego[frame]).T
    count = len(_DIRECTIONS)
    eighths = np.arctan2(y, x) / (2 * np.pi) * count
    return np.asarray(np.round(eighths), dtype=np.int64) % count

"""Detections whose errors are larger or smaller than as recorded (docs/environment).

In a closed loop no change of a frame depends on later ones: the change of the frames
so far equals that of the whole recording. Elsewhere copies of misses, new false
detections and the reach of stored detections depend on the whole recording.
"""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..cards import Card, PerturbSection
from ..core import (
    Bools,
    DataError,
    Detections,
    Floats,
    Ints,
    Scene,
    joined,
    rotate,
    select,
    starts_of,
    true_runs,
    wrap_angle,
)
from .motion import as_places, looking_back
from .simulated import in_frames, in_world, sensor_of

MAX_LAG_S = 5.0  # by which misses come again in a closed loop
NEAR_M = 2.0  # between places of a false object in frames in a row
_MISSES, _FALSE = range(2)  # knobs with random draws


@dataclass(frozen=True, eq=False)
class _Rows:
    """Detections [R] in any order of their frames."""

    frame: Ints
    true_row: Ints  # of the true box that it detects; -1: false
    box: Floats
    velocity: Floats
    class_id: Ints
    score: Floats


def perturbed(scene: Scene, card: Card) -> Scene:
    """Return the scene with the errors of its detections as ``card.perturb`` says.

    Truth and targets stay. Equal scenes, levels and seeds give equal detections. Raises
    DataError where the truth does not tell which detections are false, or which objects
    are missed.
    """
    levels = card.perturb
    if levels is None:
        return scene
    _require_truth(scene, card.id, levels)
    period_s = 1 / card.task.rate
    traits = card.source.traits
    world_scene = in_world(scene)
    if traits.velocity_ahead:  # an agent must not see the next frame in a velocity
        truth = looking_back(world_scene.truth, scene.time, period_s)
        world_scene = replace(world_scene, truth=truth)
    rows = _rows_of(world_scene, card)
    if levels.misses < 1:
        rows = _filled(rows, world_scene, card, levels)
    else:
        rows = select(rows, ~_missed_again(rows, world_scene, card, levels))
    rows = _with_false(rows, world_scene, levels)
    if levels.noise != 1:
        is_true = rows.true_row >= 0
        true_box = world_scene.truth.box[rows.true_row[is_true]]
        rows.box[is_true] = _with_noise(rows.box[is_true], true_box, levels.noise)
    least = _least_scores(scene.detections, levels.score)
    rows = select(rows, rows.score >= least[rows.frame])
    rows = _late(rows, world_scene, card, levels.delay)
    order = np.argsort(rows.frame, kind="stable")
    detections = Detections(
        start=starts_of(np.bincount(rows.frame, minlength=scene.frames)),
        box=rows.box[order],
        velocity=rows.velocity[order],
        class_id=rows.class_id[order],
        score=rows.score[order],
    )
    if scene.world is not None:
        detections = in_frames(detections, scene.world, scene.time, period_s)
    if traits.places_only:
        detections = as_places(detections)
    name = f"{scene.detector}, {levels}"
    return replace(scene, detections=detections, detector=name)


def detection_matches(scene: Scene, card: Card) -> Ints:
    """Return the row of the true box that each detection [R] detects, -1 for none.

    In each frame and class the sum of distances is least, inside the forecast gate.
    """
    truth = scene.truth
    detections = scene.detections
    gate_m = np.array(card.per_class(card.task.forecast_gate))[detections.class_id]
    true_row = np.full(len(detections.box), -1)
    for t in range(scene.frames):
        here = np.arange(len(true_row))[detections.rows(t)]
        there = np.arange(len(truth.box))[truth.rows(t)]
        row, column = _pairs(detections, here, truth, there, gate_m[here])
        true_row[here[row]] = there[column]
    return true_row


def _pairs(
    a: Any, rows: Ints, b: Any, others: Ints, gate_m: Floats
) -> tuple[Ints, Ints]:
    """Return pairs of ``rows`` of a and ``others`` of b, of one class, within a gate.

    They have the largest sum of what distances are less than the gates [rows], m.
    """
    # not where detections stay as recorded: it takes long to import
    from scipy.optimize import linear_sum_assignment

    offset_m = a.box[rows, None, :2] - b.box[None, others, :2]
    gain = gate_m[:, None] - np.linalg.norm(offset_m, axis=-1)
    gain[a.class_id[rows, None] != b.class_id[None, others]] = 0
    row, column = linear_sum_assignment(np.maximum(gain, 0), maximize=True)
    found = gain[row, column] > 0
    return row[found], column[found]


def missed(scene: Scene, card: Card, true_row: Ints) -> Bools:
    """Return the evaluated true boxes [M] in coverage without a detection.

    ``true_row`` [R]: the one that each detection detects.
    """
    is_missed = covered_truth(scene, card, true_row)
    is_missed[true_row[true_row >= 0]] = False
    return is_missed


def covered_truth(scene: Scene, card: Card, true_row: Ints) -> Bools:
    """Return the evaluated true boxes [M] that the detector could have reported.

    Stored detections reach as far as their farthest true one.
    """
    truth = scene.truth
    ego = scene.ego[truth.frame_of_rows]
    distance_m = np.linalg.norm(truth.box[:, :2] - ego[:, :2], axis=1)
    if scene.simulated and card.detector is not None:
        from ..detector import covered

        sensor = sensor_of(card.detector, scene, card.source.traits.bounded_by_truth)
        return covered(truth, scene.ego, sensor) & ~truth.neutral
    reach_m = distance_m[true_row[true_row >= 0]].max(initial=0)
    return np.asarray((distance_m <= reach_m) & ~truth.neutral)


def _require_truth(scene: Scene, env_id: str, levels: PerturbSection) -> None:
    """Raise DataError for a truth that lacks objects or frames, if a knob needs it."""
    if len(scene.annotated_frames) < scene.frames:
        raise DataError(
            f"scene {scene.name!r}: only some of its frames are annotated, so the "
            "errors of detections are unknown in the others; leave `perturb` out"
        )
    if not scene.truth_complete and (levels.misses != 1 or levels.false != 1):
        raise DataError(
            f"scene {scene.name!r}: the truth of {env_id} is not complete, so missed "
            "and false detections are unknown; change score, noise or delay alone"
        )


def _rows_of(scene: Scene, card: Card) -> _Rows:
    detections = scene.detections
    return _Rows(
        frame=detections.frame_of_rows,
        true_row=detection_matches(scene, card),
        box=np.array(detections.box, dtype=np.float64),
        velocity=np.array(detections.velocity, dtype=np.float64),
        class_id=detections.class_id,
        score=detections.score,
    )


def _draws(scene: Scene, levels: PerturbSection, *key: int) -> np.random.Generator:
    """Return draws that depend on scene, seed and ``key`` alone."""
    digest = hashlib.sha256(scene.name.encode()).digest()
    words = [int.from_bytes(digest[:8], "big"), levels.seed, *key]
    return np.random.default_rng(words)


def _objects(scene: Scene) -> Iterator[tuple[int, Ints]]:
    """Yield each evaluated object, and its rows in the truth, by frame."""
    truth = scene.truth
    evaluated = np.flatnonzero(~truth.neutral)
    order = evaluated[np.argsort(truth.object_id[evaluated], kind="stable")]
    object_id = truth.object_id[order]
    for rows in np.split(order, np.flatnonzero(np.diff(object_id)) + 1):
        if len(rows):
            yield int(truth.object_id[rows[0]]), rows


def _missed_again(
    rows: _Rows, scene: Scene, card: Card, levels: PerturbSection
) -> Bools:
    """Return the detections [R] that are missed, too.

    Each object repeats its own misses level - 1 times, each time later by a random
    number of frames: they are as long as recorded. What would come after the object's
    last frame comes in its first ones, except in a closed loop, whose future is open.
    """
    was_missed = missed(scene, card, rows.true_row)
    is_missed = np.zeros(len(was_missed), dtype=bool)
    copies = int(np.ceil(levels.misses - 1))
    for object_id, here in _objects(scene):
        rng = _draws(scene, levels, _MISSES, object_id)
        # the last copy of a level between whole numbers is that of some objects alone
        is_used = rng.random(copies) < levels.misses - 1 - np.arange(copies)
        if card.drive is None:
            lag = rng.integers(len(here), size=copies)
        else:
            lag = rng.integers(round(MAX_LAG_S * card.task.rate), size=copies)
        for later in lag[is_used].tolist():
            again = np.roll(was_missed[here], later)
            if card.drive is not None:
                again[:later] = False
            is_missed[here] |= again
    # a false detection has the number -1, and takes the last value
    return np.append(is_missed, False)[rows.true_row]


def _filled(rows: _Rows, scene: Scene, card: Card, levels: PerturbSection) -> _Rows:
    """Return the rows with detections of missed objects.

    A gap keeps the error and the score of the object's last detection before it, or of
    another object of its class.
    """
    truth = scene.truth
    is_missed = missed(scene, card, rows.true_row)
    found = np.flatnonzero(rows.true_row >= 0)
    donor_of = np.full(len(is_missed), -1)  # the detection of each true box
    donor_of[rows.true_row[found]] = found
    is_filled = np.zeros(len(is_missed), dtype=bool)
    for object_id, here in _objects(scene):
        rng = _draws(scene, levels, _MISSES, object_id)
        for first, last in true_runs(is_missed[here]):
            draw, choice = rng.random(2)
            is_filled[here[first:last]] = draw >= levels.misses
            if first > 0 and donor_of[here[first - 1]] >= 0:
                donor_of[here[first:last]] = donor_of[here[first - 1]]
                continue
            row = here[first]
            same = rows.class_id[found] == truth.class_id[row]
            others = found[same & (rows.frame[found] <= truth.frame_of_rows[row])]
            if len(others):
                donor_of[here[first:last]] = others[int(choice * len(others))]
    true_row = np.flatnonzero(is_filled & (donor_of >= 0))
    donor = donor_of[true_row]
    true_box = truth.box[rows.true_row[donor]]
    moved = rows.velocity[donor] - truth.velocity[rows.true_row[donor]]
    added = _Rows(
        frame=truth.frame_of_rows[true_row],
        true_row=true_row,
        box=_moved(truth.box[true_row], _errors(rows.box[donor], true_box)),
        velocity=truth.velocity[true_row] + moved,
        class_id=truth.class_id[true_row],
        score=rows.score[donor],
    )
    return joined([rows, added])


def _errors(box: Floats, true_box: Floats) -> Floats:
    """Return errors [R, 7]: x y z m, yaw rad, and logarithms of ratios of sizes."""
    error = box - true_box
    error[:, 3] = wrap_angle(error[:, 3])
    error[:, 4:] = np.log(box[:, 4:] / true_box[:, 4:])
    return error


def _moved(true_box: Floats, error: Floats) -> Floats:
    """Return true boxes with errors of `_errors`."""
    box = true_box + error
    box[:, 4:] = true_box[:, 4:] * np.exp(error[:, 4:])
    return box


def _with_noise(box: Floats, true_box: Floats, level: float) -> Floats:
    """Return boxes with ``level`` times their own errors.

    Front and rear that are confused stay so, unless nothing is left of the errors.
    """
    error = _errors(box, true_box)
    turn = np.where(np.abs(error[:, 3]) > np.pi / 2, np.pi * np.sign(error[:, 3]), 0)
    error[:, 3] -= turn
    error *= level
    error[:, 3] += turn * (level > 0)
    return _moved(true_box, error)


def _with_false(rows: _Rows, scene: Scene, levels: PerturbSection) -> _Rows:
    """Return the rows with fewer or more false detections.

    A false object stays or goes as a whole. A new one has the life of one that was
    recorded, and begins at a random time where another one began, seen from the ego.
    """
    if levels.false == 1:
        return rows
    lives = list(_lives(select(rows, rows.true_row < 0)))
    rng = _draws(scene, levels, _FALSE)
    parts = [select(rows, rows.true_row >= 0)]
    for copy in range(int(np.ceil(levels.false))):
        for life in lives:
            # the last copy of a level between whole numbers is that of some alone
            is_used = rng.random() < levels.false - copy
            length = life.frame[-1] - life.frame[0]
            start = int(rng.integers(scene.frames - length))
            other = lives[int(rng.integers(len(lives)))]
            if is_used:
                new = _begun(life, other, start, scene.ego) if copy else life
                parts.append(new)
    return joined(parts)


def _begun(life: _Rows, other: _Rows, start: int, ego: Floats) -> _Rows:
    """Return a life that begins at frame ``start`` where ``other`` began.

    The ego [F, 4] sees the beginnings in the same place.
    """
    first = life.frame[0]
    from_ego = other.box[0, :2] - ego[other.frame[0], :2]
    place = ego[start, :2] + rotate(from_ego, ego[start, 3] - ego[other.frame[0], 3])
    turn = ego[start, 3] - ego[first, 3]
    box = life.box.copy()
    box[:, :2] = place + rotate(life.box[:, :2] - life.box[0, :2], turn)
    box[:, 2] += ego[start, 2] - ego[first, 2]
    box[:, 3] = wrap_angle(box[:, 3] + turn)
    frame = life.frame - first + start
    return replace(life, frame=frame, box=box, velocity=rotate(life.velocity, turn))


def _lives(rows: _Rows) -> Iterator[_Rows]:
    """Yield the detections of each false object: near each other in frames in a row."""
    life = np.arange(len(rows.frame))
    for t in np.unique(rows.frame):
        here = np.flatnonzero(rows.frame == t)
        before = np.flatnonzero(rows.frame == t - 1)
        row, column = _pairs(rows, here, rows, before, np.full(len(here), NEAR_M))
        life[here[row]] = life[before[column]]
    for number in np.unique(life):
        yield select(rows, life == number)


def _least_scores(detections: Detections, level: float) -> Floats:
    """Return the least score [F] of a detection in each frame.

    It is ``level``, or that quantile of the scores so far where scores are not
    probabilities.
    """
    least = np.full(detections.frames, level or -np.inf)
    if not level:
        return least
    for t in range(detections.frames):
        so_far = detections.score[: detections.start[t + 1]]
        if len(so_far) and (so_far.min() < 0 or so_far.max() > 1):
            least[t] = np.quantile(so_far, level)
    return least


def _late(rows: _Rows, scene: Scene, card: Card, delay: float) -> _Rows:
    """Return the rows ``delay`` frames later.

    In the part of a frame, boxes move back along the velocity of their object.
    """
    frames = int(delay)
    is_true = rows.true_row >= 0
    velocity = rows.velocity.copy()
    velocity[is_true] = scene.truth.velocity[rows.true_row[is_true]]
    box = rows.box.copy()
    back_s = (delay - frames) / card.task.rate
    box[:, :2] -= back_s * np.nan_to_num(velocity)
    late = replace(rows, frame=rows.frame + frames, box=box)
    return select(late, late.frame < scene.frames)

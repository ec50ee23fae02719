"""Signs in the truth, the ego and the clock: how things move, and where they go on."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.spatial import KDTree

from ..core import Bools, Floats, Ints, pieces_of, wrap_angle
from .form_signs import LONG, heading_signs
from .recording import NEVER, Motion, Places, RecordedScene, from_ego
from .signs import Sign

_WALKERS = ("pedestrian",)
_MOVING_MPS = 2.0  # from which a heading is that of the motion
_WALKING_MPS = 0.4
_STANDING_MPS = 0.5
_MIN_COUNT = 5  # below which a share says nothing
_MIN_STEPS = 50  # below which speeds say nothing
_HARD_MPS2 = 6.0  # acceleration that is no surprise
_NOISE_M = 0.3  # of a true place
_TURN_SHARE = 0.15  # of a step, by which a car's next one may differ
_FROZEN_ROWS = 3
_STANDING_GATES = 0.5  # distance of a detection of an object that stands
_STANDING_SHARE = 0.5  # of frames with such a detection
_LANE_M = 2.0  # from the middle of a lane to a vehicle on it
_LANE_STEP_M = 1.0
_LANE_COS = 0.7  # between the directions of a lane and of a vehicle on it


def jitter_signs(recording: RecordedScene) -> Iterator[Sign]:
    """Yield how far true objects jump to and fro in the median, m."""
    _, bend = _bends(recording.motion)
    if len(bend):
        size = float(np.median(np.hypot(*bend.T)))
        yield Sign("truth_jitter", size, size / 2)


def truth_signs(recording: RecordedScene) -> Iterator[Sign]:
    """Yield the signs in the truth, the ego and the clock."""
    if len(recording.truth.box):
        motion = recording.motion
        row, bend = _bends(motion)
        if len(row):
            yield _object_jump(motion, row, bend)
            yield _common_jump(recording, motion.frame[row], bend)
        yield _stop_dead(recording)
        yield from _identities(recording)
        moves = recording.is_of(motion.class_id, LONG) & (motion.speed > _MOVING_MPS)
        along = np.cos(motion.yaw - motion.course)
        yield from heading_signs("truth", along[moves], motion.object_id[moves])
        yield from _map(recording, moves)
        yield from _speeds(recording, moves)
        yield _ego_frame(recording)
        yield _sparse(recording)
    if recording.has_ego and recording.frames >= _MIN_COUNT:
        yield from _ego(recording)
    if recording.frames > 1:
        yield _clock(recording)


def _bends(motion: Motion) -> tuple[Ints, Floats]:
    """Return rows [n] between two neighbours of their object, and their bends, m.

    Bend [n, 2]: the second difference, twice the way to the middle of the neighbours.
    """
    both = motion.steady[1:] & motion.steady[:-1]
    row = np.flatnonzero(both) + 1
    return row, motion.xy[row + 1] - 2 * motion.xy[row] + motion.xy[row - 1]


def _object_jump(motion: Motion, row: Ints, bend: Floats) -> Sign:
    """Return the largest jump of one object against steady acceleration."""
    bends = np.full_like(motion.xy, np.nan)
    bends[row] = bend
    # one false place adds 1, -2 and 1 times its error to three bends
    jump = np.hypot(*(bends[:-2] - 2 * bends[1:-1] + bends[2:]).T) / 6
    usual_step = np.zeros(len(motion.xy))
    for first, last in motion.spans:
        if last > first:
            usual_step[first:last] = np.median(motion.step[first:last])
    surprise = jump / (_NOISE_M + _TURN_SHARE * usual_step[1:-1])
    surprise[~np.isfinite(surprise)] = 0.0
    if not surprise.any():
        return Sign("truth_jump", 0.0)
    middle = int(surprise.argmax()) + 1
    before = middle - 1 + int(np.nanargmax(motion.step[middle - 1 : middle + 1]))
    return Sign(
        "truth_jump",
        float(surprise.max()),
        float(motion.step[before]),
        first=int(motion.frame[before]),
        last=int(motion.frame[before + 1]),
        object_id=int(motion.object_id[middle]),
    )


def _common_jump(recording: RecordedScene, frame: Ints, bend: Floats) -> Sign:
    """Return the largest jump of all objects at once."""
    sign = Sign("all_jump", 0.0)
    counts = np.bincount(frame, minlength=recording.frames)
    for t in np.flatnonzero(counts >= _MIN_COUNT).tolist():
        here = bend[frame == t]
        middle = np.median(here, axis=0)
        spread = np.median(np.hypot(*(here - middle).T))
        jump = float(np.hypot(*middle) - spread)
        if jump > sign.value:
            sign = Sign("all_jump", jump, first=t, last=t + 1)
    return sign


def _stop_dead(recording: RecordedScene) -> Sign:
    """Return the largest speed from which an object stands still until it ends.

    Detections there mean that it really stands.
    """
    motion = recording.motion
    places = (motion.xy, motion.frame, motion.class_id)
    reach_m = _STANDING_GATES * float(recording.gate.max())
    _, row = recording.detected.nearest(*places, reach_m)
    sign = Sign("padded_last", 0.0)
    for first, last in motion.spans.tolist():
        step = motion.step[first:last]
        moves = np.flatnonzero(step)
        if not len(moves) or len(step) - 1 - moves[-1] < _FROZEN_ROWS:
            continue
        stop = int(moves[-1]) + 1  # steps before the object stands still
        if np.mean(row[first + stop + 1 : last + 1] != NEVER) > _STANDING_SHARE:
            continue
        seconds = np.diff(motion.time[first : first + stop + 1])
        speeds = (step[:stop] / seconds)[-_FROZEN_ROWS:]
        speed = float(min(np.median(speeds), speeds[-1]))
        if speed > sign.value:
            sign = Sign(
                "padded_last",
                speed,
                first=int(motion.frame[first + stop]),
                last=int(motion.frame[last]),
                object_id=int(motion.object_id[first]),
            )
    return sign


def _identities(recording: RecordedScene) -> Iterator[Sign]:
    """Yield objects that exchange places, and the share that go on as others."""
    motion = recording.motion
    heir = _heirs(recording, motion)
    follows = np.append(motion.joined, False)  # the next row is of the same object
    leaves = np.flatnonzero((heir != NEVER) & follows)
    old = heir[leaves] - 1  # where the heir's object was before
    exchange = (old >= 0) & (heir[old] == leaves + 1)
    if exchange.any():
        row = leaves[exchange][0]
        yield Sign(
            "ids_exchanged",
            float(exchange.sum() // 2),
            first=int(motion.frame[row] + motion.stride),
            last=recording.frames - 1,
            object_id=int(motion.object_id[row]),
            other_id=int(motion.object_id[heir[row]]),
        )
    begins = np.append(True, ~motion.joined)
    ends = np.flatnonzero(~follows & (motion.frame < recording.frames - 1))
    inherited = (heir[ends] != NEVER) & begins[heir[ends]]
    share = float(inherited.mean()) if len(ends) >= _MIN_COUNT else 0.0
    yield Sign("ids_broken", share)


def _heirs(recording: RecordedScene, motion: Motion) -> Ints:
    """Return the row [n] of another object where the object of each row should go.

    `NEVER` if no other is there, and if the object itself goes near.
    """
    heir = np.full(len(motion.xy), NEVER)
    row = np.flatnonzero(motion.steady) + 1
    ahead = 2 * motion.xy[row] - motion.xy[row - 1]
    gate = recording.gate[motion.class_id[row]]
    places = Places(motion.xy, motion.frame, motion.class_id)
    distance, goal = places.nearest(
        ahead,
        motion.frame[row] + motion.stride,
        motion.class_id[row],
        float(gate.max(initial=0)),
    )
    there = motion.xy[np.minimum(row + 1, len(motion.xy) - 1)]
    own = np.where(
        np.append(motion.joined, False)[row], np.hypot(*(there - ahead).T), np.inf
    )
    other = (goal != NEVER) & (motion.number[goal] != motion.number[row])
    other &= (distance < 0.5 * gate) & (own > gate)
    heir[row[other]] = goal[other]
    return heir


def _map(recording: RecordedScene, moves: Bools) -> Iterator[Sign]:
    """Yield the share of moving vehicles that are on no lane that runs their way."""
    motion = recording.motion
    points = _lane_points(recording)
    if moves.sum() < _MIN_STEPS or not len(points):
        return
    near = KDTree(points[:, :2]).query_ball_point(motion.xy[moves], _LANE_M)
    fits = [
        bool((np.cos(points[rows, 2] - angle) > _LANE_COS).any())
        for rows, angle in zip(near, motion.course[moves], strict=True)
    ]
    yield Sign("wrong_map", 1.0 - float(np.mean(fits)))


def _lane_points(recording: RecordedScene) -> Floats:
    """Return points [n, 3] of the middle lines: x y m, and the direction, rad."""
    points = [np.empty((0, 3))]
    for lane in recording.scene.lanes:
        step = np.diff(lane.center, axis=0)
        count = np.maximum(np.hypot(*step.T) / _LANE_STEP_M, 1.0).astype(int)
        part = np.concatenate([np.arange(n) / n for n in count])
        way = np.repeat(step, count, axis=0)
        start = np.repeat(lane.center[:-1], count, axis=0)
        points.append(np.column_stack([start + part[:, None] * way, _course(way)]))
    return np.concatenate(points)


def _course(way: Floats) -> Floats:
    """Return the direction [n] of ways [n, 2], rad."""
    return np.arctan2(way[:, 1], way[:, 0])


def _speeds(recording: RecordedScene, moves: Bools) -> Iterator[Sign]:
    """Yield the usual speed of walkers, and a high one of vehicles."""
    motion = recording.motion
    walks = recording.is_of(motion.class_id, _WALKERS) & (motion.speed > _WALKING_MPS)
    if walks.sum() >= _MIN_STEPS:
        walking = float(np.median(motion.speed[walks]))
        yield Sign("walking_fast", walking)
        yield Sign("walking_slow", 1.0 / walking, walking)
    if moves.any():
        yield Sign("driving_fast", float(np.quantile(motion.speed[moves], 0.9)))


def _ego_frame(recording: RecordedScene) -> Sign:
    """Return how much plainer motion is if truth is taken as seen by the ego."""
    motion = recording.motion
    speed = np.hypot(*np.diff(recording.ego[:, :2], axis=0).T) / np.diff(
        recording.scene.time
    )
    is_moving = recording.has_ego and np.median(speed) >= _MOVING_MPS
    if not is_moving or motion.joined.sum() < _MIN_STEPS:
        return Sign("all_ego_frame", 0.0)
    pose = recording.ego[motion.frame]
    stated = _plainness(motion, motion.xy, motion.yaw)
    placed = _plainness(motion, from_ego(motion.xy, pose), motion.yaw + pose[:, 3])
    is_plain = placed[1] > 0.5  # else headings are wrong in both
    return Sign("all_ego_frame", float((placed - stated).max()) * is_plain)


def _plainness(motion: Motion, xy: Floats, yaw: Floats) -> Floats:
    """Return shares [2] of steps that stand still, and that go where the box faces."""
    step = np.diff(xy, axis=0)[motion.joined]
    speed = np.hypot(*step.T) / np.diff(motion.time)[motion.joined]
    moves = speed > _MOVING_MPS
    agrees = np.ones(1, dtype=bool)
    if moves.mean() >= 0.1:
        along = np.cos(yaw[:-1][motion.joined] - _course(step))
        agrees = along[moves] > 0.9
    return np.array([(speed < _STANDING_MPS).mean(), agrees.mean()])


def _sparse(recording: RecordedScene) -> Sign:
    """Return the share of frames without truth through which objects live on."""
    first, last = recording.motion.frame[recording.motion.spans].T
    frames = np.arange(recording.frames)
    begun = np.searchsorted(np.sort(first), frames, side="right")
    ended = np.searchsorted(np.sort(last), frames, side="left")
    empty = np.diff(recording.truth.start) == 0
    sparse = empty & (begun > ended) & np.isin(frames, recording.scene.annotated_frames)
    return Sign("truth_sparse", float(sparse.mean()), undo=partial(_annotated, ~empty))


def _annotated(annotated: Bools, recording: RecordedScene) -> RecordedScene:
    """Return the recording with its annotated frames [F] stated."""
    return replace(recording, scene=replace(recording.scene, annotated=annotated))


def _ego(recording: RecordedScene) -> Iterator[Sign]:
    """Yield the largest jump of the ego, and its angle to its own way."""
    xy = recording.ego[:, :2]
    bend = np.hypot(*np.diff(xy, n=2, axis=0).T)
    piece = pieces_of(recording.scene.time, recording.period)
    bend[piece[2:] != piece[:-2]] = 0.0
    middle = int(bend.argmax())
    jump = float(bend[middle])
    hard = _HARD_MPS2 * recording.period**2
    yield Sign("ego_jump", jump - hard, jump, first=middle, last=middle + 2)
    step = xy[2:] - xy[:-2]
    moves = np.hypot(*step.T) / (2 * recording.period) > _MOVING_MPS
    if moves.sum() >= _MIN_COUNT:
        turn = wrap_angle(recording.ego[1:-1, 3] - _course(step))[moves]
        degrees = float(np.degrees(np.median(turn)))
        yield Sign("ego_heading", abs(degrees), degrees)


def _clock(recording: RecordedScene) -> Sign:
    """Return how far apart times are, in periods of the card."""
    ratio = float(np.median(np.diff(recording.scene.time))) / recording.period
    return Sign("clock", abs(float(np.log2(ratio))), ratio)

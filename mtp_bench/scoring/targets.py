"""Targets, why one may lack a forecast, live frames and units of uncertainty (docs/definitions, "Targets", "Ranks")."""

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..core import (
    Bools,
    DataError,
    Floats,
    Ints,
    Ragged,
    Scene,
    ShapeError,
    rotate,
    wrap_angle,
)
from .definitions import BLOCK_SECONDS, MOVING_SPEED, TURNING
from .events import (
    HOLES,
    LOST_TARGETS,
    counted_in_run,
    history,
    pieces,
    separated,
    separated_truth,
)
from .neutral import evaluated
from .pairs import near_pairs

_EXCESS = 0.05  # of BLOCK_SECONDS, by which the blocks of a scene may exceed it together, for 41 frames at 2 Hz


@dataclass(frozen=True, eq=False)
class Targets(Ragged):
    """Targets of a scene, ``n`` of them, sorted by their row in the truth."""

    row: Ints  # [n] row of the truth
    frame: Ints  # [n]
    object_id: Ints  # [n]
    class_id: Ints  # [n]
    future: Floats  # [n, T, 2] true x y of the next T frames, m, frame of the scene
    distance: Floats  # [n] m to the ego now (BEV)
    approach: Floats  # [n] m, nearest BEV distance to the ego over the future
    moving: Bools  # [n] straight displacement over the future, by its time, above MOVING_SPEED
    turning: Bools  # [n] heading changes by more than TURNING from now to the last future frame

    def __len__(self) -> int:
        return len(self.row)


def find_targets(scene: Scene, card: Card) -> Targets:
    """Targets of ``scene``: eligible, not neutral, with P past frames (the current one included) and T future ones.

    Objects that no label of an image could confirm are neutral. The P + T frames are consecutive, without a hole in
    time, and the object may be neutral in all but the current one. Targets of an official list need the T future
    frames only.
    ``moving`` and ``turning`` are measured in the world also where every frame has its own frame of reference; where
    headings are nominal, no target turns.
    Raises DataError where an object occurs twice in a frame.
    """
    truth, future = evaluated(scene).truth, card.task.future
    past = 1 if scene.listed_targets else card.task.past
    frame = truth.frame_of_rows
    try:
        objects = history(frame, separated(truth.object_id, pieces(scene, card)[frame]))
    except ShapeError as error:
        raise DataError(f"scene {scene.name!r}: {error}") from None
    window = past + future
    place = _windows(objects.identity, objects.frame, window)
    rows = (
        objects.order[place[:, None] + np.arange(window)]
        if len(place)
        else np.zeros((0, window), dtype=np.intp)
    )
    now = rows[:, past - 1]
    wanted = truth.eligible[now] & ~truth.neutral[now]
    rows = rows[wanted][np.argsort(now[wanted])]
    now = rows[:, past - 1]
    xy = np.asarray(truth.box[:, :2], dtype=np.float64)
    ahead = rows[:, past:]
    steps = frame[now][:, None] + np.arange(1, future + 1)
    ego = np.asarray(scene.ego[:, :2], dtype=np.float64)
    end = rows[:, -1]
    seconds = scene.time[frame[end]] - scene.time[frame[now]]
    travelled = np.linalg.norm(
        _in_world(scene, xy[end], frame[end]) - _in_world(scene, xy[now], frame[now]),
        axis=-1,
    )
    return Targets(
        start=np.searchsorted(frame[now], np.arange(scene.frames + 1)),
        row=now,
        frame=frame[now],
        object_id=np.asarray(truth.object_id)[now],
        class_id=np.asarray(truth.class_id)[now],
        future=xy[ahead],
        distance=np.linalg.norm(xy[now] - ego[frame[now]], axis=-1),
        approach=np.linalg.norm(xy[ahead] - ego[steps], axis=-1).min(
            axis=1, initial=np.inf
        ),
        moving=travelled > MOVING_SPEED * seconds,
        turning=_turned(scene, end, now, card.source.traits.places_only),
    )


class AbsentCause(IntEnum):
    """Why a target may have no forecast: the first cause that holds, as its detections tell, not the agent."""

    NO_FORECAST = 0  # a detection of its class lies inside the forecast gate
    OTHER_CLASS = 1  # one of another class does
    OFF_PLACE = 2  # one of its class lies within two gates
    UNDETECTED_NEW = (
        3  # none of its class lay inside the gate in any earlier frame of the object
    )
    UNDETECTED_SEEN = 4


def absent_causes(scene: Scene, targets: Targets, card: Card) -> Ints:
    """Values of `AbsentCause` [n] of the ``targets``; frames in which an object is neutral are frames of it too.

    After a hole in time an object is another one.
    """
    truth, seen = separated_truth(scene, card), scene.detections
    gate = np.asarray(card.per_class(card.task.forecast_gate), dtype=np.float64)
    at = truth.frame_of_rows, truth.box[:, :2]
    row, column, distance = near_pairs(
        *at, seen.frame_of_rows, seen.box[:, :2], 2 * float(gate.max())
    )
    limit = gate[truth.class_id[row]]
    own, inside = truth.class_id[row] == seen.class_id[column], distance <= limit

    def of_targets(pairs: Bools) -> Bools:
        return np.bincount(row[pairs], minlength=len(truth.box))[targets.row] > 0

    objects = history(at[0], truth.object_id)
    now = np.bincount(row[own & inside], minlength=len(truth.box))[objects.order] > 0
    ever = np.zeros(len(now), dtype=bool)
    ever[objects.order] = counted_in_run(objects.follows, now) > 0
    holds = [
        of_targets(own & inside),
        of_targets(~own & inside),
        of_targets(own & (distance <= 2 * limit)),
    ]
    return np.select(
        [*holds, ~ever[targets.row]], list(AbsentCause)[:4], AbsentCause.UNDETECTED_SEEN
    )


def live_frames(scene: Scene, card: Card) -> Bools:
    """The frames [F] in which a target can exist: only there false forecasts count (docs/definitions, "Targets")."""
    past, future = 0 if scene.listed_targets else card.task.past - 1, card.task.future
    t, piece = np.arange(scene.frames), pieces(scene, card)
    whole = (
        piece[np.maximum(t - past, 0)]
        == piece[np.minimum(t + future, scene.frames - 1)]
    )
    return np.asarray((t >= past) & (t < scene.frames - future) & whole)


def left_out(scene: Scene, card: Card) -> dict[str, int]:
    """Counts of the holes in time of a scene, and of the targets that it would have without them; none without holes.

    They stand beside `Scene.skipped`.
    """
    holes = int(pieces(scene, card).max(initial=0))
    if not holes:
        return {}
    even = replace(scene, time=np.arange(scene.frames) / card.task.rate)
    return {
        HOLES: holes,
        LOST_TARGETS: len(find_targets(even, card)) - len(find_targets(scene, card)),
    }


def _in_world(scene: Scene, xy: Floats, frame: Ints) -> Floats:
    """Places [n, 2] m of ``frame`` [n] in a frame of reference that all frames of the scene share."""
    return (
        xy
        if scene.world is None
        else rotate(xy, scene.world[frame, 3]) + scene.world[frame, :2]
    )


def _turned(scene: Scene, end: Ints, now: Ints, nominal: bool) -> Bools:
    """True [n] where the heading in the world differs between two rows of the truth [n], unless it is ``nominal``."""
    truth, world = scene.truth, scene.world
    heading, frame = np.asarray(truth.box[:, 3], dtype=np.float64), truth.frame_of_rows
    heading = heading if world is None else heading + world[frame, 3]
    return (np.abs(wrap_angle(heading[end] - heading[now])) > TURNING) & (not nominal)


def _windows(ids: Ints, frames: Ints, length: int) -> NDArray[np.intp]:
    """First places [n] of ``length`` consecutive frames of one object."""
    if len(ids) < length:
        return np.zeros(0, dtype=np.intp)
    first, last = slice(0, len(ids) - length + 1), slice(length - 1, len(ids))
    return np.flatnonzero(
        (ids[first] == ids[last]) & (frames[last] - frames[first] == length - 1)
    )


def units(scene: Scene, card: Card) -> Ints:
    """Index of the block [F] of each frame of ``scene``: blocks of at most 20 s are the units of uncertainty.

    The blocks have equal numbers of frames, up to one, and are as few as possible. The frames must be about equally
    spaced in time; a hole counts as one period.
    """
    if scene.frames < 2:
        return np.zeros(scene.frames, dtype=np.int64)
    missing = (np.diff(scene.time) - 1.0 / card.task.rate)[
        np.diff(pieces(scene, card)) > 0
    ].sum()
    seconds = (
        float(scene.time[-1] - scene.time[0] - missing)
        * scene.frames
        / (scene.frames - 1)
    )
    count = max(
        1, int(np.ceil(round(seconds / BLOCK_SECONDS - _EXCESS, 9)))
    )  # times are sums of rounded periods
    return np.arange(scene.frames) * count // scene.frames

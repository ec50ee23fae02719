"""Samples of motion and of distances between objects, comparable for recorded and simulated traffic.

Everything is measured at 2 Hz, of objects within `REACH` of the sensor; the velocity of a frame is that since the frame
before.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mtp_bench.core import Bools, Floats, Scene, Truth
from mtp_bench.core.geometry import wrap_angle
from mtp_bench.detector.visibility import VISIBLE, visible_fractions

VEHICLES = ("car", "truck", "bus", "trailer", "construction_vehicle", "motorcycle")
PERIOD = 0.5  # s
HORIZONS = (2, 4, 6, 12)  # periods
REACH = 60.0  # m from the sensor
MOVING = 0.5  # m/s
TURNING = 1.0  # m/s: the heading of who is slower says little
PAUSING = 0.3  # m/s, of people
PARKED = 1.0  # m from where it was first
BEHIND = (
    3.0,
    1.0,
    0.3,
)  # who drives at so many m/s follows who is this near to its axis (m) and heading (rad)
FARTHEST = 40.0  # m of gap that counts as following
HARD = -3.0  # m/s2

Samples = dict[str, Floats]


@dataclass(frozen=True)
class Motion:
    """Objects of a scene at 2 Hz; NaN where an object is not there."""

    time: Floats  # [F]
    ego: Floats  # [F, 4]
    box: Floats  # [N, F, 7]
    vehicle: Bools  # [N]
    person: Bools  # [N]
    velocity: Floats  # [N, F, 2] since the frame before


def motion(scene: Scene, classes: tuple[str, ...]) -> Motion:
    stride = max(round(PERIOD / float(np.median(np.diff(scene.time)))), 1)
    frame, truth = scene.truth.frame_of_rows, scene.truth
    near = np.hypot(*(truth.box[:, :2] - scene.ego[frame, :2]).T) <= REACH
    kept = near & (frame % stride == 0) & ~truth.neutral
    number, row = np.unique(truth.object_id[kept], return_inverse=True)
    frames = -(-scene.frames // stride)
    box = np.full((len(number), frames, 7), np.nan)
    box[row, frame[kept] // stride] = truth.box[kept]
    kind = np.zeros(len(number), dtype=np.int64)
    kind[row] = truth.class_id[kept]
    named = np.array(classes)[kind]
    moment = scene.time[::stride]
    velocity = np.full((len(number), frames, 2), np.nan)
    velocity[:, 1:] = np.diff(box[..., :2], axis=1) / np.diff(moment)[:, None]
    return Motion(
        moment,
        scene.ego[::stride],
        box,
        np.isin(named, VEHICLES),
        named == "pedestrian",
        velocity,
    )


def samples(moved: Motion) -> Samples:
    speed = np.hypot(moved.velocity[..., 0], moved.velocity[..., 1])
    with np.errstate(invalid="ignore"):
        moving = (speed >= MOVING) & moved.vehicle[:, None]
    return {
        **{
            f"vehicles {h}": error
            for h, error in constant_velocity(moved, moving).items()
        },
        **{
            f"people {h}": error
            for h, error in constant_velocity(
                moved, known(speed) & moved.person[:, None]
            ).items()
        },
        **driving(moved, speed, moving),
        **use(moved, speed),
        **density(moved),
    }


def known(values: Floats) -> Bools:
    return np.asarray(np.isfinite(values))


def constant_velocity(moved: Motion, start: Bools) -> dict[int, Floats]:
    """Mean errors over each horizon of those windows that are known to the end."""
    longest, place = HORIZONS[-1], moved.box[..., :2]
    errors = []
    for t in range(1, len(moved.time) - longest):
        rows = start[:, t]
        tau = (moved.time[t + 1 : t + 1 + longest] - moved.time[t])[:, None]
        expected = place[rows, t, None] + moved.velocity[rows, t, None] * tau
        errors.append(
            np.linalg.norm(expected - place[rows, t + 1 : t + 1 + longest], axis=-1)
        )
    error = np.concatenate([np.zeros((0, longest)), *errors])
    error = error[known(error).all(axis=1)]
    return {h: error[:, :h].mean(axis=1) for h in HORIZONS}


def driving(moved: Motion, speed: Floats, moving: Bools) -> Samples:
    step = np.diff(moved.time)
    gained = np.diff(speed, axis=1) / step
    turned = np.abs(wrap_angle(np.diff(moved.box[..., 3], axis=1))) / step
    both = moving[:, 1:] & known(gained)
    with np.errstate(invalid="ignore"):
        steers = moving[:, 1:] & (speed[:, 1:] >= TURNING)
    headway = [
        following(moved.box[:, t], speed[:, t], moved.vehicle)
        for t in range(1, len(moved.time))
    ]
    return {
        "speed": speed[moving],
        "acceleration": gained[both],
        "hard": (gained[both] < HARD).astype(float),
        "yaw rate": turned[steers & known(turned)],
        "headway": np.concatenate([np.zeros(0), *headway]),
    }


def following(box: Floats, speed: Floats, vehicle: Bools) -> Floats:
    """Time gaps to the nearest vehicle straight ahead, s."""
    there = np.flatnonzero(vehicle & known(speed))
    box, speed = box[there], speed[there]
    fast, aside, askew = BEHIND
    way = box[None, :, :2] - box[:, None, :2]
    cos, sin = np.cos(box[:, 3, None]), np.sin(box[:, 3, None])
    along, across = (
        cos * way[..., 0] + sin * way[..., 1],
        cos * way[..., 1] - sin * way[..., 0],
    )
    gap = along - (box[:, None, 4] + box[None, :, 4]) / 2
    ahead = (
        (along > 0)
        & (np.abs(across) < aside)
        & (np.abs(wrap_angle(box[None, :, 3] - box[:, 3, None])) < askew)
    )
    nearest = np.where(ahead & (gap < FARTHEST), gap, np.inf).min(
        axis=1, initial=np.inf
    )
    follows = (speed >= fast) & np.isfinite(nearest)
    return np.asarray(np.maximum(nearest[follows], 0.0) / speed[follows])


def use(moved: Motion, speed: Floats) -> Samples:
    """Motion of vehicles and people, by box."""
    there = known(speed)
    place = moved.box[..., :2]
    first = np.argmax(known(place[..., 0]), axis=1)
    away = np.linalg.norm(place - place[np.arange(len(place)), first][:, None], axis=-1)
    stays = np.broadcast_to(np.nanmax(away, axis=1)[:, None] < PARKED, there.shape)
    vehicles, people = there & moved.vehicle[:, None], there & moved.person[:, None]
    return {
        "parked": stays[vehicles].astype(float),
        "standing": (~stays & (speed < MOVING))[vehicles].astype(float),
        "moving": (~stays & (speed >= MOVING))[vehicles].astype(float),
        "pausing": (speed[people] < PAUSING).astype(float),
        "walking": speed[people & (speed >= PAUSING)],
    }


def density(moved: Motion) -> Samples:
    counts: dict[str, list[Floats]] = {"visible": [], "within 5": [], "within 10": []}
    for t in range(len(moved.time)):
        box = moved.box[known(moved.box[:, t, 0]), t]
        between = np.linalg.norm(box[:, None, :2] - box[None, :, :2], axis=-1)
        none, no = np.zeros(len(box), dtype=int), np.zeros(len(box), dtype=bool)
        frame = Truth(
            np.array([0, len(box)]), box, np.zeros((len(box), 2)), none, none, no, no
        )
        counts["visible"].append(visible_fractions(frame, moved.ego[t : t + 1]))
        for far in (5, 10):
            counts[f"within {far}"].append((between < far).sum(axis=1) - 1.0)
    joined = {
        name: np.concatenate([np.zeros(0), *values]) for name, values in counts.items()
    }
    level = np.sum(joined.pop("visible")[:, None] < np.array(VISIBLE), axis=1)
    there = known(moved.box[..., 0])
    return {
        **joined,
        **{f"occluded {k}": (level == k).astype(float) for k in range(4)},
        "vehicles": there[moved.vehicle].sum(axis=0).astype(float),
        "people": there[moved.person].sum(axis=0).astype(float),
    }

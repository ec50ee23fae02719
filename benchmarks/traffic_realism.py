"""Simulated traffic beside recorded traffic: how people drive and walk, and how full their scenes are.

    python benchmarks/traffic_realism.py [--data ROOT] [--targets ROOT] [--scenes 24] [--first 100] [--json FILE]

`--data` holds nuScenes mini (all objects) and KITTI; `--targets` the training scenes of nuScenes, where only prediction
targets are known. All are measured by the same code: at 2 Hz, objects within 60 m of the sensor, boxes as they are
labelled; the velocity of a frame is that since the frame before. Generator 2 was fitted on seeds 0 to 23; `--first` is
the first seed that is shown.

A vehicle moves at 0.5 m/s and more; parked is who stays within 1 m all the time. Errors of constant velocity are mean
distances over the horizon, of moving vehicles and of all people on foot, where the next six seconds are known.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.tracking.report import show
from mtp_bench.cards import Card, HighwaySource, load_card, parse_card
from mtp_bench.detector.sight import VISIBLE, visible_fraction
from mtp_bench.geometry import wrap_angle
from mtp_bench.sources import load_scenes
from mtp_bench.types import Bools, Floats, Scene

VEHICLES = ("car", "truck", "bus", "trailer", "construction_vehicle", "motorcycle")
PERIOD = 0.5  # s
HORIZONS = (2, 4, 6, 12)  # periods
REACH = 60.0  # m from the sensor
MOVING = 0.5  # m/s
TURNING = 1.0  # m/s: the heading of who is slower says little
PARKED = 1.0  # m from where it was first
BEHIND = (3.0, 1.0, 0.3)  # who drives at so many m/s follows who is this near to its axis (m) and heading (rad)
FARTHEST = 40.0  # m of gap that counts as following
HARD = -3.0  # m/s2

Samples = dict[str, Floats]
MEAN: Callable[[Floats], float] = lambda x: float(np.mean(x))  # noqa: E731


def quantile(share: float) -> Callable[[Floats], float]:
    return lambda x: float(np.quantile(x, share))


# name, samples that it is made of, how, and what simulated traffic should reach (None: no target, beside reality)
FIGURES: tuple[tuple[str, str, Callable[[Floats], float]], ...] = (
    *((f"vehicles, error at {h * PERIOD:g} s (m)", f"vehicles {h}", MEAN) for h in HORIZONS),
    *((f"people, error at {h * PERIOD:g} s (m)", f"people {h}", MEAN) for h in HORIZONS),
    ("braking below -3 m/s2 (% of time)", "hard", lambda x: 100 * MEAN(x)),
    ("acceleration, 5 % (m/s2)", "acceleration", quantile(0.05)),
    ("acceleration, 95 % (m/s2)", "acceleration", quantile(0.95)),
    ("headway, 1 % (s)", "headway", quantile(0.01)),
    ("headway, 10 % (s)", "headway", quantile(0.1)),
    ("headway, 50 % (s)", "headway", quantile(0.5)),
    ("yaw rate, 50 % (rad/s)", "yaw rate", quantile(0.5)),
    ("yaw rate, 90 % (rad/s)", "yaw rate", quantile(0.9)),
    *((f"speed of moving, {q} % (m/s)", "speed", quantile(q / 100)) for q in (10, 25, 50, 75, 95)),
    *((f"vehicles {name} (%)", name, lambda x: 100 * MEAN(x)) for name in ("parked", "standing", "moving")),
    ("people slower than 0.3 m/s (%)", "pausing", lambda x: 100 * MEAN(x)),
    ("speed of people who walk, 50 % (m/s)", "walking", quantile(0.5)),
    ("vehicles per frame", "vehicles", MEAN),
    ("people per frame", "people", MEAN),
    ("others within 5 m", "within 5", MEAN),
    ("others within 10 m", "within 10", MEAN),
    *((f"occlusion level {k} (%)", f"occluded {k}", lambda x: 100 * MEAN(x)) for k in range(4)),
)  # fmt: skip


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
    return Motion(moment, scene.ego[::stride], box, np.isin(named, VEHICLES), named == "pedestrian", velocity)


def samples(moved: Motion) -> Samples:
    speed = np.hypot(moved.velocity[..., 0], moved.velocity[..., 1])
    with np.errstate(invalid="ignore"):
        moving = (speed >= MOVING) & moved.vehicle[:, None]
    return {
        **{f"vehicles {h}": error for h, error in constant_velocity(moved, moving).items()},
        **{f"people {h}": error for h, error in constant_velocity(moved, known(speed) & moved.person[:, None]).items()},
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
        errors.append(np.linalg.norm(expected - place[rows, t + 1 : t + 1 + longest], axis=-1))
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
    headway = [following(moved.box[:, t], speed[:, t], moved.vehicle) for t in range(1, len(moved.time))]
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
    along, across = cos * way[..., 0] + sin * way[..., 1], cos * way[..., 1] - sin * way[..., 0]
    gap = along - (box[:, None, 4] + box[None, :, 4]) / 2
    ahead = (along > 0) & (np.abs(across) < aside) & (np.abs(wrap_angle(box[None, :, 3] - box[:, 3, None])) < askew)
    nearest = np.where(ahead & (gap < FARTHEST), gap, np.inf).min(axis=1, initial=np.inf)
    follows = (speed >= fast) & np.isfinite(nearest)
    return np.asarray(np.maximum(nearest[follows], 0.0) / speed[follows])


def use(moved: Motion, speed: Floats) -> Samples:
    """What vehicles and people do, by box."""
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
        "pausing": (speed[people] < 0.3).astype(float),
        "walking": speed[people & (speed >= 0.3)],
    }


def density(moved: Motion) -> Samples:
    counts: dict[str, list[Floats]] = {"visible": [], "within 5": [], "within 10": []}
    for t in range(len(moved.time)):
        box = moved.box[known(moved.box[:, t, 0]), t]
        between = np.linalg.norm(box[:, None, :2] - box[None, :, :2], axis=-1)
        counts["visible"].append(np.asarray(visible_fraction(box, moved.ego[t])))
        for far in (5, 10):
            counts[f"within {far}"].append((between < far).sum(axis=1) - 1.0)
    joined = {name: np.concatenate([np.zeros(0), *values]) for name, values in counts.items()}
    level = np.sum(joined.pop("visible")[:, None] < np.array(VISIBLE), axis=1)
    there = known(moved.box[..., 0])
    return {
        **joined,
        **{f"occluded {k}": (level == k).astype(float) for k in range(4)},
        "vehicles": there[moved.vehicle].sum(axis=0).astype(float),
        "people": there[moved.person].sum(axis=0).astype(float),
    }


def figures(scenes: Iterable[Scene], classes: tuple[str, ...]) -> dict[str, float]:
    every = [samples(motion(scene, classes)) for scene in scenes]
    joined = {name: np.concatenate([each[name] for each in every]) for name in every[0]}
    return {name: made(joined[of]) for name, of, made in FIGURES if len(joined[of])}

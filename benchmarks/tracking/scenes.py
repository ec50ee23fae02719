"""Scenes that trackers are timed on: recordings and synthetic crowds, and what steps through them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from mtp_bench import load_submission
from mtp_bench.core import Observation, Task, Tracks
from mtp_bench.env.environment import MTPEnv
from mtp_bench.env.observation import LocalFrame, make_feed
from mtp_bench.tracking import HypothesisTracker

KITTI, NUSCENES = "MTP-KITTI-v0", "MTP-nuScenes-mini-v0"
ROOM = 60.0  # m2 per synthetic object

Row = dict[str, Any]
Scenes = dict[str, list[Observation]]
Start = Callable[
    [Task], Callable[[Observation], Any]
]  # makes what answers a scene frame by frame


def tracker(hypotheses: int, kind: Any = HypothesisTracker, **options: Any) -> Start:
    def start(task: Task) -> Callable[[Observation], Tracks]:
        made = kind(hypotheses, **options)
        made.reset(task)
        return made.step  # type: ignore[no-any-return]

    return start


def agent(hypotheses: int, name: str = "mtp") -> Start:
    def start(task: Task) -> Callable[[Observation], Any]:
        made = load_submission(name).build(task, hypotheses=hypotheses)
        made.reset(task)
        return made.act

    return start


def recordings(
    env_id: str, data: str | None, quick: bool = False, name: str | None = None
) -> tuple[Task, Scenes]:
    """All observations of the scenes of a card: the two shortest if ``quick``, or one by name."""
    env = MTPEnv(env_id, data=data, scenes=None if name is None else [name])
    scenes: Scenes = {}
    for scene in env.scene_names:
        env.reset(options={"scene": scene})
        feed = make_feed(env.scene, LocalFrame.of(env.scene), env.task, env.card)
        scenes[scene] = [feed.observe(t) for t in range(env.scene.frames)]
    return env.task, dict(
        sorted(scenes.items(), key=lambda scene: len(scene[1]))[:2]
    ) if quick else scenes


def crowd(n: int, frames: int, seed: int = 0) -> tuple[Task, Scenes]:
    """Cars and pedestrians that walk at random in a square; 2 Hz, a tenth undetected, as many false positives.

    Density does not depend on ``n``. At 60 m2 per object a car has several others within its gate.
    """
    rng, side = np.random.default_rng([seed, n]), np.sqrt(ROOM * n)
    class_id, size = np.arange(n) % 2, np.array([[4.5, 1.9, 1.6], [0.7, 0.7, 1.8]])
    xy, heading = rng.uniform(0, side, (n, 2)), rng.uniform(-np.pi, np.pi, n)
    speed = np.where(class_id == 0, 5.0, 1.2) * rng.uniform(0, 1, n)
    made: list[Observation] = []
    for _ in range(frames):
        heading += rng.normal(0, 0.1, n)
        xy += (
            0.5 * speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
        )
        heading = np.where(
            ((xy < 0) | (xy > side)).any(axis=1),
            np.arctan2(*(side / 2 - xy).T[::-1]),
            heading,
        )
        seen, false = (
            np.flatnonzero(rng.random(n) > 0.1),
            rng.integers(0, n, rng.poisson(0.1 * n)),
        )
        kind = class_id[np.concatenate([seen, false])]
        box = np.zeros((len(kind), 7))
        box[:, :2] = np.concatenate([xy[seen], rng.uniform(0, side, (len(false), 2))])
        box[:, 3], box[:, 4:] = heading[np.concatenate([seen, false])], size[kind]
        box[:, :4] += rng.normal(0, 0.15, (len(kind), 4))
        made.append(
            {
                "detection_box": box.astype(np.float32),
                "detection_class": kind.astype(np.int32),
                "detection_score": rng.uniform(0.2, 1.0, len(kind)).astype(np.float32),
                "detection_valid": np.ones(len(kind), dtype=np.int8),
                "detection_velocity": np.zeros((len(kind), 2), dtype=np.float32),
            }
        )
    task = Task(
        "synthetic",
        ("car", "pedestrian"),
        0.5,
        4,
        12,
        10,
        10,
        2 * n,
        32 * n,
        2 * n,
        20,
        "megvii",
    )
    return task, {f"{n} objects": made}


def frames_of(scenes: Scenes) -> int:
    return sum(map(len, scenes.values()))


def run_scene(start: Start, task: Task, observations: Iterable[Observation]) -> None:
    step = start(task)
    for observation in observations:
        step(observation)

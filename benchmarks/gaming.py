"""The gain from cheating: STP with dishonest answers, and honest agents, under the ranking error.

    python benchmarks/gaming.py --env MTP-nuScenes-mini-v0 [--scenes N] [--data ROOT] [--jobs N] [--json FILE]

Each dishonest row is what plain STP answered, changed afterwards; "blurred" and "dropping" rows are STP that was shown
worse detections, the mean of four draws of the noise. Differences are to STP, with their 95 % interval over units.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtp_bench import Agent, Observation
from mtp_bench.cards import Card
from mtp_bench.env.environment import MTPEnv
from mtp_bench.parallel import Workers, cores, parallel_map
from mtp_bench.running.options import RunOptions
from mtp_bench.running.reference import reference_for
from mtp_bench.running.run import agent_task, run_scene
from mtp_bench.scoring import AgentScores, Report, SceneScore, live_frames, score_scene, summarise
from mtp_bench.submission.loader import load_submission
from mtp_bench.types import Rollout, Scene, Task, starts_of_sorted

HONEST = ("truth_past", "stp", "stp_same_budget", "stp_hedged", "mtp")
NOISES = 4
Rows = NDArray[np.intp]
Change = Callable[[Scene, Rollout, Card], Rollout]


def choose(rollout: Rollout, row: Rows, frame: Rows, **changed: Any) -> Rollout:
    """The rollout with the objects ``row`` [n] in frames ``frame`` [n]; ``changed`` arrays are of these rows."""
    order = np.argsort(frame, kind="stable")
    names = ("object_box", "object_class", "object_confidence", "forecast", "forecast_log_weight")
    arrays = {name: changed.get(name, getattr(rollout, name)[row])[order] for name in names}
    return replace(rollout, object_start=starts_of_sorted(frame[order], rollout.frames), **arrays)


def frames_of(rollout: Rollout) -> Rows:
    return np.asarray(rollout.objects.frame_of_rows, dtype=np.intp)


def silence(scene: Scene, rollout: Rollout, card: Card) -> Rollout:
    return choose(rollout, np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp))


def silence_where_nobody_looks(scene: Scene, rollout: Rollout, card: Card) -> Rollout:
    row = np.flatnonzero(live_frames(scene, card)[frames_of(rollout)])
    return choose(rollout, row, frames_of(rollout)[row])


def repeated(frames: int, confidence: float) -> Change:
    """Every forecast is said again in the next ``frames`` frames."""

    def change(scene: Scene, rollout: Rollout, card: Card) -> Rollout:
        frame = frames_of(rollout)
        row = np.arange(len(frame))
        late = [row[frame + i < rollout.frames] for i in range(1, frames + 1)]
        rows = np.concatenate([row, *late])
        at = np.concatenate([frame, *(frame[r] + i for i, r in enumerate(late, start=1))])
        sure = rollout.object_confidence[rows].copy()
        sure[len(row) :] = confidence
        return choose(rollout, rows, at, object_confidence=sure)

    return change


def every_class(scene: Scene, rollout: Rollout, card: Card) -> Rollout:
    count, classes = len(rollout.object_class), len(card.task.classes)
    rows = np.tile(np.arange(count), classes)
    class_id = (rollout.object_class[rows] + np.repeat(np.arange(classes), count)) % classes
    return choose(rollout, rows, frames_of(rollout)[rows], object_class=class_id)


def widened(factor: float) -> Change:
    def change(scene: Scene, rollout: Rollout, card: Card) -> Rollout:
        path = rollout.forecast.astype(np.float64)
        mean = path.mean(axis=1, keepdims=True)
        wide = np.clip(mean + factor * (path - mean), -32000, 32000)
        return replace(rollout, forecast=np.rint(wide).astype(np.int16))

    return change


def far_pair(scene: Scene, rollout: Rollout, card: Card) -> Rollout:
    """Two samples of weight 1/2 at 200 m on both sides; the others weigh next to nothing."""
    path, weight = rollout.forecast.copy(), np.full_like(rollout.forecast_log_weight, -20.0)
    path[:, 0], path[:, 1] = 20_000, -20_000
    weight[:, :2] = np.log(0.5)
    return replace(rollout, forecast=path, forecast_log_weight=weight)


def doubled(offsets: NDArray[np.float64], confidence: Callable[[NDArray[Any]], NDArray[Any]]) -> Change:
    """Copies of every object, moved by ``offsets`` [n, 2] m; ``confidence`` of copies from that of the object."""

    def change(scene: Scene, rollout: Rollout, card: Card) -> Rollout:
        count = len(rollout.object_box)
        rows = np.tile(np.arange(count), 1 + len(offsets))
        box, sure = rollout.object_box[rows].copy(), rollout.object_confidence[rows].copy()
        box[count:, :2] += np.repeat(offsets, count, axis=0)
        sure[count:] = confidence(sure[count:])
        return choose(rollout, rows, frames_of(rollout)[rows], object_box=box, object_confidence=sure)

    return change


def confidences(change: Callable[[Scene, Rollout], NDArray[Any]]) -> Change:
    def changed(scene: Scene, rollout: Rollout, card: Card) -> Rollout:
        return replace(rollout, object_confidence=np.clip(change(scene, rollout), 0, 1).astype(np.float32))

    return changed


def crowded(scene: Scene, rollout: Rollout) -> NDArray[np.float64]:
    """Neighbours within 5 m of each object, as a share of 4."""
    from scipy.spatial import KDTree

    if not len(rollout.object_box):
        return np.zeros(0)
    place = np.column_stack([rollout.object_box[:, :2], 1e4 * frames_of(rollout)])
    near = KDTree(place).query_ball_point(place, 5.0, return_length=True) - 1
    return np.asarray(np.minimum(near / 4.0, 1.0))


def moving(scene: Scene, rollout: Rollout) -> NDArray[np.float64]:
    """The length of each forecast, as a share of 10 m."""
    end = rollout.forecast[:, :, -1].astype(np.float64).mean(axis=1) / 100.0
    return np.asarray(np.minimum(np.hypot(end[:, 0], end[:, 1]) / 10.0, 1.0))


def sure(rollout: Rollout) -> NDArray[np.float64]:
    return rollout.object_confidence.astype(np.float64)


CROSS = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
RNG_SEED = 7
CHANGES: dict[str, Change] = {
    "silence": silence,
    "silence where nobody looks": silence_where_nobody_looks,
    "repeats 1 frame, confidence 1": repeated(1, 1.0),
    "repeats 1 frame, confidence 0": repeated(1, 0.0),
    "repeats 3 frames, confidence 1": repeated(3, 1.0),
    "repeats 3 frames, confidence 0": repeated(3, 0.0),
    "every class": every_class,
    "samples x1.5": widened(1.5),
    "samples x3": widened(3.0),
    "far pair": far_pair,
    "duplicates": doubled(np.zeros((1, 2)), lambda c: c),
    "duplicates, half as sure": doubled(np.zeros((1, 2)), lambda c: 0.5 * c),
    "copies 1 m around": doubled(CROSS, lambda c: 0.5 * c),
    "random confidence": confidences(lambda s, r: np.random.default_rng(RNG_SEED).random(len(r.object_box))),
    "inverted confidence": confidences(lambda s, r: 1.0 - sure(r)),
    "confidence 1": confidences(lambda s, r: np.ones(len(r.object_box))),
    "surer in a crowd": confidences(lambda s, r: 0.5 * sure(r) + 0.5 * crowded(s, r)),
    "surer of what moves": confidences(lambda s, r: 0.5 * sure(r) + 0.5 * moving(s, r)),
}


class WorseEyes:
    """An agent that sees its detections moved by noise, or not at all."""

    def __init__(self, agent: Agent, sigma: float, drop: float, seed: int) -> None:
        self._agent, self._sigma, self._drop, self._seed = agent, sigma, drop, seed

    def reset(self, task: Task) -> None:
        """A new scene; its noise depends on nothing but the seed."""
        self._rng = np.random.default_rng(self._seed)
        self._agent.reset(task)

    def act(self, observation: Observation) -> dict[str, Any]:
        """Answer what is seen."""
        box = observation["detection_box"].copy()
        box[:, :2] += self._rng.normal(0.0, self._sigma, (len(box), 2)) if self._sigma else 0.0
        kept = self._rng.random(len(box)) >= self._drop
        order = np.argsort(~(kept & (observation["detection_valid"] == 1)), kind="stable")  # valid rows come first
        shown = {**observation, "detection_box": box}
        shown["detection_valid"] = observation["detection_valid"] * kept.astype(np.int8)
        rows = ("detection_box", "detection_velocity", "detection_score", "detection_class", "detection_valid")
        return self._agent.act({**shown, **{name: shown[name][order] for name in rows}})


EYES = {"blurred by 25 cm": (0.25, 0.0), "dropping 5 %": (0.0, 0.05)}


def play(env_id: str, options: RunOptions, scene: str) -> dict[str, list[SceneScore]]:
    """Scores of every row on one scene, one per seed of the noise."""
    found: dict[str, list[SceneScore]] = {}
    for name in HONEST:
        submission = load_submission(name)
        env = MTPEnv(env_id, **options.env_keywords, observe=submission.compare.observe, evaluation=True)
        agent = submission.build(agent_task(env, 0))
        rollout = run_scene(agent, env, scene, 0)
        found[name] = [score_scene(env.scene, rollout, env.card)] * NOISES
        if name == "stp":
            for label, change in CHANGES.items():
                found[label] = [score_scene(env.scene, change(env.scene, rollout, env.card), env.card)] * NOISES
            for label, (sigma, drop) in EYES.items():
                worse = [WorseEyes(agent, sigma, drop, seed) for seed in range(NOISES)]
                found[label] = [score_scene(env.scene, run_scene(w, env, scene, 0), env.card) for w in worse]
    return found


def report_of(env_id: str, options: RunOptions) -> Report:
    card = options.card(env_id)
    scenes = MTPEnv(env_id, **options.env_keywords).scene_names[: options.scenes]
    reference = reference_for(card, scenes, options)
    played = parallel_map(play, [(env_id, options, scene) for scene in scenes], options.workers, lambda place: None)
    agents = [
        AgentScores(
            name, 0, card.task.samples, "equal", tuple(zip(*(p[name] for p in played), strict=True)), name == HONEST[0]
        )
        for name in played[0]
    ]
    return summarise(agents, card, reference)


def main() -> None:
    from rich.console import Console
    from rich.table import Table

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", required=True)
    parser.add_argument("--scenes", type=int)
    parser.add_argument("--data")
    parser.add_argument("--jobs", type=int, default=cores())
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    start = time.perf_counter()
    report = report_of(given.env, RunOptions(given.data, given.scenes, workers=Workers(given.jobs)))
    table = Table(title=f"{given.env}: {report.condition['weights']}")
    for column in ("row", "all", "- stp", "p", "ids", "- stp", "p", "reacq.", "- stp", "p", "lost", "energy"):
        table.add_column(column, justify="left" if column == "row" else "right")
    for name in dict.fromkeys(row.agent for row in report.rows):
        rows = {row.subset: row for row in report.rows if row.agent == name}
        cells = []
        for subset in ("all", "ids", "reacquired"):
            row = rows[subset]
            cells += [shown(row.error, 3), shown(row.difference_to_stp, 3, "+"), shown(row.p, 3)]
        table.add_row(name, *cells, shown(rows["lost"].error, 2), shown(rows["all"].energy_score, 2))
    Console(width=130).print(table)
    print(f"{time.perf_counter() - start:.0f} s")
    if given.json:
        given.json.write_text(json.dumps(report.to_json("condition", "details"), indent=1) + "\n", encoding="utf-8")


def shown(value: float | None, digits: int, sign: str = "") -> str:
    return "-" if value is None else f"{value:{sign}.{digits}f}"


if __name__ == "__main__":
    main()

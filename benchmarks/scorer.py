"""Speed of the scorer: its CLEAR counts beside motmetrics and TrackEval, bADE beside one plain matching.

    python benchmarks/scorer.py [--scenes 10] [--frames 300] [--objects 20] [--area 80] [--json FILE]
    python benchmarks/scorer.py --env MTP-Intersection-v0 [--agent mtp] [--scenes 3] [--data ROOT]

Without ``--env``: boxes per CPU-second on the same synthetic frames. A box is a true box or a track box. The peers get
their distances or similarities ready-made, before their clock starts. With ``--env``: targets and forecasts per
CPU-second of the whole score of an agent's rollouts, and of its parts; one matching with every forecast kept is the
yardstick of the matchings at all cuts. CPU time (all threads) is the least of ``--repeats`` runs.
``--growth``: the same frames with 500 and 5 000 objects, the exponent of the time over the boxes, and the peak memory.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import resource
import time
import warnings
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from tests.support.tracking_counts import tracking_counts

GATE = 2.0  # m
GROWTH = 500, 5000  # objects per frame
Frames = list[tuple[str, int, Any, Any, Any, Any]]
Counts = dict[str, float]


def synthetic_frames(
    scenes: int, frames: int, objects: int, area: float, seed: int = 0
) -> Frames:
    """Objects on random walks in a square; their tracks with noise, misses (8 %), switches (1 %) and false boxes."""
    rng = np.random.default_rng(seed)
    made: Frames = []
    for s in range(scenes):
        xy, velocity = (
            rng.uniform(0, area, (objects, 2)),
            rng.normal(0, 0.5, (objects, 2)),
        )
        ids, unused = np.arange(objects), objects
        for t in range(frames):
            velocity = np.where(
                (xy < 0) | (xy > area), -np.sign(xy) * np.abs(velocity), velocity
            )
            xy = xy + velocity
            switched = rng.random(objects) < 0.01
            ids = np.where(switched, unused + np.arange(objects), ids)
            seen, false = rng.random(objects) > 0.08, int(rng.poisson(1.5))
            track_ids = np.concatenate([ids[seen], unused + objects + np.arange(false)])
            track_xy = np.concatenate(
                [
                    xy[seen] + rng.normal(0, 0.4, (seen.sum(), 2)),
                    rng.uniform(0, area, (false, 2)),
                ]
            )
            unused += objects + false
            made.append((f"s{s}", t, np.arange(objects), xy, track_ids, track_xy))
    return made


def ours(mode: Any) -> Callable[[Frames], Callable[[], Counts]]:
    """The scorer's CLEAR counts, straight from the frames."""

    def prepare(frames: Frames) -> Callable[[], Counts]:
        def run() -> Counts:
            return {
                k: float(v)
                for k, v in tracking_counts(frames, GATE, mode).items()
                if v is not None
            }

        return run

    return prepare


def motmetrics(frames: Frames) -> Callable[[], Counts]:
    """One accumulator per scene; distances beyond the gate are NaN, as it asks for."""
    import motmetrics as mm

    by_scene: dict[str, list[Any]] = {}
    for scene, _, true_ids, true_xy, track_ids, track_xy in frames:
        distance = np.linalg.norm(true_xy[:, None] - track_xy, axis=-1)
        distance[distance > GATE] = np.nan
        by_scene.setdefault(scene, []).append((true_ids, track_ids, distance))
    names = [
        "num_detections",
        "num_misses",
        "num_false_positives",
        "num_switches",
        "num_fragmentations",
    ]

    def run() -> Counts:
        total = np.zeros(len(names))
        for rows in by_scene.values():
            accumulator = mm.MOTAccumulator(auto_id=True)
            for row in rows:
                accumulator.update(*row)
            summary: Any = mm.metrics.create().compute(accumulator, metrics=names)
            total += summary.iloc[0].to_numpy(dtype=float)
        return dict(zip(("TP", "FN", "FP", "IDS", "FRAG"), total.tolist(), strict=True))

    return run


def trackeval(frames: Frames) -> Callable[[], Counts]:
    """CLEAR of TrackEval on similarities max(0, 1 - d / 4), so that 0.5 lies at the gate."""
    with contextlib.redirect_stdout(io.StringIO()):
        import trackeval as te

        metric = te.metrics.CLEAR({"THRESHOLD": 0.5, "PRINT_CONFIG": False})
    by_scene: dict[str, list[Any]] = {}
    for scene, _, true_ids, true_xy, track_ids, track_xy in frames:
        distance = np.linalg.norm(true_xy[:, None] - track_xy, axis=-1)
        by_scene.setdefault(scene, []).append(
            (true_ids, track_ids, np.maximum(0.0, 1.0 - distance / (2 * GATE)))
        )
    data = []
    for rows in by_scene.values():
        names = np.unique(np.concatenate([row[1] for row in rows]))
        data.append(
            {
                "num_gt_dets": sum(len(row[0]) for row in rows),
                "num_tracker_dets": sum(len(row[1]) for row in rows),
                "num_gt_ids": len(np.unique(np.concatenate([row[0] for row in rows]))),
                "num_tracker_ids": len(names),
                "num_timesteps": len(rows),
                "gt_ids": [row[0] for row in rows],
                "tracker_ids": [np.searchsorted(names, row[1]) for row in rows],
                "similarity_scores": [row[2] for row in rows],
            }
        )

    def run() -> Counts:
        results = [metric.eval_sequence(scene) for scene in data]
        keys = {
            "TP": "CLR_TP",
            "FN": "CLR_FN",
            "FP": "CLR_FP",
            "IDS": "IDSW",
            "FRAG": "Frag",
        }
        return {
            name: float(sum(result[key] for result in results))
            for name, key in keys.items()
        }

    return run


PROGRAMS: dict[str, tuple[Callable[[Frames], Callable[[], Counts]], str]] = {
    "mtp_bench, frame": (ours("frame"), "mtp-bench"),
    "mtp_bench, sticky": (ours("sticky"), "mtp-bench"),
    "motmetrics": (motmetrics, "motmetrics"),
    "TrackEval CLEAR": (trackeval, "trackeval"),
}


def measure(frames: Frames, repeats: int) -> list[dict[str, Any]]:
    boxes = sum(len(frame[2]) + len(frame[4]) for frame in frames)
    rows = []
    for name, (prepare, package) in PROGRAMS.items():
        run = prepare(frames)
        seconds, counts = [], Counts()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for _ in range(repeats):
                start = time.process_time()
                counts = run()
                seconds.append(time.process_time() - start)
        least = min(seconds)
        rows.append(
            {
                "program": name,
                "version": version(package),
                "cpu_s": least,
                "boxes_per_s": boxes / least,
                **counts,
            }
        )
    return rows


def measure_ranks(
    env_id: str, agent: str, scenes: int, data: str | None, repeats: int
) -> None:
    """Print the time of bADE on rollouts of ``agent``."""
    from rich.console import Console
    from rich.table import Table

    from mtp_bench.agent.loader import load_submission
    from mtp_bench.env.environment import MTPEnv
    from mtp_bench.running.playing import agent_task, run_scene
    from mtp_bench.scoring import AgentScores, find_targets, live_frames, score_scene
    from mtp_bench.scoring.forecasts import (
        Candidates,
        RecordedForecasts,
        match_by_confidence,
        match_objects,
    )
    from mtp_bench.scoring.table import agent_table

    submission = load_submission(agent)
    env = MTPEnv(env_id, data=data, evaluation=True, observe=submission.compare.observe)
    card, start = env.card, time.process_time()
    runs = []
    for name in env.scene_names[:scenes]:
        rollout = run_scene(submission.build(agent_task(env, 0)), env, name, 0)
        runs.append((env.scene, rollout))
    running = time.process_time() - start
    said = [RecordedForecasts.of(rollout) for _, rollout in runs]
    found = [
        Candidates.of(
            scene, find_targets(scene, card), forecasts, live_frames(scene, card), card
        )
        for (scene, _), forecasts in zip(runs, said, strict=True)
    ]
    scores = tuple(score_scene(scene, rollout, card) for scene, rollout in runs)
    setting = AgentScores(agent, 0, card.task.samples, "equal", (scores,))
    steps: dict[str, Callable[[], object]] = {
        "one matching, every forecast kept": lambda: [
            match_objects(scene.truth, f.frame, f.box, f.class_id, card)
            for (scene, _), f in zip(runs, said, strict=True)
        ],
        "matchings at all cuts": lambda: [
            match_by_confidence(c, f.confidence)
            for c, f in zip(found, said, strict=True)
        ],
        "errors at all budgets": lambda: agent_table(setting, None),
        "whole score": lambda: [
            [score_scene(scene, rollout, card) for scene, rollout in runs],
            agent_table(setting, None),
        ],
    }
    targets, forecasts = (
        sum(len(score) for score in scores),
        sum(len(f.frame) for f in said),
    )
    table = Table(
        title=f"{env_id}, {agent}: {len(runs)} scenes, {targets:,} targets, {forecasts:,} forecasts"
    )
    for column in (
        "step",
        "CPU s",
        "targets / CPU s",
        "forecasts / CPU s",
        "of running the agent",
    ):
        table.add_column(column, justify="left" if column == "step" else "right")
    for name, step in steps.items():
        least = min(timed(step) for _ in range(repeats))
        share = f"{least / running:.3f}"
        table.add_row(
            name,
            f"{least:.4f}",
            f"{targets / least:,.0f}",
            f"{forecasts / least:,.0f}",
            share,
        )
    Console().print(table)


def timed(step: Callable[[], object]) -> float:
    """CPU seconds of one call."""
    start = time.process_time()
    step()
    return time.process_time() - start


def measure_growth(repeats: int) -> None:
    """Print CPU time of CLEAR counts and peak memory against the objects of a frame, at equal density."""
    spent: dict[int, dict[str, float]] = {}
    for objects in GROWTH:
        frames = synthetic_frames(1, 20, objects, 80.0 * (objects / 20) ** 0.5)
        tracking_counts(frames[:2])  # imports happen here
        steps = {mode: ours(mode)(frames) for mode in ("frame", "sticky")}
        spent[objects] = {
            mode: min(timed(step) for _ in range(repeats))
            for mode, step in steps.items()
        }
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"{objects:5} objects: {spent[objects]} CPU s, peak {peak:.0f} MiB")
    few, many = GROWTH
    loglinear = many * np.log(many) / (few * np.log(few))
    for mode in spent[few]:
        slope, bound = (
            np.log(ratio) / np.log(many / few)
            for ratio in (spent[many][mode] / spent[few][mode], loglinear)
        )
        print(
            f"{mode}: CPU time grows as objects^{slope:.2f}; n log n would be objects^{bound:.2f}"
        )


def show(rows: list[dict[str, Any]], title: str) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title)
    for column in (
        "program",
        "version",
        "CPU s",
        "x sticky",
        "boxes / CPU s",
        "TP",
        "FN",
        "FP",
        "IDS",
        "FRAG",
    ):
        table.add_column(
            column, justify="left" if column in ("program", "version") else "right"
        )
    for row in rows:
        cost, ratio = (
            row["cpu_s"],
            row["cpu_s"] / rows[1]["cpu_s"],
        )  # the peers keep pairs, too
        counts = [f"{row[name]:.0f}" for name in ("TP", "FN", "FP", "IDS", "FRAG")]
        cells = f"{cost:.3f}", f"{ratio:.1f}", f"{row['boxes_per_s']:,.0f}"
        table.add_row(row["program"], row["version"], *cells, *counts)
    Console(width=110).print(table)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name, default in (
        ("scenes", 10),
        ("frames", 300),
        ("objects", 20),
        ("repeats", 3),
    ):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument(
        "--area",
        type=float,
        default=80.0,
        help="side of the square, m; smaller is more crowded",
    )
    parser.add_argument("--json", type=Path, default=None)
    parser.add_argument("--env")
    parser.add_argument("--agent", default="mtp")
    parser.add_argument("--growth", action="store_true")
    parser.add_argument("--data")
    given = parser.parse_args()
    if given.growth:
        measure_growth(given.repeats)
        return
    if given.env:
        measure_ranks(given.env, given.agent, given.scenes, given.data, given.repeats)
        return
    frames = synthetic_frames(given.scenes, given.frames, given.objects, given.area)
    tracking_counts(frames[:2])  # imports happen here
    rows = measure(frames, given.repeats)
    boxes = sum(len(frame[2]) + len(frame[4]) for frame in frames)
    show(
        rows,
        f"{boxes:,} boxes: {given.scenes} scenes x {given.frames} frames, {given.objects} objects, {given.area:g} m",
    )
    if given.json:
        setting = {
            "scenes": given.scenes,
            "frames": given.frames,
            "objects": given.objects,
            "area_m": given.area,
        }
        given.json.write_text(
            json.dumps({**setting, "boxes": boxes, "rows": rows}, indent=1) + "\n",
            encoding="utf-8",
        )


if __name__ == "__main__":
    main()

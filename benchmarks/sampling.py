"""Cost of samplers, and how well the k samples that they return stand for the pool.

    python benchmarks/sampling.py [--data ROOT] [--frames 200] [--repeats 5] [--json FILE]

Pools of real tracks: the tracker with 20 hypotheses, on KITTI and nuScenes mini. `all hypotheses` is what the agent mtp
reduces: k random samples of every hypothesis, k times 20 of each object. `distinct tracks` stands for learned modes: k
samples of each distinct track, the same draws for all tracks, weighted by the hypotheses that hold it; objects with one
track have k samples and are passed on.

Frames are taken evenly from all scenes. CPU time of one core, of each frame the least of the repeats, in which the
samplers take turns. Error is the expected minADE over objects with more than k samples: the mean distance of a sample
of the pool, by weight, from the nearest one that is returned. scikit-learn is the peer: KMeans with seeds of k-means++,
once, to the end (its default of 300 iterations at most) and after three iterations, as ours.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path
from typing import Any

os.environ.update(
    dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
)

import numpy as np
from sklearn.cluster import KMeans

from benchmarks.tracking.report import show
from benchmarks.tracking.scenes import KITTI, NUSCENES, Row, recordings
from mtp_bench.agent import Forecasts, Frame, Sampler
from mtp_bench.agent.pipeline import entry_table, make_pools, normalised, padded
from mtp_bench.core import Floats, Observation, Task
from mtp_bench.core.errors import DataError
from mtp_bench.core.tracks import group
from mtp_bench.prediction import GreedySampler, KinematicPredictor, KMeansSampler
from mtp_bench.tracking import HypothesisTracker

HYPOTHESES = 20

Pool = tuple[Floats, Floats]  # [O, S, T, 2], log-weights [O, S]


class ScikitLearn:
    """KMeansSampler by scikit-learn, object by object."""

    def __init__(self, iterations: int) -> None:
        self._iterations = iterations

    def reduce(
        self, pool: Floats, log_weight: Floats, k: int, rng: np.random.Generator
    ) -> Pool:
        """Centres [O, k, T, 2] and log-weights [O, k]."""
        centre, weight = KMeansSampler(0).reduce(
            pool, log_weight, k, rng
        )  # for objects that are passed on
        for o in np.flatnonzero(np.isfinite(log_weight).sum(axis=1) > k):
            there = np.isfinite(log_weight[o])
            points, mass = (
                pool[o, there].reshape(-1, 2 * pool.shape[2]),
                np.exp(log_weight[o, there]),
            )
            seed = int(rng.integers(2**31))
            peer: Any = KMeans(
                k,
                init="k-means++",
                n_init="auto",
                max_iter=self._iterations,
                random_state=seed,
            )
            label = peer.fit(points, sample_weight=mass).labels_
            centre[o] = peer.cluster_centers_.reshape(k, -1, 2)
            with np.errstate(divide="ignore"):
                weight[o] = np.log(np.bincount(label, mass, minlength=k))
        return centre, weight


def samplers() -> dict[str, Sampler]:
    return {
        "scikit-learn, to the end": ScikitLearn(300),
        "scikit-learn, 3 iterations": ScikitLearn(3),
        "KMeansSampler": KMeansSampler(),
        "KMeansSampler, seeds only": KMeansSampler(0),
        "GreedySampler": GreedySampler(),
    }


def of_hypotheses(task: Task, predictor: KinematicPredictor, frame: Frame) -> Forecasts:
    """K samples of each track in each hypothesis, all of their own draws."""
    return predictor.predict(frame)


def of_tracks(task: Task, predictor: KinematicPredictor, frame: Frame) -> Forecasts:
    """K samples of each distinct track, all of the same draws."""
    track = np.arange(len(frame.tracks.box))
    return Forecasts(predictor.futures(frame, track, np.zeros_like(track), task.k))


KINDS = {"all hypotheses": of_hypotheses, "distinct tracks": of_tracks}


def pools(
    task: Task, observations: list[Observation], every: int
) -> dict[str, list[Pool]]:
    """Pools of every n-th frame of a scene."""
    tracker, predictor = HypothesisTracker(HYPOTHESES), KinematicPredictor()
    tracker.reset(task)
    predictor.reset(task)
    made: dict[str, list[Pool]] = {kind: [] for kind in KINDS}
    for t, observation in enumerate(observations):
        tracks = tracker.step(observation)
        leaf = group(tracks, task.objects, 0.5).leaf
        if t % every == every - 1 and len(leaf):
            for kind, make in KINDS.items():
                forecasts = make(task, predictor, Frame(t, tracks, (observation,)))
                row = np.where(
                    leaf >= 0,
                    forecasts.rows_of(tracks)[np.arange(leaf.shape[1]), leaf],
                    -1,
                )
                entries = entry_table(
                    make_pools(row, tracks.log_weight), np.arange(len(leaf))
                )
                made[kind].append(
                    padded(forecasts.samples, normalised(forecasts), *entries)
                )
    return made


def error(pool: Pool, found: Pool, k: int) -> Floats:
    """Expected minADE [objects with more than k samples], m."""
    errors = []
    for samples, log_weight, chosen, chosen_log_weight in zip(
        *pool, *found, strict=True
    ):
        there = np.isfinite(log_weight)
        if there.sum() > k:
            those = chosen[np.isfinite(chosen_log_weight)]
            distance = np.linalg.norm(samples[there][:, None] - those, axis=-1).mean(
                axis=-1
            )
            errors.append(
                np.average(
                    distance.min(axis=1),
                    weights=np.exp(log_weight[there] - log_weight[there].max()),
                )
            )
    return np.array(errors)


def compared(
    name: str, kind: str, task: Task, frames: list[Pool], repeats: int
) -> list[Row]:
    """A row for each sampler."""
    made = samplers()
    errors: dict[str, list[Floats]] = {}
    least = {sampler: np.full(len(frames), np.inf) for sampler in made}
    for repeat in range(repeats):
        for t, frame in enumerate(frames):
            for sampler, made_one in made.items():
                rng, begin = np.random.default_rng(t), time.process_time()
                found = made_one.reduce(*frame, task.k, rng)
                least[sampler][t] = min(least[sampler][t], time.process_time() - begin)
                if repeat == 0:
                    errors.setdefault(sampler, []).append(error(frame, found, task.k))
    size = np.concatenate(
        [np.isfinite(log_weight).sum(axis=1) for _, log_weight in frames]
    )
    common = {
        "scenes": name,
        "pool": kind,
        "frames": len(frames),
        "objects": len(size) / len(frames),
        "k": task.k,
    }
    crowded = {
        "reduced": np.count_nonzero(size > task.k) / len(frames),
        "their samples": size[size > task.k].mean(),
    }
    return [
        {
            **common,
            **crowded,
            "sampler": sampler,
            "ms per frame": 1e3 * least[sampler].mean(),
            "error, m": f"{np.concatenate(errors[sampler]).mean():.4f}",
        }
        for sampler in made
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--data",
        default=None,
        help="data root with KITTI, and nuScenes mini if it is there",
    )
    parser.add_argument(
        "--frames", type=int, default=200, help="frames of each data set, about"
    )
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--json", type=Path, default=None)
    given = parser.parse_args()
    rows: list[Row] = []
    for name, env in (("KITTI val", KITTI), ("nuScenes mini", NUSCENES)):
        try:
            task, scenes = recordings(env, given.data)
        except DataError as problem:
            print(f"{name} is left out: {problem}")
            continue
        every = max(1, sum(map(len, scenes.values())) // given.frames)
        parts: list[dict[str, Any]] = [
            pools(task, observations, every) for observations in scenes.values()
        ]
        for kind in KINDS:
            frames = [frame for part in parts for frame in part[kind]]
            rows += compared(name, kind, task, frames, given.repeats)
    show("Samplers: CPU ms per frame, expected minADE", rows)
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

"""CPU time of whole runs, and wall time of their stages."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

import mtp_bench.agent.pipeline as agent_module
import mtp_bench.tracking.tracker as tracker_module
from mtp_bench.core import Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler
from mtp_bench.tracking import HypothesisTracker
from mtp_bench.tracking.tree import HypothesisTree

from .scenes import Row, Scenes, Start, frames_of, run_scene

Pieces = tuple[tuple[Any, str, str], ...]  # owner, name of its function, stage


TRACKER_STAGES: Pieces = (
    (tracker_module, "_seen", "prepare observation"),
    (HypothesisTree, "predict", "predict"),
    (tracker_module, "sparse_gains", "affinity"),
    (HypothesisTracker, "_associate", "association"),  # calls sparse_gains
    (HypothesisTree, "grow", "grow tree"),
    (HypothesisTree, "merge_equal", "grow tree"),
    (HypothesisTracker, "_output", "output"),
)


AGENT_STAGES: Pieces = (
    (HypothesisTracker, "step", "track"),
    (agent_module, "group", "group"),
    (KinematicPredictor, "predict", "forecast"),
    (KMeansSampler, "reduce", "reduce samples"),
    (agent_module, "make_action", "action"),
)


def cpu_seconds(
    starts: dict[Any, Start], task: Task, scenes: Scenes, repeats: int
) -> dict[Any, float]:
    """CPU seconds of each over all scenes: the sum of the least of each scene."""
    for start in starts.values():  # imports, kernels
        run_scene(start, task, next(iter(scenes.values()))[:20])
    total = dict.fromkeys(starts, 0.0)
    for observations in scenes.values():
        least = dict.fromkeys(starts, np.inf)
        for _ in range(repeats):
            for name, start in starts.items():
                begin = time.process_time()
                run_scene(start, task, observations)
                least[name] = min(least[name], time.process_time() - begin)
        total = {name: total[name] + least[name] for name in starts}
    return total


@contextmanager
def wrapped(
    pieces: Pieces, wrap: Callable[[Callable[..., Any], str], Callable[..., Any]]
) -> Iterator[None]:
    """The pieces stand wrapped for what they are while the context lasts."""
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in pieces]
    try:
        for owner, name, stage in pieces:
            setattr(owner, name, wrap(getattr(owner, name), stage))
        yield
    finally:
        for owner, name, function in before:
            setattr(owner, name, function)


@contextmanager
def stopwatch(pieces: Pieces) -> Iterator[dict[str, float]]:
    """Wall seconds spent in the pieces while the context lasts, by stage."""
    spent = {stage: 0.0 for _, _, stage in pieces}

    def timed(function: Callable[..., Any], stage: str) -> Callable[..., Any]:
        def run(*args: Any, **keywords: Any) -> Any:
            begin = time.perf_counter()
            result = function(*args, **keywords)
            spent[stage] += time.perf_counter() - begin
            return result

        return run

    with wrapped(pieces, timed):
        yield spent


def stages(
    start: Start, pieces: Pieces, task: Task, scenes: Scenes, repeats: int
) -> Row:
    """Microseconds per frame by stage; each stage of a scene in the repeat that took least in all."""
    total = dict.fromkeys([*(stage for _, _, stage in pieces), "rest", "all"], 0.0)
    for observations in scenes.values():
        best: dict[str, float] = {"all": np.inf}
        for _ in range(repeats):
            with stopwatch(pieces) as spent:
                begin = time.perf_counter()
                run_scene(start, task, observations)
                seconds = time.perf_counter() - begin
            if "association" in spent:
                spent["association"] -= spent["affinity"]
            if seconds < best["all"]:
                best = {**spent, "rest": seconds - sum(spent.values()), "all": seconds}
        total = {stage: total[stage] + best[stage] for stage in total}
    return {
        stage: 1e6 * seconds / frames_of(scenes) for stage, seconds in total.items()
    }

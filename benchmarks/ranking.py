"""Checks of the statistics: null test of ranks, coverage of the interval of the mean.

    python benchmarks/ranking.py --env MTP-Intersection-v0 [--agent stp] [--seeds 12] [--scenes N] [--data ROOT]

Null test: in each resample the units are drawn at random, and for each unit two different runs of the same agent in
random order. Both are the same agent, so ranking them apart is an error; 5 % of it is promised. Coverage: all units are
taken for the whole world, whose mean is known; an interval of resampled units must hold it 95 % of the time.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from mtp_bench.parallel import Workers, cores
from mtp_bench.running.options import RunOptions
from mtp_bench.running.reference import reference_for
from mtp_bench.running.run import jobs_of, run_jobs
from mtp_bench.scoring import AgentScores, bootstrap_interval, effective_number, score_scene, sign_flip_test
from mtp_bench.scoring.definitions import SIGNIFICANT
from mtp_bench.scoring.table import agent_table
from mtp_bench.submission.loader import load_submission

RESAMPLES = 2000
UNITS = (6, 10, 15, 50)
SUBSETS = ("all", "ids", "reacquired")


def unit_sums(env_id: str, agent: str, options: RunOptions) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Per subset the errors [seeds, U] and the weight [U] of all units."""
    card, submission = options.card(env_id), load_submission(agent)
    from mtp_bench.env.environment import MTPEnv

    scenes = MTPEnv(env_id, **options.env_keywords).scene_names[: options.scenes]
    jobs = [job for seed in options.seeds for job in jobs_of(submission, env_id, options.env_keywords, scenes, seed)]
    scores = run_jobs(jobs, options, score_scene)
    reference = reference_for(card, scenes, options)
    tables = [
        agent_table(AgentScores(agent, 0, card.task.samples, "equal", (tuple(scores[i : i + len(scenes)]),)), reference)
        for i in range(0, len(scores), len(scenes))
    ]
    return {
        subset: (np.array([t.errors(subset) for t in tables]), tables[0].unit_weight(tables[0].weight[subset]))
        for subset in SUBSETS
    }


def apart(errors: np.ndarray, units: int, rng: np.random.Generator) -> float:
    """Share of resamples in which two runs of one agent are ranked apart."""
    count = 0
    for _ in range(RESAMPLES):
        unit = rng.integers(errors.shape[1], size=units)
        first = rng.integers(len(errors), size=units)
        second = (first + rng.integers(1, len(errors), size=units)) % len(errors)
        count += sign_flip_test(errors[first, unit] - errors[second, unit]).p < SIGNIFICANT
    return count / RESAMPLES


def covered(errors: np.ndarray, weight: np.ndarray, units: int, rng: np.random.Generator) -> tuple[float, float]:
    """Share of resamples whose interval holds the mean of all units, and their mean effective number of units."""
    mean = errors.mean(axis=0)
    true, held, effective = mean.sum() / weight.sum(), 0, []
    for _ in range(RESAMPLES):
        unit = rng.integers(len(weight), size=units)
        interval = bootstrap_interval(mean[unit], weight[unit])
        held += interval is not None and interval[0] <= true <= interval[1]
        effective.append(effective_number(weight[unit]))
    return held / RESAMPLES, float(np.mean(effective))


def main() -> None:
    from rich.console import Console
    from rich.table import Table

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", required=True)
    parser.add_argument("--agent", default="stp")
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--scenes", type=int)
    parser.add_argument("--data")
    given = parser.parse_args()
    start = time.perf_counter()
    options = RunOptions(given.data, given.scenes, range(given.seeds), workers=Workers(cores()))
    table = Table(title=f"{given.env}, {given.agent}, {given.seeds} seeds, {RESAMPLES} resamples")
    for column in ("subset", "units", "effective", "ranked apart %", "interval covers %"):
        table.add_column(column, justify="right")
    for subset, (errors, weight) in unit_sums(given.env, given.agent, options).items():
        for units in UNITS:
            rng = np.random.default_rng(units)
            share, effective = covered(errors, weight, units, rng)
            numbers = (100 * apart(errors, units, rng), 100 * share)
            table.add_row(subset, str(units), f"{effective:.1f}", *(f"{number:.1f}" for number in numbers))
    Console().print(table)
    print(f"{time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()

"""Dependence of bADE on the seeds of the event weights: disjoint sets of runs of the reference tracker.

    python benchmarks/event_weights.py [--envs MTP-Intersection-v0 ...] [--sets 4] [--runs 48] [--scenes N]

The agents run once; only the weights of the targets change. For each subset that ranks: the standard deviation of bADE
over the sets, of the worst agent, and that of the difference to STP, in metres, beside the half-width of the 95 %
interval. Recorded envs need MTP_BENCH_DATA or --data.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mtp_bench import MTPEnv
from mtp_bench.agent.loader import load_submission
from mtp_bench.cards import Card, load_card
from mtp_bench.core.parallel import Workers, cores
from mtp_bench.running.options import RunOptions
from mtp_bench.running.perturbation import RUNS
from mtp_bench.running.playing import jobs_of, run_jobs
from mtp_bench.running.reference import make_reference
from mtp_bench.scoring import AgentScores, score_scene, summarise
from mtp_bench.scoring.definitions import Subset
from mtp_bench.scoring.rows import Row
from mtp_bench.scoring.weights import Reference

ENVS = ("MTP-nuScenes-mini-v0", "MTP-Intersection-v0", "MTP-KITTI-v0")
AGENTS = ("stp", "stp_same_samples", "stp_hedged", "mtp", "gt_tracks")
SUBSETS: tuple[Subset, ...] = ("ids", "reacquired")


def played(card: Card, scenes: Sequence[str], options: RunOptions) -> list[AgentScores]:
    """Scores of the agents, one seed."""
    jobs = [
        job
        for name in AGENTS
        for job in jobs_of(load_submission(name), card, options.env_keywords, scenes)
    ]
    scores = run_jobs(jobs, options, score_scene)
    count, samples = len(scenes), card.task.samples
    return [
        AgentScores(
            name,
            0,
            samples,
            "equal",
            (tuple(scores[i * count : (i + 1) * count]),),
            submission.compare.observe,
        )
        for i, (name, submission) in enumerate(
            zip(AGENTS, map(load_submission, AGENTS), strict=True)
        )
    ]


def rows_of(
    agents: Sequence[AgentScores], card: Card, reference: Reference
) -> dict[tuple[str, str], Row]:
    """Rows by agent and subset, with the weights of one set of runs."""
    return {
        (row.agent, row.subset): row for row in summarise(agents, card, reference).rows
    }


def spread(
    sets: Sequence[dict[tuple[str, str], Row]], subset: str
) -> dict[str, Any] | None:
    """Standard deviations over sets, and half-widths of the first set, m, the largest over agents; None without."""
    errors = np.array(
        [[rows[name, subset].error or np.nan for name in AGENTS] for rows in sets]
    )
    if np.isnan(errors).any():
        return None
    away = errors - errors[:, :1]
    halves = {name: sets[0][name, subset].interval for name in AGENTS}
    return {
        "deviation": errors.std(axis=0, ddof=1).max(),
        "deviation_of_difference": away.std(axis=0, ddof=1).max(),
        "half_width": [
            None if pair is None else (pair[1] - pair[0]) / 2
            for pair in halves.values()
        ],
        "half_width_of_difference": [
            (pair[1] - pair[0]) / 2
            for name in AGENTS[1:]
            if (pair := sets[0][name, subset].difference_interval)
        ],
        "errors": {name: errors[:, i].tolist() for i, name in enumerate(AGENTS)},
        "effective_objects": sets[0]["stp", subset].effective_objects,
    }


def measure(
    env_id: str, options: RunOptions, count: int, runs: int = RUNS
) -> dict[str, Any]:
    """All sets of one env; ``seconds`` to make the weights of one."""
    card = load_card(env_id)
    scenes = MTPEnv(card, data=options.data).scene_names[: options.scenes]
    agents = played(card, scenes, options)
    start = time.perf_counter()
    references = [
        make_reference(card, scenes, options, range(i * runs, (i + 1) * runs))
        for i in range(count)
    ]
    seconds = (time.perf_counter() - start) / count
    sets = [rows_of(agents, card, reference) for reference in references]
    subsets = {subset: spread(sets, subset) for subset in SUBSETS}
    return {
        "env": env_id,
        "sets": count,
        "runs": runs,
        "seconds": round(seconds, 1),
        "subsets": subsets,
    }


def ranges(values: Sequence[float | None]) -> str:
    """Least and largest of some half-widths."""
    known = [value for value in values if value is not None]
    return f"{min(known):.3f} to {max(known):.3f}" if known else "-"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--envs", nargs="+", default=ENVS)
    parser.add_argument("--data")
    parser.add_argument("--sets", type=int, default=4)
    parser.add_argument("--runs", type=int, default=RUNS, help="per set, at most 255")
    parser.add_argument("--scenes", type=int)
    parser.add_argument("--jobs", type=int, default=cores())
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    options = RunOptions(
        arguments.data, arguments.scenes, workers=Workers(arguments.jobs)
    )
    results = []
    for env_id in arguments.envs:
        results.append(measure(env_id, options, arguments.sets, arguments.runs))
        print(
            f"{env_id}: {arguments.sets} sets of {arguments.runs} runs, {results[-1]['seconds']} s each"
        )
        for subset, row in results[-1]["subsets"].items():
            if row is None:
                print(f"  {subset:10}  no targets in a set")
                continue
            own, paired = (
                ranges(row["half_width"]),
                ranges(row["half_width_of_difference"]),
            )
            print(
                f"  {subset:10}  error: deviation {row['deviation']:.4f} m, half-width {own} m"
            )
            print(
                f"  {'':10}  to stp: deviation {row['deviation_of_difference']:.4f} m, half-width {paired} m",
                flush=True,
            )
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()

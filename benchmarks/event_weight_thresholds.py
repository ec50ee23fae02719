"""Share of the event weights that comes from reference runs with each score threshold.

    python benchmarks/event_weight_thresholds.py [--envs MTP-nuScenes-mini-v0 ...] [--scenes N] [--seeds 3]

A third of the 48 runs of the reference tracker sees all detections. The others see those above the 10 % or the 25 %
quantile of the scores of true ones. For each event and group of runs: the share of the weight that the group gives, and
the gain of hypotheses beyond the same samples, in metres, where the targets are weighed by the runs of that group
alone. The runs are those of the frozen weights; for a whole split the program compares the two. Recorded envs need
MTP_BENCH_DATA or --data.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence

import numpy as np

from mtp_bench import MTPEnv
from mtp_bench.agent.loader import load_submission
from mtp_bench.cards import Card, load_card
from mtp_bench.core.parallel import Workers, cores
from mtp_bench.running.options import RunOptions
from mtp_bench.running.perturbation import ASSIGNMENTS, QUANTILES, RUNS
from mtp_bench.running.playing import jobs_of, run_jobs
from mtp_bench.running.reference import frozen_reference, make_reference
from mtp_bench.scoring import AgentScores, score_scene, summarise
from mtp_bench.scoring.definitions import Subset
from mtp_bench.scoring.weights import COUNTED_EVENTS, Reference

ENVS = ("MTP-nuScenes-mini-v0", "MTP-Intersection-v0")
AGENTS = ("stp", "stp_same_samples", "mtp")
CONTROL = "stp_same_samples"
SUBSETS: tuple[Subset, ...] = ("ids", "reacquired")
THRESHOLDS = ("none", *(f"{quantile:.0%} quantile" for quantile in QUANTILES))
FEW_RUNS = 4


def threshold_of(run: int) -> str:
    """Return the score threshold of a reference run, as `Perturbation.perturbed` chooses it."""
    return THRESHOLDS[run // len(ASSIGNMENTS) % len(THRESHOLDS)]


def counts_of(reference: Reference, scenes: Sequence[str]) -> np.ndarray:
    """Return the number of runs [n, 4] with each event of `COUNTED_EVENTS`, over the targets of all scenes."""
    return np.concatenate([reference.of(scene).counts for scene in scenes]).astype(int)


def scores_of(
    names: Sequence[str], card: Card, scenes: Sequence[str], options: RunOptions
) -> list[AgentScores]:
    """Run baselines and return their scores, all seeds."""
    agents = []
    for name in names:
        submission = load_submission(name)
        runs = []
        for seed in options.seeds:
            jobs = jobs_of(submission, card, options.env_keywords, scenes, seed)
            runs.append(tuple(run_jobs(jobs, options, score_scene)))
        agents.append(
            AgentScores(
                name,
                0,
                card.task.samples,
                "equal",
                tuple(runs),
                submission.compare.observe,
            )
        )
    return agents


def gain_text(
    agents: Sequence[AgentScores], card: Card, reference: Reference, subset: Subset
) -> str:
    """Return bADE of `mtp` less that of the control on a subset, metres, with its interval and p."""
    report = summarise(agents, card, reference)
    row = next(
        row
        for row in report.paired
        if (row.agent, row.other, row.subset) == ("mtp", CONTROL, subset)
    )
    if row.error is None or row.interval is None:
        return "no test"
    low, high = row.interval
    return f"{row.error:+.3f} [{low:+.3f}, {high:+.3f}], p {row.p:.3f}"


def print_shares(
    counts: Mapping[str, np.ndarray], gains: Mapping[tuple[str, Subset], str]
) -> None:
    """Print a line per subset and threshold; ``counts``: runs [n, 4] with each event, by threshold."""
    total = np.sum(list(counts.values()), axis=0)
    for subset in SUBSETS:
        event = COUNTED_EVENTS.index(subset)
        runs = total[:, event]
        weight = runs.sum()
        rare = runs[runs <= FEW_RUNS].sum() / weight
        print(f"  {subset}: {weight / RUNS:.1f} weight, {(runs > 0).sum()} targets")
        print(
            f"    {rare:.1%} of the weight on targets with at most {FEW_RUNS} of {RUNS} runs"
        )
        for threshold, group in counts.items():
            share = group[:, event].sum() / weight
            print(
                f"    threshold {threshold:13} {share:6.1%} of the weight; mtp - control {gains[threshold, subset]}"
            )


def measure(env_id: str, options: RunOptions) -> None:
    """Make the weights of each group of runs, run the agents, and print the shares and the gains."""
    card = load_card(env_id)
    names = MTPEnv(card, data=options.data).scene_names
    scenes = options.chosen(names)
    runs_of = {
        threshold: [run for run in range(RUNS) if threshold_of(run) == threshold]
        for threshold in THRESHOLDS
    }
    references = {
        threshold: make_reference(card, scenes, options, runs)
        for threshold, runs in runs_of.items()
    }
    counts = {
        threshold: counts_of(reference, scenes)
        for threshold, reference in references.items()
    }
    agents = scores_of(AGENTS, card, scenes, options)
    gains = {
        (threshold, subset): gain_text(agents, card, reference, subset)
        for threshold, reference in references.items()
        for subset in SUBSETS
    }
    print(f"{env_id}: {len(scenes)} of {len(names)} scenes, {len(options.seeds)} seeds")
    frozen = frozen_reference(card)
    if frozen is not None and scenes == tuple(names):
        equal = np.array_equal(
            np.sum(list(counts.values()), axis=0), counts_of(frozen, scenes)
        )
        print(f"  sums over the groups equal the frozen weights: {equal}")
    print_shares(counts, gains)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--envs", nargs="+", default=ENVS)
    parser.add_argument("--data")
    parser.add_argument("--scenes", type=int)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--jobs", type=int, default=cores())
    arguments = parser.parse_args()
    for env_id in arguments.envs:
        seeds = range(arguments.seeds)
        options = RunOptions(
            arguments.data, arguments.scenes, seeds, workers=Workers(arguments.jobs)
        )
        measure(env_id, options)


if __name__ == "__main__":
    main()

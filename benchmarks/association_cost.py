"""Cost of wrong association and gain of hypotheses on training scenes of nuScenes that the project has not used.

    python -m benchmarks.association_cost --data ROOT --used ROOT [--every 1] [--seeds 1]

``--used``: a second data root. Its training scenes are left out, since motion noise was fitted to them. The agents
forecast constant velocity and share Megvii's detections. Their event weights are made from the scenes that are run, as
`mtp-bench compare --split train` makes them. The cost of association is how far `perfect_association_same_samples`
lowers bADE below that of `stp_same_samples`. The gain of hypotheses is how far `mtp` lowers it.
"""

from __future__ import annotations

import argparse

from benchmarks.event_weight_thresholds import scores_of
from mtp_bench import MTPEnv
from mtp_bench.cards import load_card, with_split
from mtp_bench.core.parallel import Workers, cores
from mtp_bench.running.options import RunOptions
from mtp_bench.running.reference import make_reference
from mtp_bench.scoring import Report, summarise
from mtp_bench.scoring.definitions import Subset

ENV = "MTP-nuScenes-v0"
SAME, PERFECT = "stp_same_samples", "perfect_association_same_samples"
AGENTS = ("stp", SAME, PERFECT, "mtp")
PAIRS = ((PERFECT, SAME), ("mtp", SAME))
SUBSETS: tuple[Subset, ...] = ("all", "ids", "reacquired")


def print_report(report: Report) -> None:
    """Print bADE of each agent, then the differences of `PAIRS`, metres."""
    for row in report.rows:
        if row.subset in SUBSETS:
            print(
                f"{row.agent:33} {row.subset:10} {row.error:.3f}, {row.effective_objects:.0f} effective objects"
            )
    for one, other in PAIRS:
        for subset in SUBSETS:
            pair = next(
                each
                for each in report.paired
                if (each.agent, each.other, each.subset) == (one, other, subset)
            )
            low, high = pair.interval or (float("nan"), float("nan"))
            print(
                f"{one} - {other}, {subset}: {pair.error:+.3f} [{low:+.3f}, {high:+.3f}], p {pair.p:.3f}"
            )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", required=True)
    parser.add_argument("--used", required=True)
    parser.add_argument(
        "--every", type=int, default=1, help="2 takes every second scene"
    )
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=cores())
    arguments = parser.parse_args()
    used = set(MTPEnv(ENV, data=arguments.used, split="train").scene_names)
    names = [
        name
        for name in MTPEnv(ENV, data=arguments.data, split="train").scene_names
        if name not in used
    ]
    scenes = tuple(names[:: arguments.every])
    card = with_split(load_card(ENV), "train")
    seeds = range(arguments.seeds)
    options = RunOptions(
        arguments.data,
        names=scenes,
        seeds=seeds,
        split="train",
        workers=Workers(arguments.jobs),
    )
    reference = make_reference(card, scenes, options)
    agents = scores_of(AGENTS, card, scenes, options)
    print(
        f"{ENV}, train: {len(scenes)} of {len(names)} scenes that {arguments.used} does not have"
    )
    print_report(summarise(agents, card, reference))


if __name__ == "__main__":
    main()

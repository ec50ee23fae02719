"""Do event weights depend on the seeds of their runs? Two disjoint sets of 48 runs per env, and the time they take.

    python benchmarks/event_weights.py [--envs MTP-Intersection-v0 ...] [--runs 48] [--scenes N] [--json FILE]

For every subset: the correlation of the two sets' weights over all targets, their sums and effective numbers of targets
(sum w)^2 / sum w^2. The second correlation is what sets of as many independent runs with these weights would have; a
set takes every assignment and cut equally often, so its own is a little higher. Recorded envs need MTP_BENCH_DATA or
--data.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtp_bench.cards import load_card
from mtp_bench.env import MTPEnv
from mtp_bench.parallel import Workers, cores
from mtp_bench.running.options import RunOptions
from mtp_bench.running.perturbation import RUNS
from mtp_bench.running.reference import make_reference
from mtp_bench.scoring.weights import Reference

ENVS = ("MTP-nuScenes-mini-v0", "MTP-Intersection-v0", "MTP-KITTI-v0")
SUBSETS = ("ids", "lost", "reacquired", "frag")


def weights(reference: Reference, scenes: Sequence[str], subset: str) -> NDArray[np.float64]:
    """Of the targets of all scenes."""
    return np.concatenate([reference.weight(name, subset) for name in scenes])


def compare_sets(first: NDArray[np.float64], second: NDArray[np.float64], runs: int) -> dict[str, Any]:
    """Correlation of two sets of weights of the same targets, None where one of them is constant."""
    constant = min(np.ptp(first), np.ptp(second)) == 0
    coins = np.mean([one * (1 - one) for one in (first, second)]) / (runs - 1)  # variance of a share of the runs
    return {
        "expected": None if constant else float(1 - coins / np.mean([first.var(), second.var()])),
        "correlation": None if constant else float(np.corrcoef(first, second)[0, 1]),
        "sums": [float(one.sum()) for one in (first, second)],
        "effective": [float(one.sum() ** 2 / max((one**2).sum(), 1e-12)) for one in (first, second)],
        "certain": int((first >= 0.9).sum()),  # targets that nearly every run errs at
        "rare": int(((first > 0) & (first <= 0.1)).sum()),
    }


def measure(env_id: str, options: RunOptions, runs: int = RUNS) -> dict[str, Any]:
    """Both sets of one env; ``seconds`` of the first."""
    card = load_card(env_id)
    scenes = MTPEnv(card, data=options.data).scene_names[: options.scenes]
    start = time.perf_counter()
    first = make_reference(card, scenes, options, range(runs))
    seconds = time.perf_counter() - start
    second = make_reference(card, scenes, options, range(runs, 2 * runs))
    rows = {}
    for name in SUBSETS:
        one, other = (weights(reference, scenes, name) for reference in (first, second))
        rows[name] = compare_sets(one, other, runs)
    return {"env": env_id, "targets": first.totals["targets"], "seconds": round(seconds, 1), "subsets": rows}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--envs", nargs="+", default=ENVS)
    parser.add_argument("--data")
    parser.add_argument("--runs", type=int, default=RUNS, help="at most 255")
    parser.add_argument("--scenes", type=int)
    parser.add_argument("--jobs", type=int, default=cores())
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    options = RunOptions(arguments.data, arguments.scenes, workers=Workers(arguments.jobs))
    results = []
    for env_id in arguments.envs:
        results.append(measure(env_id, options, arguments.runs))
        print(f"{env_id}: {results[-1]['targets']} targets, {results[-1]['seconds']} s")
        for name, row in results[-1]["subsets"].items():
            correlation = "–" if row["correlation"] is None else f"{row['correlation']:.3f} of {row['expected']:.3f}"
            sums, effective = (" / ".join(f"{value:8.1f}" for value in row[key]) for key in ("sums", "effective"))
            counts = f"{row['certain']:5d} targets in 90 % of the runs, {row['rare']:5d} in up to 10 %"
            print(f"  {name:10}  r {correlation}   sums {sums}   effective {effective}   {counts}", flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()

"""CPU seconds until the compiled kernels of the tracker and the forecaster are ready, cold and from the cache.

    python benchmarks/compile.py [--repeats 3] [--json FILE]

Every measurement is a process of its own; cold ones start with an empty cache. The first group includes the import of
numba.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path

KERNELS = {
    "association": ("mtp_bench.tracking.kernels.association", ("search",)),
    "affinity": ("mtp_bench.tracking.kernels.affinity_kernels", ("sparse_pairs",)),
    "tree": ("mtp_bench.tracking.kernels.tree_kernels", ("grow", "distinct_rows", "descend", "histories")),
    "motion": ("mtp_bench.tracking.kernels.motion_kernels", ("predict", "update_pairs")),
    "filter": ("mtp_bench.prediction.kalman", ("filter_pasts",)),
    "kinematic": ("mtp_bench.prediction.kinematic", ("expand",)),
    "greedy": ("mtp_bench.prediction.greedy", ("k_medians",)),
    "k-means": ("mtp_bench.prediction.k_means", ("k_means",)),
}


def here() -> dict[str, float]:
    """CPU seconds of each group of kernels, in this process."""
    seconds = {}
    for name, (module, kernels) in KERNELS.items():
        loaded = import_module(module)
        start = time.process_time()
        for kernel in kernels:
            getattr(loaded, kernel).compiled()
        seconds[name] = time.process_time() - start
    return {**seconds, "all": sum(seconds.values())}


def measured(cache: str) -> dict[str, float]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
    command = [sys.executable, __file__, "--here"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    seconds: dict[str, float] = json.loads(done.stdout)
    return seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", type=Path, default=None)
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.here:
        print(json.dumps(here()))
        return
    runs = {"cold": [], "warm": []}  # type: dict[str, list[dict[str, float]]]
    for _ in range(given.repeats):
        with tempfile.TemporaryDirectory() as cache:
            runs["cold"].append(measured(cache))
            runs["warm"].append(measured(cache))
    for kind, found in runs.items():
        least = min(found, key=lambda seconds: seconds["all"])
        print(f"{kind}: " + ", ".join(f"{name} {s:.2f}" for name, s in least.items()), end="; ")
        print("all of every run: " + ", ".join(f"{seconds['all']:.2f}" for seconds in found))
    if given.json:
        given.json.write_text(json.dumps(runs, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

"""CPU seconds until the compiled kernels of the tracker and the forecaster are ready, cold and from the cache.

    python benchmarks/compile.py [--repeats 3] [--json FILE]

Every measurement is a process of its own; cold ones start with an empty cache.
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

PACKAGES = ("mtp_bench.tracking", "mtp_bench.prediction")


def here() -> dict[str, float]:
    """CPU seconds of the imports and of each kernel, in this process."""
    start = time.process_time()
    for package in PACKAGES:
        import_module(package)
    seconds = {"imports": time.process_time() - start}
    for kernel in import_module("mtp_bench.tracking.kernels.compile").KERNELS:
        start = time.process_time()
        kernel.compile()
        seconds[kernel.function.__name__] = time.process_time() - start
    return {**seconds, "all": sum(seconds.values())}


def measured(cache: str) -> dict[str, float]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
    command = [sys.executable, __file__, "--here"]
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, check=True
    )
    seconds: dict[str, float] = json.loads(done.stdout)
    return seconds


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
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
        print(
            f"{kind}: " + ", ".join(f"{name} {s:.2f}" for name, s in least.items()),
            end="; ",
        )
        print(
            "all of every run: "
            + ", ".join(f"{seconds['all']:.2f}" for seconds in found)
        )
    if given.json:
        given.json.write_text(json.dumps(runs, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

"""Coverage of the 95 % intervals of an error and of a difference, by the number of units.

    python benchmarks/ranking.py [--records leaderboard/records] [--envs MTP-nuScenes-v0 ...] [--resamples 1000]

The units of a stored record are taken for the whole world, whose error is known. Units are drawn from them with
replacement, and the interval of those that were drawn must hold the known error 95 % of the time. The same is asked of
the difference of two agents. Its interval inverts the sign-flip test, so the remaining share is that of the tests that
reject the true difference. Draws that have no interval, such as a difference in fewer than six units with weight, are
left out.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mtp_bench.judge import load_record
from mtp_bench.scoring.definitions import Subset
from mtp_bench.scoring.statistics import (
    bootstrap_interval,
    effective_number,
    paired_difference,
)

ENVS = ("MTP-nuScenes-v0", "MTP-ETH-UCY-v0", "MTP-Intersection-v0", "MTP-Highway-v0")
AGENT, CONTROL = "mtp", "stp_same_samples"
SUBSETS: tuple[Subset, ...] = ("all", "ids", "reacquired")
UNITS = (6, 10, 14, 20, 30, 50, 100)
LEAST_KNOWN = (
    0.5  # share of the draws that have an interval, of a coverage that is shown
)

Sums = NDArray[np.float64]
Interval = Callable[[Sums, Sums], tuple[float, float] | None]


class Coverage(NamedTuple):
    """Coverage of one kind of interval at one number of units."""

    covered: float  # share of the intervals that hold the true value, NaN without any
    known: float  # share of the draws that have an interval
    effective: float  # mean effective number of units

    @property
    def text(self) -> str:
        """The coverage in per cent; a dash where fewer than half of the draws have an interval."""
        return f"{100 * self.covered:.1f}" if self.known >= LEAST_KNOWN else "–"


def coverage(
    error: Sums, weight: Sums, units: int, interval: Interval, resamples: int
) -> Coverage:
    """Draw ``units`` of the units with replacement, many times, and count the intervals that hold the true value.

    ``error``, ``weight`` [U]: sums over the targets of each unit, of an error or of a difference.
    """
    rng = np.random.default_rng(units)
    true = error.sum() / weight.sum()
    covered: list[bool] = []
    effective: list[float] = []
    while len(effective) < resamples:
        drawn = rng.integers(len(weight), size=units)
        if not weight[drawn].any():
            continue
        effective.append(effective_number(weight[drawn]))
        ends = interval(error[drawn], weight[drawn])
        if ends is not None:
            covered.append(ends[0] <= true <= ends[1])
    share = float(np.mean(covered)) if covered else float("nan")
    return Coverage(share, len(covered) / resamples, float(np.mean(effective)))


def interval_of_difference(
    difference: Sums, weight: Sums
) -> tuple[float, float] | None:
    """Return the interval of a difference, which inverts the sign-flip test."""
    test = paired_difference(difference, np.zeros(len(weight)), weight)
    return test and test.interval


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--records", type=Path, default=Path("leaderboard/records"))
    parser.add_argument("--envs", nargs="+", default=ENVS)
    parser.add_argument("--resamples", type=int, default=1000)
    arguments = parser.parse_args()
    start = time.perf_counter()
    print(
        f"| environment | subset | 95 % interval of | {' | '.join(f'{units} units' for units in UNITS)} |"
    )
    print(f"|---|---|---|{'--:|' * len(UNITS)}")
    for env_id in arguments.envs:
        record, control = (
            load_record(arguments.records / name / f"{env_id}.json")
            for name in (AGENT, CONTROL)
        )
        for subset in SUBSETS:
            weight = np.array(record.unit_weight(subset))
            error = np.array(record.unit_error(subset))
            difference = error - np.array(control.unit_error(subset))
            error_cells = []
            difference_cells = []
            for units in UNITS:
                of_error = coverage(
                    error, weight, units, bootstrap_interval, arguments.resamples
                )
                error_cells.append(f"{of_error.text} ({of_error.effective:.1f})")
                paired = coverage(
                    difference,
                    weight,
                    units,
                    interval_of_difference,
                    arguments.resamples,
                )
                difference_cells.append(paired.text)
            print(f"| {env_id} | {subset} | `{AGENT}` | {' | '.join(error_cells)} |")
            print(
                f"| | | `{AGENT}` − `{CONTROL}` | {' | '.join(difference_cells)} |",
                flush=True,
            )
    print(f"{time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()

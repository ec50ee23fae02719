"""Microseconds of k-best association: our kernels beside what can be installed with pip.

    pip install -e ".[bench]"        # nrl-tracker and pyrecest; what is not installed is left out
    python benchmarks/k_best.py [--problems 10] [--repeats 5] [--json FILE]

Problems are gated as on KITTI: objects 12 m apart on average, a detection of nine in ten with a noise of 0.5 m, a
false positive for the others, and pairs within ``--gate`` metres, which cost distance - gate. Dense ones allow all
pairs, at that cost or at a random one. CPU time of one core, least of the repeats. ``lsa`` is one
scipy.optimize.linear_sum_assignment of the gated square matrix. "x" beside a program: the ratio of its time to ours.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.tracking.report import show
from mtp_bench.core import Bools, Floats
from mtp_bench.tracking.kernels.association import joint_k_best
from tests.support.textbook_k_best import k_best as textbook

SIZES, KS, PARENTS = (5, 20, 50, 100), (1, 20, 100), 20
SLOW = 0.2  # s; a call that takes longer is measured once


def gated(rng: np.random.Generator, n: int, gate: float) -> Floats:
    """Cost [n, n] of pairs of tracks and detections, inf beyond the gate."""
    cost = dense(rng, n, gate)
    return np.where(cost < 0.0, cost, np.inf)


def dense(rng: np.random.Generator, n: int, gate: float) -> Floats:
    """Cost [n, n] of all pairs of tracks and detections, positive beyond the gate."""
    side = 12.0 * np.sqrt(n)
    tracks = rng.uniform(0, side, (n, 2))
    detections = tracks + rng.normal(0, 0.5, (n, 2))
    false = rng.random(n) < 0.1
    detections[false] = rng.uniform(0, side, (int(false.sum()), 2))
    distance = np.linalg.norm(tracks[:, None] - rng.permutation(detections), axis=-1)
    return np.asarray(distance - gate)


def sparse(cost: Floats) -> tuple[Any, ...]:
    row, column = (np.ascontiguousarray(index) for index in np.nonzero(cost < np.inf))
    return (
        np.searchsorted(row, np.arange(len(cost) + 1)),
        column,
        cost[row, column],
        cost.shape[1],
    )


def hypotheses(rng: np.random.Generator, n: int) -> tuple[Bools, Floats]:
    """Parents as a tracker has them: they differ in a fifth of the tracks, at least four."""
    member = np.ones((PARENTS, n), dtype=bool)
    doubtful = rng.permutation(n)[: max(4, n // 5)]
    member[:, doubtful] = rng.random((PARENTS, len(doubtful))) < 0.5
    return member, np.sort(rng.exponential(2.0, PARENTS))


def microseconds(
    function: Callable[..., Any], calls: list[tuple[Any, ...]], repeats: int
) -> float:
    """CPU time of a call on average over the calls, in the best of the repeats."""
    least = np.inf
    function(*calls[0])  # imports and caches
    for _ in range(repeats):
        loops, spent = 0, 0.0
        start = time.process_time()
        while spent < 0.02:
            for arguments in calls:
                function(*arguments)
            loops += 1
            spent = time.process_time() - start
        least = min(least, spent / loops / len(calls))
        if spent > SLOW * len(calls):
            break
    return float(least * 1e6)


def lsa(cost: Floats) -> Any:
    from scipy.optimize import linear_sum_assignment

    return linear_sum_assignment(cost)


def nrl_tracker(cost: Floats, k: int) -> Any:
    """Unmatched rows cost 0 there too."""
    return importlib.import_module("pytcl.assignment_algorithms").murty(
        cost, k, cost_of_non_assignment=0.0
    )


def pyrecest(cost: Floats, k: int) -> Any:
    zeros = np.zeros(len(cost))
    return importlib.import_module(
        "pyrecest.utils.assignment"
    ).murty_k_best_assignments(cost, k, zeros, zeros)


PEERS: dict[str, tuple[str, Callable[[Floats, int], Any]]] = {
    "textbook over scipy": ("scipy", textbook),
    "nrl-tracker": ("pytcl", nrl_tracker),
    "pyrecest": ("pyrecest", pyrecest),
}


def installed() -> dict[str, Callable[[Floats, int], Any]]:
    return {
        name: run
        for name, (module, run) in PEERS.items()
        if importlib.util.find_spec(module)
    }


def single(
    n: int, k: int, given: argparse.Namespace, problems: list[Floats]
) -> dict[str, Any]:
    everyone, base = np.ones((1, n), dtype=bool), np.zeros(1)
    calls = [(*sparse(cost), everyone, base, k) for cost in problems]
    square = [(np.where(cost < np.inf, cost, 1e3),) for cost in problems]
    row: dict[str, Any] = {
        "n": n,
        "k": k,
        "lsa": microseconds(lsa, square, given.repeats),
    }
    row["mtp_bench"] = microseconds(joint_k_best, calls, given.repeats)
    for name, run in installed().items():
        few = problems if n < 50 else problems[:1]
        row[name] = (
            microseconds(run, [(cost, k) for cost in few], given.repeats)
            if n * n * k <= 50_000
            else None
        )
    return with_ratios(row)


def with_ratios(row: dict[str, Any]) -> dict[str, Any]:
    """The row with the ratio of each other program's time to ours behind it."""
    others = [name for name in ("lsa", *PEERS) if name in row]
    ratios = {
        name: row[name] / row["mtp_bench"] if row[name] else None for name in others
    }
    return row | {f"{name}, x": ratio for name, ratio in ratios.items()}


def ungated(
    given: argparse.Namespace, rng: np.random.Generator
) -> list[dict[str, Any]]:
    """All pairs allowed, n = 100, k = 20."""
    n, k, everyone, base = 100, 20, np.ones((1, 100), dtype=bool), np.zeros(1)
    kinds: dict[str, Callable[[], Floats]] = {
        "positions": lambda: dense(rng, n, given.gate),
        "random": lambda: -rng.random((n, n)),
    }
    rows: list[dict[str, Any]] = []
    for kind, make in kinds.items():
        problems = [make() for _ in range(given.problems)]
        calls = [(*sparse(cost), everyone, base, k) for cost in problems]
        row: dict[str, Any] = {"n": n, "k": k, "costs": kind}
        row["lsa"] = microseconds(lsa, [(cost,) for cost in problems], given.repeats)
        row["mtp_bench"] = microseconds(joint_k_best, calls, given.repeats)
        rows.append(with_ratios(row))
    return rows


def joint(
    n: int, given: argparse.Namespace, problems: list[Floats], rng: np.random.Generator
) -> dict[str, Any]:
    together, apart = [], []
    for cost in problems:
        member, base = hypotheses(rng, n)
        together.append((*sparse(cost), member, base, PARENTS))
        apart += [
            (*sparse(cost), member[h : h + 1], base[h : h + 1], PARENTS)
            for h in range(PARENTS)
        ]
    square = [(np.where(cost < np.inf, cost, 1e3),) for cost in problems]
    row: dict[str, Any] = {
        "n": n,
        "H": PARENTS,
        "lsa": microseconds(lsa, square, given.repeats),
    }
    row["joint"] = microseconds(joint_k_best, together, given.repeats)
    row["separate"] = PARENTS * microseconds(joint_k_best, apart, given.repeats)
    row["ratio"] = row["separate"] / row["joint"]
    return row


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--problems", type=int, default=10)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--gate", type=float, default=4.0, help="m")
    parser.add_argument("--json", type=Path, default=None)
    given = parser.parse_args()
    rng = np.random.default_rng(0)
    problems = {
        n: [gated(rng, n, given.gate) for _ in range(given.problems)] for n in SIZES
    }
    choices = {
        n: float(np.mean([(cost < np.inf).sum() / n for cost in problems[n]]))
        for n in SIZES
    }
    one = [single(n, k, given, problems[n]) for n in SIZES for k in KS]
    every = ungated(given, rng)
    steps = [joint(n, given, problems[n], rng) for n in SIZES]
    show("one parent, us per call", one)
    show("one parent, all pairs allowed", every)
    show(f"{PARENTS} parents to {PARENTS} children, us per step", steps)
    if given.json:
        setting = {
            "gate_m": given.gate,
            "problems": given.problems,
            "pairs_per_row": choices,
        }
        given.json.write_text(
            json.dumps(
                {**setting, "single": one, "dense": every, "joint": steps}, indent=1
            )
            + "\n",
            encoding="utf-8",
        )


if __name__ == "__main__":
    main()

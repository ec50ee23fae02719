"""Units, significance, and who may be ranked."""

from __future__ import annotations

import itertools
import math
import operator
from collections.abc import Hashable, Sequence

import numpy as np

from mtp_bench.cards import Card
from mtp_bench.types import Floats, Scene

from .targets import Target

RANKED = ("all", "ids", "reacquired")


def units_of(scenes: Sequence[Scene], targets: Sequence[Target], card: Card) -> list[tuple[int, int]]:
    """Scene and block of each target: a scene of F / rate seconds has ceil(seconds / 20) blocks of equal length."""
    units = []
    for target in targets:
        frames = scenes[target.scene].frames
        blocks = math.ceil(frames / card.task.rate / 20 - 1e-9)
        units.append((target.scene, target.t * blocks // frames))
    return units


def sums_of(keys: Sequence[Hashable], values: Floats) -> list[float]:
    """Sum of the values [n] of each key."""
    sums: dict[Hashable, float] = {}
    for key, value in zip(keys, values, strict=True):
        sums[key] = sums.get(key, 0.0) + float(value)
    return list(sums.values())


def effective(weights: Sequence[float]) -> float:
    """(sum of weights)^2 / sum of squares."""
    squares = sum(w * w for w in weights)
    return sum(weights) ** 2 / squares if squares > 0 else 0.0


def sign_flip(differences: Sequence[float]) -> float:
    """Two-sided p: share of sign patterns whose sum is at least as far from 0. Units of difference 0 change nothing.

    Reading: beyond 14 units of a difference, 10 000 draws of signs of `default_rng(0)`, and the sum itself as one more.
    """
    d = [x for x in differences if x != 0]
    seen = abs(sum(d)) * (1 - 1e-12)
    if len(d) <= 14:
        patterns = list(itertools.product((1, -1), repeat=len(d)))
        as_far = [signs for signs in patterns if abs(sum(map(operator.mul, signs, d))) >= seen]
        return len(as_far) / len(patterns)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (10_000, len(d)))
    return (1 + int((np.abs(signs @ np.array(d)) >= seen).sum())) / 10_001


def why_unranked(subset: str, weights: Floats, units: Sequence[Hashable], owners: Sequence[Hashable]) -> str:
    """Why a subset ranks nobody; empty where it ranks. Reading: "all" needs 6 effective units, and no more."""
    if subset not in RANKED:
        return "shown, not ranked"
    of_units = sums_of(units, weights)
    if effective(of_units) < 6:
        return "too few recordings to rank"
    if subset != "all" and effective(sums_of(owners, weights)) < 20:
        return "too few objects"
    if subset != "all" and max(of_units) > 0.25 * sum(of_units):
        return "one unit is more than a quarter"
    return ""


def guarded(subset: str, all_error: float, stp_all_error: float, own_stp_all_error: float | None) -> bool:
    """Whether the agent may not be ranked on an event subset, since it is worse than STP on "all"."""
    ends = [stp_all_error] if own_stp_all_error is None else [stp_all_error, own_stp_all_error]
    return subset != "all" and all_error > min(ends)

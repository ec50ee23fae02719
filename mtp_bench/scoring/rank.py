"""Rules of rank (docs/definitions, "Ranks"), the same for comparisons and records."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import require_shape
from .definitions import LARGEST_SHARE, RANKED_OBJECTS, RANKED_SUBSETS, RANKED_UNITS, SIGNIFICANT
from .rows import Budget
from .statistics import ROUNDING, beyond_rounding, effective_number, sign_flip_test

NOT_CAUSAL = "not causal: stored tracks, which may have seen the future"
ALONE = "one agent alone is not ranked"
_DIGITS = 1e-9  # share of a weight or a number of objects by which the digits in a record may differ from it


@dataclass(frozen=True)
class Entrant:
    """Properties of a run that decide whether its agent is ranked."""

    budget: Budget
    samples: int  # per object
    saw_truth: bool
    unfinished: str = ""  # short reason why not all of it was run; empty if all was
    stored_tracks: bool = False  # its tracks are from a program that may have seen the future


def why_unranked(entrant: Entrant) -> str | None:
    """Short reason why an agent is shown but not ranked; None if it is ranked."""
    if entrant.unfinished:
        return entrant.unfinished
    if entrant.saw_truth:
        return "saw the truth"
    if entrant.stored_tracks:
        return NOT_CAUSAL
    if entrant.budget != "equal":
        return f"{entrant.samples} samples per object, not the env's own k"
    return None


def why_not_on(subset: str, objects: float, unit_weight: ArrayLike) -> str | None:
    """Short reason why agents are not ranked on a subset; None if they are.

    ``objects``: their effective number; ``unit_weight`` [U]: the weight of the targets of each unit.
    """
    weight = np.asarray(unit_weight, dtype=np.float64)
    if subset != "all" and subset not in RANKED_SUBSETS:
        return "shown only"
    if objects < RANKED_OBJECTS * (1.0 - _DIGITS):
        return f"{objects:.1f} objects, fewer than {RANKED_OBJECTS}"
    units = effective_number(weight)
    if units < RANKED_UNITS * (1.0 - _DIGITS):
        return f"too few recordings to rank: {units:.1f} effective units, fewer than {RANKED_UNITS}"
    if subset != "all" and weight.max() > LARGEST_SHARE * weight.sum() * (1.0 + _DIGITS):
        return f"one unit has more than {LARGEST_SHARE:.0%} of the weight"
    return None


def guard(error_of_all: float | None, stp: float | None, own: float | None = None) -> str | None:
    """Reason why an agent is not ranked on event subsets: over all targets it is worse than STP; None if it is not.

    ``stp``: the error of STP over all targets; ``own``: of STP with the agent's own predictor; None if unknown.
    """
    for limit, whose in ((stp, "stp"), (own, "stp with its own predictor")):
        if error_of_all is not None and limit is not None and error_of_all > limit * (1.0 + ROUNDING):
            return f"over all targets its error is above that of {whose}"
    return None


def ranks_by_test(sums: ArrayLike) -> list[int]:
    """Rank of each agent: 1 + the number of agents that are significantly better.

    ``sums`` [A, U]: weighted errors of each agent, summed over the targets of each unit, which are the same for all.
    Better: the sum of the differences is below 0 and the sign-flip test over units has p < .05.
    """
    errors = np.asarray(sums, dtype=np.float64)
    require_shape("sums", errors, (None, None))
    ranks = [1] * len(errors)
    for a in range(len(errors)):
        for b in range(a):
            difference = beyond_rounding(errors[a], errors[b])
            if sign_flip_test(difference) < SIGNIFICANT:
                ranks[a if difference.sum() > 0 else b] += 1
    return ranks


def ranks_among(sums: Sequence[ArrayLike], why: Sequence[str | None]) -> list[int | None]:
    """Ranks as of `ranks_by_test` among the agents without a reason in ``why``; None for the others."""
    ranked = [i for i, reason in enumerate(why) if reason is None]
    ranks = ranks_by_test(np.asarray([sums[i] for i in ranked])) if ranked else []
    rank = dict(zip(ranked, ranks, strict=True))
    return [rank.get(i) for i in range(len(why))]

"""Who is ranked, and in which order (protocol, "Uncertainty"): the same rules for a comparison and for records."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..shapes import require_shape
from .definitions import MOST_FORECASTS, RANKED_OBJECTS
from .rows import Budget
from .statistics import paired_interval


@dataclass(frozen=True)
class Entrant:
    """What decides whether an agent is ranked at all."""

    budget: Budget
    samples: int  # per object
    saw_truth: bool
    truth_complete: bool
    forecasts: float  # objects per frame
    unfinished: str = ""  # in a few words why not all of it was run; empty: all was


def why_unranked(entrant: Entrant, stp: Entrant | None) -> str | None:
    """Why an agent is shown, never ranked, in a few words; None where it is ranked.

    ``stp`` is the one beside it: where false forecasts cost nothing because the truth is not complete, an agent that
    forecasts far more objects than STP is not ranked either.
    """
    if entrant.unfinished:
        return entrant.unfinished
    if entrant.saw_truth:
        return "saw the truth"
    if entrant.budget != "equal":
        return f"{entrant.samples} samples per object, not the env's own k"
    if stp is not None and not entrant.truth_complete and entrant.forecasts > MOST_FORECASTS * stp.forecasts:
        return f"forecasts more than {MOST_FORECASTS:g} times as many objects as stp, where false ones cost nothing"
    return None


def enough_objects(objects: int) -> bool:
    """Whether a subset with this number of objects is ranked; one with fewer is shown."""
    return objects >= RANKED_OBJECTS


def shared_ranks(numerators: ArrayLike, denominator: ArrayLike) -> list[int]:
    """Ranks, 1 = least mean, of agents [A, S] over the same targets [S].

    From the best on, an agent shares the rank of the leader of the group before it if their paired interval covers 0;
    else it leads the next group. Without an interval (fewer than two scenes) all share rank 1.
    """
    top, bottom = np.asarray(numerators, dtype=np.float64), np.asarray(denominator, dtype=np.float64)
    require_shape("numerators", top, (None, len(bottom)))
    order = np.argsort(top.sum(axis=1), kind="stable")
    ranks = [1] * len(top)
    leader, rank = -1, 1
    for position, agent in enumerate(order.tolist()):
        interval = paired_interval(top[agent], top[leader], bottom) if leader >= 0 else None
        if leader < 0 or (interval is not None and interval[0] > 0):
            leader, rank = agent, position + 1
        ranks[agent] = rank
    return ranks

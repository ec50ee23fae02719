"""Rules of rank and shares of gaps that an agent closes (docs/definitions, "Ranks" and "Controls, and the gap closed").

The gaps are to prediction from ground-truth tracks, and to perfect association.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import require_finite, require_shape
from .definitions import GUARD, GUARD_SIGNIFICANT, LARGEST_SHARE, RANKED_OBJECTS, RANKED_SUBSETS, RANKED_UNITS, Subset
from .rows import Budget
from .statistics import Gap, beyond_rounding, effective_number, gap_closed, paired_difference, significant_pairs
from .table import AgentScores, AgentTable

NOT_CAUSAL = "not causal: stored tracks, which may have seen the future"
ASSOCIATED = "saw which detections are of one object"
SAW_TRUTH = "saw the truth"
_NEVER = {"truth": SAW_TRUTH, "associated": ASSOCIATED, "tracks": NOT_CAUSAL}  # modes that are never ranked
ALONE = "one agent alone is not ranked"
_DIGITS = 1e-9  # share of a weight or a number of objects by which the digits in a record may differ from it
UNSTATED = "its manifest does not state gap_references"
NOT_KINEMATIC = "its predictor is not that of stp"
NOT_RUN = "its references were not run"
NO_GAP = "the gap is not significantly above 0"
NO_TARGETS = "no targets"


def why_unranked(budget: Budget, samples: int, observe: str, unfinished: str = "") -> str | None:
    """Short reason why an agent is shown but not ranked; None if it is ranked.

    ``samples``: per object; ``observe``: the mode of the env; ``unfinished``: why not all of it was run.
    """
    free = None if budget == "equal" else f"{samples} samples per object, not the env's own k"
    return unfinished or _NEVER.get(observe, free)


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


def guard(of_all: ArrayLike, weight: ArrayLike, stp: ArrayLike | None, own: ArrayLike | None = None) -> str | None:
    """Reason why an agent is not ranked on event subsets: over all targets it is worse than STP; None if it is not.

    ``of_all`` [U]: its errors over all targets, summed in each unit; ``stp`` [U]: those of STP, ``own`` [U]: of STP
    with the agent's own predictor; None if unknown. ``weight`` [U]: number of targets. Worse: significantly and by
    more than 1 %, or by more than 5 %.
    """
    for limit, whose in ((stp, "stp"), (own, "stp with its own predictor")):
        difference = None if limit is None else paired_difference(of_all, limit, weight)
        if limit is None or difference is None:
            continue
        excess = difference.mean * float(np.sum(weight)) / max(float(np.sum(limit)), 1e-300)
        if excess > GUARD or (excess > GUARD_SIGNIFICANT and difference.significant):
            return f"over all targets its bADE is above that of {whose}"
    return None


class Rank(NamedTuple):
    """The position of an agent among the ranked ones."""

    place: int  # by bADE, from 1 on; agents of equal bADE share it
    span: tuple[int, int]  # 1 + the number of agents that are significantly better; n - the number significantly worse


def rank_by_error(sums: ArrayLike, weight: ArrayLike) -> list[Rank]:
    """Places of agents by bADE, and the ranks that the paired tests leave open.

    ``sums`` [A, U]: weighted errors of each agent, summed over the targets of each unit, which are the same for all;
    ``weight`` [U] of these targets. Better: the sum of the differences is below 0 and p < 0.05.
    """
    errors = np.asarray(sums, dtype=np.float64)
    require_shape("sums", errors, (None, None))
    require_finite("sums", errors)
    pairs, total = np.array(np.triu_indices(len(errors), 1)), errors.sum(axis=1)
    less = beyond_rounding(total[pairs[0]], total[pairs[1]])
    pairs = np.where(less < 0, pairs, pairs[::-1])[:, less != 0]  # the smaller error first
    sure = pairs[:, significant_pairs(errors, weight, pairs)]
    smaller, better, worse = (np.bincount(each, minlength=len(errors)) for each in (pairs[1], sure[1], sure[0]))
    ends = zip((1 + better).tolist(), (len(errors) - worse).tolist(), strict=True)
    return [Rank(1 + int(place), span) for place, span in zip(smaller, ends, strict=True)]


def ranks_among(sums: Sequence[ArrayLike], weight: ArrayLike, why: Sequence[str | None]) -> list[Rank | None]:
    """Ranks as of `rank_by_error` among the agents without a reason in ``why``; None for the others."""
    ranked = [i for i, reason in enumerate(why) if reason is None]
    ranks = rank_by_error(np.asarray([sums[i] for i in ranked]), weight) if ranked else []
    rank = dict(zip(ranked, ranks, strict=True))
    return [rank.get(i) for i in range(len(why))]


def span_text(span: tuple[int, int] | None) -> str | None:
    """A range of ranks, "1–3"; one number where it holds one rank."""
    return None if span is None else "–".join(map(str, dict.fromkeys(span)))


def rank_text(place: int | None, span: tuple[int, int] | None) -> str | None:
    """A place with its range of ranks, "2 (1–3)"; the place alone where the range is that place."""
    if place is None or span is None or span[0] == span[1]:
        return None if place is None else str(place)
    return f"{place} ({span_text(span)})"


class References(NamedTuple):
    """Runs with an agent's own predictor and presence model beside which it is measured; None: not run."""

    single: AgentScores | None = None  # one hypothesis
    ground_truth: AgentScores | None = None  # the same on ground-truth tracks
    same_samples: AgentScores | None = None  # one hypothesis, all samples that several draw, reduced to k
    associated_same_samples: AgentScores | None = None  # the same with perfect association of the detections
    associated: AgentScores | None = None  # perfect association, with as many samples as the agent draws
    tracks: AgentScores | None = None  # ground-truth tracks, with as many samples as the agent draws


class Pair(NamedTuple):
    """The tables between which a gap is closed; None if the agent is absent."""

    stp: AgentTable | None  # of association: one hypothesis with all samples
    truth: AgentTable | None  # of association: the same with perfect association


class GapPairs(NamedTuple):
    """The pairs between which an agent's gaps are closed, and reasons why one is missing."""

    kinematic: Pair | None  # stp and gt_tracks; None if the agent has another predictor
    own: Pair | None
    association: Pair | None
    why: str = NOT_RUN
    why_association: str = NOT_RUN


def pairs_of(
    table: AgentTable, shared: Pair, references: Mapping[str, References | None], tables: Mapping[int, AgentTable]
) -> GapPairs:
    """Pairs of an agent; ``shared``: stp and gt_tracks, ``tables``: of all references, by the id of their scores."""
    agent = table.setting.agent
    if agent not in references:
        return GapPairs(shared, None, None)
    runs = references[agent]
    if runs is None:
        return GapPairs(None, None, None, UNSTATED, UNSTATED)
    of = [None if each is None else tables[id(each)] for each in runs]
    kinematic = runs.single is not None and shared.stp is not None and runs.single.agent == shared.stp.setting.agent
    association, why = (None, SAW_TRUTH) if table.setting.observe == "truth" else (Pair(*of[2:4]), NOT_RUN)
    why_kinematic = NOT_RUN if kinematic else NOT_KINEMATIC
    return GapPairs(shared if kinematic else None, Pair(*of[:2]), association, why_kinematic, why)


def gap_columns(table: AgentTable, subset: Subset, pairs: GapPairs) -> dict[str, Any]:
    """Fields of a `Row`: shares of the gaps with intervals, and reasons of blank ones."""
    gap, why = _closed(table, subset, pairs.kinematic, pairs.why)
    same, _ = _closed(table, subset, pairs.own, NOT_RUN)
    association, why_association = _closed(table, subset, pairs.association, pairs.why_association)
    return {
        "gap_closed": gap and gap.closed,
        "gap_interval": gap and gap.interval,
        "gap_blank_because": why,
        "gap_closed_same_predictor": same and same.closed,
        "gap_same_predictor_interval": same and same.interval,
        "association_gap_closed": association and association.closed,
        "association_gap_interval": association and association.interval,
        "association_gap_blank_because": why_association,
    }


def _closed(table: AgentTable, subset: Subset, pair: Pair | None, missing: str) -> tuple[Gap | None, str | None]:
    """The share of a gap that an agent closes, or the reason why it is undefined."""
    high, low = pair or (None, None)
    if high is None or low is None:
        return None, missing
    if len({each.setting.samples for each in (table, high, low)}) > 1:
        return None, f"{table.setting.samples} samples per object, its references have {high.setting.samples}"
    weight = table.unit_weight(table.weight[subset])
    if not weight.any():
        return None, NO_TARGETS
    error, above, below = (each.errors(subset) for each in (table, high, low))
    gap = gap_closed(error, above, below, weight)
    return gap, None if gap is not None else NO_GAP

"""Rules of rank and shares of gaps that an agent closes (docs/definitions, "Ranks" and "Controls, and the gap closed").

The gaps are to prediction from ground-truth tracks, and to perfect association.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ..core import Floats, require_finite, require_shape
from .definitions import (
    GUARD,
    GUARD_SIGNIFICANT,
    LARGEST_SHARE,
    RANKED_OBJECTS,
    RANKED_SUBSETS,
    RANKED_UNITS,
    Subset,
)
from .rows import Budget
from .statistics import (
    UnitSums,
    beyond_rounding,
    effective_number,
    share_interval,
    significant_pairs,
)
from .table import AgentScores, AgentTable

NOT_CAUSAL = "not causal: stored tracks, which may have seen the future"
ASSOCIATED = "saw which detections are of one object"
SAW_TRUTH = "saw the truth"
_NEVER = {
    "truth": SAW_TRUTH,
    "associated": ASSOCIATED,
    "tracks": NOT_CAUSAL,
}  # modes that are never ranked
ALONE = "one agent alone is not ranked"
_DIGITS = 1e-9  # share of a weight or a number of objects by which the digits in a record may differ from it
UNSTATED = "its manifest does not state gap_references"
NOT_KINEMATIC = "its predictor is not that of stp"
NOT_RUN = "its references were not run"
NO_GAP = "the gap is not significantly above 0"
NO_TARGETS = "no targets"


def why_unranked(budget: Budget, samples: int, observe: str) -> str | None:
    """Return a short reason why an agent is shown but not ranked; None if it is ranked.

    ``samples``: per object; ``observe``: the mode of the env.
    """
    free = (
        None
        if budget == "equal"
        else f"{samples} samples per object, not the env's own k"
    )
    return _NEVER.get(observe, free)


def why_not_on(subset: Subset, sums: UnitSums) -> str | None:
    """Return a short reason why agents are not ranked on a subset; None if they are.

    ``sums``: of one of the agents, whose targets are those of all.
    """
    weight = sums.weight
    if subset != "all" and subset not in RANKED_SUBSETS:
        return "shown only"
    if sums.effective_objects < RANKED_OBJECTS * (1.0 - _DIGITS):
        return f"{sums.effective_objects:.1f} objects, fewer than {RANKED_OBJECTS}"
    units = effective_number(weight)
    if units < RANKED_UNITS * (1.0 - _DIGITS):
        return f"too few recordings to rank: {units:.1f} effective units, fewer than {RANKED_UNITS}"
    if subset != "all" and weight.max() > LARGEST_SHARE * weight.sum() * (
        1.0 + _DIGITS
    ):
        return f"one unit has more than {LARGEST_SHARE:.0%} of the weight"
    return None


class HasSums(Protocol):
    """Agent of a comparison, or record, with sums over units."""

    def sums_on(self, subset: Subset) -> UnitSums:
        """Return the sums over the units of the targets of a subset."""
        ...


def guard(
    agent: HasSums, stp: HasSums | None, own: HasSums | None = None
) -> str | None:
    """Return why an agent is not ranked on event subsets; None if it is.

    Over all targets it is worse than ``stp`` or ``own``, STP with the agent's own predictor: significantly and by more
    than 1 %, or by more than 5 %. A limit of None is unknown.
    """
    sums = agent.sums_on("all")
    for limit, whose in ((stp, "stp"), (own, "stp with its own predictor")):
        if limit is None:
            continue
        limit_sums = limit.sums_on("all")
        difference = sums.minus(limit_sums)
        if difference is None:
            continue
        excess = (
            difference.mean
            * float(sums.weight.sum())
            / max(float(limit_sums.error.sum()), 1e-300)
        )
        if excess > GUARD or (excess > GUARD_SIGNIFICANT and difference.significant):
            return f"over all targets its bADE is above that of {whose}"
    return None


class Place(NamedTuple):
    """The place of an agent on one subset, and the ranks that the tests leave open."""

    place: int | None = None  # by bADE, from 1 on; agents of equal bADE share it
    span: tuple[int, int] | None = (
        None  # 1 + number of significantly better agents; n - number of worse ones
    )
    why: str = ""  # it has no place

    @property
    def rank(self) -> str | None:
        """The place with its span, "2 (1–3)"; the place alone where the span is that place; None without a place."""
        if self.place is None or self.span is None:
            return None
        return (
            str(self.place)
            if self.span[0] == self.span[1]
            else f"{self.place} ({span_text(self.span)})"
        )


def rank_by_error(sums: ArrayLike, weight: ArrayLike) -> list[Place]:
    """Places of agents by bADE, and the ranks that the paired tests leave open.

    ``sums`` [A, U]: weighted errors of each agent, summed over the targets of each unit, which are the same for all;
    ``weight`` [U] of these targets. Better: the sum of the differences is below 0 and p < 0.05.
    """
    errors = np.asarray(sums, dtype=np.float64)
    require_shape("sums", errors, (None, None))
    require_finite("sums", errors)
    pairs, total = np.array(np.triu_indices(len(errors), 1)), errors.sum(axis=1)
    less = beyond_rounding(total[pairs[0]], total[pairs[1]])
    pairs = np.where(less < 0, pairs, pairs[::-1])[
        :, less != 0
    ]  # the smaller error first
    sure = pairs[:, significant_pairs(errors, weight, pairs)]
    smaller, better, worse = (
        np.bincount(each, minlength=len(errors))
        for each in (pairs[1], sure[1], sure[0])
    )
    ends = zip((1 + better).tolist(), (len(errors) - worse).tolist(), strict=True)
    return [
        Place(1 + int(place), span) for place, span in zip(smaller, ends, strict=True)
    ]


def places_on(
    subsets: Sequence[Subset],
    agents: Sequence[HasSums],
    unranked: Sequence[str | None],
    guarded: Sequence[str | None],
) -> list[dict[Subset, Place]]:
    """Return the places of agents with the same targets on each subset.

    ``unranked``: reasons why agents have no place at all; ``guarded``: why they have none on event subsets.
    """
    places: list[dict[Subset, Place]] = [{} for _ in agents]
    for subset in subsets if agents else ():
        sums = [agent.sums_on(subset) for agent in agents]
        of_all = why_not_on(subset, sums[0])
        why = [own or of_all for own in unranked]
        if subset != "all":
            why = [
                reason or of_guard
                for reason, of_guard in zip(why, guarded, strict=True)
            ]
        errors = [
            own.error for own, reason in zip(sums, why, strict=True) if reason is None
        ]
        ranks = iter(rank_by_error(np.array(errors), sums[0].weight) if errors else ())
        for place, reason in zip(places, why, strict=True):
            place[subset] = next(ranks) if reason is None else Place(why=reason)
    return places


def span_text(span: tuple[int, int] | None) -> str | None:
    """A range of ranks, "1–3"; one number where it holds one rank."""
    return None if span is None else "–".join(map(str, dict.fromkeys(span)))


class References(NamedTuple):
    """Runs with an agent's own predictor and presence model beside which it is measured; None: not run."""

    single: AgentScores | None = None  # one hypothesis
    ground_truth: AgentScores | None = None  # the same on ground-truth tracks
    same_samples: AgentScores | None = (
        None  # one hypothesis, all samples that several draw, reduced to k
    )
    associated_same_samples: AgentScores | None = (
        None  # the same with perfect association of the detections
    )
    associated: AgentScores | None = (
        None  # perfect association, with as many samples as the agent draws
    )
    tracks: AgentScores | None = (
        None  # ground-truth tracks, with as many samples as the agent draws
    )


class Gap(NamedTuple):
    """Share of a gap that is closed, or the reason why it is undefined."""

    closed: float | None = None  # 0: as STP, 1: as from ground-truth tracks
    parts: tuple[Floats, Floats] | None = (
        None  # [U], [U] what is closed of each unit, and the gap
    )
    why: str | None = None  # it is undefined

    @property
    def interval(self) -> tuple[float, float] | None:
        """Interval of the share (95 %), over resampled units."""
        return None if self.parts is None else share_interval(*self.parts)


def gap_closed(agent: UnitSums, stp: UnitSums, truth: UnitSums) -> Gap:
    """Return the share (E_STP - E) / (E_STP - E_GT) that an agent closes on one subset.

    ``stp``: of STP, ``truth``: of STP on ground-truth tracks, both on the targets of the agent. It is undefined without
    targets, where numbers of samples differ, and unless STP is significantly worse than ground-truth tracks.
    """
    if len({agent.samples, stp.samples, truth.samples}) > 1:
        return Gap(
            why=f"{agent.samples} samples per object, its references have {stp.samples}"
        )
    difference = stp.minus(truth)
    if difference is None:
        return Gap(why=NO_TARGETS)
    if difference.mean <= 0 or not difference.significant:
        return Gap(why=NO_GAP)
    closed = stp.error - agent.error
    gap = stp.error - truth.error
    return Gap(float(closed.sum() / gap.sum()), (closed, gap))


class Pair(NamedTuple):
    """The agents between which a gap is closed; None if one is absent."""

    stp: HasSums | None = None  # of association: one hypothesis with all samples
    truth: HasSums | None = None  # of association: the same with perfect association
    missing: str = NOT_RUN  # why one is absent

    def closed_by(self, agent: HasSums, subset: Subset) -> Gap:
        """Return the share of the gap that an agent closes, or the reason why it is undefined."""
        if self.stp is None or self.truth is None:
            return Gap(why=self.missing)
        return gap_closed(
            *(each.sums_on(subset) for each in (agent, self.stp, self.truth))
        )


class GapPairs(NamedTuple):
    """The pairs between which an agent's gaps are closed."""

    kinematic: Pair = (
        Pair()
    )  # stp and gt_tracks, unless the agent has another predictor
    own: Pair = Pair()
    association: Pair = Pair()


def pairs_of(
    table: AgentTable,
    stp: AgentTable | None,
    truth: AgentTable | None,
    references: Mapping[str, References | None],
    tables: Mapping[int, AgentTable],
) -> GapPairs:
    """Return the pairs of an agent; ``tables``: of all references, by the id of their scores."""
    agent = table.setting.agent
    if agent not in references:
        return GapPairs(Pair(stp, truth))
    runs = references[agent]
    if runs is None:
        return GapPairs(*[Pair(missing=UNSTATED)] * 3)
    ends = [None if run is None else tables[id(run)] for run in runs]
    kinematic = (
        runs.single is not None
        and stp is not None
        and runs.single.agent == stp.setting.agent
    )
    return GapPairs(
        kinematic=Pair(stp, truth) if kinematic else Pair(missing=NOT_KINEMATIC),
        own=Pair(ends[0], ends[1]),
        association=Pair(missing=SAW_TRUTH)
        if table.setting.observe == "truth"
        else Pair(ends[2], ends[3]),
    )


def gap_columns(table: AgentTable, subset: Subset, pairs: GapPairs) -> dict[str, Any]:
    """Fields of a `Row`: shares of the gaps with intervals, and reasons of blank ones."""
    gap, same, association = (pair.closed_by(table, subset) for pair in pairs)
    return {
        "gap_closed": gap.closed,
        "gap_interval": gap.interval,
        "gap_blank_because": gap.why,
        "gap_closed_same_predictor": same.closed,
        "gap_same_predictor_interval": same.interval,
        "association_gap_closed": association.closed,
        "association_gap_interval": association.interval,
        "association_gap_blank_because": association.why,
    }

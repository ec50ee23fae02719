"""Rules of rank, and shares of gaps that an agent closes.

The gaps are to prediction from ground-truth tracks, and to perfect association. All of
it needs the sums over units alone, of agents of a comparison as of records
(docs/definitions, "Ranks" and "Controls, and the gap closed").
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
FROM_FILE = "read from a file: not verified, may have seen the future"
_UNRANKED_MODES = {
    "truth": SAW_TRUTH,
    "associated": ASSOCIATED,
    "tracks": NOT_CAUSAL,
    "file": FROM_FILE,
}
ALONE_TEXT = "one agent alone is not ranked"
# share by which the digits in a record may differ from a weight or number of objects
_DIGITS = 1e-9
REFERENCES_UNSTATED = "its manifest does not state gap_references"
NOT_KINEMATIC = "its predictor is not that of stp"
NOT_RUN = "its references were not run"
NO_GAP = "the gap is not significantly above 0"
NO_TARGETS = "no targets"


def why_unranked(budget: Budget, samples: int, observe: str) -> str | None:
    """Return a short reason why an agent is not ranked.

    None if it is. ``samples``: number per object. ``observe``: mode of the env.
    """
    if observe != "detections":
        return _UNRANKED_MODES.get(observe, FROM_FILE)
    if budget != "equal":
        return f"{samples} samples per object, not the env's own k"
    return None


def why_not_on(subset: Subset, sums: UnitSums) -> str | None:
    """Return a short reason why a subset does not rank agents.

    None if it does. ``sums``: sums of any agent, since all have the same targets.
    """
    if subset != "all" and subset not in RANKED_SUBSETS:
        return "shown only"
    if sums.effective_objects < RANKED_OBJECTS * (1.0 - _DIGITS):
        return f"{sums.effective_objects:.1f} objects, fewer than {RANKED_OBJECTS}"
    units = effective_number(sums.weight)
    if units < RANKED_UNITS * (1.0 - _DIGITS):
        return (
            f"too few recordings to rank: {units:.1f} effective units, "
            f"fewer than {RANKED_UNITS}"
        )
    largest_weight = LARGEST_SHARE * sums.weight.sum() * (1.0 + _DIGITS)
    if subset != "all" and sums.weight.max() > largest_weight:
        return f"one unit has more than {LARGEST_SHARE:.0%} of the weight"
    return None


class HasSums(Protocol):
    """Agent of a comparison, or record, with sums over units."""

    def sums_on(self, subset: Subset) -> UnitSums:
        """Return the sums over the units of the targets of a subset."""
        ...


def guard_reason(
    agent: HasSums, stp: HasSums | None, own_stp: HasSums | None = None
) -> str | None:
    """Return why an agent is not ranked on event subsets.

    None if it is.
    Over all targets it is worse than ``stp`` or ``own_stp``, STP with the agent's own
    predictor: significantly and by more than 1 %, or by more than 5 %. A limit of None
    is unknown.
    """
    sums = agent.sums_on("all")
    limits = {"stp": stp, "stp with its own predictor": own_stp}
    for limit_name, limit in limits.items():
        if limit is None:
            continue
        limit_sums = limit.sums_on("all")
        difference = sums.minus(limit_sums)
        if difference is None:
            continue
        limit_error = max(float(limit_sums.error.sum()), 1e-300)  # above 0
        # as a share of the limit
        excess = difference.mean * float(sums.weight.sum()) / limit_error
        if excess > GUARD or (excess > GUARD_SIGNIFICANT and difference.significant):
            return f"over all targets its bADE is above that of {limit_name}"
    return None


class Place(NamedTuple):
    """The place of an agent on one subset, and the ranks that the tests leave open."""

    place: int | None = None  # rank by bADE, from 1 on; agents of equal bADE share it
    # 1 + number of significantly better agents; n - number of worse ones
    span: tuple[int, int] | None = None
    why: str = ""  # reason why it has no place; empty: it has one

    @property
    def rank(self) -> str | None:
        """The place with its span, "2 (1–3)".

        Without a span of one rank.
        """
        if self.place is None or self.span is None:
            return None
        if self.span[0] == self.span[1]:
            return str(self.place)
        return f"{self.place} ({span_text(self.span)})"


def rank_by_error(sums: ArrayLike, weight: ArrayLike) -> list[Place]:
    """Return places of agents by bADE, and the ranks that the tests leave open.

    ``sums`` [A, U]: weighted errors of each agent, summed over the targets of each
    unit, which are the same for all; ``weight`` [U] of these targets. Better: the sum
    of the differences is below 0 and p < 0.05.
    """
    errors = np.asarray(sums, dtype=np.float64)
    require_shape("sums", errors, (None, None))
    require_finite("sums", errors)
    agents = len(errors)
    total = errors.sum(axis=1)
    pairs = np.array(np.triu_indices(agents, 1))
    difference = beyond_rounding(total[pairs[0]], total[pairs[1]])
    smaller_first = np.where(difference < 0, pairs, pairs[::-1])
    pairs = smaller_first[:, difference != 0]  # [2, P] the better agent first
    significant = pairs[:, significant_pairs(errors, weight, pairs)]
    place = 1 + np.bincount(pairs[1], minlength=agents)
    first_rank = 1 + np.bincount(significant[1], minlength=agents)
    last_rank = agents - np.bincount(significant[0], minlength=agents)
    return [
        Place(int(place[i]), (int(first_rank[i]), int(last_rank[i])))
        for i in range(agents)
    ]


def places_on(
    subsets: Sequence[Subset],
    agents: Sequence[HasSums],
    unranked: Sequence[str | None],
    guarded: Sequence[str | None],
) -> list[dict[Subset, Place]]:
    """Return the places of agents with the same targets on each subset.

    ``unranked``: for each agent the reason why it has no place on any subset.
    ``guarded``: the reason why it has none on event subsets. None: no such reason.
    """
    places: list[dict[Subset, Place]] = [{} for _ in agents]
    if not agents:
        return places
    for subset in subsets:
        sums = [agent.sums_on(subset) for agent in agents]
        subset_reason = why_not_on(subset, sums[0])
        reasons = []
        for i in range(len(agents)):
            event_reason = None if subset == "all" else guarded[i]
            reasons.append(unranked[i] or subset_reason or event_reason)
        for i, place in enumerate(_placed(sums, reasons)):
            places[i][subset] = place
    return places


def _placed(sums: Sequence[UnitSums], reasons: Sequence[str | None]) -> Sequence[Place]:
    """Return the places of agents on one subset.

    An agent with a reason against its rank has no place.
    """
    ranked = [i for i, reason in enumerate(reasons) if reason is None]
    places = [Place(why=reason or "") for reason in reasons]
    if ranked:
        errors = [sums[i].error for i in ranked]
        for i, place in zip(ranked, rank_by_error(errors, sums[0].weight), strict=True):
            places[i] = place
    return places


def span_text(span: tuple[int, int] | None) -> str | None:
    """Return a range of ranks, "1–3".

    One number where it holds one rank.
    """
    if span is None:
        return None
    first, last = span
    return str(first) if first == last else f"{first}–{last}"


class References(NamedTuple):
    """Runs with an agent's own predictor and presence model.

    None: not run.
    """

    single: AgentScores | None = None  # one hypothesis
    ground_truth: AgentScores | None = None  # the same on ground-truth tracks
    # one hypothesis, all samples that several draw, reduced to k
    same_samples: AgentScores | None = None
    # the same with perfect association of the detections
    associated_same_samples: AgentScores | None = None
    # perfect association, with as many samples as the agent draws
    associated: AgentScores | None = None
    # ground-truth tracks, with as many samples as the agent draws
    tracks: AgentScores | None = None


class Gap(NamedTuple):
    """Share of a gap that is closed, or the reason why it is undefined."""

    closed: float | None = None  # 0: as STP, 1: as from ground-truth tracks
    # [U], [U] m, weighted errors summed per unit: closed part of the gap, and the gap
    parts: tuple[Floats, Floats] | None = None
    why: str | None = None  # reason why it is undefined

    @property
    def interval(self) -> tuple[float, float] | None:
        """Interval of the share (95 %), over resampled units."""
        return None if self.parts is None else share_interval(*self.parts)


def gap_closed(agent: UnitSums, stp: UnitSums, truth: UnitSums) -> Gap:
    """Return the share (E_STP - E) / (E_STP - E_GT) that an agent closes.

    ``stp``: of STP, ``truth``: of STP on ground-truth tracks, both on the targets of
    the agent. It is undefined without targets, where numbers of samples differ, and
    unless STP is significantly worse than ground-truth tracks.
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


class GapPair(NamedTuple):
    """The agents between which a gap is closed.

    None if one is absent.
    """

    # for the gap of association: one hypothesis with all samples
    stp: HasSums | None = None
    # for the gap of association: the same with perfect association
    truth: HasSums | None = None
    missing: str = NOT_RUN  # why one is absent

    def closed_by(self, agent: HasSums, subset: Subset) -> Gap:
        """Return the share of the gap that an agent closes, or why it is undefined."""
        if self.stp is None or self.truth is None:
            return Gap(why=self.missing)
        return gap_closed(
            agent.sums_on(subset), self.stp.sums_on(subset), self.truth.sums_on(subset)
        )


class GapPairs(NamedTuple):
    """The pairs between which an agent's gaps are closed."""

    kinematic: GapPair = GapPair()  # stp and gt_tracks, unless it has another predictor
    own: GapPair = GapPair()
    association: GapPair = GapPair()


def pairs_of(
    table: AgentTable,
    stp: AgentTable | None,
    truth: AgentTable | None,
    references: Mapping[str, References | None],
    tables: Mapping[AgentScores | None, AgentTable],
) -> GapPairs:
    """Return the pairs of an agent.

    ``tables``: of all references by their scores; None, of one that was not run, is
    no key.
    """
    setting = table.setting
    if setting.agent not in references:
        return GapPairs(GapPair(stp, truth))
    runs = references[setting.agent]
    if runs is None:
        unstated = GapPair(missing=REFERENCES_UNSTATED)
        return GapPairs(unstated, unstated, unstated)
    single = tables.get(runs.single)
    ground_truth = tables.get(runs.ground_truth)
    kinematic = GapPair(missing=NOT_KINEMATIC)
    # its predictor is that of stp if its own reference is stp
    if single and stp and single.setting.agent == stp.setting.agent:
        kinematic = GapPair(stp, truth)
    association = GapPair(
        tables.get(runs.same_samples), tables.get(runs.associated_same_samples)
    )
    if setting.observe == "truth":
        association = GapPair(missing=SAW_TRUTH)
    return GapPairs(kinematic, GapPair(single, ground_truth), association)


def gap_columns(table: AgentTable, subset: Subset, pairs: GapPairs) -> dict[str, Any]:
    """Return fields of a `Row`: gaps with intervals, and reasons of blank ones."""
    gap, own_gap, association = (pair.closed_by(table, subset) for pair in pairs)
    return {
        "gap_closed": gap.closed,
        "gap_interval": gap.interval,
        "gap_blank_because": gap.why,
        "gap_closed_same_predictor": own_gap.closed,
        "gap_same_predictor_interval": own_gap.interval,
        "association_gap_closed": association.closed,
        "association_gap_interval": association.interval,
        "association_gap_blank_because": association.why,
    }

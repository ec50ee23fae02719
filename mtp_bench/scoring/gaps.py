"""Shares of gaps that an agent closes: to prediction from ground-truth tracks, and to perfect association."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from .definitions import Subset
from .rank import SAW_TRUTH
from .statistics import Gap, gap_closed
from .table import AgentScores, AgentTable

UNSTATED = "its manifest does not state gap_references"
NOT_KINEMATIC = "its predictor is not that of stp"
NOT_RUN = "its references were not run"
NO_GAP = "the gap is not significantly above 0"
NO_TARGETS = "no targets"


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

    kinematic: Pair | None  # stp and truth_past; None if the agent has another predictor
    own: Pair | None
    association: Pair | None
    why: str = NOT_RUN
    why_association: str = NOT_RUN


def pairs_of(
    table: AgentTable, shared: Pair, references: Mapping[str, References | None], tables: Mapping[int, AgentTable]
) -> GapPairs:
    """Pairs of an agent; ``shared``: stp and truth_past, ``tables``: of all references, by the id of their scores."""
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

"""Ranks of records from their sums per unit, by the rules of the scorer.

Recorded envs are ranked by the sums of the records; simulated ones by those of hidden
scenes, from signed levels.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from ...agent import controls
from ...core import baseline_names, long_work
from ...scoring import (
    NO_GAP,
    NOT_KINEMATIC,
    REFERENCES_UNSTATED,
    SAW_TRUTH,
    SUBSETS,
    GapPair,
    GapPairs,
    PairedDifference,
    Place,
    Subset,
    guard_reason,
    places_on,
)
from .attestation import Checked
from .eligibility import (
    NOT_ON_HIDDEN,
    held_back,
    taken_names,
    why_not_comparable,
    why_not_genuine,
    why_unranked,
)
from .fields import LEVELS
from .record import SubmissionPart
from .shipped import baselines, network_references, networks_on_truth

STP, TRUTH = (controls()[role] for role in ("single", "ground_truth"))
ASSOCIATION = controls()["same_samples"], controls()["associated_same_samples"]
_OTHER_DATA = "other data, scenes or hidden scenes than the ranked ones"


@dataclass(frozen=True)
class Standing:
    """Ranks of a record in its environment, with its gaps and differences."""

    places: Mapping[Subset, Place]
    # part of the main ranking, even if that has too few recordings or waits for a round
    compared: bool = False
    # shares closed of the gap between STP and ground-truth tracks
    gaps: Mapping[Subset, float] = field(default_factory=dict)
    # the same between references with the predictor of the record
    own_gaps: Mapping[Subset, float] = field(default_factory=dict)
    association_gaps: Mapping[Subset, float] = field(default_factory=dict)
    # why a gap on all targets is missing; None: it is there
    gap_blank: str | None = REFERENCES_UNSTATED
    association_gap_blank: str | None = REFERENCES_UNSTATED
    # of bADE, to STP's
    differences: Mapping[Subset, PairedDifference] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Entrant(Checked):
    """A record among others of its env."""

    unranked_because: str | None = None
    not_comparable_because: str | None = None

    @cached_property  # it reads the submission of that name
    def baseline(self) -> str:
        """Name of the submission.

        It is empty for another one under a baseline's name.
        """
        return "" if why_not_genuine(self.record) else self.record.submission.name


# by the name of a genuine submission: its finished record with the highest level
_Best = Mapping[str, _Entrant]


def standings(
    records: Sequence[Checked], subsets: Sequence[Subset] = SUBSETS
) -> dict[str, Standing]:
    """Rank records of any envs.

    Returns the standing of each by its digest. ``subsets``: those that have places,
    gaps and differences.

    Only records of what ships, of one data and the same units are ranked against each
    other; on simulated envs those of one seal. The main ranking of an env is that of
    the newest seal with a record of STP, then that of the record with the highest
    level, STP's before others: never the largest group as such. A better record moves
    others down; apart from that, a record changes no group, guard or gap but its own.
    """
    groups = defaultdict[str, list[Checked]](list)
    for checked in records:
        groups[checked.record.env.id].append(checked)
    by_digest: dict[str, Standing] = {}
    with long_work("comparing pairs of records") as work:
        work.started(sum(len(group) ** 2 for group in groups.values()))
        for env_id, group in groups.items():
            by_digest |= _standings_of_env(group, subsets)
            work.done(env_id, len(group) ** 2)
    return by_digest


def gap_reference_names(
    submission: SubmissionPart, observe: str = "truth"
) -> tuple[str, str] | None:
    """Return the records that bound a gap for the submission's predictor.

    None if they are unknown. ``observe``: "truth" for gap_closed, "associated" for the
    association gap.
    """
    if submission.gap_references is None:
        return None
    if submission.gap_references == "controls":
        return (STP, TRUTH) if observe == "truth" else ASSOCIATION
    # weights that ship, as for simulated traffic, are in no list of a record
    baseline = baselines().get(submission.name)
    shipped_networks = () if baseline is None else baseline.networks
    predictors = set()
    for network in submission.networks or shipped_networks:
        # such as modes-truth; names of files of weights go on with the env
        parts = network.split("-")
        name = parts[0]
        tracks = parts[1] if len(parts) > 1 else ""
        # trained on tracklets: in gap_closed the references are of ground-truth tracks
        predictors.add(f"{name}-truth" if observe == "truth" else f"{name}-{tracks}")
    for predictor in sorted(predictors):
        if (pair := network_references(predictor, observe)) is not None:
            return pair
    return None


def _standings_of_env(
    records: Sequence[Checked], subsets: Sequence[Subset]
) -> dict[str, Standing]:
    entrants = _entrants(records)
    peers = _main_group(entrants)
    finished = [peer for peer in peers if peer.record.status == "finished"]
    best_records = {peer.baseline: peer for peer in sorted(finished, key=_precedence)}
    places, compared = _ranked_places(peers, best_records, subsets)
    by_digest = {}
    for entrant in entrants:
        unranked = Place(why=entrant.unranked_because or _OTHER_DATA)
        entrant_places = places.get(entrant, dict.fromkeys(subsets, unranked))
        standing = Standing(entrant_places, compared=entrant in compared)
        if entrant in peers:
            known_subsets = subsets if entrant in finished else ()
            standing = _with_gaps(standing, entrant, best_records, known_subsets)
        by_digest[entrant.record.digest] = standing
    return by_digest


def _ranked_places(
    peers: Sequence[_Entrant], best_records: _Best, subsets: Sequence[Subset]
) -> tuple[dict[_Entrant, Mapping[Subset, Place]], list[_Entrant]]:
    """Return the places of candidates, and the entrants of the main ranking.

    Those are the ranked ones, or before a round those that wait for it.
    """
    candidates = [peer for peer in peers if peer.unranked_because is None]
    truths = _truth_references(best_records)
    held_because = [held_back(candidate, truths) for candidate in candidates]
    guards = [_guarded(candidate, best_records) for candidate in candidates]
    places = places_on(subsets, candidates, held_because, guards)
    ranked = []
    for candidate, reason in zip(candidates, held_because, strict=True):
        if reason is None:
            ranked.append(candidate)
    waiting = [peer for peer in peers if peer.unranked_because == NOT_ON_HIDDEN]
    return dict(zip(candidates, places, strict=True)), ranked or waiting


def _entrants(records: Sequence[Checked]) -> list[_Entrant]:
    name_reasons = taken_names(records)
    entrants = []
    for checked in records:
        record = checked.record
        name_reason = name_reasons.get(record.digest)
        unranked = why_unranked(record, checked.hidden) or name_reason
        not_comparable = why_not_comparable(record) or name_reason
        entrants.append(_Entrant(record, checked.signed, unranked, not_comparable))
    return entrants


def _main_group(entrants: Sequence[_Entrant]) -> list[_Entrant]:
    """Return the comparable entrants under the conditions of the main ranking."""
    comparable = []
    rankable = []
    for entrant in entrants:
        if entrant.not_comparable_because is None:
            comparable.append(entrant)
        if entrant.unranked_because is None:
            rankable.append(entrant)
    # before a round: on public scenes
    leading = rankable or comparable
    if not leading:
        return []
    with_stp = {entrant.conditions for entrant in leading if entrant.baseline == STP}

    def group_key(entrant: _Entrant) -> tuple[object, ...]:
        # a seal without a record of STP leads only alone
        return (entrant.conditions in with_stp, *_precedence(entrant))

    main_conditions = max(leading, key=group_key).conditions
    return [peer for peer in comparable if peer.conditions == main_conditions]


def _precedence(entrant: _Entrant) -> tuple[object, ...]:
    """Return a sort key: the largest decides on the main ranking and within a name."""
    name = entrant.baseline
    seal_date = ""
    if entrant.signed is not None and entrant.signed.seal is not None:
        seal_date = entrant.signed.seal.made
    return (
        seal_date,
        LEVELS.index(entrant.level),
        name == STP,
        name in baseline_names(),
        entrant.record.digest,
    )


def _guarded(entrant: _Entrant, best_records: _Best) -> str | None:
    """Return why a record is not ranked on event subsets, compared with STP."""
    stp = best_records.get(STP)
    if stp is None:
        return "no record of stp beside it"
    return guard_reason(entrant, stp, _pairs(entrant, best_records).own.stp)


def _pairs(entrant: _Entrant, best_records: _Best) -> GapPairs:
    """Return the pairs of reference records that define each gap of a record.

    A gap is the difference of their errors, and the record closes a share of it. A pair
    may state why it is missing.
    """
    submission = entrant.record.submission
    # references with the predictor of the submission itself
    own_pair = _pair(submission, "truth", best_records)
    kinematic = own_pair
    if submission.gap_references == "own":
        kinematic = GapPair(missing=NOT_KINEMATIC)
    association = GapPair(missing=SAW_TRUTH)
    if entrant.record.env.observe != "truth":
        association = _pair(submission, "associated", best_records)
    return GapPairs(kinematic, own_pair, association)


def _pair(submission: SubmissionPart, observe: str, best_records: _Best) -> GapPair:
    """Return the records of `gap_reference_names`, or why one is missing."""
    names = gap_reference_names(submission, observe)
    if names is None and submission.gap_references == "own":
        return GapPair(missing="no reference with its predictor ships")
    if names is None:
        return GapPair(missing=REFERENCES_UNSTATED)
    stp, truth = map(best_records.get, names)
    absent_name = names[0] if stp is None else names[1]
    missing = f"no record of {absent_name} beside it"  # read only if one is None
    return GapPair(stp, truth, missing)


def _with_gaps(
    standing: Standing,
    entrant: _Entrant,
    best_records: _Best,
    subsets: Sequence[Subset],
) -> Standing:
    """Return the standing of a record with its gaps to the reference records."""
    pairs = _pairs(entrant, best_records)
    differences: dict[Subset, PairedDifference] = {}
    stp = best_records.get(STP)
    if stp not in (None, entrant) and stp.record.samples == entrant.record.samples:
        for subset in subsets:
            if (difference := entrant.minus(stp, subset)) is not None:
                differences[subset] = difference
    gaps = _closed(entrant, pairs.kinematic, subsets)
    association_gaps = _closed(entrant, pairs.association, subsets)
    return replace(
        standing,
        gaps=gaps,
        own_gaps=_closed(entrant, pairs.own, subsets),
        association_gaps=association_gaps,
        gap_blank=_gap_blank(entrant, pairs.kinematic, gaps),
        association_gap_blank=_gap_blank(entrant, pairs.association, association_gaps),
        differences=differences,
    )


def _closed(
    entrant: _Entrant, pair: GapPair, subsets: Sequence[Subset]
) -> dict[Subset, float]:
    """Return the closed shares of a gap, on the subsets that define it."""
    gaps = {}
    for subset in subsets:
        closed_share = pair.closed_by(entrant, subset).closed
        if closed_share is not None:
            gaps[subset] = closed_share
    return gaps


def _gap_blank(
    entrant: _Entrant, pair: GapPair, gaps: Mapping[Subset, float]
) -> str | None:
    """Return why a gap on all targets is missing; None: it is there."""
    if "all" in gaps:
        return None
    return pair.closed_by(entrant, "all").why or NO_GAP


def _truth_references(best_records: _Best) -> list[_Entrant]:
    """Return two records with ground-truth tracks.

    The first predicts without a network, the second with the network of lowest error.
    Empty unless there are both.
    """
    truth = best_records.get(TRUTH)
    learned = []
    for name in networks_on_truth():
        entrant = best_records.get(name)
        if entrant is None:
            continue
        error = entrant.row_of("all").error
        if error is not None:
            learned.append((error, entrant))
    if truth is None or not learned:
        return []
    return [truth, min(learned, key=lambda pair: pair[0])[1]]

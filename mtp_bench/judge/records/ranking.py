"""Ranks of records from their sums per unit: the rules of the scorer, applied to records.

Recorded envs are ranked by the sums of the records; simulated ones by those of hidden
scenes, from signed levels.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from ...agent import controls
from ...core import baseline_names, long_work
from ...scoring import (
    NO_GAP,
    NOT_KINEMATIC,
    SAW_TRUTH,
    SUBSETS,
    UNSTATED,
    GapPairs,
    Pair,
    PairedDifference,
    Place,
    Subset,
    guard,
    places_on,
)
from .attestation import Checked, SignedLevel
from .eligibility import (
    NOT_ON_HIDDEN,
    Ships,
    held_back,
    taken_names,
    why_not_comparable,
    why_not_genuine,
    why_unranked,
)
from .fields import LEVELS
from .record import Record, SubmissionPart
from .shipped import baselines, learned_truths, network_references, shipped

STP, TRUTH = (controls()[role] for role in ("single", "ground_truth"))
ASSOCIATION = controls()["same_samples"], controls()["associated_same_samples"]
OTHERS = "other data, scenes or hidden scenes than the ranked ones"


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
    gap_blank: str = UNSTATED  # why one of the ``gaps`` is missing
    association_gap_blank: str = UNSTATED
    # difference of bADE to STP's
    differences: Mapping[Subset, PairedDifference] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Entrant(Checked):
    """A record among others of its env."""

    unranked_because: str | None = None
    not_comparable_because: str | None = None

    @cached_property  # it reads the submission of that name
    def baseline(self) -> str:
        """Name of the submission; empty for another one under a baseline's name."""
        return "" if why_not_genuine(self.record) else self.record.submission.name


# by the name of a genuine submission: its finished record with the highest level
_Best = Mapping[str, _Entrant]


def standings(
    records: Sequence[Record],
    levels: Mapping[str, SignedLevel] | None = None,
    ships: Ships = shipped,
    subsets: Sequence[Subset] = SUBSETS,
) -> dict[str, Standing]:
    """Rank records of any envs; returns the standing of each by its digest.

    ``levels`` are by digest, too; ``ships``: the shipped env of an id; ``subsets``:
    those that have places, gaps and differences.

    Only records of what ships, of one data and the same units are ranked against each
    other; on simulated envs those of one seal. The main ranking of an env is that of
    the newest seal with a record of STP, then that of the record with the highest
    level, STP's before others: never the largest group as such. A better record moves
    others down; apart from that, a record changes no group, guard or gap but its own.
    """
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(record.env.id, []).append(record)
    standing: dict[str, Standing] = {}
    with long_work("comparing pairs of records") as work:
        work.started(sum(len(group) ** 2 for group in groups.values()))
        for env_id, group in groups.items():
            standing |= _standings_of_env(group, levels or {}, ships, subsets)
            work.done(env_id, len(group) ** 2)
    return standing


def own_ends(
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
        name, tracks, *_ = [*network.split("-"), ""]
        # trained on tracklets: in gap_closed the references are of ground-truth tracks
        predictors.add(f"{name}-truth" if observe == "truth" else f"{name}-{tracks}")
    for predictor in sorted(predictors):
        if (pair := network_references(predictor, observe)) is not None:
            return pair
    return None


def _standings_of_env(
    records: Sequence[Record],
    levels: Mapping[str, SignedLevel],
    ships: Ships,
    subsets: Sequence[Subset],
) -> dict[str, Standing]:
    entrants = _entrants(records, levels, ships)
    peers = _main_group(entrants)
    finished = [peer for peer in peers if peer.record.status == "finished"]
    best = {peer.baseline: peer for peer in sorted(finished, key=_precedence)}
    candidates = [peer for peer in peers if peer.unranked_because is None]
    truths = _truths(best)
    held_because = [held_back(candidate, truths) for candidate in candidates]
    guards = [_guarded(candidate, best) for candidate in candidates]
    ranks = places_on(subsets, candidates, held_because, guards)
    places = dict(zip(candidates, ranks, strict=True))
    compared = _compared(peers, dict(zip(candidates, held_because, strict=True)))
    standing = {}
    for entrant in entrants:
        unranked = Place(why=entrant.unranked_because or OTHERS)
        standing[entrant.record.digest] = _standing(
            entrant,
            places.get(entrant, dict.fromkeys(subsets, unranked)),
            entrant in compared,
            best if entrant in peers else None,
            subsets if entrant in finished else (),
        )
    return standing


def _compared(
    peers: Sequence[_Entrant], held_because: Mapping[_Entrant, str | None]
) -> list[_Entrant]:
    """Return the entrants of the main ranking; before a round those that wait for it."""
    ranked = [peer for peer in peers if held_because.get(peer, "unranked") is None]
    return ranked or [peer for peer in peers if peer.unranked_because == NOT_ON_HIDDEN]


def _entrants(
    records: Sequence[Record], levels: Mapping[str, SignedLevel], ships: Ships
) -> list[_Entrant]:
    taken = taken_names(records, levels)
    entrants = []
    for record in records:
        level = levels.get(record.digest)
        name_taken = taken.get(record.digest)
        unranked = why_unranked(record, level, ships) or name_taken
        not_comparable = why_not_comparable(record, ships) or name_taken
        entrants.append(_Entrant(record, level, unranked, not_comparable))
    return entrants


def _main_group(entrants: Sequence[_Entrant]) -> list[_Entrant]:
    """Return the comparable entrants under the conditions of the main ranking."""
    comparable = [e for e in entrants if e.not_comparable_because is None]
    # before a round: on public scenes
    leading = [e for e in entrants if e.unranked_because is None] or comparable
    if not leading:
        return []
    main = max(leading, key=_precedence_of_group(leading)).conditions
    return [e for e in comparable if e.conditions == main]


def _precedence_of_group(
    leading: Sequence[_Entrant],
) -> Callable[[_Entrant], tuple[object, ...]]:
    """Return a sort key: a seal without a record of STP leads only alone."""
    with_stp = {e.conditions for e in leading if e.baseline == STP}
    return lambda entrant: (entrant.conditions in with_stp, *_precedence(entrant))


def _precedence(entrant: _Entrant) -> tuple[object, ...]:
    """Return a sort key: the largest decides on the main ranking and within a name."""
    seal = None if entrant.signed is None else entrant.signed.seal
    name = entrant.baseline
    return (
        "" if seal is None else seal.made,
        LEVELS.index(entrant.level),
        name == STP,
        name in baseline_names(),
        entrant.record.digest,
    )


def _guarded(entrant: _Entrant, best: _Best) -> str | None:
    """Return why a record is not ranked on event subsets, from records of STP."""
    stp = best.get(STP)
    if stp is None:
        return "no record of stp beside it"
    return guard(entrant, stp, _pairs(entrant, best).own.stp)


def _pairs(entrant: _Entrant, best: _Best) -> GapPairs:
    """Return the records between which the gaps of a record are closed."""
    submission = entrant.record.submission
    has_other_predictor = submission.gap_references == "own"
    unstated = Pair(missing=UNSTATED)
    if has_other_predictor:
        unstated = Pair(missing="no reference with its predictor ships")

    def pair_of(names: tuple[str, str] | None) -> Pair:
        if names is None:
            return unstated
        stp, truth = map(best.get, names)
        absent = names[0] if stp is None else names[1]
        return Pair(stp, truth, f"no record of {absent} beside it")

    own = pair_of(own_ends(submission))
    kinematic = Pair(missing=NOT_KINEMATIC) if has_other_predictor else own
    if entrant.record.env.observe == "truth":
        return GapPairs(kinematic, own, Pair(missing=SAW_TRUTH))
    return GapPairs(kinematic, own, pair_of(own_ends(submission, "associated")))


def _standing(
    entrant: _Entrant,
    places: Mapping[Subset, Place],
    compared: bool,
    best: _Best | None,
    subsets: Sequence[Subset],
) -> Standing:
    """Return the standing of a record; ``best``: reference records to compare with."""
    if best is None:
        return Standing(places, compared)
    pairs = _pairs(entrant, best)
    differences: dict[Subset, PairedDifference] = {}
    stp = best.get(STP)
    if stp not in (None, entrant) and stp.record.samples == entrant.record.samples:
        for subset in subsets:
            if (difference := entrant.minus(stp, subset)) is not None:
                differences[subset] = difference
    return Standing(
        places,
        compared,
        gaps=_closed(entrant, pairs.kinematic, subsets),
        own_gaps=_closed(entrant, pairs.own, subsets),
        association_gaps=_closed(entrant, pairs.association, subsets),
        gap_blank=pairs.kinematic.closed_by(entrant, "all").why or NO_GAP,
        association_gap_blank=pairs.association.closed_by(entrant, "all").why or NO_GAP,
        differences=differences,
    )


def _closed(
    entrant: _Entrant, pair: Pair, subsets: Sequence[Subset]
) -> dict[Subset, float]:
    """Return the shares of a gap that are closed, on the subsets that define it."""
    gaps = {subset: pair.closed_by(entrant, subset).closed for subset in subsets}
    return {subset: share for subset, share in gaps.items() if share is not None}


def _truths(best: _Best) -> list[_Entrant]:
    """Return the records of ground-truth tracks and of the best network on them.

    Empty unless there are both.
    """
    truth = best.get(TRUTH)
    learned = []
    for name in learned_truths():
        entrant = best.get(name)
        error = None if entrant is None else entrant.row_of("all").error
        if entrant is not None and error is not None:
            learned.append((error, entrant))
    if truth is None or not learned:
        return []
    return [truth, min(learned, key=lambda pair: pair[0])[1]]

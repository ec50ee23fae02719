"""Ranks of records from their sums per unit: the rules of the scorer, applied to records.

Recorded envs are ranked by the sums of the records; simulated ones by those of hidden scenes, from signed levels.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from operator import itemgetter
from typing import Any, TypeVar

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
from .attestation import LEVELS, Checked, SignedLevel
from .eligibility import (
    NOT_ON_HIDDEN,
    Ships,
    held_back,
    taken_names,
    why_not_comparable,
    why_not_genuine,
    why_unranked,
)
from .record import Record, SubmissionPart
from .shipped import baselines, learned_truths, network_references, shipped

STP, TRUTH = (controls()[role] for role in ("single", "ground_truth"))
ASSOCIATION = controls()["same_samples"], controls()["associated_same_samples"]
Value = TypeVar("Value")
OTHERS = "other data, scenes or hidden scenes than the ranked ones"


@dataclass(frozen=True)
class Standing:
    """Ranks of a record among those of its environment, and its gaps and differences to reference agents."""

    places: Mapping[Subset, Place]
    compared: bool = False  # part of the main ranking of its environment, even if that has too few recordings or waits
    gaps: Mapping[Subset, float] = field(
        default_factory=dict
    )  # gap_closed between STP and ground-truth tracks
    own_gaps: Mapping[Subset, float] = field(
        default_factory=dict
    )  # gap_closed between references of its predictor
    association_gaps: Mapping[Subset, float] = field(default_factory=dict)
    gap_blank: str = UNSTATED  # why one of the ``gaps`` is missing
    association_gap_blank: str = UNSTATED
    differences: Mapping[Subset, PairedDifference] = field(
        default_factory=dict
    )  # of bADE, to STP's


@dataclass(frozen=True, eq=False)
class _Entrant(Checked):
    """A record among others of its env."""

    unranked: str | None = None  # why it is not ranked
    not_comparable: str | None = (
        None  # why its numbers cannot be compared with those of others
    )

    @cached_property  # it reads the submission of that name
    def baseline(self) -> str:
        """Name of the submission; empty for another submission under the name of a baseline."""
        return "" if why_not_genuine(self.record) else self.record.submission.name


_Best = Mapping[
    str, _Entrant
]  # by the name of a genuine submission: its finished record with the highest level


def standings(
    records: Sequence[Record],
    levels: Mapping[str, SignedLevel] | None = None,
    ships: Ships = shipped,
    subsets: Sequence[Subset] = SUBSETS,
) -> dict[str, Standing]:
    """Standing of each record of any envs, by its digest, as are ``levels``; ``ships``: the shipped env of an id.

    ``subsets``: those that have places, gaps and differences.

    Only records of what ships, of one data and the same units are ranked against each other; on simulated envs those
    of one seal. The main ranking of an env is that of the newest seal with a record of STP, then that of the
    record with the highest level, STP's before others: never the largest group as such. A better record moves others
    down; apart from that, a record changes no group, guard or gap but its own.
    """
    levels = levels or {}
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(record.env.id, []).append(record)
    standing: dict[str, Standing] = {}
    with long_work("comparing pairs of records") as work:
        work.started(sum(len(group) ** 2 for group in groups.values()))
        for env_id, group in groups.items():
            standing |= _standings_of_env(group, levels, ships, subsets)
            work.done(env_id, len(group) ** 2)
    return standing


def own_ends(
    submission: SubmissionPart, observe: str = "truth"
) -> tuple[str, str] | None:
    """Names of the records that bound a gap for the submission's predictor; None if unknown.

    ``observe``: "truth" for gap_closed, "associated" for the association gap.
    """
    if submission.gap_references == "controls":
        return (STP, TRUTH) if observe == "truth" else ASSOCIATION
    # weights that ship, as for simulated traffic, are in no list of a record
    baseline = baselines().get(submission.name)
    shipped = () if baseline is None else baseline.networks
    names = () if submission.gap_references is None else submission.networks or shipped
    # predictors that were trained on tracklets have the references of ground-truth tracks in gap_closed
    known = {
        name.split("-")[0] + "-truth"
        if observe == "truth"
        else "-".join(name.split("-")[:2])
        for name in names
    }
    pairs = (network_references(network, observe) for network in sorted(known))
    return next((pair for pair in pairs if pair is not None), None)


def _standings_of_env(
    records: Sequence[Record],
    levels: Mapping[str, SignedLevel],
    ships: Ships,
    subsets: Sequence[Subset],
) -> dict[str, Standing]:
    taken = taken_names(records, levels)
    entrants = []
    for record in records:
        level, other = levels.get(record.digest), taken.get(record.digest)
        reasons = why_unranked(record, level, ships), why_not_comparable(record, ships)
        entrants.append(
            _Entrant(record, level, *(reason or other for reason in reasons))
        )
    ranked = [each for each in entrants if each.unranked is None]
    comparable = [each for each in entrants if each.not_comparable is None]
    main = _main_conditions(ranked or comparable)  # before a round: on public scenes
    peers = [each for each in comparable if each.conditions == main]
    finished = [each for each in peers if each.record.status == "finished"]
    best = {each.baseline: each for each in sorted(finished, key=_precedence)}
    truths = _truths(best)
    candidates = [each for each in ranked if each.conditions == main]
    held = [held_back(each, truths) for each in candidates]
    guards = [_guarded(each, best) for each in candidates]
    places = dict(
        zip(candidates, places_on(subsets, candidates, held, guards), strict=True)
    )
    group = [each for each, why in zip(candidates, held, strict=True) if why is None]
    compared = group or [each for each in peers if each.unranked == NOT_ON_HIDDEN]
    standing = {}
    for each in entrants:
        unplaced = dict.fromkeys(subsets, Place(why=each.unranked or OTHERS))
        beside: dict[str, Any] = {}
        if each in peers:
            beside = _beside(each, best, subsets if each in finished else ())
        standing[each.record.digest] = Standing(
            places.get(each, unplaced), each in compared, **beside
        )
    return standing


def _main_conditions(ranked: Sequence[_Entrant]) -> tuple[object, ...] | None:
    """Conditions of the main ranking, from the ranked entrants or others that compare; None without any."""
    with_stp = {each.conditions for each in ranked if each.baseline == STP}
    leading = [
        each for each in ranked if each.conditions in with_stp
    ] or ranked  # a seal without STP yet
    return max(leading, key=_precedence).conditions if leading else None


def _precedence(entrant: _Entrant) -> tuple[object, ...]:
    """Sort key: the largest decides on the main ranking, and among records of one name."""
    signed, name = entrant.signed, entrant.baseline
    made = signed.seal.made if signed is not None and signed.seal is not None else ""
    return (
        made,
        LEVELS.index(entrant.level),
        name == STP,
        name in baseline_names(),
        entrant.record.digest,
    )


def _guarded(entrant: _Entrant, best: _Best) -> str | None:
    """Return why a record is not ranked on event subsets, from those of STP and of STP with its own predictor."""
    stp = best.get(STP)
    return (
        "no record of stp beside it"
        if stp is None
        else guard(entrant, stp, _pairs(entrant, best).own.stp)
    )


def _pairs(entrant: _Entrant, best: _Best) -> GapPairs:
    """Return the records between which the gaps of a record are closed; ``best`` holds the reference agents."""
    submission = entrant.record.submission
    other = submission.gap_references == "own"
    unstated = Pair(
        missing="no reference with its predictor ships" if other else UNSTATED
    )

    def pair_of(names: tuple[str, str] | None) -> Pair:
        if names is None:
            return unstated
        stp, truth = map(best.get, names)
        return Pair(
            stp,
            truth,
            f"no record of {names[0] if stp is None else names[1]} beside it",
        )

    own = pair_of(own_ends(submission))
    kinematic = Pair(missing=NOT_KINEMATIC) if other else own
    if entrant.record.env.observe == "truth":
        return GapPairs(kinematic, own, Pair(missing=SAW_TRUTH))
    return GapPairs(kinematic, own, pair_of(own_ends(submission, "associated")))


def _beside(
    entrant: _Entrant, best: _Best, subsets: Sequence[Subset]
) -> dict[str, Any]:
    """Return fields of a `Standing`: gaps with reasons of missing ones, and differences to STP."""
    pairs = _pairs(entrant, best)
    gaps, own_gaps, association_gaps = (
        _defined({subset: pair.closed_by(entrant, subset).closed for subset in subsets})
        for pair in pairs
    )
    stp = best.get(STP)
    differences: dict[Subset, PairedDifference] = {}
    if (
        stp is not None
        and stp is not entrant
        and stp.record.samples == entrant.record.samples
    ):
        differences = _defined(
            {subset: entrant.minus(stp, subset) for subset in subsets}
        )
    return {
        "gaps": gaps,
        "gap_blank": pairs.kinematic.closed_by(entrant, "all").why or NO_GAP,
        "own_gaps": own_gaps,
        "association_gaps": association_gaps,
        "association_gap_blank": pairs.association.closed_by(entrant, "all").why
        or NO_GAP,
        "differences": differences,
    }


def _defined(values: Mapping[Subset, Value | None]) -> dict[Subset, Value]:
    return {subset: value for subset, value in values.items() if value is not None}


def _truths(best: _Best) -> list[_Entrant]:
    """Records of ground-truth tracks and of the best learned predictor on them; empty unless there are both."""
    truth, *learned = map(best.get, (TRUTH, *learned_truths()))
    errors = [
        (each.sums.row.error, each)
        for each in learned
        if each is not None and each.sums.row.error is not None
    ]
    least = min(errors, key=itemgetter(0), default=None)
    return [] if truth is None or least is None else [truth, least[1]]

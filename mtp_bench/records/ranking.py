"""Ranks of records from their sums per unit: the rules of the scorer, applied to records.

Recorded envs are ranked by the sums of the records; simulated ones by those of hidden scenes, from signed levels.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import itemgetter
from typing import Any

from .. import notice
from .._bundle import baseline_names
from ..scoring.definitions import SUBSETS, Subset
from ..scoring.rank import NO_GAP, NOT_KINEMATIC, SAW_TRUTH, UNSTATED, guard, rank_text, ranks_among, why_not_on
from ..scoring.statistics import PairedDifference, gap_closed
from ..submission.loader import controls
from .attestation import LEVELS, Checked, SignedLevel
from .eligibility import NOT_ON_HIDDEN, Ships, held_back, taken_names, why_not_comparable, why_not_genuine, why_unranked
from .record import Record, SubmissionPart
from .shipped import baselines, learned_truths, network_references, shipped

STP, TRUTH = (controls()[role] for role in ("single", "ground_truth"))
ASSOCIATION = controls()["same_samples"], controls()["associated_same_samples"]
OTHERS = "other data, scenes or hidden scenes than the ranked ones"


@dataclass(frozen=True)
class Place:
    """The place of a record on one subset, and the ranks that the tests leave open."""

    place: int | None = None
    span: tuple[int, int] | None = None
    why: str = ""  # it has no place

    @property
    def rank(self) -> str | None:
        """The place with the ranks that the tests leave open, "2 (1–3)"; None without a place."""
        return rank_text(self.place, self.span)


@dataclass(frozen=True)
class Standing:
    """Ranks of a record among those of its environment, and its gaps and differences to reference agents."""

    places: Mapping[Subset, Place]
    compared: bool = False  # part of the main ranking of its environment, even if that has too few recordings or waits
    gaps: Mapping[Subset, float] = field(default_factory=dict)  # gap_closed between STP and ground-truth tracks
    own_gaps: Mapping[Subset, float] = field(default_factory=dict)  # gap_closed between references of its predictor
    association_gaps: Mapping[Subset, float] = field(default_factory=dict)
    gap_blank: str = UNSTATED  # why one of the ``gaps`` is missing
    association_gap_blank: str = UNSTATED
    differences: Mapping[Subset, PairedDifference] = field(default_factory=dict)  # of bADE, to STP's


@dataclass(frozen=True, eq=False)
class _Entrant(Checked):
    """A record among others of its env."""

    unranked: str | None = None  # why it is not ranked
    not_comparable: str | None = None  # why its numbers cannot be compared with those of others

    @cached_property  # it reads the submission of that name
    def baseline(self) -> str:
        """Name of the submission; empty for another submission under the name of a baseline."""
        return "" if why_not_genuine(self.record) else self.record.submission.name


_Best = Mapping[str, _Entrant]  # by the name of a genuine submission: its finished record with the highest level


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
    with notice.work("comparing pairs of records") as work:
        work.started(sum(len(group) ** 2 for group in groups.values()))
        for env_id, group in groups.items():
            standing |= _standings_of_env(group, levels, ships, subsets)
            work.done(env_id, len(group) ** 2)
    return standing


def own_ends(submission: SubmissionPart, observe: str = "truth") -> tuple[str, str] | None:
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
    known = {name.split("-")[0] + "-truth" if observe == "truth" else "-".join(name.split("-")[:2]) for name in names}
    pairs = (network_references(network, observe) for network in sorted(known))
    return next((pair for pair in pairs if pair is not None), None)


def _standings_of_env(
    records: Sequence[Record], levels: Mapping[str, SignedLevel], ships: Ships, subsets: Sequence[Subset]
) -> dict[str, Standing]:
    taken = taken_names(records, levels)
    entrants = []
    for record in records:
        level, other = levels.get(record.digest), taken.get(record.digest)
        reasons = why_unranked(record, level, ships), why_not_comparable(record, ships)
        entrants.append(_Entrant(record, level, *(reason or other for reason in reasons)))
    ranked = [each for each in entrants if each.unranked is None]
    comparable = [each for each in entrants if each.not_comparable is None]
    main = _main_conditions(ranked or comparable)  # before a round: on public scenes
    peers = [each for each in comparable if each.conditions == main]
    finished = (each for each in peers if each.record.status == "finished")
    best = {each.baseline: each for each in sorted(finished, key=_precedence)}
    truths = _truths(best)
    alike = [each for each in ranked if each.conditions == main]
    held = {each.record.digest: why for each in alike if (why := held_back(each, truths)) is not None}
    group = [each for each in alike if each.record.digest not in held]
    whys = {each.record.digest: each.unranked or OTHERS for each in entrants}
    places = {digest: dict.fromkeys(subsets, Place(why=why)) for digest, why in (whys | held).items()}
    if group:
        of_group = zip(group, _places(group, best, subsets), strict=True)
        places |= {each.record.digest: place for each, place in of_group}
    waiting = [each for each in peers if each.unranked == NOT_ON_HIDDEN]
    inside = {each.record.digest for each in group or waiting}
    standing = {digest: Standing(place, digest in inside) for digest, place in places.items()}
    for each in peers:
        differences = _differences(each, best.get(STP), subsets)
        found = replace(standing[each.record.digest], **_all_gaps(each, best, subsets), differences=differences)
        standing[each.record.digest] = found
    return standing


def _main_conditions(ranked: Sequence[_Entrant]) -> tuple[object, ...] | None:
    """Conditions of the main ranking, from the ranked entrants or others that compare; None without any."""
    with_stp = {each.conditions for each in ranked if each.baseline == STP}
    leading = [each for each in ranked if each.conditions in with_stp] or ranked  # a seal without STP yet
    return max(leading, key=_precedence).conditions if leading else None


def _precedence(entrant: _Entrant) -> tuple[object, ...]:
    """Sort key: the largest decides on the main ranking, and among records of one name."""
    signed, name = entrant.signed, entrant.baseline
    made = signed.seal.made if signed is not None and signed.seal is not None else ""
    return made, LEVELS.index(entrant.level), name == STP, name in baseline_names(), entrant.record.digest


def _places(group: Sequence[_Entrant], best: _Best, subsets: Sequence[Subset]) -> list[dict[Subset, Place]]:
    """Places of records that are ranked against each other; the ``best`` hold their reference agents."""
    places: list[dict[Subset, Place]] = [{} for _ in group]
    sums = [entrant.sums for entrant in group]
    guards = [None if {*subsets} == {"all"} else _guarded(entrant, best) for entrant in group]  # of event subsets
    for subset in subsets:
        weight = sums[0].unit_weight(subset)
        of_all = why_not_on(subset, sums[0].row_of(subset).effective_objects, weight)
        why = [of_all or (None if subset == "all" else guarded) for guarded in guards]
        ranks = ranks_among([each.unit_error(subset) for each in sums], weight, why)
        for place, rank, reason in zip(places, ranks, why, strict=True):
            place[subset] = Place(why=reason or "") if rank is None else Place(rank.place, rank.span)
    return places


def _guarded(entrant: _Entrant, best: _Best) -> str | None:
    """Reason why a record is not ranked on event subsets, from those of STP and of STP with its own predictor."""
    pair = own_ends(entrant.record.submission)
    stp, own = best.get(STP), None if pair is None else best.get(pair[0])
    if stp is None:
        return "no record of stp beside it"
    limits = (None if each is None else each.sums.unit_error("all") for each in (stp, own))
    return guard(entrant.sums.unit_error("all"), entrant.sums.unit_weight("all"), *limits)


def _all_gaps(entrant: _Entrant, best: _Best, subsets: Sequence[Subset]) -> dict[str, Any]:
    """Fields of a `Standing`: gaps that a record closes, and reasons of missing ones."""
    submission = entrant.record.submission
    kinematic, other = submission.gap_references == "controls", submission.gap_references == "own"
    unstated = "no reference with its predictor ships" if other else UNSTATED
    own, why = _gaps(entrant, best, own_ends(submission), unstated, subsets)
    association, why_association = dict[Subset, float](), SAW_TRUTH
    if entrant.record.env.observe != "truth":
        association, why_association = _gaps(entrant, best, own_ends(submission, "associated"), unstated, subsets)
    return {
        "gaps": own if kinematic else {},
        "gap_blank": NOT_KINEMATIC if other else why,
        "own_gaps": own,
        "association_gaps": association,
        "association_gap_blank": why_association,
    }


def _gaps(
    entrant: _Entrant, best: _Best, pair: tuple[str, str] | None, unstated: str, subsets: Sequence[Subset]
) -> tuple[dict[Subset, float], str]:
    """Gap that a record closes between those of a ``pair`` of names on each subset, and why it is missing on others."""
    if pair is None:
        return {}, unstated
    stp, truth = map(best.get, pair)
    if stp is None or truth is None:
        return {}, f"no record of {pair[0] if stp is None else pair[1]} beside it"
    if len({each.record.samples for each in (entrant, stp, truth)}) > 1:
        return {}, f"{entrant.record.samples} samples per object, its references have {stp.record.samples}"
    closed: dict[Subset, float] = {}
    for subset in subsets if entrant.record.status == "finished" else ():
        error, high, low = (each.sums.unit_error(subset) for each in (entrant, stp, truth))
        gap = gap_closed(error, high, low, stp.sums.unit_weight(subset))
        if gap is not None:
            closed[subset] = gap.closed
    return closed, NO_GAP


def _differences(entrant: _Entrant, stp: _Entrant | None, subsets: Sequence[Subset]) -> dict[Subset, PairedDifference]:
    """BADE of a record minus that of STP's record with the same k, on each subset."""
    if stp is None or stp is entrant or stp.record.samples != entrant.record.samples:
        return {}
    if entrant.record.status != "finished":
        return {}
    return {subset: difference for subset in subsets if (difference := entrant.minus(stp, subset)) is not None}


def _truths(best: _Best) -> list[_Entrant]:
    """Records of ground-truth tracks and of the best learned predictor on them; empty unless there are both."""
    truth, *learned = map(best.get, (TRUTH, *learned_truths()))
    errors = [(each.sums.row.error, each) for each in learned if each is not None and each.sums.row.error is not None]
    least = min(errors, key=itemgetter(0), default=None)
    return [] if truth is None or least is None else [truth, least[1]]

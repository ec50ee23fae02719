"""Ranks of records from their sums per unit: the rules of the scorer, applied to records.

Recorded envs are ranked by the sums of the records; simulated ones by those of hidden scenes, from signed levels.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from operator import itemgetter
from typing import Any, TypeVar

from .. import notice
from .._bundle import baseline_names
from ..scoring.definitions import SUBSETS, Subset
from ..scoring.rank import NO_GAP, NOT_KINEMATIC, SAW_TRUTH, UNSTATED, guard, rank_text, ranks_among, why_not_on
from ..scoring.statistics import PairedDifference, share_closed
from ..submission.loader import controls
from .attestation import LEVELS, Checked, SignedLevel
from .eligibility import NOT_ON_HIDDEN, Ships, held_back, taken_names, why_not_comparable, why_not_genuine, why_unranked
from .record import HiddenPart, Record, SubmissionPart
from .shipped import baseline_networks, learned_truths, network_references, shipped

STP, TRUTH = (controls()[role] for role in ("single", "ground_truth"))
ASSOCIATION = controls()["same_samples"], controls()["associated_same_samples"]
OTHERS = "other data, scenes or hidden scenes than the ranked ones"
T = TypeVar("T")


class BySubset(Mapping[Subset, T]):
    """Values by subset, each made when it is first read, as a table shows few; missing ones are left out."""

    def __init__(self, make: Callable[[Subset], T | None] = lambda subset: None) -> None:
        self._value = cache(make)

    def __getitem__(self, subset: Subset) -> T:
        value = self._value(subset) if subset in SUBSETS else None
        if value is None:
            raise KeyError(subset)
        return value

    def __iter__(self) -> Iterator[Subset]:
        return (subset for subset in SUBSETS if subset in self)

    def __len__(self) -> int:
        return len(list(self))


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
    gaps: Mapping[Subset, float] = field(default_factory=BySubset)  # gap_closed between STP and ground-truth tracks
    own_gaps: Mapping[Subset, float] = field(default_factory=BySubset)  # gap_closed between references of its predictor
    association_gaps: Mapping[Subset, float] = field(default_factory=BySubset)
    gap_blank: str = UNSTATED  # why one of the ``gaps`` is missing
    association_gap_blank: str = UNSTATED
    differences: Mapping[Subset, PairedDifference] = field(default_factory=BySubset)  # of bADE, to STP's


@dataclass(frozen=True, eq=False)
class _Entrant(Checked):
    """A record among others of its env."""

    unranked: str | None = None  # why it is not ranked
    not_comparable: str | None = None  # why its numbers cannot be compared with those of others

    @cached_property  # it reads the submission of that name
    def baseline(self) -> str:
        """Name of the submission; empty for another submission under the name of a baseline."""
        return "" if why_not_genuine(self.record) else self.record.submission.name

    @cached_property
    def conditions(self) -> tuple[object, ...]:
        """Data, scenes and units: equal for results that can be compared."""
        return conditions(self.sums)


_Best = Mapping[str, _Entrant]  # by the name of a genuine submission: its finished record with the highest level


def standings(
    records: Sequence[Record], levels: Mapping[str, SignedLevel] | None = None, ships: Ships = shipped
) -> dict[str, Standing]:
    """Standing of each record of any envs, by its digest, as are ``levels``; ``ships``: the shipped env of an id.

    Only records of what ships, of one data and the same units are ranked against each other; on simulated envs those
    of one seal. The main ranking of an env is that of the newest seal with a record of STP, then that of the
    record with the highest level, STP's before others: never the largest group as such. A better record moves others
    down; apart from that, a record changes no group, guard or gap but its own. Records of earlier definitions are
    ranked among themselves, if they have a signed level; they are not compared with what ships.
    """
    levels = levels or {}
    groups: dict[tuple[str, str], list[Record]] = {}
    for record in records:
        groups.setdefault((record.env.id, record.earlier), []).append(record)
    standing: dict[str, Standing] = {}
    with notice.work("comparing pairs of records") as work:
        work.started(sum(len(group) ** 2 for group in groups.values()))
        for (env_id, _), group in groups.items():
            standing |= _standings_of_env(group, levels, ships)
            work.done(env_id, len(group) ** 2)
    return standing


def conditions(sums: Record | HiddenPart) -> tuple[object, ...]:
    """Data, scenes and units: equal for results that can be compared."""
    if isinstance(sums, HiddenPart):
        of: tuple[object, ...] = (sums.commitment, sums.weights)
    else:
        of = (sums.env.split, sums.env.data_manifest, *(scene.scene for scene in sums.per_scene))
    rows = tuple((row.targets, row.objects, round(row.effective_objects, 6)) for row in sums.rows[: len(SUBSETS)])
    return (*of, rows, tuple(tuple(round(w, 6) for w in sums.unit_weight(subset)) for subset in SUBSETS))


def own_ends(submission: SubmissionPart, observe: str = "truth") -> tuple[str, str] | None:
    """Names of the records that bound a gap for the submission's predictor; None if unknown.

    ``observe``: "truth" for gap_closed, "associated" for the association gap.
    """
    if submission.ends == "controls":
        return (STP, TRUTH) if observe == "truth" else ASSOCIATION
    # weights that ship, as for simulated traffic, are in no list of a record
    names = () if submission.ends is None else submission.networks or baseline_networks(submission.name)
    # predictors that were trained on tracklets have the references of ground-truth tracks in gap_closed
    known = {name.split("-")[0] + "-truth" if observe == "truth" else "-".join(name.split("-")[:2]) for name in names}
    networks = sorted(known)
    pairs = (network_references(network, observe) for network in networks)
    return next((pair for pair in pairs if pair is not None), None)


def _standings_of_env(
    records: Sequence[Record], levels: Mapping[str, SignedLevel], ships: Ships
) -> dict[str, Standing]:
    taken = taken_names(records, levels)
    entrants = []
    for record in records:
        level, other = levels.get(record.digest), taken.get(record.digest)
        reasons = (why(record, level, ships) or other for why in (why_unranked, why_not_comparable))
        entrants.append(_Entrant(record, level, *reasons))
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
    ranks = cache(partial(_places, group, cache(lambda each: _guarded(each, best))))
    places: dict[str, Mapping[Subset, Place]] = {
        digest: dict.fromkeys(SUBSETS, Place(why=why)) for digest, why in (whys | held).items()
    }
    places |= {each.record.digest: BySubset(partial(_place, ranks, each.record.digest)) for each in group}
    waiting = [each for each in peers if each.unranked == NOT_ON_HIDDEN]
    inside = {each.record.digest for each in group or waiting}
    standing = {digest: Standing(place, digest in inside) for digest, place in places.items()}
    for each in peers:
        differences = BySubset(partial(_difference, each, best.get(STP)))
        found = replace(standing[each.record.digest], **_all_gaps(each, best), differences=differences)
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


def _place(places: Callable[[Subset], Mapping[str, Place]], digest: str, subset: Subset) -> Place:
    return places(subset)[digest]


def _places(group: Sequence[_Entrant], guarded: Callable[[_Entrant], str | None], subset: Subset) -> dict[str, Place]:
    """Places on a subset of records that are ranked against each other, by digest."""
    first = group[0].sums
    of_all = why_not_on(subset, first.row_of(subset).effective_objects, weight := first.unit_weight(subset))
    why = [of_all or (None if subset == "all" else guarded(entrant)) for entrant in group]
    ranks = ranks_among([entrant.sums.unit_error(subset) for entrant in group], weight, why)
    return {
        each.record.digest: Place(why=reason or "") if rank is None else Place(rank.place, rank.span)
        for each, rank, reason in zip(group, ranks, why, strict=True)
    }


def _guarded(entrant: _Entrant, best: _Best) -> str | None:
    """Reason why a record is not ranked on event subsets, from those of STP and of STP with its own predictor."""
    pair = own_ends(entrant.record.submission)
    stp, own = best.get(STP), None if pair is None else best.get(pair[0])
    if stp is None:
        return "no record of stp beside it"
    limits = (None if each is None else each.sums.unit_error("all") for each in (stp, own))
    return guard(entrant.sums.unit_error("all"), entrant.sums.unit_weight("all"), *limits)


def _all_gaps(entrant: _Entrant, best: _Best) -> dict[str, Any]:
    """Fields of a `Standing`: gaps that a record closes, and reasons of missing ones."""
    submission = entrant.record.submission
    kinematic, other = submission.ends == "controls", submission.ends == "own"
    unstated = "no reference with its predictor ships" if other else UNSTATED
    own, why = _gaps(entrant, best, own_ends(submission), unstated)
    association, why_association = BySubset[float](), SAW_TRUTH
    if entrant.record.env.observe != "truth":
        association, why_association = _gaps(entrant, best, own_ends(submission, "associated"), unstated)
    return {
        "gaps": own if kinematic else BySubset(),
        "gap_blank": NOT_KINEMATIC if other else why,
        "own_gaps": own,
        "association_gaps": association,
        "association_gap_blank": why_association,
    }


def _gaps(entrant: _Entrant, best: _Best, pair: tuple[str, str] | None, unstated: str) -> tuple[BySubset[float], str]:
    """Gap that a record closes between those of a ``pair`` of names on each subset, and why it is missing on others."""
    if pair is None:
        return BySubset(), unstated
    stp, truth = map(best.get, pair)
    if stp is None or truth is None:
        return BySubset(), f"no record of {pair[0] if stp is None else pair[1]} beside it"
    if len({each.record.samples for each in (entrant, stp, truth)}) > 1:
        return BySubset(), f"{entrant.record.samples} samples per object, its references have {stp.record.samples}"

    def closed(subset: Subset) -> float | None:
        error, high, low = (each.sums.unit_error(subset) for each in (entrant, stp, truth))
        return share_closed(error, high, low, stp.sums.unit_weight(subset))

    return BySubset(closed) if entrant.record.status == "finished" else BySubset(), NO_GAP


def _difference(entrant: _Entrant, stp: _Entrant | None, subset: Subset) -> PairedDifference | None:
    """BADE of a record minus that of STP's record with the same k."""
    if stp is None or stp is entrant or stp.record.samples != entrant.record.samples:
        return None
    return entrant.minus(stp, subset) if entrant.record.status == "finished" else None


def _truths(best: _Best) -> list[_Entrant]:
    """Records of ground-truth tracks and of the best learned predictor on them; empty unless there are both."""
    truth, *learned = map(best.get, (TRUTH, *learned_truths()))
    errors = [(each.sums.row.error, each) for each in learned if each is not None and each.sums.row.error is not None]
    least = min(errors, key=itemgetter(0), default=None)
    return [] if truth is None or least is None else [truth, least[1]]

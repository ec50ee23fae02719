"""Records against each other, from their sums per unit alone: the rules of the scorer, applied to records.

Recorded envs are ranked by the sums of the records; simulated ones by those of hidden scenes, from signed levels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from .._bundle import baseline_names
from ..scoring.rank import guard, ranks_among, why_not_on
from ..scoring.statistics import PairedDifference, gap_closed, paired_difference
from ..scoring.subsets import SUBSETS, Subset
from .attestation import LEVELS, Checked, SignedLevel
from .eligibility import Ships, taken_names, why_not_comparable, why_not_genuine, why_unranked
from .record import HiddenPart, Record, SubmissionPart
from .shipped import baseline_networks, shipped

STP, TRUTH = "stp", "truth_past"
# Between whom the gap of an agent with a network is: one hypothesis, and true pasts, with the network of true pasts
NETWORK_ENDS = {"modes": ("stp_modes", "truth_modes"), "ptp": ("stp_ptp", "truth_ptp")}
OTHERS = "other data, scenes or hidden scenes than the ranked ones"


@dataclass(frozen=True)
class Place:
    """Where a record stands on one subset."""

    rank: int | None = None
    why: str = ""  # it has no rank


@dataclass(frozen=True)
class Standing:
    """Where a record stands among those of its environment."""

    places: Mapping[Subset, Place]
    compared: bool = False  # with the main ranking of its environment, whether or not that has ranks
    gaps: Mapping[Subset, float] = field(default_factory=dict)  # what it closes of that from STP to true pasts
    own_gaps: Mapping[Subset, float] = field(default_factory=dict)  # of that between ends with its own predictor
    differences: Mapping[Subset, PairedDifference] = field(default_factory=dict)  # of what ranks, to STP beside it


@dataclass(frozen=True, eq=False)
class _Entrant(Checked):
    """A record beside others of its env."""

    why: str | None = None  # it is never ranked
    apart: str | None = None  # its numbers say nothing beside those of others

    @cached_property  # it reads the submission of that name
    def named(self) -> str:
        """Its name, where it is the name's owner."""
        return "" if why_not_genuine(self.record) else self.record.submission.name


def standings(
    records: Sequence[Record], levels: Mapping[str, SignedLevel] | None = None, ships: Ships = shipped
) -> dict[str, Standing]:
    """Where each record stands, by its digest.

    Args:
        records: Of any envs.
        levels: Signed levels by the digest of the record.
        ships: What ships for an env, by its id.

    Only records of what ships, of one data, the same units and division are ranked against each other; on simulated
    envs those of one seal. The main ranking of an env is that of the newest seal that STP is on, and of the record
    that was checked best, STP's before others: never that of most records. A better record moves others down; apart
    from that, what a record holds changes no group, guard or gap but its own. Records of an earlier version stand
    apart, among themselves: they are not checked against what ships, and only those with a signed level are ranked.
    """
    found: dict[str, Standing] = {}
    levels = levels or {}
    groups: dict[tuple[str, str], list[Record]] = {}
    for record in records:
        groups.setdefault((record.env.id, record.earlier_version), []).append(record)
    for group in groups.values():
        found |= _of_env(group, levels, ships)
    return found


def conditions(sums: Record | HiddenPart) -> tuple[object, ...]:
    """What two must share to be compared with each other: then they have the same units, too."""
    if isinstance(sums, HiddenPart):
        of: tuple[object, ...] = (sums.commitment, sums.weights)
    else:
        of = (sums.env.split, sums.env.data_manifest, *(scene.scene for scene in sums.per_scene))
    rows = tuple((row.targets, row.objects, round(row.effective_objects, 6)) for row in sums.rows)
    return (*of, rows, tuple(tuple(round(w, 6) for w in sums.unit_weight(subset)) for subset in SUBSETS))


def difference_of(one: Checked, other: Checked, subset: Subset) -> PairedDifference | None:
    """The error of ``one`` less that of ``other``, metres, paired unit by unit; they have the same `conditions`."""
    return paired_difference(one.sums.unit_error(subset), other.sums.unit_error(subset), one.sums.unit_weight(subset))


def _of_env(records: Sequence[Record], levels: Mapping[str, SignedLevel], ships: Ships) -> dict[str, Standing]:
    taken = taken_names(records, levels)
    entrants = [_entrant(record, levels.get(record.digest), taken.get(record.digest), ships) for record in records]
    groups: dict[tuple[str, tuple[object, ...]], list[_Entrant]] = {}
    for entrant in entrants:
        if entrant.why is None:
            groups.setdefault((entrant.record.division, conditions(entrant.sums)), []).append(entrant)
    closed = [entrant for entrant in entrants if entrant.why is None and entrant.record.division == "closed"]
    anchored = {conditions(entrant.sums) for entrant in closed if entrant.named == STP}
    leading = [each for each in closed if conditions(each.sums) in anchored] or closed  # a seal that STP is not on yet
    main = None if not leading else conditions(max(leading, key=_anchors).sums)
    beside = [each for each in entrants if each.apart is None and main is not None and conditions(each.sums) == main]
    places = {entrant.record.digest: _nowhere(entrant.why or "") for entrant in entrants}
    for (division, condition), group in groups.items():
        ranked = _places(group, beside)
        if (division, condition) != ("closed", main):
            ranked = [_nowhere(_outside(division, place["all"])) for place in ranked]
        places |= {entrant.record.digest: place for entrant, place in zip(group, ranked, strict=True)}
    inside = {entrant.record.digest for entrant in groups.get(("closed", main), [])} if main is not None else set()
    gaps = {entrant.record.digest: _gaps(entrant, beside, (STP, TRUTH)) for entrant in beside}
    own = {each.record.digest: _own_gaps(each, beside, gaps[each.record.digest]) for each in beside}
    differences = {entrant.record.digest: _differences(entrant, _named(STP, beside)) for entrant in beside}
    return {
        digest: Standing(
            place, digest in inside, gaps.get(digest, {}), own.get(digest, {}), differences.get(digest, {})
        )
        for digest, place in places.items()
    }


def _entrant(record: Record, level: SignedLevel | None, taken: str | None, ships: Ships) -> _Entrant:
    why = why_unranked(record, level, ships) or taken
    return _Entrant(record, level, why, why_not_comparable(record, level, ships) or taken)


def _anchors(entrant: _Entrant) -> tuple[object, ...]:
    """How much a record says of which ranking is the main one; the largest decides."""
    signed, name = entrant.signed, entrant.named
    made = signed.seal.made if signed is not None and signed.seal is not None else ""
    return made, LEVELS.index(entrant.level), name == STP, name in baseline_names(), entrant.record.digest


def _nowhere(why: str) -> dict[Subset, Place]:
    return dict.fromkeys(SUBSETS, Place(why=why))


def _outside(division: str, place: Place) -> str:
    """Why a record has no rank that is ranked among others than those of the main ranking."""
    if division == "closed":
        return OTHERS
    return "open division" + (f": rank {place.rank} there" if place.rank is not None else "")


def _places(group: Sequence[_Entrant], beside: Sequence[_Entrant]) -> list[dict[Subset, Place]]:
    """The places of records that are ranked against each other; ``beside`` has the ends of their gaps."""
    places: list[dict[Subset, Place]] = [{} for _ in group]
    sums = [entrant.sums for entrant in group]
    limits = [_limits(entrant, beside) for entrant in group]
    for subset in SUBSETS:
        nobody = why_not_on(subset, sums[0].row_of(subset).effective_objects, sums[0].unit_weight(subset))
        why = [
            nobody or (None if subset == "all" else _guarded(each.row.error, *limit))
            for each, limit in zip(sums, limits, strict=True)
        ]
        ranks = ranks_among([each.unit_error(subset) for each in sums], why)
        for place, rank, reason in zip(places, ranks, why, strict=True):
            place[subset] = Place(rank, reason or "")
    return places


def _guarded(error: float | None, stp: float | None, own: float | None) -> str | None:
    """Why a record is not ranked on event subsets; where STP is not beside it nobody knows."""
    return "no record of stp beside it" if stp is None else guard(error, stp, own)


def _limits(entrant: _Entrant, beside: Sequence[_Entrant]) -> tuple[float | None, float | None]:
    """Errors over all targets of STP, and of STP with the record's own predictor; None: not known."""
    ends = own_ends(entrant.record.submission)
    stp, own = _named(STP, beside), None if ends is None else _named(ends[0], beside)
    return None if stp is None else stp.sums.row.error, None if own is None else own.sums.row.error


def own_ends(submission: SubmissionPart) -> tuple[str, str] | None:
    """Whose records are the ends of a gap with the predictor of a submission; None where there are none."""
    if submission.ends == "controls":
        return STP, TRUTH
    # weights that ship, as for simulated traffic, are in no list of a record
    named = submission.networks or baseline_networks(submission.name)
    networks = sorted(name.partition("-")[0] for name in named)
    found = next((NETWORK_ENDS[name] for name in networks if name in NETWORK_ENDS), None)
    return found if submission.ends == "own" else None


def _gaps(entrant: _Entrant, beside: Sequence[_Entrant], ends: tuple[str, str] | None) -> dict[Subset, float]:
    """What a record closes of the gap between two records ``beside`` it, all of one k."""
    stp, truth = (None, None) if ends is None else (_named(name, beside) for name in ends)
    if stp is None or truth is None or len({each.record.samples for each in (entrant, stp, truth)}) > 1:
        return {}
    closed: dict[Subset, float] = {}
    for subset in SUBSETS if entrant.record.status == "finished" else ():
        error, high, low = (each.sums.unit_error(subset) for each in (entrant, stp, truth))
        gap = gap_closed(error, high, low, stp.sums.unit_weight(subset))
        if gap is not None:
            closed[subset] = gap.closed
    return closed


def _own_gaps(entrant: _Entrant, beside: Sequence[_Entrant], gaps: Mapping[Subset, float]) -> Mapping[Subset, float]:
    """What a record closes of the gap between ends with its own predictor; ``gaps``: between STP and true pasts."""
    ends = own_ends(entrant.record.submission)
    return gaps if ends == (STP, TRUTH) else _gaps(entrant, beside, ends)


def _differences(entrant: _Entrant, stp: _Entrant | None) -> dict[Subset, PairedDifference]:
    """The error of a record minus that of the record of ``stp`` of the same k, paired unit by unit."""
    if stp is None or stp is entrant or stp.record.samples != entrant.record.samples:
        return {}
    found: dict[Subset, PairedDifference] = {}
    for subset in SUBSETS if entrant.record.status == "finished" else ():
        less = difference_of(entrant, stp, subset)
        if less is not None:
            found[subset] = less
    return found


def _named(name: str, entrants: Sequence[_Entrant]) -> _Entrant | None:
    """The genuine baseline of that name, the one that was checked best."""
    found = [each for each in entrants if each.named == name and each.record.status == "finished"]
    return max(found, key=_anchors, default=None)

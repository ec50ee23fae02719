"""What the paper finds, whether it holds here, and how sure that is: relations, for absolute numbers do not compare."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..running.settings import Setting
from ..scoring.definitions import RANKED_UNITS
from ..scoring.statistics import bootstrap_interval, effective_number, ratio, share_interval
from ..scoring.subsets import Subset
from ..types import Floats
from ..viz.terminal.paper import PAPER_HYPOTHESES, figures_of, paper_facts
from .findings import Findings
from .plan import SAME_BUDGET
from .table import Number, Table, Text

HOLDS, FAILS, OPEN = "holds", "does not hold", "cannot be told"
_MUCH = 2.0  # a stage that takes so many times as long has slowed down


@dataclass(frozen=True)
class Relation:
    """A relation of the paper beside ours."""

    relation: Text
    paper: Text  # what the paper has; empty where it has no number for this env
    measured: Text  # what ours is of, in words
    value: Number
    low: Number
    high: Number
    unit: Text
    verdict: Text


def relation_table(found: Findings) -> Table:
    """Every relation that can be looked at here."""
    return Table(
        "relations",
        "What the paper finds, and what holds here",
        "Relations of the paper with the 95 % interval of ours. One holds where the whole interval says so, and does "
        "not where the whole interval says the opposite. Else, and with fewer than 6 effective recordings, it cannot "
        "be told.",
        list(relations(found)),
    )


def relations(found: Findings) -> Iterator[Relation]:
    """The relations, in the order of the paper."""
    yield from _costs(found)
    yield from _frequency(found)
    if found.subject.most != found.subject.single:
        yield from _gains(found)
    if (found.subject.most.hypotheses or 1) > 1:
        yield from _shared(found)
        yield from _speed(found)
    yield from _people(found)


def _costs(found: Findings) -> Iterator[Relation]:
    subject = found.subject
    kinds: tuple[tuple[Subset, str, str], ...] = (
        ("paper_ids", "ids", "An identity switch"), ("paper_frag", "frag", "A fragment"),
    )  # fmt: skip
    for subset, key, what in kinds:
        ends = [figures_of(found.bench.of_paper, agent, "equal", 1).get(key) for agent in ("truth_past", "stp")]
        papers = ""
        if ends[0] and ends[1]:
            papers = f"minADE {ends[0][0]:.3f} m from true pasts, {ends[1][0]:.3f} m from tracklets"
        yield _difference(found, subject.end, subject.truth, subset, +1, f"{what} makes prediction much worse", papers)


def _gains(found: Findings) -> Iterator[Relation]:
    subject, most = found.subject, found.subject.most
    env_id, count = found.bench.of_paper, found.subject.most.hypotheses or 1
    who = "Hypotheses win" if count > 1 else f"{subject.name} wins"

    def paper(key: str, *ends: tuple[str, str, int]) -> str:
        known = [figures_of(env_id, *end).get(key) for end in ends]
        return " to ".join(f"{pair[0]:.3f} m" for pair in known if pair) if all(known) else ""

    kinds: tuple[tuple[Subset, str, str], ...] = (
        ("paper_ids", "ids", "where identities switch"), ("paper_frag", "frag", "at fragments"),
        ("all", "all", "over all targets"),
    )  # fmt: skip
    one, many = ("stp", "equal", 1), ("mtp", "equal", count)
    for subset, key, place in kinds:
        what = f"{who} part of it back {place}"
        yield _difference(found, most, subject.single, subset, -1, what, paper(key, one, many))
    few = min((h for h in subject.equal if h >= 5), default=count)
    if few < count:
        told = paper("ids", ("mtp", "equal", few), many)
        yield _difference(found, most, subject.equal[few], "paper_ids", -1, "More hypotheses win more", told)
    if count in subject.free:
        yield _kept(found, subject.single, most, subject.free[count], paper("ids", ("mtp", "free", count), many))
    control = next((s for s in found.plan.controls if s.label == SAME_BUDGET), None)
    if control is not None and subject.single in found.plan.controls:  # which have its predictor
        what = f"{who} more than as many samples from one hypothesis (a control that the paper does not have)"
        yield _difference(found, most, control, "paper_ids", -1, what, "")


def _difference(
    found: Findings, setting: Setting, other: Setting, subset: Subset, sign: int, what: str, paper: str
) -> Relation:
    """A setting minus another one by minADE, the paper's number; ``sign`` of what the paper finds."""
    row = found.difference(setting, other, subset)
    low, high = row.minADE_interval or (None, None)
    place = {"all": "all targets", "paper_ids": "targets with an IDS", "paper_frag": "targets with a FRAG"}[subset]
    names = [_named(each) for each in (setting, other)]
    tables = [found.table(each) for each in (setting, other)]
    both = (tables[0].covered > 0) & (tables[1].covered > 0)
    return Relation(
        relation=what,
        paper=paper,
        measured=f"minADE, {names[0]} minus {names[1]}, {row.shared} {place} that both cover",
        value=row.minADE,
        low=low,
        high=high,
        unit="m",
        verdict=verdict(low, high, 0.0, sign, tables[0].unit_weight(tables[0].weight[subset] * both)),
    )


def _named(setting: Setting) -> str:
    if (setting.hypotheses or 1) == 1:
        return setting.label
    return f"{setting.label} with H = {setting.hypotheses}" + (" and all samples" if setting.budget == "free" else "")


def _kept(found: Findings, single: Setting, equal: Setting, free: Setting, paper: str) -> Relation:
    """How much of the gain is left when k of all samples are chosen."""
    tables = [found.table(setting) for setting in (single, equal, free)]
    weight = tables[0].weight["paper_ids"] * np.all([table.covered > 0 for table in tables], axis=0)
    ade = [
        table.per_unit(np.divide(table.min_ade, np.maximum(table.covered, 1)), weight) for table in tables
    ]  # [3][U] m, summed
    interval = share_interval(ade[0] - ade[1], ade[0] - ade[2])
    low, high = interval or (None, None)
    return Relation(
        relation="Sampling keeps most of the gain",
        paper=paper,
        measured="share of the gain on IDS, by minADE, that is left with k samples",
        value=ratio((ade[0] - ade[1]).sum(), (ade[0] - ade[2]).sum()),
        low=low,
        high=high,
        unit="share",
        verdict=verdict(low, high, 0.5, +1, tables[0].unit_weight(weight)),
    )


def _frequency(found: Findings) -> Iterator[Relation]:
    near = found.of(found.subject.single).around[0]
    events = [float(len(scene.own["lost"].frame)) for scene in near]
    objects = [float(scene.objects) for scene in near]
    low, high = bootstrap_interval(events, objects) or (None, None)
    yield Relation(
        relation="On average a trajectory has a fragment",
        paper="about one or more per trajectory on KITTI and nuScenes (figure)",
        measured=f"losses of {found.subject.single.label} per true object and scene",
        value=ratio(sum(events), sum(objects)),
        low=low,
        high=high,
        unit="per trajectory",
        verdict=verdict(low, high, 1.0, +1, np.array(objects)),
    )


def _shared(found: Findings) -> Iterator[Relation]:
    count = found.subject.most.hypotheses
    papers = paper_facts(found.bench.of_paper, "shared").get("ids") if count == PAPER_HYPOTHESES else None
    told = ""
    if papers is not None:
        told = f"{papers['one']} to {papers['all']}, {1 - papers['all'] / papers['one']:.1%} fewer"
    one, every = (found.of(setting).around[0] for setting in (found.subject.single, found.subject.most))
    first = np.array([len(scene.own["ids"].frame) for scene in one], dtype=float)
    left = np.array([len(scene.shared["ids"].frame) for scene in every], dtype=float)
    low, high = share_interval(first - left, first) or (None, None)
    yield Relation(
        relation="Most switches are absent from at least one hypothesis",
        paper=told,
        measured=f"{first.sum():.0f} ids with one hypothesis, {left.sum():.0f} in all {count}",
        value=ratio((first - left).sum(), first.sum()),
        low=low,
        high=high,
        unit="share",
        verdict=verdict(low, high, 0.5, +1, first),
    )


def _speed(found: Findings) -> Iterator[Relation]:
    times = sorted(found.speed, key=lambda speed: speed.hypotheses)
    papers = paper_facts(found.bench.of_paper, "speed")
    for stage, slows in (("tracking", True), ("prediction", False)):
        first, last = (getattr(times[i], stage) for i in (0, -1))
        if not first or not last or len(times) < 2:
            continue
        rates = papers.get(stage) if times[-1].hypotheses == PAPER_HYPOTHESES else None
        yield Relation(
            relation=f"{stage.capitalize()} {'slows down much' if slows else 'hardly slows down'} with hypotheses",
            paper="" if rates is None else f"{rates['1']} to {rates[str(PAPER_HYPOTHESES)]} frames/s",
            measured=f"time of a frame with H = {times[-1].hypotheses} by that with 1",
            value=last / first,
            low=None,
            high=None,
            unit="times",
            verdict=HOLDS if (last / first > _MUCH) == slows else FAILS,
        )


def _people(found: Findings) -> Iterator[Relation]:
    if not found.plan.retracking:
        return
    plain, again, hypotheses, both = found.plan.retracking
    papers = paper_facts(found.bench.of_paper, "people")
    for name, setting, other, of in (
        ("Re-tracking helps one hypothesis", again, plain, ("plain", "retracking")),
        ("Hypotheses help without re-tracking", hypotheses, plain, ("plain", "hypotheses")),
        ("Re-tracking helps hypotheses", both, hypotheses, ("hypotheses", "both")),
    ):
        told = " to ".join(f"{papers[key][0]:.3f} m" for key in of) if papers else ""
        yield _difference(found, setting, other, "all", -1, name, told)


def verdict(low: float | None, high: float | None, limit: float, sign: int, weight: Floats) -> str:
    """Whether a value lies above (``sign`` 1) or below (-1) a limit, as its interval says.

    ``weight`` [U]: of the units; with fewer effective ones than a rank needs nothing is said.
    """
    if low is None or high is None or effective_number(weight) < RANKED_UNITS:
        return OPEN
    above, below = low > limit, high < limit
    return HOLDS if (above if sign > 0 else below) else FAILS if (below if sign > 0 else above) else OPEN

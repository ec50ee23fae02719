"""Relations between numbers of the paper, tested here with intervals; the absolute numbers are not comparable."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace as Row

import numpy as np

from ..running.settings import Setting
from ..scoring.definitions import RANKED_UNITS
from ..scoring.rows import Interval
from ..scoring.statistics import bootstrap_interval, effective_number, ratio, share_interval
from ..scoring.subsets import Subset
from ..types import Floats
from ..viz.terminal.paper import PAPER_HYPOTHESES, figures_of, paper_facts
from .findings import Findings

HOLDS, FAILS, OPEN = "holds", "does not hold", "cannot be told"
Kinds = tuple[tuple[Subset, str, str], ...]  # subset, key of the paper's figures, words
_MUCH = 2.0  # a stage that takes this many times as long has slowed down
_PLACES = {"all": "all targets", "paper_ids": "targets with an IDS", "paper_frag": "targets with a FRAG"}


def relation_rows(findings: Findings) -> Iterator[Row]:
    """The relations that can be examined here, in the order of the paper."""
    yield from _costs(findings)
    yield _frequency(findings)
    if findings.subject.most != findings.subject.single:
        yield from _gains(findings)
    if (findings.subject.most.hypotheses or 1) > 1:
        yield _shared(findings)
        yield from _speed(findings)
    yield from _people(findings)


def _relation(
    relation: str, paper: str, measured: str, value: float | None, interval: Interval | None, unit: str, holds: str
) -> Row:
    """A row with a relation of the paper and our measure of it.

    ``paper``: the paper's figures, empty if it has none for this env; ``measured``: our measure, in words.
    """
    return Row(
        relation=relation,
        paper=paper,
        measured=measured,
        value=value,
        value_interval=interval,
        unit=unit,
        verdict=holds,
    )


def verdict(interval: Interval | None, limit: float, sign: int, weight: Floats) -> str:
    """Verdict on a value that should lie above (``sign`` 1) or below (-1) a limit, by its interval.

    ``weight`` [U]: of the units; with fewer effective units than a rank needs the verdict is OPEN.
    """
    if interval is None or effective_number(weight) < RANKED_UNITS:
        return OPEN
    low, high = (sign * (end - limit) for end in interval)
    return HOLDS if min(low, high) > 0 else FAILS if max(low, high) < 0 else OPEN


def _costs(findings: Findings) -> Iterator[Row]:
    subject = findings.subject
    kinds: Kinds = (("paper_ids", "ids", "An identity switch"), ("paper_frag", "frag", "A fragment"))
    for subset, key, event in kinds:
        pair = [figures_of(findings.bench.of_paper, role, "equal", 1).get(key) for role in ("truth_past", "stp")]
        papers = ""
        if pair[0] and pair[1]:
            papers = f"minADE {pair[0][0]:.3f} m from GT tracks, {pair[1][0]:.3f} m from tracklets"
        title = f"{event} makes prediction much worse"
        yield _difference(findings, subject.reference, subject.truth, subset, +1, title, papers)


def _gains(findings: Findings) -> Iterator[Row]:
    subject, most = findings.subject, findings.subject.most
    env_id, count = findings.bench.of_paper, most.hypotheses or 1
    winner = "Hypotheses win" if count > 1 else f"{subject.name} wins"

    def paper(key: str, *keys: tuple[str, str, int]) -> str:
        known = [figures_of(env_id, *each).get(key) for each in keys]
        return " to ".join(f"{figures[0]:.3f} m" for figures in known if figures) if all(known) else ""

    one, many = ("stp", "equal", 1), ("mtp", "equal", count)
    kinds: Kinds = (
        ("paper_ids", "ids", "where identities switch"),
        ("paper_frag", "frag", "at fragments"),
        ("all", "all", "over all targets"),
    )
    for subset, key, place in kinds:
        title = f"{winner} part of it back {place}"
        yield _difference(findings, most, subject.single, subset, -1, title, paper(key, one, many))
    few = min((h for h in subject.equal if h >= 5), default=count)
    if few < count:
        figures = paper("ids", ("mtp", "equal", few), many)
        yield _difference(findings, most, subject.equal[few], "paper_ids", -1, "More hypotheses win more", figures)
    if count in subject.free:
        yield _kept(findings, subject.single, most, subject.free[count], paper("ids", ("mtp", "free", count), many))
    control = findings.plan.same_samples
    if control is not None and subject.single in findings.plan.controls:  # they share its predictor
        title = f"{winner} more than as many samples from one hypothesis (a control that the paper does not have)"
        yield _difference(findings, most, control, "paper_ids", -1, title, "")


def _difference(
    findings: Findings, setting: Setting, other: Setting, subset: Subset, sign: int, title: str, paper: str
) -> Row:
    """A setting minus another one by minADE, the paper's number; ``sign`` of what the paper finds."""
    row = findings.difference(setting, other, subset)
    first, second = findings.table(setting), findings.table(other)
    weight = first.unit_weight(first.weight[subset] * ((first.covered > 0) & (second.covered > 0)))
    measured = f"minADE, {_name(setting)} minus {_name(other)}, {row.shared} {_PLACES[subset]} that both cover"
    interval = row.minADE_interval
    return _relation(title, paper, measured, row.minADE, interval, "m", verdict(interval, 0.0, sign, weight))


def _name(setting: Setting) -> str:
    if (setting.hypotheses or 1) == 1:
        return setting.label
    return f"{setting.label} with H = {setting.hypotheses}" + (" and all samples" if setting.budget == "free" else "")


def _kept(findings: Findings, single: Setting, equal: Setting, free: Setting, paper: str) -> Row:
    """Share of the gain that is left if k of all samples are chosen."""
    tables = [findings.table(setting) for setting in (single, equal, free)]
    weight = tables[0].weight["paper_ids"] * np.all([table.covered > 0 for table in tables], axis=0)
    alone, chosen, whole = (
        table.per_unit(np.divide(table.min_ade, np.maximum(table.covered, 1)), weight) for table in tables
    )  # [U] m, summed
    gains = alone - chosen, alone - whole
    interval = share_interval(*gains)
    measured = "share of the gain on IDS, by minADE, that is left with k samples"
    holds = verdict(interval, 0.5, +1, tables[0].unit_weight(weight))
    share = ratio(gains[0].sum(), gains[1].sum())
    return _relation("Sampling keeps most of the gain", paper, measured, share, interval, "share", holds)


def _frequency(findings: Findings) -> Row:
    near = findings.of(findings.subject.single).around[0]
    events = [float(len(scene.own["lost"].frame)) for scene in near]
    objects = [float(scene.objects) for scene in near]
    interval = bootstrap_interval(events, objects)
    return _relation(
        "On average a trajectory has a fragment",
        "about one or more per trajectory on KITTI and nuScenes (figure)",
        f"losses of {findings.subject.single.label} per true object and scene",
        ratio(sum(events), sum(objects)),
        interval,
        "per trajectory",
        verdict(interval, 1.0, +1, np.array(objects)),
    )


def _shared(findings: Findings) -> Row:
    count, paper = findings.subject.most.hypotheses, ""
    papers = paper_facts(findings.bench.of_paper, "shared").get("ids") if count == PAPER_HYPOTHESES else None
    if papers is not None:
        paper = f"{papers['one']} to {papers['all']}, {1 - papers['all'] / papers['one']:.1%} fewer"
    one, every = (findings.of(setting).around[0] for setting in (findings.subject.single, findings.subject.most))
    first = np.array([len(scene.own["ids"].frame) for scene in one], dtype=float)
    left = np.array([len(scene.shared["ids"].frame) for scene in every], dtype=float)
    interval = share_interval(first - left, first)
    return _relation(
        "Most switches are absent from at least one hypothesis",
        paper,
        f"{first.sum():.0f} ids with one hypothesis, {left.sum():.0f} in all {count}",
        ratio((first - left).sum(), first.sum()),
        interval,
        "share",
        verdict(interval, 0.5, +1, first),
    )


def _speed(findings: Findings) -> Iterator[Row]:
    times = sorted(findings.speed, key=lambda speed: speed.hypotheses)
    papers = paper_facts(findings.bench.of_paper, "speed")
    for stage, slows in (("tracking", True), ("prediction", False)):
        first, last = (getattr(times[i], stage) for i in (0, -1))
        if not first or not last or len(times) < 2:
            continue
        rates = papers.get(stage) if times[-1].hypotheses == PAPER_HYPOTHESES else None
        yield _relation(
            f"{stage.capitalize()} {'slows down much' if slows else 'hardly slows down'} with hypotheses",
            "" if rates is None else f"{rates['1']} to {rates[str(PAPER_HYPOTHESES)]} frames/s",
            f"time of a frame with H = {times[-1].hypotheses} by that with 1",
            last / first,
            None,
            "times",
            HOLDS if (last / first > _MUCH) == slows else FAILS,
        )


def _people(findings: Findings) -> Iterator[Row]:
    if not findings.plan.retracking:
        return
    plain, again, hypotheses, both = findings.plan.retracking
    papers = paper_facts(findings.bench.of_paper, "people")
    for title, setting, other, pair in (
        ("Re-tracking helps one hypothesis", again, plain, ("plain", "retracking")),
        ("Hypotheses help without re-tracking", hypotheses, plain, ("plain", "hypotheses")),
        ("Re-tracking helps hypotheses", both, hypotheses, ("hypotheses", "both")),
    ):
        figures = " to ".join(f"{papers[key][0]:.3f} m" for key in pair) if papers else ""
        yield _difference(findings, setting, other, "all", -1, title, figures)

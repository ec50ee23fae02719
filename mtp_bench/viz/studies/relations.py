"""Relations between numbers of the paper, tested here with intervals; the absolute numbers are not comparable."""

from collections.abc import Iterator
from types import SimpleNamespace as Row
from typing import Any, NamedTuple

import numpy as np

from ...core import Floats
from ...running import Setting
from ...scoring import (
    RANKED_UNITS,
    Interval,
    Subset,
    bootstrap_interval,
    effective_number,
    ratio,
    share_interval,
)
from ..terminal.paper import PAPER_HYPOTHESES, figures_of, shared_events
from .runs import Findings

HOLDS, FAILS, OPEN = "holds", "does not hold", "cannot be told"


class _Place(NamedTuple):
    subset: Subset
    key: str  # of the paper's figures
    event: str
    where: str
    targets: str


_PLACES = (
    _Place(
        "paper_ids",
        "ids",
        "An identity switch",
        "where identities switch",
        "targets with an IDS",
    ),
    _Place("paper_frag", "frag", "A fragment", "at fragments", "targets with a FRAG"),
    _Place("all", "all", "", "over all targets", "all targets"),
)


def relation_rows(findings: Findings) -> Iterator[Row]:
    """The relations that can be examined here, in the order of the paper.

    A row has the paper's figures (``paper``, empty if it has none for this env) and ours in words (``measured``).
    """
    yield from _costs(findings)
    yield _frequency(findings)
    if findings.subject.most != findings.subject.single:
        yield from _gains(findings)
    if (findings.subject.most.hypotheses or 1) > 1:
        yield _shared(findings)


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
    for place in _PLACES[:2]:
        roles = ("ground_truth", "single")
        truth, stp = (
            figures_of(findings.bench.of_paper, role, "equal", 1).get(place.key)
            for role in roles
        )
        papers = (
            f"minADE {truth[0]:.3f} m from GT tracks, {stp[0]:.3f} m from tracklets"
            if truth and stp
            else ""
        )
        title = f"{place.event} makes prediction much worse"
        yield _difference(
            findings, subject.reference, subject.truth, place, +1, title, papers
        )


def _gains(findings: Findings) -> Iterator[Row]:
    subject, most, switches = findings.subject, findings.subject.most, _PLACES[0]
    count = most.hypotheses or 1
    winner = "Hypotheses win" if count > 1 else f"{subject.name} wins"

    def paper(key: str, *settings: tuple[str, str, int]) -> str:
        known = [
            figures_of(findings.bench.of_paper, *each).get(key) for each in settings
        ]
        return (
            " to ".join(f"{figures[0]:.3f} m" for figures in known if figures)
            if all(known)
            else ""
        )

    one, many = ("single", "equal", 1), ("several", "equal", count)
    for place in _PLACES:
        title = f"{winner} part of it back {place.where}"
        yield _difference(
            findings,
            most,
            subject.single,
            place,
            -1,
            title,
            paper(place.key, one, many),
        )
    few = min((h for h in subject.equal if h >= 5), default=count)
    if few < count:
        figures = paper("ids", ("several", "equal", few), many)
        yield _difference(
            findings,
            most,
            subject.equal[few],
            switches,
            -1,
            "More hypotheses win more",
            figures,
        )
    if count in subject.free:
        yield _kept(
            findings,
            subject.free[count],
            paper("ids", ("several", "free", count), many),
        )
    rivals = (
        findings.plan.rivals if subject.single in findings.plan.controls else []
    )  # they share its predictor
    for control in rivals:
        title = f"{winner} more than {control.label} (a control that the paper does not have)"
        yield _difference(findings, most, control, switches, -1, title, "")


def _difference(
    findings: Findings,
    setting: Setting,
    other: Setting,
    place: _Place,
    sign: int,
    title: str,
    paper: str,
) -> Row:
    """A setting minus another one by minADE, the paper's number; ``sign`` of what the paper finds."""
    row = findings.difference(setting, other, place.subset)
    first, second = findings.table(setting), findings.table(other)
    weight = first.unit_weight(
        first.weight[place.subset] * ((first.covered > 0) & (second.covered > 0))
    )
    measured = f"minADE, {_name(setting)} minus {_name(other)}, {row.shared} {place.targets} that both cover"
    found = verdict(row.minADE_interval, 0.0, sign, weight)
    return _row(title, paper, measured, row.minADE, row.minADE_interval, "m", found)


def _row(
    relation: str,
    paper: str,
    measured: str,
    value: Any,
    value_interval: Any,
    unit: str,
    verdict: str,
) -> Row:
    return Row(**locals())


def _name(setting: Setting) -> str:
    if (setting.hypotheses or 1) == 1:
        return setting.label
    return f"{setting.label} with H = {setting.hypotheses}" + (
        " and all samples" if setting.budget == "free" else ""
    )


def _kept(findings: Findings, free: Setting, paper: str) -> Row:
    """Share of the gain that is left if k of all samples are chosen."""
    subject = findings.subject
    tables = [
        findings.table(setting) for setting in (subject.single, subject.most, free)
    ]
    weight = tables[0].weight["paper_ids"] * np.all(
        [table.covered > 0 for table in tables], axis=0
    )
    alone, chosen, whole = (
        table.per_unit(np.divide(table.min_ade, np.maximum(table.covered, 1)), weight)
        for table in tables
    )  # [U] m, summed
    measured = "share of the gain on IDS, by minADE, that is left with k samples"
    gains = (alone - chosen, alone - whole)
    return _share(
        "Sampling keeps most of the gain",
        paper,
        measured,
        gains,
        tables[0].unit_weight(weight),
    )


def _share(
    relation: str,
    paper: str,
    measured: str,
    parts: tuple[Floats, Floats],
    weight: Floats,
) -> Row:
    """A share that should be above one half: of two numbers [U] per unit, summed."""
    interval = share_interval(*parts)
    value = ratio(parts[0].sum(), parts[1].sum())
    return _row(
        relation,
        paper,
        measured,
        value,
        interval,
        "share",
        verdict(interval, 0.5, +1, weight),
    )


def _frequency(findings: Findings) -> Row:
    near = findings.of(findings.subject.single).events[0]
    events = np.array([scene.own["lost"] for scene in near], dtype=float)
    objects = np.array([scene.objects for scene in near], dtype=float)
    interval = bootstrap_interval(events, objects)
    title, paper = (
        "On average a trajectory has a fragment",
        "about one or more on KITTI and nuScenes (figure)",
    )
    measured = f"losses of {findings.subject.single.label} per true object and scene"
    value, found = (
        ratio(events.sum(), objects.sum()),
        verdict(interval, 1.0, +1, objects),
    )
    return _row(title, paper, measured, value, interval, "per trajectory", found)


def _shared(findings: Findings) -> Row:
    count, paper = findings.subject.most.hypotheses, ""
    papers = (
        shared_events(findings.bench.of_paper).get("ids")
        if count == PAPER_HYPOTHESES
        else None
    )
    if papers is not None:
        paper = f"{papers['one']} to {papers['all']}, {1 - papers['all'] / papers['one']:.1%} fewer"
    one, every = (
        findings.of(setting).events[0]
        for setting in (findings.subject.single, findings.subject.most)
    )
    first = np.array([scene.own["ids"] for scene in one], dtype=float)
    left = np.array([scene.shared["ids"] for scene in every], dtype=float)
    measured = (
        f"{first.sum():.0f} ids with one hypothesis, {left.sum():.0f} in all {count}"
    )
    claim = "Most switches are absent from at least one hypothesis"
    return _share(claim, paper, measured, (first - left, first), first)

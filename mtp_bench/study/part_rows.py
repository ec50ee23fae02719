"""Rows of the tables of events, and of parts of the error: causes, time since an event, age, class, confidence."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from types import SimpleNamespace as Row

import numpy as np

from ..running.settings import Setting
from ..scoring.definitions import DISTANCE_BINS, PLANNING_SIGMA
from ..types import Bools, Floats
from ..viz.terminal.paper import PAPER_HYPOTHESES, paper_facts
from .causes import CAUSES
from .circumstances import KINDS
from .error_rows import settings_of_rows, shown_settings, subset_name, values_of
from .findings import Findings

FRAME_BINS = 20


def _count(findings: Findings, setting: Setting, which: str, kind: str) -> int:
    """Events of a kind, "own" or "shared", in the first run of a setting."""
    return sum(len(getattr(scene, which)[kind].frame) for scene in findings.of(setting).around[0])


def frequency_rows(findings: Findings) -> Iterator[Row]:
    """The paper's figure on frequency: events per trajectory and per frame."""
    single = findings.subject.single
    near = findings.of(single).around[0]
    objects, frames, boxes = (sum(getattr(scene, name) for scene in near) for name in ("objects", "frames", "boxes"))
    for kind in KINDS:
        events = _count(findings, single, "own", kind)
        yield Row(
            kind=kind,
            events=events,
            per_trajectory=events / max(1, objects),
            per_frame=events / max(1, frames),
            per_1000_boxes=1000 * events / max(1, boxes),
            trajectories=objects,
            frames=frames,
            boxes=boxes,
        )


def distance_rows(findings: Findings) -> Iterator[Row]:
    """The paper's figure on distance: events by the distance of their object from the ego, m."""
    papers = paper_facts(findings.bench.of_paper, "near")
    near = findings.of(findings.subject.single).around[0]
    for kind in ("ids", "frag") if findings.bench.card.has_ego else ():
        distance = np.concatenate([scene.own[kind].distance for scene in near])
        for low, high in pairwise(DISTANCE_BINS):
            yield Row(
                kind=kind,
                low=low,
                high=None if np.isinf(high) else high,
                events=int(((distance >= low) & (distance < high)).sum()),
                events_up_to=int((distance < high).sum()),
                paper_events_up_to=papers.get(f"{high:g}"),
            )


def shared_rows(findings: Findings) -> Iterator[Row]:
    """The paper's count of events that all hypotheses share."""
    papers = paper_facts(findings.bench.of_paper, "shared")
    for subject in findings.plan.subjects:
        for count, setting in subject.equal.items():
            for kind in KINDS if count > 1 else ():
                one, every = _count(findings, subject.single, "own", kind), _count(findings, setting, "shared", kind)
                paper = papers.get(kind, {}) if count == PAPER_HYPOTHESES else {}
                yield Row(
                    kind=kind,
                    agent=subject.name,
                    H=count,
                    events_single=one,
                    events_in_all=every,
                    fewer=1 - every / one if one else None,
                    paper_events_single=paper.get("one"),
                    paper_events_in_all=paper.get("all"),
                    paper_fewer=1 - paper["all"] / paper["one"] if paper else None,
                )


def frame_rows(findings: Findings) -> Iterator[Row]:
    """The paper's figure on error statistics: events over frames."""
    subject = findings.subject
    one, every = (findings.of(setting).around[0] for setting in (subject.single, subject.most))
    frames = max(scene.frames for scene in one)
    edges = np.unique(np.linspace(0, frames, min(FRAME_BINS, frames) + 1).astype(int))
    for kind in ("ids", "frag") if (subject.most.hypotheses or 1) > 1 else ():
        single = np.histogram(np.concatenate([scene.own[kind].frame for scene in one]), edges)[0]
        shared = np.histogram(np.concatenate([scene.shared[kind].frame for scene in every]), edges)[0]
        for i, (low, high) in enumerate(pairwise(edges.tolist())):
            yield Row(
                kind=kind,
                first_frame=low,
                last_frame=high - 1,
                events_single=int(single[i]),
                events_in_all=int(shared[i]),
            )


def cause_rows(findings: Findings) -> Iterator[Row]:
    """The ranking error as a sum of its causes."""
    rows: list[Row] = []
    for subset in ("all", "ids", "reacquired"):
        for subject, setting in settings_of_rows(findings):
            weight = findings.table(setting).weight[subset]
            if setting.budget != "equal" or not weight.sum():
                continue
            row = findings.row(setting, subset)
            parts = findings.causes(subject, setting, subset) @ weight / weight.sum()
            cause = Row(
                targets_of=subset_name(subset),
                agent=row.agent,
                H=row.hypotheses,
                error=row.error,
                **dict(zip(CAUSES, parts.tolist(), strict=True)),
                **values_of(row, "targets objects"),
            )
            rows += [] if cause in rows else [cause]  # a control stands beside every subject
    yield from rows


def _bin_rows(findings: Findings, setting: Setting, by: str, bins: Mapping[str, Floats | Bools]) -> Iterator[Row]:
    """A row for each of the ``bins`` with targets; bins are weights [n] of the targets by name."""
    table = findings.table(setting)
    for name, weight in bins.items():
        mean = findings.mean(table, table.capped, weight)
        if mean.targets:
            ade = findings.mean_ade(table, weight)
            yield Row(
                by=by,
                bin=name,
                agent=setting.label,
                H=table.setting.hypotheses,
                plain_error=mean.value,
                plain_error_interval=mean.interval,
                minADE=ade.value,
                minADE_interval=ade.interval,
                coverage=float((table.covered * weight).sum() / len(table.setting.seeds) / np.sum(weight)),
                **values_of(mean, "targets objects"),
            )


def since_rows(findings: Findings) -> Iterator[Row]:
    """Errors over the frames since an event."""
    steps = 2 * findings.bench.card.task.past
    for kind in ("ids", "lost", "reacquired"):
        since = findings.since(kind)
        bins = {str(step): since == step for step in range(steps + 1)}
        bins |= {f"over {steps}": since > steps, "never so far": since < 0}
        for setting in shown_settings(findings):
            yield from _bin_rows(findings, setting, kind, bins)


def age_rows(findings: Findings) -> Iterator[Row]:
    """Errors over the age of the track."""
    past = findings.bench.card.task.past
    edges = sorted({0, 1, 2, 3, past, 2 * past, 4 * past, 8 * past})
    age = np.concatenate([scene.age for scene in findings.of(findings.subject.single).around[0]])
    bins = {"no track": age < 0}
    for low, high in pairwise(edges):
        bins[str(low) if high == low + 1 else f"{low} to {high - 1}"] = (age >= low) & (age < high)
    bins[f"{edges[-1]} or more"] = age >= edges[-1]
    for setting in shown_settings(findings):
        yield from _bin_rows(findings, setting, "age of the track, frames", bins)


def bin_rows(findings: Findings) -> Iterator[Row]:
    """Errors by distance, class and motion."""
    for setting in shown_settings(findings):
        table = findings.table(setting)
        bins: dict[str, dict[str, Floats | Bools]] = {"motion": {"moving": table.moving, "static": ~table.moving}}
        bins["class"] = {name: table.class_id == c for c, name in enumerate(findings.bench.card.task.classes)}
        if findings.bench.card.has_ego:
            bins["distance"] = {
                f"{low:g}-{high:g} m" if np.isfinite(high) else f"beyond {low:g} m": (table.distance >= low)
                & (table.distance < high)
                for low, high in pairwise(DISTANCE_BINS)
            }
            bins["planning"] = {"weighted": np.exp(-(table.approach**2) / (2.0 * PLANNING_SIGMA**2))}
        for by, of in bins.items():
            yield from _bin_rows(findings, setting, by, of)


def calibration_rows(findings: Findings) -> Iterator[Row]:
    """Share of forecasts of true objects over the stated confidence."""
    for setting in shown_settings(findings):
        detail = findings.details(setting)
        for part in () if setting.ideal else detail.reliability:
            yield Row(
                agent=detail.agent,
                H=detail.hypotheses,
                confidence=part.confidence,
                of_a_true_object=part.matched,
                forecasts=part.forecasts,
                brier=detail.brier,
            )

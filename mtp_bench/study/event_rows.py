"""Rows of the tables of events: frequency, distance to the ego, events of all hypotheses, events over frames."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from types import SimpleNamespace as Row

import numpy as np

from ..running.settings import Setting
from ..scoring.definitions import DISTANCE_BINS
from ..viz.terminal.paper import PAPER_HYPOTHESES, paper_facts
from .circumstances import KINDS
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
    """The paper's figure on distance: how far from the ego identities err."""
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

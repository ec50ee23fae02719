"""How often identities err, where, when, and how often all hypotheses err together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...running.settings import Setting
from ...scoring.circumstances import KINDS, Circumstances, EventRows
from ...scoring.definitions import DISTANCE_BINS
from ...types import Ints
from ...viz.terminal.paper import PAPER_HYPOTHESES, paper_facts
from ..findings import Findings
from ..table import Count, Metres, Number, Share, Table, Text

FRAME_BINS = 20


def _around(found: Findings, setting: Setting) -> Sequence[Circumstances]:
    return found.of(setting).around[0]


@dataclass(frozen=True)
class FrequencyRow:
    """How often one kind of event happens."""

    kind: Text
    events: Count
    per_trajectory: Number
    per_frame: Number
    per_1000_boxes: Number
    trajectories: Count
    frames: Count
    boxes: Count


def frequency_table(found: Findings) -> Table:
    """The paper's figure on frequency: events per trajectory and per frame."""
    near = _around(found, found.subject.single)
    objects, frames, boxes = (sum(getattr(scene, name) for scene in near) for name in ("objects", "frames", "boxes"))
    rows = []
    for kind in KINDS:
        events = sum(len(scene.own[kind].frame) for scene in near)
        rates = events / max(1, objects), events / max(1, frames), 1000 * events / max(1, boxes)
        rows.append(FrequencyRow(kind, events, *rates, objects, frames, boxes))
    return Table(
        "frequency",
        "How often identities err",
        f"Events of {found.subject.single.label} on all evaluated true objects, targets or not. frag is lost or "
        "reacquired. A trajectory is one true object of one scene.",
        rows,
    )


@dataclass(frozen=True)
class DistanceRow:
    """Events of one kind at one distance to the ego."""

    kind: Text
    low: Metres
    high: Metres
    events: Count
    events_up_to: Count
    paper_events_up_to: Number


def distance_table(found: Findings) -> Table:
    """The paper's figure on distance: how far from the ego identities err."""
    rows = []
    papers = paper_facts(found.bench.of_paper, "near")
    for kind in ("ids", "frag") if found.bench.card.has_ego else ():
        distance = np.concatenate([scene.own[kind].distance for scene in _around(found, found.subject.single)])
        for low, high in pairwise(DISTANCE_BINS):
            count, up_to = int(((distance >= low) & (distance < high)).sum()), int((distance < high).sum())
            limit, theirs = (None, None) if np.isinf(high) else (high, papers.get(f"{high:g}"))
            rows.append(DistanceRow(kind, low, limit, count, up_to, theirs))
    return Table(
        "distance",
        "How far from the ego identities err",
        f"Events of {found.subject.single.label} by the distance of the object to the ego. The paper counts IDS and "
        "FRAG together on the 150 scenes of its nuScenes test split.",
        rows,
    )


@dataclass(frozen=True)
class SharedRow:
    """Events with one hypothesis, and in all hypotheses."""

    kind: Text
    agent: Text
    H: Count
    events_single: Count
    events_in_all: Count
    fewer: Share
    paper_events_single: Number
    paper_events_in_all: Number
    paper_fewer: Share


def shared_table(found: Findings) -> Table:
    """The paper's count of events that all hypotheses share."""
    rows = []
    papers = paper_facts(found.bench.of_paper, "shared")
    for subject in found.plan.subjects:
        for count, setting in subject.equal.items():
            for kind in KINDS if count > 1 else ():
                one = sum(len(scene.own[kind].frame) for scene in _around(found, subject.single))
                every = sum(len(scene.shared[kind].frame) for scene in _around(found, setting))
                fewer = 1 - every / one if one else None
                paper = papers.get(kind) if count == PAPER_HYPOTHESES else None
                theirs = (paper["one"], paper["all"], 1 - paper["all"] / paper["one"]) if paper else (None,) * 3
                rows.append(SharedRow(kind, subject.name, count, one, every, fewer, *theirs))
    return Table(
        "shared",
        "Events that every hypothesis shares",
        "Events with one hypothesis, and those that happen in every one of H hypotheses along its own lineage: what no "
        "hypothesis can undo.",
        rows,
    )


@dataclass(frozen=True)
class FrameRow:
    """Events in a part of the frames."""

    kind: Text
    first_frame: Count
    last_frame: Count
    events_single: Count
    events_in_all: Count


def frame_table(found: Findings) -> Table:
    """The paper's figure on error statistics: events over frames."""
    rows = []
    one, every = (_around(found, setting) for setting in (found.subject.single, found.subject.most))
    frames = max(scene.frames for scene in one)
    edges = np.unique(np.linspace(0, frames, min(FRAME_BINS, frames) + 1).astype(int))
    for kind in ("ids", "frag"):
        counts = [
            np.histogram(_frames([getattr(scene, which)[kind] for scene in near]), edges)[0]
            for near, which in ((one, "own"), (every, "shared"))
        ]
        for low, high, single, shared in zip(edges[:-1], edges[1:], *counts, strict=True):
            rows.append(FrameRow(kind, int(low), int(high) - 1, int(single), int(shared)))
    most = found.subject.most.hypotheses or 1
    return Table(
        "frames",
        "Events over frames",
        f"Events in each part of the scenes, with one hypothesis and in all {most} hypotheses of {found.subject.name}.",
        rows if most > 1 else [],
    )


def _frames(events: Sequence[EventRows]) -> Ints:
    return np.concatenate([np.zeros(0, dtype=np.int64), *(rows.frame for rows in events)])

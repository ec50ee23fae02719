"""What a recording shows: its agents, and dense arrays over all frames of the scene and of what they said."""

from __future__ import annotations

import itertools
import re
from collections.abc import Container, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ...errors import MtpBenchError, UnknownNameError
from ...scoring.events import history
from ...types import Bools, Detections, Floats, Ints, Ragged, Scene, Truth, to_metres
from ..answers import Answers
from ..focus import Focus
from ..frame_view import ego_boxes
from ..palette import FALSE, Color
from ..replay import Incident, Replay
from .colors import DETECTION, EGO, NEUTRAL, TRUTH, Colors, track_colors

LEVELS = ("off", "tracks", "top", "all")  # of detail, each with what the one before it has
TRAIL_POINTS = 12
TRAIL_RATE = 5.0  # Hz, at most: a longer trail of faster recordings has no more points
TOP_SAMPLES = 3
TOP_HYPOTHESES = 4


@dataclass(frozen=True, eq=False)
class Boxes(Ragged):
    """Boxes over all frames."""

    box: NDArray[np.float32]  # [R, 7]
    color: Colors  # [R, 3]
    label: list[str]  # [R], or empty


@dataclass(frozen=True, eq=False)
class Strips(Ragged):
    """Polylines over all frames; a shorter one repeats its last point."""

    point: NDArray[np.float32]  # [S, points, 3]
    color: Colors  # [S, 3]
    label: list[str] = field(default_factory=list)  # [S], or empty


Shape = TypeVar("Shape", Boxes, Strips)


def at_frame(shape: Shape, t: int) -> Shape:
    """The rows of one frame."""
    rows = shape.rows(t)
    parts = {name: values[rows] for name, values in vars(shape).items() if name != "start"}
    return replace(shape, start=np.array([0, rows.stop - rows.start]), **parts)


def truth_boxes(truth: Truth) -> Boxes:
    """True boxes, labelled with their object; those beside the evaluated classes are darker."""
    labels = truth.object_id.astype(str).tolist()
    return Boxes(truth.start, _single(truth.box), _either(truth.neutral, NEUTRAL, TRUTH), labels)


def detection_boxes(detections: Detections, false: Bools) -> Boxes:
    """Detections; the false positives [D] in another colour."""
    return Boxes(detections.start, _single(detections.box), _either(false, FALSE, DETECTION), [])


def platform_boxes(ego: Floats) -> Boxes:
    """The sensor platform at its poses [F, 4]."""
    return Boxes(np.arange(len(ego) + 1), _single(ego_boxes(ego)), _all(EGO, len(ego)), [])


def heaviest_hypotheses(said: Answers, level: str) -> list[int]:
    """The hypotheses of a level: all, else the few that weigh most over the scene."""
    alive = np.flatnonzero(said.hypotheses.member.any(axis=0))
    if level == "all":
        return [int(h) for h in alive]
    weight = np.exp(said.rollout.hypothesis_log_weight.astype(np.float64))[:, alive].sum(axis=0)
    heaviest = alive[np.argsort(-weight, kind="stable")[:TOP_HYPOTHESES]]
    return sorted(int(h) for h in heaviest)


def hypothesis_boxes(said: Answers, hypothesis: int) -> Boxes:
    """Tracks of one hypothesis, labelled with their id."""
    rollout, rows = said.rollout, np.flatnonzero(said.hypotheses.member[:, hypothesis])
    ids = rollout.track_id[rows]
    start = np.searchsorted(rows, rollout.track_start)
    return Boxes(start, _single(rollout.track_box[rows]), track_colors(ids), ids.astype(str).tolist())


def trails(said: Answers, hypothesis: int) -> Strips:
    """Where the tracks of a hypothesis were, now first."""
    rollout, rows = said.rollout, np.flatnonzero(said.hypotheses.member[:, hypothesis])
    rate = said.card.task.rate
    past = said.past(rows, hypothesis, trail_frames(rate))[:, :: _stride(rate)]
    point = _single(rollout.track_box[past, :3])
    return Strips(np.searchsorted(rows, rollout.track_start), point, track_colors(rollout.track_id[rows]))


def trail_frames(rate: float) -> int:
    """How many frames a trail reaches back."""
    return (TRAIL_POINTS - 1) * _stride(rate)


def _stride(rate: float) -> int:
    return max(1, round(rate / TRAIL_RATE))


def forecasts(said: Answers, level: str, chosen: Bools) -> Strips:
    """Forecast samples of the ``chosen`` objects [O], from the object on, in the colour of the object's track.

    All of them, or those few that weigh most.
    """
    rollout = said.rollout
    weight = rollout.forecast_log_weight
    stated = np.isfinite(weight) & chosen[:, None]
    if level != "all":
        rank = np.argsort(np.argsort(-weight, axis=1, kind="stable"), axis=1, kind="stable")
        stated &= rank < TOP_SAMPLES
    row, sample = np.nonzero(stated)
    point = np.repeat(rollout.object_box[row, None, :3].astype(np.float64), rollout.forecast.shape[2] + 1, axis=1)
    point[:, 1:, :2] += to_metres(rollout.forecast[row, sample])
    start = np.searchsorted(row, rollout.object_start)
    sure = [f"confidence {value:.2f}" for value in rollout.object_confidence[row]]
    return Strips(start, _single(point), track_colors(said.object_track_id[row]), sure)


def true_futures(truth: Truth, future: int) -> Strips:
    """Where the evaluated objects go within the horizon of ``future`` frames, while they are there without a gap."""
    before = history(truth.frame_of_rows, truth.object_id).previous()
    after = np.arange(len(before))  # a row without a successor follows itself
    after[before[before >= 0]] = np.flatnonzero(before >= 0)
    start = row = np.flatnonzero(~truth.neutral)
    point = np.empty((len(row), future + 1, 3), dtype=np.float32)
    for k in range(future + 1):
        point[:, k] = truth.box[row, :3]
        row = after[row]
    return Strips(np.searchsorted(start, truth.start), point, _all(TRUTH, len(start)))


def map_lines(scene: Scene, border: bool) -> list[NDArray[np.float32]]:
    """Polylines [n, 3] of the road: lane borders but in junctions, or middles of lanes; on the ground of detections."""
    boxes = scene.detections.box  # not the true ones, which an evaluation does not show
    ground = float(np.median(boxes[:, 2] - boxes[:, 6] / 2)) if len(boxes) else 0.0
    lines = [lane.center for lane in scene.lanes]
    if border:
        lines = [line for lane in scene.lanes if not lane.junction for line in (lane.left, lane.right)]
    return [_single(np.column_stack([line, np.full(len(line), ground)])) for line in lines]


def _single(values: Floats) -> NDArray[np.float32]:
    return np.ascontiguousarray(values, dtype=np.float32)


def _either(mask: Bools, yes: Color, no: Color) -> Colors:
    return np.where(mask[:, None], yes, no).astype(np.uint8)


def _all(color: Color, count: int) -> Colors:
    return np.full((count, 3), color, dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class ShownAgent:
    """One agent in a recording."""

    replay: Replay
    name: str  # part of the paths of its entities; empty for the only agent
    number: int  # of the agents shown
    hypotheses: list[int]

    @property
    def root(self) -> str:
        """Prefix of the paths of its entities."""
        return f"agents/{self.name}/" if self.name else ""

    @property
    def focus_root(self) -> str:
        """Prefix of the paths of an event alone, of which the first agent's needs none."""
        return self.root if self.number else ""

    @property
    def best(self) -> int | None:
        """The shown hypothesis that is best in most frames; None where none is shown."""
        count = np.bincount(self.replay.said.hypotheses.best, minlength=max(self.hypotheses, default=0) + 1)
        return max(self.hypotheses, key=lambda h: count[h], default=None)

    def titled(self, text: str) -> str:
        """``text`` for a view of this agent, with its name where there are several."""
        return f"{self.name}: {text}" if self.name else text


@dataclass(frozen=True, eq=False)
class Contents:
    """The runs of a recording."""

    agents: list[ShownAgent]
    level: str  # of LEVELS
    at: Incident | None  # of the first run: what the views look at

    @cached_property
    def focuses(self) -> list[tuple[ShownAgent, Focus]]:
        """The event alone, as each run has it; nothing without an event."""
        if self.at is None:
            return []
        return list(zip(self.agents, Focus.of_all([agent.replay for agent in self.agents], self.at), strict=True))


def box_counts(replay: Replay) -> dict[str, Ints]:
    """The `Replay.counts` that can be known: no FP where the truth is not complete."""
    return {name: count for name, count in replay.counts.items() if name != "FP" or replay.scene.truth_complete}


def contents_of(replays: Sequence[Replay], level: str, at: Incident | None = None) -> Contents:
    """What is drawn of these runs; they must be of one scene, and get different names."""
    if level not in LEVELS:
        raise UnknownNameError("level", level, LEVELS)
    scenes = {replay.scene.name for replay in replays}
    if len(scenes) != 1:
        raise MtpBenchError(f"a recording shows one scene, got {', '.join(sorted(scenes)) or 'none'}")
    agents: list[ShownAgent] = []
    for replay in replays:
        name = _name(replay.agent, {agent.name for agent in agents}) if len(replays) > 1 else ""
        hypotheses = [] if level == "off" else heaviest_hypotheses(replay.said, level)
        agents.append(ShownAgent(replay, name, len(agents), hypotheses))
    return Contents(agents, level, at)


def _name(agent: str, taken: Container[str]) -> str:
    """Part of an entity path; a second run of an agent gets a number."""
    base = re.sub(r"[^\w.-]", "_", agent) or "agent"
    names = itertools.chain([base], (f"{base}-{number}" for number in itertools.count(2)))
    return next(name for name in names if name not in taken)

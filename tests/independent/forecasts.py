"""One run: what an agent forecast in all scenes under one seed, and the verdict on each frame of it."""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from mtp_bench.cards import Card
from mtp_bench.core import Bools, Rollout, Scene

from .displacement import Numbers, numbers, stated
from .matching import Keys, best_pairs
from .targets import Target, live_frames, neutral_rows, unconfirmed


@dataclass(frozen=True)
class Verdict:
    """Outcome of the kept forecasts of a frame, by their rows."""

    matched: dict[int, int]  # row -> row of the evaluated truth
    neutral: frozenset[int]
    false: frozenset[int]


@dataclass(eq=False)
class Run:
    """The scenes with their targets, and the rollouts of one seed."""

    card: Card
    scenes: Sequence[Scene]
    targets: list[Target]
    rollouts: Sequence[Rollout]
    index: dict[tuple[int, int], int] = field(init=False)  # scene, row of the truth -> target
    live: list[list[int]] = field(init=False)
    neutral: list[Bools] = field(init=False)
    pair: dict[tuple[int, int, int], Numbers] = field(init=False, default_factory=dict)
    hidden: dict[tuple[int, int], bool] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self.index = {(target.scene, target.row): i for i, target in enumerate(self.targets)}
        self.live = [live_frames(scene, self.card) for scene in self.scenes]
        self.neutral = [neutral_rows(scene) for scene in self.scenes]

    @property
    def complete(self) -> bool:
        """True if every object is known, so that a forecast can be false."""
        return all(scene.truth_complete for scene in self.scenes)

    @property
    def miss_errors(self) -> tuple[float, ...]:
        return self.card.per_class(self.card.task.miss_error)

    @property
    def gates(self) -> tuple[float, ...]:
        return self.card.per_class(self.card.task.forecast_gate)

    def frames(self) -> list[tuple[int, int]]:
        """Scene and number of every live frame."""
        return [(s, t) for s, live in enumerate(self.live) for t in live]

    def rows(self, s: int, t: int, least: float = -math.inf) -> list[int]:
        """Forecasts of a frame with at least this confidence."""
        said = self.rollouts[s]
        return [r for r in range(said.object_start[t], said.object_start[t + 1]) if said.object_confidence[r] >= least]

    def against(self, s: int, row: int, truth_row: int) -> Numbers:
        """Numbers of a forecast against a target."""
        key = (s, row, truth_row)
        if key not in self.pair:
            future = self.targets[self.index[s, truth_row]].future
            self.pair[key] = numbers(*stated(self.rollouts[s], row), future)
        return self.pair[key]

    def is_hidden(self, s: int, t: int, row: int) -> bool:
        """True if the image could not confirm the forecast."""
        image, said = self.scenes[s].image, self.rollouts[s]
        if image is None:
            return False
        if (s, row) not in self.hidden:
            self.hidden[s, row] = unconfirmed(image, t, said.object_box[row, :2], int(said.object_class[row]))
        return self.hidden[s, row]


@functools.cache
def judge_frame(run: Run, s: int, t: int, least: float = -math.inf) -> Verdict:
    """Match the forecasts of at least this confidence to the evaluated objects, then what is left to the neutral ones.

    Reading: a forecast that the image cannot confirm may still be matched to an evaluated object; unmatched, it is
    neutral without using up the excuse of a neutral object.
    """
    rows = run.rows(s, t, least)
    truth = range(run.scenes[s].truth.start[t], run.scenes[s].truth.start[t + 1])
    matched = _match(run, s, rows, [g for g in truth if not run.neutral[s][g]])
    left = [r for r in rows if r not in matched]
    hidden = {r for r in left if run.is_hidden(s, t, r)}
    open_rows = [r for r in left if r not in hidden]
    excused = _match(run, s, open_rows, [g for g in truth if run.neutral[s][g]])
    return Verdict(matched, frozenset(hidden | set(excused)), frozenset(set(open_rows) - set(excused)))


def _match(run: Run, s: int, rows: Sequence[int], truth_rows: Sequence[int]) -> dict[int, int]:
    """Reading: a pair whose object is not a target has minADE 0 in the rule of ties."""
    said, truth, gates = run.rollouts[s], run.scenes[s].truth, run.gates
    pairs: dict[tuple[int, int], Keys] = {}
    for r in rows:
        for g in truth_rows:
            kind = int(truth.class_id[g])
            far = math.dist(said.object_box[r, :2], truth.box[g, :2])
            if kind == said.object_class[r] and far <= gates[kind]:
                min_ade = run.against(s, r, g).min_ade if (s, g) in run.index else 0.0
                pairs[r, g] = (far, float(said.object_confidence[r]), min_ade)
    return best_pairs(pairs)

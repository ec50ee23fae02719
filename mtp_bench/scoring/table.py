"""All scenes and seeds of one agent in one table, a row per target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import RolloutError
from ..types import Bools, Ints
from .definitions import FORECAST_AP_GATES
from .rows import Budget
from .score import SceneScore
from .subsets import SUBSETS, ReferenceSubsets, masks

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class AgentScores:
    """Scores of one agent in one setting: one run per seed, each with the same scenes."""

    agent: str
    hypotheses: int
    samples: int  # k, per object
    budget: Budget  # "free": another number of samples than the task's k, never ranked
    seeds: tuple[tuple[SceneScore, ...], ...]
    ideal: bool = False  # saw the truth: shown, never ranked


@dataclass(frozen=True, eq=False)
class AgentTable:
    """Targets [n] of all scenes; errors are summed over the seeds that cover a target, ``covered`` counts those."""

    setting: AgentScores
    scene: Ints  # [n] index of the scene
    object_id: Ints  # [n]
    class_id: Ints  # [n]
    distance: Array  # [n] m
    approach: Array  # [n] m
    moving: Bools  # [n]
    covered: Array  # [n] seeds
    min_ade: Array  # [n] m, summed
    min_fde: Array  # [n] m, summed
    energy_score: Array  # [n] m, summed
    curve: Array  # [n, len(ks)] m, summed
    hit: Array  # [n] seeds with a final point within 2 m
    near: Array  # [n] seeds with a final point within 4 m
    miss_error: Array  # [n] m, c
    capped: Array  # [n] m, mean over seeds of min(minADE, c), c where not covered
    missed: Array  # [n] m, the part of it from seeds that do not cover the target
    false_error: Array  # [S] m of the false forecasts of each scene, mean over seeds
    mask: dict[str, Bools]  # [n] per subset
    events: dict[str, int | None]  # events of the reference in these scenes, on targets or not, per subset

    @property
    def scores(self) -> list[SceneScore]:
        """Scores of all seeds and scenes."""
        return [score for run in self.setting.seeds for score in run]

    @property
    def scenes(self) -> int:
        """Number of scenes S."""
        return len(self.false_error)

    @property
    def complete(self) -> bool:
        """Whether the truth of every scene is complete, so that a false forecast is known to be one."""
        return all(score.truth_complete for score in self.scores)

    @property
    def forecasts(self) -> float:
        """Forecast objects per frame, over all seeds and scenes."""
        return sum(score.forecasts for score in self.scores) / max(sum(score.frames for score in self.scores), 1)

    def per_scene(self, value: Array, mask: Bools) -> Array:
        """Sums [S] of ``value`` [n] over the targets of ``mask``."""
        return np.bincount(self.scene[mask], weights=value[mask], minlength=self.scenes).astype(np.float64)

    def targets(self, mask: Bools) -> Array:
        """Number of targets of ``mask`` in each scene [S]."""
        return self.per_scene(np.ones(len(mask)), mask)

    def objects(self, mask: Bools) -> int:
        """Number of distinct objects among the targets of ``mask``."""
        return len(np.unique(np.stack([self.scene[mask], self.object_id[mask]]), axis=1).T)


def stated_hypotheses(seeds: Sequence[Sequence[SceneScore]]) -> int:
    """The most hypotheses that an agent stated in a frame of any scene."""
    return max((score.hypotheses for run in seeds for score in run), default=0)


def agent_table(setting: AgentScores, reference: ReferenceSubsets | None) -> AgentTable:
    """Table of one agent; without ``reference`` only the subset "all" has targets.

    Raises RolloutError without a scene, or where seeds differ in scenes or targets.
    """
    if not setting.seeds or not setting.seeds[0]:
        raise RolloutError(f"agent {setting.agent!r} has no scored scene, expected at least one")
    for run in setting.seeds[1:]:
        require_same_targets(setting.seeds[0], run, f"the seeds of agent {setting.agent!r}")
    first = setting.seeds[0]
    covered = _over_seeds(setting, "covered")
    uncovered = 1.0 - covered / len(setting.seeds)
    return AgentTable(
        setting=setting,
        scene=np.repeat(np.arange(len(first)), [len(score) for score in first]),
        object_id=_join(first, "object_id"),
        class_id=_join(first, "class_id"),
        distance=_join(first, "distance"),
        approach=_join(first, "approach"),
        moving=_join(first, "moving"),
        covered=covered,
        min_ade=_over_seeds(setting, "min_ade"),
        min_fde=_over_seeds(setting, "min_fde"),
        energy_score=_over_seeds(setting, "energy_score"),
        curve=_over_seeds(setting, "curve"),
        hit=_seeds_with([~_join(run, "miss") for run in setting.seeds]),
        near=_seeds_with([_join(run, "min_fde") <= FORECAST_AP_GATES[1] for run in setting.seeds]),
        capped=np.mean([_join(run, "capped") for run in setting.seeds], axis=0),
        miss_error=_join(first, "miss_error"),
        missed=uncovered * _join(first, "miss_error"),
        false_error=np.mean([[score.false_error for score in run] for run in setting.seeds], axis=0),
        mask=_masks(first, reference),
        events=_events(first, reference),
    )


def require_same_targets(a: Sequence[SceneScore], b: Sequence[SceneScore], who: str) -> None:
    """Raise RolloutError unless both have the same scenes and targets in the same order."""
    if [score.scene for score in a] != [score.scene for score in b]:
        raise RolloutError(f"{who} were scored on different scenes, expected the same scenes in the same order")
    for x, y in zip(a, b, strict=True):
        if not np.array_equal(x.key, y.key):
            raise RolloutError(f"{who} have different targets in scene {x.scene!r}; were they scored with one card?")


def _join(run: Sequence[SceneScore], name: str) -> NDArray[Any]:
    """Array ``name`` of all scenes."""
    return np.concatenate([getattr(score, name) for score in run])


def _seeds_with(holds: Sequence[Bools]) -> Array:
    """In how many seeds something holds [n]."""
    return np.asarray(np.sum(holds, axis=0), dtype=np.float64)


def _over_seeds(setting: AgentScores, name: str) -> Array:
    """Sum over the seeds that cover a target."""
    total: Any = 0.0
    for run in setting.seeds:
        value = _join(run, name)
        here = _join(run, "covered")
        total = total + np.where(here.reshape(-1, *[1] * (value.ndim - 1)), value, 0.0)
    return np.asarray(total, dtype=np.float64)


def _masks(run: Sequence[SceneScore], reference: ReferenceSubsets | None) -> dict[str, Bools]:
    if reference is None:
        count = sum(len(score) for score in run)
        return {name: np.full(count, name == "all") for name in SUBSETS}
    parts = [masks(reference, score) for score in run]
    return {name: np.concatenate([part[name] for part in parts]) for name in SUBSETS}


def _events(run: Sequence[SceneScore], reference: ReferenceSubsets | None) -> dict[str, int | None]:
    if reference is None:
        return dict.fromkeys(SUBSETS)
    truth = _join(run, "truth_key")
    counts: dict[str, int | None] = {name: int(np.isin(truth, reference.keys(name)).sum()) for name in SUBSETS[1:]}
    return {"all": None, **counts}

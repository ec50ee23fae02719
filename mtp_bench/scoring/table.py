"""All scenes and seeds of one agent in one table, a row per target."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import Bools, Floats, Ints, RolloutError, cache_root
from .bade import ONE_PER_TARGET, BudgetErrors, Budgets, CardBudget, errors_at
from .definitions import KNOWN_SUBSETS, SUBSETS, Subset
from .rows import AgentSetting, Budget
from .score import SceneScore
from .statistics import UnitSums, effective_number
from .weights import Reference

_OF_TARGETS = (
    "class_id",
    "distance",
    "approach",
    "moving",
    "miss_error",
    "absent_cause",
)  # the same for all seeds
_SUMMED = ("covered", "min_ade", "min_fde", "energy_score", "curve")


@dataclass(frozen=True, eq=False)
class AgentScores:
    """Scores of one agent in one setting: one run per seed, each with the same scenes."""

    agent: str
    hypotheses: int
    samples: int  # k, per object
    budget: Budget  # "free": another number of samples than the task's k, never ranked
    seeds: tuple[tuple[SceneScore, ...], ...]
    observe: str = (
        "detections"  # mode of the env; those with others are shown, never ranked
    )

    @property
    def key(self) -> dict[str, Any]:
        """Fields of an `AgentSetting`."""
        return {name: getattr(self, name) for name in AgentSetting.model_fields}


@dataclass(frozen=True, eq=False)
class Bade:
    """bADE per target [n], mean over seeds; m."""

    error: Floats
    missed: Floats  # the part from targets without a forecast
    below_threshold: (
        Floats  # of that, the part of targets with a forecast that is not sure enough
    )
    by_score: (
        Floats  # the error with the score of the nearest detection as the confidence
    )


@dataclass(frozen=True, eq=False)
class AgentTable:
    """Targets [n] of all scenes; errors are summed over the seeds that cover a target, ``covered`` counts those."""

    setting: AgentScores
    budgets: Budgets
    scene: Ints  # [n] index of the scene
    unit: Ints  # [n] index of the unit
    units: int  # U
    person: (
        Ints  # [n] index of the object, the same in all scenes cut from one recording
    )
    class_id: Ints  # [n]
    distance: Floats  # [n] m
    approach: Floats  # [n] m
    moving: Bools  # [n]
    covered: Floats  # [n] seeds
    min_ade: Floats  # [n] m, summed
    min_fde: Floats  # [n] m, summed
    energy_score: Floats  # [n] m, summed
    curve: Floats  # [n, len(ks)] m, summed
    hit: Floats  # [n] seeds with a final point within 2 m
    miss_error: Floats  # [n] m, c
    absent_cause: Ints  # [n] values of `AbsentCause`
    capped: Floats  # [n] m, mean over seeds of min(minADE, c), c where not covered; every forecast is kept
    of_all: Bade  # at the budgets of "all"
    of_subsets: Bade  # at the budget of the subsets
    weight: dict[str, Floats]  # [n] per subset
    events: dict[
        str, float | None
    ]  # per subset: expected number in a run of the reference

    def bade(self, subset: str) -> Bade:
        """BADE on a subset; turning targets have the budgets of all."""
        return self.of_all if subset in ("all", "turning") else self.of_subsets

    @property
    def subsets(self) -> tuple[Subset, ...]:
        """Subsets of a report: without "turning" where no target turns."""
        return KNOWN_SUBSETS if self.weight["turning"].any() else SUBSETS

    @property
    def scores(self) -> list[SceneScore]:
        """Scores of all seeds and scenes."""
        return [score for run in self.setting.seeds for score in run]

    @property
    def complete(self) -> bool:
        """True if the truth of every scene is complete, so that false forecasts are known."""
        return all(score.truth_complete for score in self.scores)

    @cached_property
    def live(self) -> int:
        """Live frames, over all seeds and scenes."""
        return sum(score.live for score in self.scores)

    def per_unit(self, value: Floats, weight: Floats) -> Floats:
        """Sums [U] of ``value`` [n] times ``weight`` [n]."""
        return np.bincount(
            self.unit, weights=value * weight, minlength=self.units
        ).astype(np.float64)

    def unit_weight(self, weight: Floats) -> Floats:
        """Weight of the targets of each unit [U]."""
        return self.per_unit(np.ones(len(weight)), weight)

    def sums_on(self, subset: Subset) -> UnitSums:
        """Return the sums over the units of the targets of a subset."""
        weight = self.weight[subset]
        return UnitSums(
            samples=self.setting.samples,
            weight=self.unit_weight(weight),
            error=self.per_unit(self.bade(subset).error, weight),
            effective_objects=effective_number(
                np.bincount(self.person, weights=weight)
            ),
        )


def stated_hypotheses(seeds: Sequence[Sequence[SceneScore]]) -> int:
    """Largest number of hypotheses that an agent stated in a frame."""
    return max((score.hypotheses for run in seeds for score in run), default=0)


def agent_table(
    setting: AgentScores,
    reference: Reference | None,
    constants: CardBudget = ONE_PER_TARGET,
) -> AgentTable:
    """Table of one agent; without ``reference`` only "all" and "turning" have weight, and ``constants`` set budgets.

    Raises RolloutError without a scene, for scenes with another number of samples, and for seeds that differ in scenes
    or targets; DataError for a scene without event weights.
    """
    if not setting.seeds or not setting.seeds[0]:
        raise RolloutError(
            f"agent {setting.agent!r} has no scored scene, expected at least one"
        )
    other = next(
        (
            score
            for run in setting.seeds
            for score in run
            if score.samples != setting.samples
        ),
        None,
    )
    if other is not None:
        raise RolloutError(
            f"scene {other.scene!r} of agent {setting.agent!r} has {other.samples} samples per object, expected "
            f"{setting.samples} as in the others"
        )
    for run in setting.seeds[1:]:
        require_same_targets(
            setting.seeds[0], run, f"the seeds of agent {setting.agent!r}"
        )
    first = setting.seeds[0]
    scene = np.repeat(np.arange(len(first)), [len(score) for score in first])
    recording = np.unique([score.recording for score in first], return_inverse=True)[1]
    objects = np.stack(
        [recording[scene], _join(first, "object_id")], axis=1
    )  # [n, 2] distinct over recordings
    units_before = np.concatenate([[0], np.cumsum([score.units for score in first])])
    complete = all(score.truth_complete for score in first)
    budgets = (constants if reference is None else reference.budget).budgets(
        len(scene), complete
    )
    of_all, of_subsets = _bades(setting.seeds, budgets)
    columns: dict[str, Any] = {
        **{name: _join(first, name) for name in _OF_TARGETS},
        **{name: over_seeds(setting, name) for name in _SUMMED},
    }
    return AgentTable(
        setting=setting,
        budgets=budgets,
        scene=scene,
        unit=_join(first, "unit") + units_before[scene],
        units=int(units_before[-1]),
        person=np.unique(objects, axis=0, return_inverse=True)[1].reshape(-1),
        **columns,
        hit=np.asarray(
            np.sum([~_join(run, "miss") for run in setting.seeds], axis=0),
            dtype=np.float64,
        ),
        capped=np.mean([_join(run, "capped") for run in setting.seeds], axis=0),
        of_all=of_all,
        of_subsets=of_subsets,
        weight=_weights(first, reference),
        events=_events(first, reference),
    )


def run_errors(
    run: Sequence[SceneScore],
    budgets: Sequence[float] | Floats,
    known: bool,
    which: str,
) -> BudgetErrors:
    """Errors of one run at each of the ``budgets``.

    ``known``: budgets are of false forecasts; ``which``: the field of a score with the cuts.
    """
    live = None if known else sum(score.live for score in run)
    return errors_at([getattr(score, which) for score in run], budgets, live)


def _bades(
    seeds: Sequence[Sequence[SceneScore]], budgets: Budgets
) -> tuple[Bade, Bade]:
    """BADE at the budgets of "all", and at that of the subsets."""
    allowed = [*budgets.all, budgets.subsets]
    own = [run_errors(run, allowed, budgets.false_known, "cuts") for run in seeds]
    score = [
        run_errors(run, allowed, budgets.false_known, "score_cuts") for run in seeds
    ]
    unsure = [
        run.missed * _join(scores, "covered")
        for run, scores in zip(own, seeds, strict=True)
    ]
    runs = (
        [run.error for run in own],
        [run.missed for run in own],
        unsure,
        [run.error for run in score],
    )
    parts = [np.mean(of_seeds, axis=0) for of_seeds in runs]
    return Bade(*(part[:-1].mean(axis=0) for part in parts)), Bade(
        *(part[-1] for part in parts)
    )


def require_same_targets(
    a: Sequence[SceneScore], b: Sequence[SceneScore], who: str
) -> None:
    """Raise RolloutError unless both have the same scenes and targets in the same order."""
    if [score.scene for score in a] != [score.scene for score in b]:
        raise RolloutError(
            f"{who} were scored on different scenes, expected the same scenes in the same order"
        )
    for x, y in zip(a, b, strict=True):
        if not (
            np.array_equal(x.frame, y.frame)
            and np.array_equal(x.object_id, y.object_id)
        ):
            raise RolloutError(
                f"{who} have different targets in scene {x.scene!r}; were they scored with one card?"
            )


def _join(run: Sequence[SceneScore], name: str) -> NDArray[Any]:
    return np.concatenate([getattr(score, name) for score in run])


def over_seeds(setting: AgentScores, name: str) -> Floats:
    """Array ``name`` [n, ...] of all scenes, summed over the seeds that cover a target."""
    total: Any = 0.0
    for run in setting.seeds:
        value = _join(run, name)
        here = _join(run, "covered")
        total = total + np.where(here.reshape(-1, *[1] * (value.ndim - 1)), value, 0.0)
    return np.asarray(total, dtype=np.float64)


def _weights(
    run: Sequence[SceneScore], reference: Reference | None
) -> dict[str, Floats]:
    """Weight [n] of the targets on each subset; raises RolloutError for a scene with another number of targets."""
    count = sum(len(score) for score in run)
    weights: dict[str, Floats] = {
        name: np.full(count, float(name == "all")) for name in SUBSETS
    }
    weights["turning"] = _join(run, "turning").astype(np.float64)
    if reference is None:
        return weights
    for score in run:
        if (targets := reference.of(score.scene).targets) != len(score):
            raise RolloutError(
                f"the event weights of scene {score.scene!r} are of {targets} targets, the scene has {len(score)}: "
                f"delete {cache_root()}, whose scenes are made again; if that does not help, the weights were made of "
                "other data"
            )
    for name in SUBSETS[1:]:
        weights[name] = np.concatenate(
            [reference.weight(score.scene, name) for score in run]
        )
    return weights


def _events(
    run: Sequence[SceneScore], reference: Reference | None
) -> dict[str, float | None]:
    """Expected events of a reference run on targets; for the paper's subsets those of plain STP, on all boxes."""
    if reference is None:
        return dict.fromkeys(KNOWN_SUBSETS)
    counts: dict[str, float | None] = {
        name: float(sum(reference.weight(score.scene, name).sum() for score in run))
        for name in SUBSETS[1:5]
    }
    ids, lost, back = np.sum(
        [reference.of(score.scene).stp_events for score in run], axis=0
    ).tolist()
    return {
        "all": None,
        "turning": None,
        **counts,
        "paper_ids": float(ids),
        "paper_frag": float(lost + back),
    }

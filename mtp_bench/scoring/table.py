"""All scenes and seeds of one agent: a table per target, and numbers per scene."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import Bools, Floats, Ints, RolloutError, cache_root
from .bade import ONE_PER_TARGET, BudgetErrors, Budgets, CardBudget, errors_at
from .definitions import KNOWN_SUBSETS, SUBSETS, Subset
from .rows import AgentSetting, Budget
from .score import SceneScore
from .statistics import UnitSums, effective_number, ratio
from .weights import COUNTED_EVENTS, WEIGHTED_SUBSETS, Reference


@dataclass(frozen=True, eq=False)
class AgentScores:
    """Scores of one agent in one setting: a run per seed, each with the same scenes."""

    agent: str
    hypotheses: int
    samples: int  # k, per object
    budget: Budget  # "free": another number of samples than the task's k, never ranked
    seeds: tuple[tuple[SceneScore, ...], ...] = field(repr=False)
    # mode of the env; those with others are shown, never ranked
    observe: str = "detections"

    @property
    def key(self) -> dict[str, Any]:
        """Fields of an `AgentSetting`."""
        return {name: getattr(self, name) for name in AgentSetting.model_fields}


@dataclass(frozen=True, eq=False)
class Bade:
    """bADE per target [n] in metres, mean over seeds."""

    error: Floats
    missed: Floats  # the part from targets without a forecast
    # the part of `missed` from targets whose forecast has too little confidence
    below_threshold: Floats
    # the error with the score of the nearest detection as the confidence
    by_score: Floats


class ReferenceErrors(NamedTuple):
    """Plain errors [n] m of references with an agent's predictor and samples.

    They are means over the seeds that cover a target, NaN without such a seed.
    """

    associated: Floats  # perfect association
    centred: Floats  # the same with the present place moved to the truth
    ground_truth: Floats  # ground-truth tracks


@dataclass(frozen=True, eq=False, repr=False)
class AgentTable:
    """Targets [n] of all scenes.

    Errors are summed over the seeds that cover a target, ``covered`` counts those.
    """

    setting: AgentScores
    budgets: Budgets
    scene: Ints  # [n] index of the scene
    unit: Ints  # [n] index of the unit
    units: int  # U
    # [n] index of the object, the same in all scenes cut from one recording
    person: Ints
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
    # [n] m, mean over seeds of min(minADE, c), c where not covered; every forecast is
    # kept
    capped: Floats
    of_all: Bade  # at the budgets of "all"
    of_subsets: Bade  # at the budget of the subsets
    weight: dict[str, Floats]  # [n] per subset
    # per subset: expected number in a run of the reference
    events: dict[str, float | None]
    split: ReferenceErrors | None = None  # of references that split errors into parts

    def __repr__(self) -> str:
        return f"AgentTable of {self.setting.agent}: {len(self.scene)} targets"

    def bade(self, subset: str) -> Bade:
        """Return bADE on a subset.

        Turning targets have the budgets of all.
        """
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
        """True if the truth of every scene is complete: false forecasts are known."""
        return all(score.truth_complete for score in self.scores)

    @property
    def has_tracks(self) -> bool:
        """False if no rollout states a track: events and CLEAR are undefined then."""
        return any(score.has_tracks for score in self.scores)

    @cached_property
    def live(self) -> int:
        """Live frames, over all seeds and scenes."""
        return sum(score.live for score in self.scores)

    def per_unit(self, value: Floats, weight: Floats) -> Floats:
        """Return sums [U] of ``value`` [n] times ``weight`` [n]."""
        sums = np.bincount(self.unit, weights=value * weight, minlength=self.units)
        return sums.astype(np.float64)

    def unit_weight(self, weight: Floats) -> Floats:
        """Return the weight of the targets of each unit [U]."""
        return self.per_unit(np.ones(len(weight)), weight)

    def sums_on(self, subset: Subset) -> UnitSums:
        """Return the sums over the units of the targets of a subset."""
        weight = self.weight[subset]
        object_weight = np.bincount(self.person, weights=weight)
        return UnitSums(
            samples=self.setting.samples,
            weight=self.unit_weight(weight),
            error=self.per_unit(self.bade(subset).error, weight),
            effective_objects=effective_number(object_weight),
        )


def stated_hypotheses(seeds: Sequence[Sequence[SceneScore]]) -> int:
    """Return the largest number of hypotheses that an agent stated in a frame."""
    return max((score.hypotheses for run in seeds for score in run), default=0)


def agent_table(
    setting: AgentScores,
    reference: Reference | None,
    constants: CardBudget = ONE_PER_TARGET,
) -> AgentTable:
    """Return the table of one agent.

    Without ``reference`` only "all" and "turning" have weight, and ``constants`` set
    budgets. Raises RolloutError without a scene, for scenes with another number of
    samples, and for seeds that differ in scenes or targets; DataError for a scene
    without event weights.
    """
    _check_seeds(setting)
    seeds = setting.seeds
    first_run = seeds[0]
    scene = np.repeat(np.arange(len(first_run)), [len(score) for score in first_run])
    recordings = [score.recording for score in first_run]
    recording = np.unique(recordings, return_inverse=True)[1]
    # [n, 2] distinct over recordings
    objects = np.stack([recording[scene], join_scenes(first_run, "object_id")], axis=1)
    unit_ends = np.cumsum([score.units for score in first_run])
    first_unit = np.concatenate([[0], unit_ends])
    if reference is not None:
        constants = reference.budget
    budgets = constants.budgets(
        targets=len(scene),
        false_known=all(score.truth_complete for score in first_run),
    )
    of_all, of_subsets = _bades(seeds, budgets)
    hits = [~join_scenes(run, "miss") for run in seeds]
    return AgentTable(
        setting=setting,
        budgets=budgets,
        scene=scene,
        unit=join_scenes(first_run, "unit") + first_unit[scene],
        units=int(unit_ends[-1]),
        person=np.unique(objects, axis=0, return_inverse=True)[1].reshape(-1),
        class_id=join_scenes(first_run, "class_id"),
        distance=join_scenes(first_run, "distance"),
        approach=join_scenes(first_run, "approach"),
        moving=join_scenes(first_run, "moving"),
        covered=over_seeds(setting, "covered"),
        min_ade=over_seeds(setting, "min_ade"),
        min_fde=over_seeds(setting, "min_fde"),
        energy_score=over_seeds(setting, "energy_score"),
        curve=over_seeds(setting, "curve"),
        hit=np.asarray(np.sum(hits, axis=0), dtype=np.float64),
        miss_error=join_scenes(first_run, "miss_error"),
        absent_cause=join_scenes(first_run, "absent_cause"),
        capped=np.mean([join_scenes(run, "capped") for run in seeds], axis=0),
        of_all=of_all,
        of_subsets=of_subsets,
        weight=_weights(first_run, reference),
        events=_events(first_run, reference),
    )


def _check_seeds(setting: AgentScores) -> None:
    """Raise RolloutError as `agent_table`."""
    who = f"agent {setting.agent!r}"
    if not setting.seeds or not setting.seeds[0]:
        raise RolloutError(f"{who} has no scored scene, expected at least one")
    for run in setting.seeds:
        for score in run:
            if score.samples != setting.samples:
                raise RolloutError(
                    f"scene {score.scene!r} of {who} has {score.samples} samples per "
                    f"object, expected {setting.samples} as in the others"
                )
    for run in setting.seeds[1:]:
        require_same_targets(setting.seeds[0], run, f"the seeds of {who}")


def run_errors(
    run: Sequence[SceneScore],
    budgets: Sequence[float] | Floats,
    false_known: bool,
    cuts_name: str = "cuts",
) -> BudgetErrors:
    """Return the errors of one run at each of the ``budgets``.

    ``false_known``: budgets are of false forecasts; ``cuts_name``: the field of a score
    with the cuts.
    """
    live_frames = None if false_known else sum(score.live for score in run)
    return errors_at([getattr(score, cuts_name) for score in run], budgets, live_frames)


def _bades(
    seeds: Sequence[Sequence[SceneScore]], budgets: Budgets
) -> tuple[Bade, Bade]:
    """Return bADE at the budgets of "all", and at that of the subsets."""
    allowed = [*budgets.all, budgets.subsets]
    per_seed = []
    for run in seeds:
        errors = run_errors(run, allowed, budgets.false_known)
        below_threshold = errors.missed * join_scenes(run, "covered")
        by_score = run_errors(
            run, allowed, budgets.false_known, cuts_name="score_cuts"
        ).error
        per_seed.append((errors.error, errors.missed, below_threshold, by_score))
    parts = [np.mean(of_seeds, axis=0) for of_seeds in zip(*per_seed, strict=True)]
    # the last budget is that of the subsets
    of_all = Bade(*[part[:-1].mean(axis=0) for part in parts])
    return of_all, Bade(*[part[-1] for part in parts])


def require_same_targets(
    run: Sequence[SceneScore], other_run: Sequence[SceneScore], who: str
) -> None:
    """Raise RolloutError unless both runs have the same scenes and targets in order."""
    if [score.scene for score in run] != [score.scene for score in other_run]:
        raise RolloutError(
            f"{who} were scored on different scenes, expected the same scenes in the "
            "same order"
        )
    for score, other_score in zip(run, other_run, strict=True):
        same_frames = np.array_equal(score.frame, other_score.frame)
        if not same_frames or not np.array_equal(
            score.object_id, other_score.object_id
        ):
            raise RolloutError(
                f"{who} have different targets in scene {score.scene!r}; "
                "were they scored with one card?"
            )


def join_scenes(run: Sequence[SceneScore], name: str) -> NDArray[Any]:
    """Return the array ``name`` of all scenes."""
    return np.concatenate([getattr(score, name) for score in run])


def over_seeds(setting: AgentScores, name: str) -> Floats:
    """Return the array ``name`` [n, ...], summed over the seeds that cover a target."""
    total: Any = 0.0
    for run in setting.seeds:
        value = join_scenes(run, name)
        covered = join_scenes(run, "covered").reshape(-1, *[1] * (value.ndim - 1))
        total = total + np.where(covered, value, 0.0)
    return np.asarray(total, dtype=np.float64)


def _weights(
    run: Sequence[SceneScore], reference: Reference | None
) -> dict[str, Floats]:
    """Return the weight [n] of the targets on each subset.

    Raises RolloutError for a scene with another number of targets.
    """
    targets = sum(len(score) for score in run)
    weights: dict[str, Floats] = {name: np.zeros(targets) for name in SUBSETS}
    weights["all"] = np.ones(targets)
    weights["turning"] = join_scenes(run, "turning").astype(np.float64)
    if reference is None:
        return weights
    for score in run:
        weighed_targets = reference.of(score.scene).targets
        if weighed_targets != len(score):
            raise RolloutError(
                f"the event weights of scene {score.scene!r} are of {weighed_targets} "
                f"targets, the scene has {len(score)}: delete {cache_root()}, whose "
                "scenes are made again; if that does not help, the weights were made "
                "of other data"
            )
    for name in WEIGHTED_SUBSETS:
        weights[name] = np.concatenate(
            [reference.weight(score.scene, name) for score in run]
        )
    return weights


def _events(
    run: Sequence[SceneScore], reference: Reference | None
) -> dict[str, float | None]:
    """Return the expected events of a reference run on targets.

    On the paper's subsets they are the events of plain STP, counted on all boxes.
    """
    events: dict[str, float | None] = dict.fromkeys(KNOWN_SUBSETS)
    if reference is None:
        return events
    for name in COUNTED_EVENTS:
        events[name] = float(
            sum(reference.weight(score.scene, name).sum() for score in run)
        )
    # of STP: switches, lost, reacquired
    stp_events = [reference.of(score.scene).stp_events for score in run]
    ids, *fragments = np.sum(stp_events, axis=0).tolist()
    events["paper_ids"] = float(ids)
    events["paper_frag"] = float(sum(fragments))
    return events


@dataclass(frozen=True)
class SceneResult:
    """One agent on one scene under one seed.

    None: undefined, for lack of targets.
    """

    agent: str
    scene: str
    seed: int
    frames: int
    targets: int
    covered: int  # targets with a forecast
    min_ade: float | None  # m, mean over covered targets
    min_fde: float | None  # m
    coverage: float | None  # share of the targets with a forecast

    @classmethod
    def of(cls, agent: str, seed: int, score: SceneScore) -> "SceneResult":
        """Return the numbers of a scored scene."""
        targets = len(score)
        covered = int(score.covered.sum())
        return cls(
            agent=agent,
            scene=score.scene,
            seed=seed,
            frames=score.frames,
            targets=targets,
            covered=covered,
            min_ade=ratio(float(score.min_ade[score.covered].sum()), covered),
            min_fde=ratio(float(score.min_fde[score.covered].sum()), covered),
            coverage=ratio(covered, targets),
        )


def rows_per_scene(tables: Sequence[AgentTable]) -> Iterator[dict[str, Any]]:
    """Return a row per agent, seed and scene.

    The seeds are numbered from 0.
    ``bADE_sum`` is bADE over all targets, summed over those of the scene: its sums over
    the scenes, divided by the number of targets and averaged over seeds, are the bADE
    of the report. The budgets are those of all scenes.
    """
    for table in tables:
        budgets = table.budgets
        for seed, run in enumerate(table.setting.seeds):
            errors = run_errors(run, budgets.all, budgets.false_known).error
            sums = np.bincount(
                table.scene, weights=errors.mean(axis=0), minlength=len(run)
            )
            for score, bade_sum in zip(run, sums.tolist(), strict=True):
                switches = score.own_events["ids"] if table.has_tracks else None
                result = SceneResult.of(table.setting.agent, seed, score)
                yield {
                    **table.setting.key,
                    "seed": seed,
                    "scene": result.scene,
                    "frames": result.frames,
                    "targets": result.targets,
                    "covered": result.covered,
                    "coverage": result.coverage,
                    "minADE": result.min_ade,
                    "minFDE": result.min_fde,
                    "bADE": ratio(bade_sum, result.targets),
                    "bADE_sum": bade_sum,
                    "forecasts": score.forecasts,
                    "false_forecasts": score.false_forecasts,
                    "identity_switches": switches,
                    "ms_per_frame": 1e3 * score.seconds,
                }

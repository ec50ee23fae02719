"""Numbers of a record from rollouts: the same when it is made and when it is verified."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...cards import Card
from ...scoring import (
    AgentScores,
    ReferenceSubsets,
    SceneScore,
    masks,
    paired_interval,
    score_scene,
    stated_hypotheses,
    summarise,
)
from ...sources import open_source
from ...types import Rollout
from ..reference import frozen_reference
from .provenance import data_manifest, scene_digest
from .record import MotionGap, ReferencePart, RowPart, ScenePart, Status

Progress = Callable[[str], object]
MOTION_TOLERANCE = 0.05  # share of the error without motion by which that with motion may exceed it


@dataclass(frozen=True)
class Evaluation:
    """The part of a record that follows from rollouts, card, data and scorer."""

    rows: list[RowPart]
    details: dict[str, Any]
    per_scene: list[ScenePart]
    motion_gap: MotionGap | None
    reference: ReferencePart
    data_manifest: str
    truth_complete: bool
    hypotheses: int


def evaluate(
    agent: str,
    card: Card,
    data: str | None,
    runs: Mapping[int, Sequence[Rollout]],
    hypotheses: int | None = None,
    ideal: bool = False,
    workers: int = 1,
    progress: Progress | None = None,
) -> Evaluation:
    """Score the rollouts of each seed (``runs``: seed -> the same scenes in the same order) of one agent.

    ``hypotheses`` as declared; None: what the agent states. ``ideal``: it saw the truth. Raises RolloutError where the
    rollouts do not fit the scenes, DataError where data is missing.
    """
    reference = frozen_reference(card)
    subsets = reference.subsets if reference else None
    scored = _score(card, data, list(zip(*runs.values(), strict=True)), workers, progress)
    seeds = tuple(zip(*(scores for _, scores in scored), strict=True))
    samples = next(iter(runs.values()))[0].forecast.shape[1]
    given = AgentScores(
        agent=agent,
        hypotheses=hypotheses or stated_hypotheses(seeds),
        samples=samples,
        budget="equal" if samples == card.task.samples else "free",
        seeds=seeds,
        ideal=ideal,
    )
    report = summarise([given], card, subsets)
    per_scene = [_scene_part(scores, subsets) for _, scores in scored]
    return Evaluation(
        rows=[RowPart.model_validate(row) for row in report.rows],
        details=report.details[0],
        per_scene=per_scene,
        motion_gap=motion_gap(per_scene, list(runs)),
        reference=_reference_part(card, reference.origin if reference else None, subsets),
        data_manifest=data_manifest(digest for digest, _ in scored),
        truth_complete=all(score.truth_complete for run in seeds for score in run),
        hypotheses=given.hypotheses,
    )


def moves(seed: int) -> bool:
    """Whether a seed's local frames are turned and shifted at random: all but the first."""
    return seed != 0


def motion_gap(per_scene: Sequence[ScenePart], seeds: Sequence[int]) -> MotionGap | None:
    """How much larger the error of the moved seeds is than that of the others; None unless there are both."""
    moved = np.array([moves(seed) for seed in seeds])
    targets = np.array([scene.counts["all"] for scene in per_scene], dtype=np.float64)
    if moved.all() or not moved.any() or targets.sum() == 0:
        return None
    errors = np.array([scene.errors["all"] for scene in per_scene])  # [S, seeds]
    with_motion, without = errors[:, moved].mean(axis=1), errors[:, ~moved].mean(axis=1)
    interval = paired_interval(with_motion, without, targets)
    total = float(targets.sum())
    return MotionGap(
        still=float(without.sum()) / total,
        moved=float(with_motion.sum()) / total,
        difference=float((with_motion - without).sum()) / total,
        interval=None if interval is None else list(interval),
    )


def depends_on_motion(gap: MotionGap | None) -> bool:
    """Whether an agent knows the scenes by their coordinates, as a lookup table does.

    Its error with motion is larger than without by more than MOTION_TOLERANCE of it, and the paired interval over
    scenes lies above 0. Other draws and other rounding differ by chance in either direction; the interval alone would
    reject one honest agent in 40.
    """
    if gap is None or gap.interval is None:
        return False
    return gap.interval[0] > 0.0 and gap.difference > MOTION_TOLERANCE * gap.still


def status_of(
    gap: MotionGap | None, scenes: int, scenes_of_split: int, crashed: int, runs: int, reason: str = ""
) -> tuple[Status, str]:
    """Status of a record and why: ``crashed`` of ``runs`` (scenes x seeds) were cut short; ``reason`` of one."""
    if runs and crashed == runs:
        return "crashed", f"no scene was finished: {reason}" if reason else "no scene was finished"
    if gap is not None and depends_on_motion(gap):
        return "rejected", (
            f"the error grows from {gap.still:.3f} to {gap.moved:.3f} m where the scene is turned and shifted: "
            "the answers depend on where the scene lies"
        )
    if scenes < scenes_of_split:
        return "partial", f"{scenes} of {scenes_of_split} scenes"
    return "finished", ""


def _score(
    card: Card, data: str | None, scenes: Sequence[Sequence[Rollout]], workers: int, progress: Progress | None
) -> list[tuple[str, tuple[SceneScore, ...]]]:
    """Digest and scores, one per seed, of each scene; ``scenes`` holds the rollouts of all seeds of each."""
    if workers == 1 or len(scenes) < 2:
        results = (_score_scene(index, card, data, rollouts) for index, rollouts in enumerate(scenes))
        return [part for _, part in _told(results, scenes, progress)]
    from joblib import Parallel, delayed

    parallel: Any = Parallel(n_jobs=min(workers, len(scenes)), backend="loky", return_as="generator_unordered")
    found = parallel(delayed(_score_scene)(index, card, data, rollouts) for index, rollouts in enumerate(scenes))
    return [part for _, part in sorted(_told(found, scenes, progress), key=lambda result: result[0])]


def _told(results: Any, scenes: Sequence[Sequence[Rollout]], progress: Progress | None) -> list[Any]:
    """All results; ``progress`` hears of each as it comes."""
    done = []
    for result in results:
        done.append(result)
        if progress is not None:
            progress(scenes[result[0]][0].scene)
    return done


def _score_scene(
    index: int, card: Card, data: str | None, rollouts: Sequence[Rollout]
) -> tuple[int, tuple[str, tuple[SceneScore, ...]]]:
    scene = open_source(card, data).load(rollouts[0].scene)
    return index, (scene_digest(scene), tuple(score_scene(scene, rollout, card) for rollout in rollouts))


def _scene_part(scores: Sequence[SceneScore], reference: ReferenceSubsets | None) -> ScenePart:
    """Errors of a scene, one score per seed; "all" holds the spurious forecasts, as in the report."""
    first = scores[0]
    mask = masks(reference, first) if reference else {"all": np.ones(len(first), dtype=bool)}
    errors = {
        name: [float(s.capped[rows].sum()) + (s.spurious_error if name == "all" else 0.0) for s in scores]
        for name, rows in mask.items()
    }
    count = len(first)
    seeds = [error / count if count else None for error in errors["all"]]
    return ScenePart(
        scene=first.scene,
        targets=count,
        missing_aware=sum(errors["all"]) / len(scores) / count if count else None,
        seeds=seeds,
        counts={name: int(rows.sum()) for name, rows in mask.items()},
        errors=errors,
    )


def _reference_part(card: Card, origin: str | None, subsets: ReferenceSubsets | None) -> ReferencePart:
    if subsets is None or origin is None:
        return ReferencePart(
            name=card.reference, hash="", origin="no frozen subsets for this env and split: only 'all' has targets"
        )
    return ReferencePart(name=subsets.reference, hash=subsets.hash, origin=origin)

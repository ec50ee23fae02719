"""Numbers of a record from rollouts: the same when it is made and when it is verified."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..cards import Card
from ..parallel import Workers, parallel_map
from ..running.frozen_subsets import frozen_reference
from ..running.options import RunOptions
from ..scoring import (
    AgentScores,
    ReferenceSubsets,
    SceneScore,
    masks,
    mean_error,
    score_scene,
    stated_hypotheses,
    summarise,
)
from ..scoring.error import error_sum
from ..scoring.rows import Row
from ..sources import open_source
from ..types import Rollout
from .provenance import data_manifest, scene_digest
from .record import ReferencePart, ScenePart, Status


@dataclass(frozen=True)
class Evaluation:
    """The part of a record that follows from rollouts, card, data and scorer."""

    rows: list[Row]
    details: dict[str, Any]  # as JSON
    per_scene: list[ScenePart]
    reference: ReferencePart
    data_manifest: str
    truth_complete: bool
    hypotheses: int


def evaluate(
    agent: str,
    card: Card,
    options: RunOptions,
    runs: Mapping[int, Sequence[Rollout]],
    hypotheses: int | None,
    ideal: bool,
) -> Evaluation:
    """Score the rollouts of each seed (``runs``: seed -> the same scenes in the same order) of one agent.

    ``agent`` is its name, ``card`` the environment; of ``options`` data, the number of processes and progress count.
    ``hypotheses`` as declared; None: what the agent states. ``ideal``: it saw the truth. Raises RolloutError where the
    rollouts do not fit the scenes, DataError where data is missing.
    """
    reference = frozen_reference(card)
    subsets = reference.subsets if reference else None
    calls = [(card, options.data, rollouts) for rollouts in zip(*runs.values(), strict=True)]
    scored: list[tuple[str, tuple[SceneScore, ...]]] = parallel_map(
        _score_scene,
        calls,
        Workers(options.workers.count),
        lambda place: options.progress.done(calls[place][2][0].scene),
    )
    seeds = tuple(zip(*(scores for _, scores in scored), strict=True))
    samples = next(iter(runs.values()))[0].forecast.shape[1]
    setting = AgentScores(
        agent=agent,
        hypotheses=hypotheses or stated_hypotheses(seeds),
        samples=samples,
        budget="equal" if samples == card.task.samples else "free",
        seeds=seeds,
        ideal=ideal,
    )
    report = summarise([setting], card, subsets)
    per_scene = [_scene_part(scores, subsets) for _, scores in scored]
    return Evaluation(
        rows=report.rows,
        details=report.details[0].model_dump(mode="json"),
        per_scene=per_scene,
        reference=ReferencePart(
            name=reference.subsets.reference if reference else card.reference,
            hash=reference.subsets.hash if reference else "",
            origin=reference.origin
            if reference
            else "no frozen subsets for this env and split: only 'all' has targets",
        ),
        data_manifest=data_manifest(digest for digest, _ in scored),
        truth_complete=all(score.truth_complete for run in seeds for score in run),
        hypotheses=setting.hypotheses,
    )


def status_of(
    scenes: int,
    scenes_of_split: int,
    crashed: int,
    runs: int,
    reasons: Mapping[str, str] | None = None,
    split: str | None = None,
) -> tuple[Status, str]:
    """Status of a record and why: ``crashed`` of ``runs`` (scenes x seeds) were cut short, for ``reasons``.

    ``scenes`` of ``scenes_of_split`` were run; ``split``: another one than the env's. An agent that broke the rules of
    the gateway in any run is rejected.
    """
    reasons = reasons or {}
    for key, reason in reasons.items():
        if reason.startswith("rejected: "):
            return "rejected", f"{key}: {reason.removeprefix('rejected: ')}"
    if runs and crashed == runs:
        first = next(iter(reasons.values()), "")
        return "crashed", f"no scene was finished: {first}" if first else "no scene was finished"
    where = "" if split is None else f" of split {split!r}, not the env's"
    if scenes < scenes_of_split or split is not None:
        return "partial", f"{scenes} of {scenes_of_split} scenes{where}"
    return "finished", ""


def _score_scene(card: Card, data: str | None, rollouts: Sequence[Rollout]) -> tuple[str, tuple[SceneScore, ...]]:
    """Digest and scores, one per seed, of one scene."""
    scene = open_source(card, data).load(rollouts[0].scene)
    return scene_digest(scene), tuple(score_scene(scene, rollout, card) for rollout in rollouts)


def _scene_part(scores: Sequence[SceneScore], reference: ReferenceSubsets | None) -> ScenePart:
    """Errors of a scene, one score per seed."""
    first = scores[0]
    subsets = {name: targets for name, targets in masks(reference, first).items() if name != "all"} if reference else {}
    of_subset = {name: [error_sum(score, targets) for score in scores] for name, targets in subsets.items()}
    of_all = [error_sum(score) for score in scores]
    return ScenePart(
        scene=first.scene,
        targets=len(first),
        missing_aware=sum(of_all) / len(scores) / len(first) if len(first) else None,
        seeds=[mean_error([score]) for score in scores],
        counts={"all": len(first), **{name: int(targets.sum()) for name, targets in subsets.items()}},
        errors={"all": of_all, **of_subset},
    )

"""Results of a record from rollouts, the same when it is made and verified."""

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np

from ...cards import Card
from ...core import Drive, Rollout, Workers, parallel_map
from ...running import RunOptions
from ...scoring import (
    DEFINITIONS,
    GOLDEN,
    KNOWN_SUBSETS,
    AgentDrives,
    AgentScores,
    AgentTable,
    Reference,
    Reliability,
    Row,
    SceneScore,
    Subset,
    driving_rows,
    ratio,
    scene_score,
    score_scene,
    stated_hypotheses,
    summarise,
)
from ...sources import open_source, scene_digest
from .canonical import rounded
from .record import ReferencePart, ScorerPart
from .results import FACTS, DrivesPart, Results
from .targets import drive_targets, targets_of

Runs = Mapping[int, Sequence[Rollout]]  # seed -> the same scenes in the same order


@dataclass(frozen=True)
class Evaluation:
    """The part of a record that follows from rollouts, card, data and scorer."""

    results: Results
    fields: dict[str, Any]  # further fields of a `Record` that follow from the rollouts
    reference: Reference
    # of the data that was scored, in the order of scenes
    scene_digests: tuple[str, ...]
    truth_complete: bool
    ms_per_frame: float | None

    @property
    def data_manifest(self) -> str:
        """Hex sha256 over the digests of the scenes, in their order."""
        return hashlib.sha256("\n".join(self.scene_digests).encode()).hexdigest()

    @property
    def record_fields(self) -> dict[str, Any]:
        """Fields of a record that follow from the evaluation, under today's scorer."""
        return {
            **dict(self.results),
            **self.fields,
            "targets_sha256": self.results.targets.digest,
            "reference": ReferencePart(
                name=self.reference.agent,
                hash=self.reference.digest,
                origin=self.reference.origin,
                frozen=self.reference.frozen,
            ),
            "scorer": ScorerPart(
                definitions=DEFINITIONS, source_digest=scorer_digest()
            ),
        }


def evaluate(
    agent: str,
    card: Card,
    options: RunOptions,
    runs: Runs,
    reference: Reference,
    hypotheses: int | None,
    observe: str,
    subsets: Collection[Subset] = KNOWN_SUBSETS,
) -> Evaluation:
    """Score an agent's rollouts, a run per seed.

    ``agent`` is its name, ``card`` the environment, ``reference`` the event weights of
    these scenes; ``options`` give data, number of processes and progress.
    ``hypotheses``: number that the manifest declares; None: the actions state it.
    ``observe``: mode of the env. ``subsets``: only these get numbers, since older
    records have fewer. Raises RolloutError if the rollouts do not fit the scenes,
    DataError if data is missing.
    """
    if card.drive is not None:
        return _evaluate_drives(agent, runs, reference, hypotheses)
    scene_runs = list(zip(*runs.values(), strict=True))
    scored: list[tuple[str, tuple[SceneScore, ...]]] = parallel_map(
        _score_scene,
        [(card, options.data, rollouts) for rollouts in scene_runs],
        Workers(options.workers.count),
        lambda index: options.progress.done(scene_runs[index][0].scene),
    )
    scene_digests, scene_scores = zip(*scored, strict=True)
    seeds = tuple(zip(*scene_scores, strict=True))  # scores of all scenes by seed
    samples = scene_runs[0][0].forecast.shape[1]
    setting = AgentScores(
        agent=agent,
        hypotheses=hypotheses or stated_hypotheses(seeds),
        samples=samples,
        budget="equal" if samples == card.task.samples else "free",
        seeds=seeds,
        observe=observe,
    )
    report = summarise([setting], card, reference)
    (table,) = report.tables
    (details,) = report.details
    errors = {}
    numbers = {}
    for row in report.rows:
        if row.subset in subsets:
            errors[row.subset] = unit_errors(table, row.subset)
            numbers[row.subset] = numbers_of(row)
    targets = targets_of(table, table.subsets, details.nothing_predicted)
    fields = {
        "hypotheses": setting.hypotheses,
        "samples": samples,
        "brier": rounded(details.brier),
        "overconfidence": rounded(overconfidence(details.reliability)),
        "curve": rounded(details.curve),
    }
    return Evaluation(
        results=Results(error=errors, numbers=numbers, targets=targets),
        fields=fields,
        reference=reference,
        scene_digests=scene_digests,
        truth_complete=table.complete,
        ms_per_frame=report.rows[0].ms_per_frame,
    )


def _evaluate_drives(
    agent: str, runs: Runs, reference: Reference, hypotheses: int | None
) -> Evaluation:
    """Score the drives of rollouts by the ways of ``reference``.

    A way is the distance that the ego drives with ground-truth tracks. Worlds react to
    agents, so the digests of scenes cover the ways alone.
    """
    rollouts = list(chain.from_iterable(runs.values()))
    ways = reference.ways(rollout.scene for rollout in rollouts)
    drives: dict[str, list[Drive]] = {scene: [] for scene in ways}
    for rollout in rollouts:
        if rollout.drive is not None:
            drives[rollout.scene].append(rollout.drive)
    (driving,) = driving_rows([AgentDrives(agent, drives)], ways)
    scores = []
    for scene, scene_drives in drives.items():
        scores.append([scene_score(drive, ways[scene]) for drive in scene_drives])
    facts = driving.model_dump(include=set(DrivesPart.model_fields))
    seconds = np.concatenate([rollout.seconds for rollout in rollouts])
    results = Results(
        error={},
        numbers={},
        drives=DrivesPart(**rounded(facts), scores=rounded(scores)),
        targets=drive_targets(list(ways)),
    )
    return Evaluation(
        results=results,
        fields={
            "hypotheses": hypotheses or max(map(_most_hypotheses, rollouts)),
            "samples": rollouts[0].forecast.shape[1],
        },
        reference=reference,
        scene_digests=tuple(f"{scene} {way}" for scene, way in ways.items()),
        truth_complete=True,
        ms_per_frame=1e3 * float(seconds.mean()),
    )


def _most_hypotheses(rollout: Rollout) -> int:
    """Return the largest number of hypotheses in a frame."""
    counts = np.isfinite(rollout.hypothesis_log_weight).sum(axis=1)
    return int(counts.max(initial=0))


def scorer_digest(definitions: str = DEFINITIONS, golden: str = GOLDEN) -> str:
    """Return the hex sha256 of a version of the definitions and its golden results."""
    return hashlib.sha256(f"{definitions}\n{golden}".encode()).hexdigest()


def unit_errors(table: AgentTable, subset: Subset) -> list[float]:
    """Return the weighted bADE per unit [U], metres, as records store it."""
    errors: list[float] = rounded(table.sums_on(subset).error.tolist())
    return errors


def numbers_of(row: Row) -> dict[str, float]:
    """Return the facts of a row that records store.

    Costs by cause are stored for the subset "all" alone.
    """
    numbers = {}
    for name in Row.model_fields:
        is_cost = name.startswith("cost_")
        if name not in FACTS or (is_cost and row.subset != "all"):
            continue
        value = getattr(row, name)
        if value is not None:
            numbers[name] = rounded(value)
    return numbers


def overconfidence(reliability: Sequence[Reliability]) -> float | None:
    """Return the mean stated confidence less the share of true forecasts."""
    excess = sum(
        part.forecasts * (part.confidence - part.matched) for part in reliability
    )
    return ratio(excess, sum(part.forecasts for part in reliability))


def _score_scene(
    card: Card, data: str | None, rollouts: Sequence[Rollout]
) -> tuple[str, tuple[SceneScore, ...]]:
    """Return the digest of one scene and its scores, one per seed."""
    scene = open_source(card, data).load(rollouts[0].scene)
    scores = tuple(score_scene(scene, rollout, card) for rollout in rollouts)
    return scene_digest(scene), scores

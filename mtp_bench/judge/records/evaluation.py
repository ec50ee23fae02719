"""Numbers of a record from rollouts: the same when it is made and when it is verified."""

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...cards import Card
from ...core import Rollout, Workers, parallel_map
from ...running import RunOptions
from ...scoring import (
    DEFINITIONS,
    GOLDEN,
    KNOWN_SUBSETS,
    SUBSETS,
    AgentDrives,
    AgentScores,
    AgentTable,
    Reference,
    Row,
    SceneScore,
    Subset,
    bootstrap_interval,
    driving_rows,
    scene_score,
    score_scene,
    stated_hypotheses,
    summarise,
)
from ...sources import open_source, scene_digest
from .canonical import rounded
from .record import (
    DrivingPart,
    MissedPart,
    ReferencePart,
    ScenePart,
    ScorerPart,
    Status,
)

_OF_RECORD = (
    "hypotheses",
    "rows",
    "nothing_predicted",
    "details",
    "per_scene",
    "driving",
)  # same name
LEFT_OUT = (  # fields of a row that depend on other records, or are measured
    "place",
    "rank_range",
    "unranked_because",
    "gap_closed",
    "gap_interval",
    "gap_closed_same_predictor",
    "gap_same_predictor_interval",
    "association_gap_closed",
    "association_gap_interval",
    "gap_blank_because",
    "association_gap_blank_because",
    "ms_per_frame",
)
_COUNTS = (
    "targets",
    "effective_targets",
    "objects",
    "effective_objects",
    "scenes",
    "effective_units",
)  # of a row
Runs = Mapping[int, Sequence[Rollout]]  # seed -> the same scenes in the same order


@dataclass(frozen=True)
class Evaluation:
    """The part of a record that follows from rollouts, card, data and scorer."""

    rows: list[Row]  # without ranks and times
    nothing_predicted: float | None
    details: dict[str, Any]  # as JSON
    per_scene: list[ScenePart]
    reference: Reference
    scene_digests: tuple[
        str, ...
    ]  # of the data that was scored, in the order of the scenes
    truth_complete: bool
    hypotheses: int
    ms_per_frame: float | None
    driving: DrivingPart | None = None

    @property
    def data_manifest(self) -> str:
        """Hex sha256 over the digests of the scenes, in their order."""
        return hashlib.sha256("\n".join(self.scene_digests).encode()).hexdigest()

    def record_parts(
        self, missed: MissedPart, runs: int, scenes_of_split: int
    ) -> dict[str, Any]:
        """Fields of a record that follow from the evaluation, under today's scorer: its numbers and its status.

        ``missed`` in ``runs`` (scenes x seeds); ``scenes_of_split``: number of scenes of the split.
        """
        status, reason = status_of(len(self.per_scene), scenes_of_split, missed, runs)
        weights = self.reference
        return {
            "reference": ReferencePart(
                name=weights.agent,
                hash=weights.digest,
                origin=weights.origin,
                frozen=weights.frozen,
            ),
            "scorer": ScorerPart(
                definitions=DEFINITIONS, source_digest=scorer_digest()
            ),
            "status": status,
            "status_reason": reason,
            **{name: getattr(self, name) for name in _OF_RECORD},
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
    """Score the rollouts of each seed of one agent.

    ``agent`` is its name, ``card`` the environment, ``reference`` the event weights of these scenes; ``options`` give
    data, number of processes and progress. ``hypotheses`` as declared; None: as the answers state. ``observe``: the
    mode of the env; ``subsets``: others get no numbers, as in older records. Raises RolloutError if the rollouts do not
    fit the scenes, DataError if data is missing.
    """
    if card.drive is not None:
        return _evaluate_drives(agent, card, runs, reference, hypotheses)
    calls = [
        (card, options.data, rollouts) for rollouts in zip(*runs.values(), strict=True)
    ]
    workers = Workers(options.workers.count)
    scored: list[tuple[str, tuple[SceneScore, ...]]] = parallel_map(
        _score_scene,
        calls,
        workers,
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
        observe=observe,
    )
    report = summarise([setting], card, reference)
    (table,) = report.tables
    rows = [_stored(row) for row in report.rows if row.subset in subsets]
    return Evaluation(
        rows=rows,
        nothing_predicted=report.details[0].nothing_predicted,
        details=rounded(report.details[0].model_dump(mode="json")),
        per_scene=per_scene_of(table, [row.subset for row in rows]),
        reference=reference,
        scene_digests=tuple(digest for digest, _ in scored),
        truth_complete=table.complete,
        hypotheses=setting.hypotheses,
        ms_per_frame=report.rows[0].ms_per_frame,
    )


def _evaluate_drives(
    agent: str, card: Card, runs: Runs, reference: Reference, hypotheses: int | None
) -> Evaluation:
    """Score the drives of rollouts by the ways of ``reference``. Worlds react to agents: digests are of ways alone."""
    every = [rollout for rollouts in runs.values() for rollout in rollouts]
    ways = reference.ways(rollout.scene for rollout in every)
    drives = {
        name: [
            each.drive
            for each in every
            if each.scene == name and each.drive is not None
        ]
        for name in ways
    }
    (driving,) = driving_rows([AgentDrives(agent, drives)], ways)
    scores = [
        [scene_score(drive, ways[name]) for drive in own]
        for name, own in drives.items()
    ]
    errors = rounded([1.0 - float(np.mean(own)) for own in scores])
    stated = max(
        int(np.isfinite(each.hypothesis_log_weight).sum(axis=1).max(initial=0))
        for each in every
    )
    samples = every[0].forecast.shape[1]
    blank = {**dict.fromkeys(Row.model_fields), **dict.fromkeys(_COUNTS, 0)} | {
        "agent": agent,
        "hypotheses": hypotheses or stated,
        "samples": samples,
        "seeds": len(runs),
        "budget": "equal" if samples == card.task.samples else "free",
    }
    interval = bootstrap_interval(errors, np.ones(len(errors)))
    of_all = {
        **dict.fromkeys(_COUNTS, len(errors)),
        "error": float(np.mean(errors)),
        "interval": interval,
    }
    rows = [
        Row.model_validate(
            {**blank, "subset": each, **(of_all if each == "all" else {})}
        )
        for each in SUBSETS
    ]
    none: dict[Subset, list[float]] = {subset: [0.0] for subset in SUBSETS}
    return Evaluation(
        rows=[_stored(row) for row in rows],
        nothing_predicted=None,
        details={},
        per_scene=[
            ScenePart(
                scene=name,
                weight={**none, "all": [1.0]},
                error={**none, "all": [error]},
            )
            for name, error in zip(ways, errors, strict=True)
        ],
        reference=reference,
        scene_digests=tuple(f"{name} {way}" for name, way in ways.items()),
        truth_complete=True,
        hypotheses=hypotheses or stated,
        ms_per_frame=1e3
        * float(np.concatenate([rollout.seconds for rollout in every]).mean()),
        driving=DrivingPart(**rounded(driving.model_dump()), scores=rounded(scores)),
    )


def status_of(
    scenes: int, scenes_of_split: int, missed: MissedPart, runs: int
) -> tuple[Status, str]:
    """Status of a record of ``scenes`` of a split and its reason, by what was ``missed`` in ``runs`` (scenes x seeds).

    An agent that broke the rules of the gateway in any run is rejected.
    """
    for key, reason in missed.reasons.items():
        if reason.startswith("rejected: "):
            return "rejected", f"{key}: {reason.removeprefix('rejected: ')}"
    if runs and missed.crashed_scenes == runs:
        return "crashed", ": ".join(
            ["no scene was finished", *list(missed.reasons.values())[:1]]
        )
    if scenes < scenes_of_split:
        return "partial", f"{scenes} of {scenes_of_split} scenes"
    return "finished", ""


def scorer_digest(definitions: str = DEFINITIONS, golden: str = GOLDEN) -> str:
    """Hex sha256 of the version of the definitions and of the scorer's golden results."""
    return hashlib.sha256(f"{definitions}\n{golden}".encode()).hexdigest()


def per_scene_of(
    table: AgentTable, subsets: Sequence[Subset] = SUBSETS
) -> list[ScenePart]:
    """Sums of each unit on ``subsets``; the units of a scene are consecutive."""
    scores = table.setting.seeds[0]
    ends = np.cumsum([score.units for score in scores])[:-1]
    sums = {name: table.sums_on(name) for name in subsets}
    weight = {name: np.split(sums[name].weight, ends) for name in subsets}
    error = {name: np.split(sums[name].error, ends) for name in subsets}
    return [
        ScenePart(
            scene=score.scene,
            weight={name: rounded(weight[name][i].tolist()) for name in subsets},
            error={name: rounded(error[name][i].tolist()) for name in subsets},
        )
        for i, score in enumerate(scores)
    ]


def _score_scene(
    card: Card, data: str | None, rollouts: Sequence[Rollout]
) -> tuple[str, tuple[SceneScore, ...]]:
    """Digest and scores, one per seed, of one scene."""
    scene = open_source(card, data).load(rollouts[0].scene)
    return scene_digest(scene), tuple(
        score_scene(scene, rollout, card) for rollout in rollouts
    )


def _stored(row: Row) -> Row:
    """The row without fields that depend on other records, rounded to be equal on other machines."""
    kept = {name: rounded(value) for name, value in row.model_dump().items()}
    return row.model_copy(update={**kept, **dict.fromkeys(LEFT_OUT)})

"""Driving in a closed loop: scores of scenes and rows of agents, paired by scene (docs/definitions, "Driving")."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from ..core import Column, Drive, Floats, Section
from .bade import ONE_PER_TARGET
from .rows import Interval, IntervalColumn
from .score import SceneScore
from .statistics import bootstrap_interval, paired_difference
from .table import run_errors

WEIGHTS = {"progress": 5.0, "no near miss": 5.0, "comfort": 2.0}
LEAST_WAY = (
    5.0  # m: where ground-truth tracks let the ego drive less, progress counts as made
)
_Many = Annotated[float, Field(ge=0)]
_Part = Annotated[float, Field(ge=0, le=1)]
_per_100 = partial(Column, better="lower", format=".1f", group="per 100 scenes")


class DrivingRow(Section):
    """Driving of one agent over all scenes and seeds."""

    agent: Annotated[str, Column(help="Name of the submission.")]
    drive_score: Annotated[
        float, Column("drive score", better="higher", help="Mean over scenes, 0 to 1.")
    ]
    interval: IntervalColumn
    difference: Annotated[
        float | None,
        Column("to stp", "", "higher", "+.3f", "Drive score minus that of stp."),
    ]
    difference_interval: IntervalColumn
    p: Annotated[
        float | None,
        Column("p", format=".3f", help="Sign-flip test of the difference over scenes."),
    ]
    collisions: Annotated[
        _Many,
        _per_100("collisions at fault", help="Collisions at fault per 100 scenes."),
    ]
    collisions_interval: IntervalColumn
    any_collision: Annotated[
        _Many, _per_100("collisions", help="All collisions per 100 scenes.")
    ]
    near_misses: Annotated[
        _Many, _per_100("near misses", help="Near misses per 100 scenes.")
    ]
    phantom_brakes: Annotated[
        _Many,
        _per_100("phantom brakes", help="Hard braking on a free way, per 100 scenes."),
    ]
    progress: Annotated[
        _Part,
        Column(
            "progress",
            "share",
            "higher",
            help="Way over that with ground-truth tracks.",
        ),
    ]
    goal_seconds: Annotated[
        _Many | None,
        Column("s to goal", "", "lower", help="Seconds, if it is reached; mean."),
    ]
    comfort: Annotated[
        _Part,
        Column(
            "comfort",
            "share",
            "higher",
            help="Scenes within nuPlan's bounds of comfort.",
        ),
    ]
    bade: Annotated[
        float | None,
        Column(
            "bADE",
            "m",
            better="lower",
            help="Of the targets in the agent's own drives.",
        ),
    ]
    scenes: Annotated[int, Column(help="Scenes that it drove in.")] = 0


@dataclass(frozen=True, eq=False)
class AgentDrives:
    """Drives of an agent: for each scene one per seed; and the scores of its forecasts in them, a run per seed."""

    agent: str
    drives: Mapping[str, Sequence[Drive]]
    scores: Sequence[Sequence[SceneScore]] = ()


def scene_score(drive: Drive, reference: float) -> float:
    """Score of one drive, 0 to 1; ``reference``: m that the ego drives there with ground-truth tracks."""
    parts = (
        progress_of(drive, reference),
        float(drive.near_misses == 0),
        float(drive.comfortable),
    )
    total = sum(
        weight * part for weight, part in zip(WEIGHTS.values(), parts, strict=True)
    )
    return 0.0 if drive.at_fault else total / sum(WEIGHTS.values())


def progress_of(drive: Drive, reference: float) -> float:
    """Share of the ``reference`` way that was driven, at most 1."""
    return 1.0 if reference < LEAST_WAY else min(1.0, drive.way / reference)


def scene_scores(agent: AgentDrives, reference: Mapping[str, float]) -> Floats:
    """Scores [S] of the scenes of ``reference``, means over seeds."""
    return np.array(
        [
            np.mean([scene_score(d, way) for d in agent.drives[name]])
            for name, way in reference.items()
        ]
    )


def driving_rows(
    agents: Sequence[AgentDrives],
    reference: Mapping[str, float],
    stp: AgentDrives | None = None,
) -> list[DrivingRow]:
    """A row per agent, the best score first; ``reference``: way with ground-truth tracks of each scene, m."""
    base = None if stp is None else scene_scores(stp, reference)
    rows = [_row(agent, reference, None if agent is stp else base) for agent in agents]
    return sorted(rows, key=lambda row: -row.drive_score)


def own_bade(agent: AgentDrives) -> float | None:
    """BADE in the agent's own drives, m, mean over seeds; budgets up to a false forecast per target; or None."""
    runs = [run for run in agent.scores if any(map(len, run))]
    errors = [
        run_errors(
            run, ONE_PER_TARGET.budgets(sum(map(len, run))).all, True, "cuts"
        ).error.mean()
        for run in runs
    ]
    return float(np.mean(errors)) if errors else None


def score_interval(scores: ArrayLike) -> Interval | None:
    """Interval of the mean of drive scores of scenes [S], at most 1."""
    interval = bootstrap_interval(scores, np.ones(np.shape(scores)))
    return interval and (interval[0], min(interval[1], 1.0))


def fault_interval(collisions: float, scenes: int) -> Interval:
    """Interval of ``collisions`` per 100 scenes (Clopper and Pearson 1934): resamples say too little of rare events."""
    from scipy.special import betaincinv

    hits = min(collisions / 100.0, 1.0) * scenes
    low = betaincinv(hits, scenes - hits + 1.0, 0.025) if hits > 0 else 0.0
    high = betaincinv(hits + 1.0, scenes - hits, 0.975) if hits < scenes else 1.0
    return 100.0 * float(low), 100.0 * float(high)


def _row(
    agent: AgentDrives, reference: Mapping[str, float], base: Floats | None
) -> DrivingRow:
    score = scene_scores(agent, reference)
    drives = [agent.drives[name] for name in reference]
    every = [
        (drive, way)
        for own, way in zip(drives, reference.values(), strict=True)
        for drive in own
    ]
    faults = np.array(
        [np.mean([100.0 * drive.at_fault for drive in own]) for own in drives]
    )
    to_stp = (
        None if base is None else paired_difference(score, base, np.ones(len(score)))
    )
    goals = [drive.seconds for drive, _ in every if drive.goal]
    return DrivingRow(
        agent=agent.agent,
        drive_score=float(score.mean()),
        interval=score_interval(score),
        difference=to_stp and to_stp.mean,
        difference_interval=to_stp and to_stp.interval,
        p=to_stp and to_stp.p,
        collisions=float(faults.mean()),
        collisions_interval=fault_interval(float(faults.mean()), len(faults)),
        any_collision=float(
            np.mean([100.0 * bool(drive.collision) for drive, _ in every])
        ),
        near_misses=float(np.mean([100.0 * drive.near_misses for drive, _ in every])),
        progress=float(np.mean([progress_of(drive, way) for drive, way in every])),
        phantom_brakes=float(
            np.mean([100.0 * drive.phantom_brakes for drive, _ in every])
        ),
        goal_seconds=float(np.mean(goals)) if goals else None,
        comfort=float(np.mean([drive.comfortable for drive, _ in every])),
        bade=own_bade(agent),
        scenes=len(reference),
    )

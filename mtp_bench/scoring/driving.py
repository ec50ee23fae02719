"""Driving in a closed loop: scores of scenes and rows of agents, paired by scene.

Definitions: docs/definitions, "Driving".
"""

from collections.abc import Callable, Mapping, Sequence
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
from .statistics import bootstrap_interval, numbers_of, paired_difference
from .table import run_errors

DRIVE_SCORE_WEIGHTS = {"progress": 5.0, "no near miss": 5.0, "comfort": 2.0}
# where ground-truth tracks let the ego drive less, progress counts as made
MIN_WAY_M = 5.0
_Amount = Annotated[float, Field(ge=0)]
_Share = Annotated[float, Field(ge=0, le=1)]
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
        _Amount,
        _per_100("collisions at fault", help="Collisions at fault per 100 scenes."),
    ]
    collisions_interval: IntervalColumn
    any_collision: Annotated[
        _Amount, _per_100("collisions", help="All collisions per 100 scenes.")
    ]
    near_misses: Annotated[
        _Amount, _per_100("near misses", help="Near misses per 100 scenes.")
    ]
    phantom_brakes: Annotated[
        _Amount,
        _per_100("phantom brakes", help="Hard braking on a free way, per 100 scenes."),
    ]
    progress: Annotated[
        _Share,
        Column(
            "progress",
            "share",
            "higher",
            help="Way over that with ground-truth tracks.",
        ),
    ]
    goal_seconds: Annotated[
        _Amount | None,
        Column("s to goal", "", "lower", help="Seconds, if it is reached; mean."),
    ]
    comfort: Annotated[
        _Share,
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
    """Drives of an agent, one per scene and seed.

    ``scores``: scores of its forecasts in these drives, a run per seed.
    """

    agent: str
    drives: Mapping[str, Sequence[Drive]]
    scores: Sequence[Sequence[SceneScore]] = ()


def scene_score(drive: Drive, reference: float) -> float:
    """Return the score of one drive, 0 to 1.

    ``reference``: m that the ego drives there with ground-truth tracks.
    """
    if drive.at_fault:
        return 0.0
    parts = {
        "progress": progress_of(drive, reference),
        "no near miss": float(drive.near_misses == 0),
        "comfort": float(drive.comfortable),
    }
    total = sum(DRIVE_SCORE_WEIGHTS[name] * part for name, part in parts.items())
    return total / sum(DRIVE_SCORE_WEIGHTS.values())


def progress_of(drive: Drive, reference: float) -> float:
    """Return the share of the ``reference`` way (m) that was driven, at most 1."""
    return 1.0 if reference < MIN_WAY_M else min(1.0, drive.way / reference)


def scene_scores(agent: AgentDrives, reference: Mapping[str, float]) -> Floats:
    """Return the scores [S] of the scenes of ``reference``, means over seeds.

    ``reference``: way with ground-truth tracks of each scene, m.
    """
    scores = []
    for scene, way_m in reference.items():
        scores.append(np.mean([scene_score(d, way_m) for d in agent.drives[scene]]))
    return np.array(scores)


def driving_rows(
    agents: Sequence[AgentDrives],
    reference: Mapping[str, float],
    stp: AgentDrives | None = None,
) -> list[DrivingRow]:
    """Return a row per agent, the best score first.

    ``reference``: way with ground-truth tracks of each scene, m.
    """
    stp_scores = None if stp is None else scene_scores(stp, reference)
    rows = []
    for agent in agents:
        rows.append(_row(agent, reference, None if agent is stp else stp_scores))
    return sorted(rows, key=lambda row: -row.drive_score)


def own_bade(agent: AgentDrives) -> float | None:
    """Return bADE in the agent's own drives, m, mean over seeds.

    Budgets are up to a false forecast per target. None without targets.
    """
    errors = []
    for run in agent.scores:
        targets = sum(len(score) for score in run)
        if targets:
            budgets = ONE_PER_TARGET.budgets(targets).all
            errors.append(run_errors(run, budgets, false_known=True).error.mean())
    return float(np.mean(errors)) if errors else None


def score_interval(scores: ArrayLike) -> Interval | None:
    """Return the interval of the mean of drive scores of scenes [S], at most 1."""
    interval = bootstrap_interval(scores, np.ones(np.shape(scores)))
    return interval and (interval[0], min(interval[1], 1.0))


def fault_interval(collisions: float, scenes: int) -> Interval:
    """Return the 95 % interval of ``collisions`` per 100 scenes.

    It is that of Clopper and Pearson (1934) for a share of scenes.

    Resamples say too little of rare events.
    """
    from scipy.special import betaincinv

    hits = min(collisions / 100.0, 1.0) * scenes
    low = betaincinv(hits, scenes - hits + 1.0, 0.025) if hits > 0 else 0.0
    high = betaincinv(hits + 1.0, scenes - hits, 0.975) if hits < scenes else 1.0
    return 100.0 * float(low), 100.0 * float(high)


def _mean(drives: Sequence[Drive], value: Callable[[Drive], float]) -> float:
    return float(np.mean([value(drive) for drive in drives]))


def _row(
    agent: AgentDrives, ways_m: Mapping[str, float], stp_scores: Floats | None
) -> DrivingRow:
    scores = scene_scores(agent, ways_m)
    difference = None
    if stp_scores is not None:
        difference = paired_difference(scores, stp_scores, np.ones(len(scores)))
    mean, mean_interval, p = numbers_of(difference)
    drives: list[Drive] = []
    progress = []
    faults_per_100 = []
    for scene, way_m in ways_m.items():
        scene_drives = agent.drives[scene]
        drives += scene_drives
        progress += [progress_of(drive, way_m) for drive in scene_drives]
        faults_per_100.append(_mean(scene_drives, lambda drive: 100.0 * drive.at_fault))
    faults = float(np.mean(faults_per_100))
    arrived = [drive for drive in drives if drive.goal]

    return DrivingRow(
        agent=agent.agent,
        drive_score=float(scores.mean()),
        interval=score_interval(scores),
        difference=mean,
        difference_interval=mean_interval,
        p=p,
        collisions=faults,
        collisions_interval=fault_interval(faults, len(scores)),
        any_collision=_mean(drives, lambda drive: 100.0 * bool(drive.collision)),
        near_misses=_mean(drives, lambda drive: 100.0 * drive.near_misses),
        progress=float(np.mean(progress)),
        phantom_brakes=_mean(drives, lambda drive: 100.0 * drive.phantom_brakes),
        goal_seconds=_mean(arrived, lambda drive: drive.seconds) if arrived else None,
        comfort=_mean(drives, lambda drive: float(drive.comfortable)),
        bade=own_bade(agent),
        scenes=len(ways_m),
    )

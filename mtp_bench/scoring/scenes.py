"""Numbers of single scenes: while a run goes on, and of a report."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .score import SceneScore
from .statistics import ratio
from .table import AgentTable, run_errors


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
                    "identity_switches": score.own_events["ids"],
                    "ms_per_frame": 1e3 * score.seconds,
                }

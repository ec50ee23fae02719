"""Plans of the ego of a closed loop: where it wants to drive, where it brakes hard, and the object that slows it."""

from dataclasses import dataclass

import numpy as np

from ..sources.highway.world import RATE
from ..types import HARD_BRAKING, Bools, Floats
from .replay import Replay


@dataclass(frozen=True, eq=False)
class ShownPlan:
    """One decision of the planner."""

    path: Floats  # [T + 1, 2] m, of the ego, from now on
    hard: Bools  # [T] steps in which it brakes by more than `HARD_BRAKING`
    acceleration: float  # m/s2, of now
    risk: float  # chance of a contact along the path
    slower: Floats  # [0 or 1, 7] box of the forecast object that slows the ego


def plan_at(run: Replay, t: int) -> ShownPlan | None:
    """The plan in frame ``t`` of the scene; None without a closed loop."""
    drive = run.rollout.drive
    if drive is None or t >= len(drive.plan):
        return None
    now = float(drive.acceleration[t * round(RATE / run.card.task.rate)])
    speed = np.hypot(*np.diff(drive.plan[t], axis=0).T) * run.card.task.rate  # [T] m/s, means of the steps
    hard = np.append(now, np.diff(speed) * run.card.task.rate) < HARD_BRAKING
    boxes, cause = run.rollout.object_box[run.rollout.objects.rows(t - run.first)], int(drive.cause[t])
    slower = boxes[cause : cause + 1].astype(np.float64) if cause >= 0 else np.zeros((0, 7))
    return ShownPlan(drive.plan[t], hard, now, float(drive.risk[t]), slower)

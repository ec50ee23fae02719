"""Plans of the ego of a closed loop: where it wants to drive, where it brakes hard, and the object that slows it."""

from dataclasses import dataclass

import numpy as np

from ..sources.highway.world import RATE
from ..types import Bools, Drive, Floats
from .replay import Replay

HARD = -3.0  # m/s2


@dataclass(frozen=True, eq=False)
class ShownPlan:
    """One decision of the planner."""

    path: Floats  # [T + 1, 2] m, of the ego, from now on
    hard: Bools  # [T] steps in which it brakes by more than `HARD`
    acceleration: float  # m/s2, of now
    risk: float  # chance of a contact along the path
    slower: Floats  # [0 or 1, 7] box of the forecast object that slows the ego


def plan_at(run: Replay, t: int) -> ShownPlan | None:
    """The plan in frame ``t`` of the scene; None without a closed loop."""
    drive = run.rollout.drive
    if drive is None or t >= len(drive.plan):
        return None
    now = float(drive.acceleration[t * round(RATE / run.card.task.rate)])
    start, cause = run.rollout.objects.rows(t - run.first).start, int(drive.cause[t])
    slower = run.rollout.object_box[start + cause : start + cause + (cause >= 0)].astype(np.float64)
    return ShownPlan(drive.plan[t], _hard(drive, t, now, 1.0 / run.card.task.rate), now, float(drive.risk[t]), slower)


def _hard(drive: Drive, t: int, now: float, dt: float) -> Bools:
    speed = np.hypot(*np.diff(drive.plan[t], axis=0).T) / dt  # [T] m/s, means of the steps
    return np.append(now, np.diff(speed) / dt) < HARD

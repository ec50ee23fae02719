"""Closed loops: plans of the ego, where it brakes hard and the object that slows it; the cause of a collision."""

from dataclasses import dataclass

import numpy as np

from ..sources.highway.world import RATE
from ..types import HARD_BRAKING, Bools, Floats
from .focus import Focus
from .replay import Replay
from .terminal.output import counted

SECONDS = 3.0  # before a collision, for its cause
LEAST = 0.5  # share of frames, and confidence, below which something was missing


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


def collision_cause(focus: Focus) -> str:
    """The first part of the stack that lacked something, and what: "tracker: detected in 5, forecast in 2"..."""
    run, t, own = focus.replay, focus.at.frame, focus.at.object_id
    first = max(0, t - round(SECONDS * run.card.task.rate))
    frames = [each for each in range(first, t) if focus.rows[each] >= 0] or [t]
    seen = run.scene.detections.frame_of_rows[run.detected == own]
    detected, made = int(np.isin(frames, seen).sum()), [one for each in frames if (one := focus.forecast(each))]
    switches = [e.frame for e in run.events if (e.kind, e.object_id) == ("ids", own) and e.frame >= first]
    text = f"detected in {detected} and forecast in {len(made)} of the {counted(len(frames), 'frame')} before"
    ends = [one.nearest_path[: t - one.frame + 1][-1] for one in made]
    off = float(np.mean([np.hypot(*(end - focus.place(t))) for end in ends])) if made else 0.0
    sure = float(np.nan_to_num(run.worth[focus.rows[frames], 1]).sum()) / max(1, len(made))
    text += f"; its nearest sample {off:.1f} m off where they meet, confidence {sure:.2f}" if made else ""
    text += f"; it changed its track at {focus.seconds(switches[-1]):.1f} s" if switches else ""
    few, astray = LEAST * len(frames), off > focus.gate
    lacking = detected < few, len(made) < few or (len(switches) > 0 and astray), sure < LEAST, astray, True
    return f"{('detector', 'tracker', 'confidence', 'predictor', 'planner')[lacking.index(True)]}: {text}"

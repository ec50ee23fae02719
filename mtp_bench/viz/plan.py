"""Closed loops: plans of the ego, where it brakes hard and the object that slows it; the cause of a collision."""

from dataclasses import dataclass

import numpy as np

from ..core import HARD_BRAKING, Bools, Floats, to_metres
from ..traffic import RATE
from .focus import Focus
from .run_replay import Replay
from .terminal.output import counted

SECONDS = 3.0  # before a collision, for its cause
LEAST = 0.5  # share of frames, and confidence, below which something was missing


@dataclass(frozen=True, eq=False)
class ShownPlan:
    """One decision of the planner."""

    path: Floats  # [T + 1, 2] m, of the ego, from now on
    hard: Bools  # [T] steps in which it brakes by more than `HARD_BRAKING`
    acceleration: float  # m/s2, of now
    risk: float  # severity-weighted contact score along the path, in [0, 1]
    slower: Floats  # [0 or 1, 7] box of the forecast object that slows the ego


def plan_at(run: Replay, t: int) -> ShownPlan | None:
    """The plan in frame ``t`` of the scene; None without a closed loop."""
    drive = run.rollout.drive
    if drive is None or t >= len(drive.plan):
        return None
    now = float(drive.acceleration[t * round(RATE / run.card.task.rate)])
    speed = (
        np.hypot(*np.diff(drive.plan[t], axis=0).T) * run.card.task.rate
    )  # [T] m/s, means of the steps
    hard = np.append(now, np.diff(speed) * run.card.task.rate) < HARD_BRAKING
    boxes, cause = (
        run.rollout.object_box[run.rollout.objects.rows(t - run.first)],
        int(drive.cause[t]),
    )
    slower = (
        boxes[cause : cause + 1].astype(np.float64) if cause >= 0 else np.zeros((0, 7))
    )
    return ShownPlan(drive.plan[t], hard, now, float(drive.risk[t]), slower)


def collision_cause(focus: Focus) -> str:
    """The first part of the stack that lacked something, and what: "tracker: detected in 5, forecast in 2"..."""
    run, t, own, told = (
        focus.replay,
        focus.at.frame,
        focus.at.object_id,
        focus.replay.rollout,
    )
    first = max(0, t - round(SECONDS * run.card.task.rate))
    frames = [each for each in range(first, t) if focus.rows[each] >= 0] or [t]
    detected = int(
        np.isin(frames, run.scene.detections.frame_of_rows[run.detected == own]).sum()
    )
    switches = [
        e.frame
        for e in run.events
        if (e.kind, e.object_id) == ("ids", own) and e.frame >= first
    ]
    off, sure = (
        list[float](),
        list[float](),
    )  # m, of the nearest sample; the scorer matches no forecast this late
    for each in frames:
        rows = told.objects.rows(each)
        far = np.hypot(*(told.object_box[rows, :2] - focus.place(each)).T)
        far[told.object_class[rows] != focus.at.class_id] = np.inf
        row = rows.start + int(np.argmin(far)) if (far <= focus.gate).any() else -1
        samples = (
            told.forecast[row][np.isfinite(told.forecast_log_weight[row])]
            if row >= 0
            else told.forecast[:0, 0]
        )
        if len(samples):
            ends = told.object_box[row, :2] + to_metres(
                samples[:, : max(1, t - each)][:, -1]
            )
            off.append(float(np.hypot(*(ends - focus.place(t)).T).min()))
            sure.append(float(told.object_confidence[row]))
    text = f"detected in {detected} and forecast in {len(off)} of the {counted(len(frames), 'frame')} before"
    text += (
        f"; nearest sample {np.mean(off):.1f} m off where they meet, confidence {np.mean(sure):.2f}"
        if off
        else ""
    )
    text += (
        f"; it changed its track at {focus.seconds(switches[-1]):.1f} s"
        if switches
        else ""
    )
    few, astray = LEAST * len(frames), bool(off) and np.mean(off) > focus.gate
    lacking = (
        detected < few,
        len(off) < few or (switches and astray),
        np.mean(sure or [1.0]) < LEAST,
        astray,
        True,
    )
    return f"{('detector', 'tracker', 'confidence', 'predictor', 'planner')[[*map(bool, lacking)].index(True)]}: {text}"

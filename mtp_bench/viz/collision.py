"""Cause of a collision of a closed loop: what the agent knew of the road user in the last seconds before it."""

import numpy as np

from .focus import Focus
from .terminal.output import counted

SECONDS = 3.0  # that are looked at
LEAST = 0.5  # share of frames, and confidence, below which something was missing


def collision_cause(focus: Focus) -> str:
    """The part of the stack at fault, and why: "detector: detected in 1 and forecast in 0 of the 6 frames before".

    It is at fault that first lacks something on the way to the planner; the planner, where nothing was missing.
    """
    run, t = focus.replay, focus.at.frame
    first = t - round(SECONDS * run.card.task.rate)
    frames = [each for each in range(max(0, first), t) if focus.rows[each] >= 0] or [t]
    seen = run.scene.detections.frame_of_rows[run.detected == focus.at.object_id]
    detected, made = int(np.isin(frames, seen).sum()), [one for each in frames if (one := focus.forecast(each))]
    switches = [
        e.frame for e in run.events if e.kind == "ids" and e.object_id == focus.at.object_id and e.frame > first
    ]
    text = f"detected in {detected} and forecast in {len(made)} of the {counted(len(frames), 'frame')} before"
    sure, off = 0.0, 0.0
    if made:
        ends = [one.nearest_path[: t - one.frame + 1][-1] for one in made]
        off = float(np.mean([np.hypot(*(end - focus.place(t))) for end in ends]))
        sure = float(np.nan_to_num(run.worth[focus.rows[frames], 1]).sum()) / len(made)
        text += f"; with a confidence of {sure:.2f}, and its nearest sample {off:.1f} m off the place where they meet"
    text += f"; it changed its track at {focus.seconds(switches[-1]):.1f} s" if switches else ""
    lacks = {
        "detector": detected < LEAST * len(frames),
        "tracker": len(made) < LEAST * len(frames) or (bool(switches) and off > focus.gate),
        "confidence": sure < LEAST,
        "predictor": off > focus.gate,
    }
    return f"{next((part for part, applies in lacks.items() if applies), 'planner')}: {text}"

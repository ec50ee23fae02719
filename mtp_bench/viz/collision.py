"""Cause of a collision of a closed loop: what the agent knew of the road user in the last seconds before it."""

import numpy as np

from .focus import Focus
from .terminal.output import counted

SECONDS = 3.0  # that are looked at
LEAST = 0.5  # share of frames, and confidence, below which something was missing


def collision_cause(focus: Focus) -> str:
    """The first part of the stack that lacked something, and what: "tracker: detected in 5, forecast in 2"..."""
    run, t = focus.replay, focus.at.frame
    first = max(0, t - round(SECONDS * run.card.task.rate))
    frames = [each for each in range(first, t) if focus.rows[each] >= 0] or [t]
    seen = run.scene.detections.frame_of_rows[run.detected == focus.at.object_id]
    detected, made = int(np.isin(frames, seen).sum()), [one for each in frames if (one := focus.forecast(each))]
    switches = [
        e.frame for e in run.events if (e.kind, e.object_id) == ("ids", focus.at.object_id) and e.frame >= first
    ]
    text = f"detected in {detected} and forecast in {len(made)} of the {counted(len(frames), 'frame')} before"
    ends = [one.nearest_path[: t - one.frame + 1][-1] for one in made]
    off = float(np.mean([np.hypot(*(end - focus.place(t))) for end in ends])) if made else 0.0
    sure = float(np.nan_to_num(run.worth[focus.rows[frames], 1]).sum()) / max(1, len(made))
    text += f"; its nearest sample {off:.1f} m off where they meet, confidence {sure:.2f}" if made else ""
    text += f"; it changed its track at {focus.seconds(switches[-1]):.1f} s" if switches else ""
    lacks = {
        "detector": detected < LEAST * len(frames),
        "tracker": len(made) < LEAST * len(frames) or (len(switches) > 0 and off > focus.gate),
        "confidence": sure < LEAST,
        "predictor": off > focus.gate,
    }
    return f"{next((part for part, applies in lacks.items() if applies), 'planner')}: {text}"

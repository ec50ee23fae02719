"""Cost and content of hypotheses, against H and against objects."""

from __future__ import annotations

import resource
from collections.abc import Iterable
from typing import Any

import numpy as np

from mtp_bench.core import Ints, Task, Tracks
from mtp_bench.core.tracks import group
from mtp_bench.tracking import HypothesisTracker
from tests.support.plain_tracker import PlainTracker

from .scenes import Row, Scenes, agent, crowd, frames_of, tracker
from .timing import AGENT_STAGES, cpu_seconds, stages

PAPER = {1: 207.0, 5: 65.0, 10: 25.0, 20: 8.1}  # frames/s


def distinct_histories(tracks: Tracks, task: Task) -> Ints:
    """Distinct tracks [O] that stand for each object in the hypotheses, objects as the agent reports them."""
    leaf = np.sort(group(tracks, task.objects, 0.5).leaf, axis=1)
    return np.asarray(
        1 + (np.diff(leaf, axis=1) > 0).sum(axis=1) - (leaf[:, 0] < 0), dtype=np.int64
    )


def alive(hypotheses: int, task: Task, scenes: Scenes, **options: Any) -> Row:
    """Averages over frames of what the tracker holds; histories, over objects of all frames."""
    counts: list[tuple[int, int, int]] = []
    histories: list[Ints] = []
    for observations in scenes.values():
        made = HypothesisTracker(hypotheses, **options)
        made.reset(task)
        for observation in observations:
            histories.append(distinct_histories(made.step(observation), task))
            member = made._tree.member
            counts.append((len(member), member.shape[1], int(member[0].sum())))
    held, leaves, tracks = np.mean(counts, axis=0).tolist()
    per_object = float(np.concatenate(histories).mean())
    return {
        "hypotheses alive": held,
        "leaves": leaves,
        "tracks of the best": tracks,
        "histories per object": per_object,
    }


def against_hypotheses(
    task: Task, scenes: Scenes, sizes: Iterable[int], repeats: int
) -> list[Row]:
    """Cost against H on recordings, beside the plain tracker and the paper."""
    frames = frames_of(scenes)
    ours = cpu_seconds({h: tracker(h) for h in sizes}, task, scenes, repeats)
    plain = cpu_seconds({h: tracker(h, PlainTracker) for h in (1, 20)}, task, scenes, 1)
    return [
        {
            "H": h,
            "frames/s": frames / seconds,
            "us per frame": 1e6 * seconds / frames,
            "x H=1": seconds / ours[1],
            "plain frames/s": frames / plain[h] if h in plain else None,
            "plain / ours": plain[h] / seconds if h in plain else None,
            "plain x H=1": plain[h] / plain[1] if h in plain else None,
            "paper frames/s": PAPER.get(h),
            "paper x H=1": PAPER[1] / PAPER[h] if h in PAPER else None,
            **alive(h, task, scenes),
        }
        for h, seconds in ours.items()
    ]


def against_objects(sizes: Iterable[int], frames: int, repeats: int) -> list[Row]:
    rows = []
    for n in sizes:
        task, scenes = crowd(n, frames)
        seconds = cpu_seconds({h: tracker(h) for h in (1, 20)}, task, scenes, repeats)
        row: Row = {
            "objects": n,
            **{f"us, H={h}": 1e6 * seconds[h] / frames for h in seconds},
        }
        peak = (
            resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        )  # of this process so far
        rows.append(
            {
                **row,
                "H=20 / H=1": seconds[20] / seconds[1],
                "peak, MiB": peak,
                **alive(20, task, scenes),
            }
        )
    return rows


def growth(rows: list[Row], over: str, cost: str) -> dict[str, float]:
    """Slopes of log cost over log size: least squares over all, and between the last two."""
    x, y = (np.log([row[name] for row in rows]) for name in (over, cost))
    return {
        "all": float(np.polyfit(x, y, 1)[0]),
        "last two": float((y[-1] - y[-2]) / (x[-1] - x[-2])),
    }


def whole_agent(name: str, task: Task, scenes: Scenes, repeats: int) -> list[Row]:
    starts = {h: agent(h) for h in (1, 20)}
    seconds, rows = cpu_seconds(starts, task, scenes, repeats), []
    for h, start in starts.items():
        row = {
            "scenes": name,
            "frames": frames_of(scenes),
            "H": h,
            "CPU ms": 1e3 * seconds[h] / frames_of(scenes),
        }
        split = {
            stage: us / 1e3
            for stage, us in stages(start, AGENT_STAGES, task, scenes, 1).items()
        }
        rows.append({**row, "x H=1": seconds[h] / seconds[1], **split})
    return rows

"""Cost and memory of tracking with H hypotheses: KITTI, synthetic scenes, and the whole agent.

    python benchmarks/tracker.py [--data ROOT] [--json FILE] [--repeats 3] [--quick]

A frame is one step of one tracker for all classes; observations are made before the clock starts. CPU time of one core;
per scene the least of the repeats, in which everything compared takes turns. Stages are wall time (their clock must be
cheap), with about 2 us per frame for the clock itself. The plain tracker is the same in NumPy, and it is run once;
"plain / ours" is the ratio of its time to ours.
An object's distinct histories are the distinct tracks that stand for it in the hypotheses, as the agent groups them.

Memory is that of a process of its own, after ten frames with two hypotheses: the peak of the resident set (libraries
and all), what it rises by while the scene is run (Linux only, in pages: too coarse for little), and the peak that
tracemalloc sees, in which what kernels allocate is counted.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

os.environ.update(
    dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
)


from benchmarks.tracking.hypotheses import (
    against_hypotheses,
    against_objects,
    alive,
    growth,
    whole_agent,
)
from benchmarks.tracking.memory import memory, memory_here
from benchmarks.tracking.report import show
from benchmarks.tracking.scenes import (
    KITTI,
    NUSCENES,
    ROOM,
    Row,
    crowd,
    frames_of,
    recordings,
    tracker,
)
from benchmarks.tracking.timing import TRACKER_STAGES, cpu_seconds, stages
from mtp_bench.core.errors import DataError

HYPOTHESES, OBJECTS = (1, 5, 10, 20, 50, 100, 200), (10, 20, 50, 100, 200, 500, 5000)


def on_recordings(data: str | None, repeats: int, quick: bool) -> dict[str, Any]:
    task, scenes = recordings(KITTI, data, quick)
    frames = frames_of(scenes)
    where = f"KITTI val, {len(scenes)} sequences, {frames} frames, {len(task.classes)} classes per frame"
    results: dict[str, Any] = {"frames": frames, "sequences": list(scenes)}
    results["kitti"] = against_hypotheses(task, scenes, HYPOTHESES, repeats)
    show(f"Tracker against H: {where}", results["kitti"])
    results["stages"] = [
        {"H": h, **stages(tracker(h), TRACKER_STAGES, task, scenes, repeats)}
        for h in HYPOTHESES
    ]
    show(f"Stages, us per frame: {where}", results["stages"])
    results["memory"] = memory(data, scenes, (1, 20) if quick else (1, 20, 100))
    show(
        "Memory on the KITTI sequence with the most detections per frame",
        results["memory"],
    )
    agents = whole_agent("KITTI val", task, scenes, 1 if quick else 2)
    try:
        agents += whole_agent(
            "nuScenes mini", *recordings(NUSCENES, data, quick), 1 if quick else 2
        )
    except DataError as error:
        print(f"nuScenes mini is left out: {error}", file=sys.stderr)
    results["agent"] = agents
    show("Whole agent (mtp), ms per frame; stages are wall time", agents)
    return results


def on_crowds(repeats: int, quick: bool) -> dict[str, Any]:
    frames = 10 if quick else 40
    objects = against_objects(OBJECTS[:3] if quick else OBJECTS, frames, repeats)
    show(
        f"Tracker against objects: synthetic, {frames} frames each, one object per {ROOM:g} m2",
        objects,
    )
    task, scenes = crowd(20 if quick else 50, frames)
    n = int(next(iter(scenes)).split()[0])
    seconds = cpu_seconds({h: tracker(h) for h in HYPOTHESES}, task, scenes, repeats)
    crowded: list[Row] = [
        {
            "objects": n,
            "H": h,
            "us per frame": 1e6 * spent / frames,
            "x H=1": spent / seconds[1],
            **alive(h, task, scenes),
        }
        for h, spent in seconds.items()
    ]
    show(f"Tracker against H: synthetic, {n} objects, {frames} frames", crowded)
    exponents = {
        f"objects (H = {h})": growth(objects, "objects", f"us, H={h}") for h in (1, 20)
    }
    exponents[f"H ({n} objects)"] = growth(crowded, "H", "us per frame")
    return {"objects": objects, "crowd": crowded, "growth": exponents}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--data",
        default=None,
        help="data root with KITTI, and nuScenes mini if it is there",
    )
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument(
        "--quick", action="store_true", help="few scenes, once: does it run?"
    )
    parser.add_argument("--json", type=Path, default=None)
    parser.add_argument(
        "--memory", nargs=3, metavar=("WHAT", "H", "SCENE"), help=argparse.SUPPRESS
    )
    given = parser.parse_args()
    if given.memory:
        what, hypotheses, scene = given.memory
        print(json.dumps(memory_here(what, int(hypotheses), given.data, scene)))
        return
    repeats = 1 if given.quick else given.repeats
    results = on_recordings(given.data, repeats, given.quick) | on_crowds(
        10 * repeats, given.quick
    )  # short scenes
    results["growth"]["H (KITTI)"] = growth(results["kitti"], "H", "us per frame")
    show(
        "Exponents: slope of log cost over log size",
        [{"of": k, **v} for k, v in results["growth"].items()],
    )
    if given.json:
        given.json.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

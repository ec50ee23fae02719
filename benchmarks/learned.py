"""Cost of a whole agent with a learned predictor: twenty hypotheses against one, by stage.

    python benchmarks/learned.py [AGENT ...] [--data ROOT] [--repeats 3] [--quick]

AGENT: names of baselines with a parameter ``hypotheses``; by default mtp_modes and mtp. KITTI val and nuScenes mini;
weights must have been trained (baselines/README.md). CPU time of one core, per scene the least of the repeats, in which
all take turns; stages are wall time of one run.
"""

from __future__ import annotations

import argparse
import os
import sys
from typing import Any

os.environ.update(
    dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
)

import mtp_bench.agent.pipeline as pipeline_module
from benchmarks.tracking.report import show
from benchmarks.tracking.scenes import (
    KITTI,
    NUSCENES,
    Row,
    Scenes,
    agent,
    frames_of,
    recordings,
)
from benchmarks.tracking.timing import Pieces, cpu_seconds, stages
from mtp_bench.core import Task
from mtp_bench.core.errors import MtpBenchError
from mtp_bench.prediction import (
    GreedySampler,
    KinematicPredictor,
    KMeansSampler,
    LearnedPredictor,
    LearnedPresence,
)
from mtp_bench.tracking import HypothesisTracker

STAGES: Pieces = (
    (HypothesisTracker, "step", "track"),
    (pipeline_module, "group", "group"),
    (LearnedPredictor, "predict", "forecast"),
    (KinematicPredictor, "predict", "forecast"),
    (GreedySampler, "reduce", "reduce"),
    (KMeansSampler, "reduce", "reduce"),
    (LearnedPresence, "probability", "presence"),
    (pipeline_module, "make_action", "action"),
)


def costs(
    name: str, task: Task, scenes: Scenes, names: list[str], repeats: int
) -> list[Row]:
    starts = {(who, h): agent(h, who) for who in names for h in (1, 5, 20)}
    seconds, frames, rows = (
        cpu_seconds(starts, task, scenes, repeats),
        frames_of(scenes),
        list[Row](),
    )
    for (who, h), start in starts.items():
        row: Row = {
            "scenes": name,
            "agent": who,
            "H": h,
            "CPU ms": 1e3 * seconds[who, h] / frames,
        }
        row["x H=1"] = seconds[who, h] / seconds[who, 1]
        split: dict[str, Any] = {
            stage: us / 1e3
            for stage, us in stages(start, STAGES, task, scenes, 1).items()
        }
        rows.append({**row, **split, "frames/s of forecast": 1e3 / split["forecast"]})
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("agents", nargs="*", default=["mtp_modes", "mtp"])
    parser.add_argument("--data")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="The two shortest scenes.")
    given = parser.parse_args()
    for name, env_id in (("KITTI val", KITTI), ("nuScenes mini", NUSCENES)):
        try:
            rows = costs(
                name,
                *recordings(env_id, given.data, given.quick),
                given.agents,
                given.repeats,
            )
        except MtpBenchError as error:
            print(f"{name} is left out: {error}", file=sys.stderr)
            continue
        show(f"Whole agent, ms per frame: {name}", rows)


if __name__ == "__main__":
    main()

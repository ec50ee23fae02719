"""Measure the curves of robustness, and keep their levels in leaderboard/robustness.

    python benchmarks/robustness.py [--env MTP-nuScenes-mini-v0] [--knob noise] [--jobs 2]

It goes on where it was stopped: finished levels are not run again. MTP-nuScenes-v0 needs the root of v1.0-trainval in
MTP_BENCH_DATA; its truth holds targets alone, so `noise` is that of detections of targets. Networks must be trained first:
`mtp-bench compare ... --train`. Tables and the figure are made of the levels by `python -m docs.generate.robustness`.
"""

import argparse
import time
from pathlib import Path

from mtp_bench.core.parallel import Workers
from mtp_bench.running import LEVELS, Robustness, RunOptions, robustness

FOLDER = Path(__file__).parents[1] / "leaderboard" / "robustness"
AGENTS = (
    "stp",
    "stp_same_samples",
    "stp_neighbours",
    "mtp",
    "affinity",
    "tracking_free",
    "stp_modes_tracklets",
    "perfect_association_same_samples",
)
DRIVERS = ("gt_tracks", "stp", "mtp", "tracking_free")
DRIVE = "MTP-Drive-Intersection-v0"
DRIVE_SCENES = 50
KNOBS = tuple(LEVELS)
PLAN = {
    "MTP-nuScenes-mini-v0": KNOBS,
    "MTP-KITTI-v0": KNOBS,
    "MTP-Intersection-v0": KNOBS,
    "MTP-nuScenes-v0": ("noise", "score", "delay"),
    DRIVE: ("noise", "misses", "delay"),
}


def measure(env: str, knob: str, jobs: int) -> Robustness:
    """Run the agents at the levels of a knob that are not measured yet."""
    is_drive = env == DRIVE
    options = RunOptions(
        scenes=DRIVE_SCENES if is_drive else None, workers=Workers(jobs)
    )
    agents = DRIVERS if is_drive else AGENTS
    return robustness(agents, env, knob, options=options, folder=FOLDER / env)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--env", choices=PLAN, action="append")
    parser.add_argument("--knob", choices=KNOBS, action="append")
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    for env in given.env or PLAN:
        for knob in PLAN[env]:
            if knob in (given.knob or KNOBS):
                start = time.monotonic()
                result = measure(env, knob, given.jobs)
                seconds = time.monotonic() - start
                print(
                    f"{env}, {knob}, {seconds:.0f} s of {given.jobs} processes: {result.answer}",
                    flush=True,
                )


if __name__ == "__main__":
    main()

"""The curves of robustness: measured levels, kept in leaderboard/robustness, and a table and a figure made of them.

    python benchmarks/robustness.py measure [--env MTP-nuScenes-mini-v0] [--knob noise] [--jobs 2]
    python benchmarks/robustness.py show [--markdown page.md] [--figure curves.svg] [--dark]

`measure` goes on where it was stopped: finished levels are not run again. MTP-nuScenes-v0 needs the root of v1.0-trainval
in MTP_BENCH_DATA; its truth holds targets alone, so `noise` is that of detections of targets. Networks must be trained
first: `mtp-bench compare ... --train`.
"""

import argparse
import json
import time
from pathlib import Path

from mtp_bench.core.parallel import Workers
from mtp_bench.running import LEVELS, Level, Robustness, RunOptions, robustness
from mtp_bench.scoring import numbers_of
from mtp_bench.viz import draw_curves

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
SHOWN = (
    "stp",
    "mtp",
    "tracking_free",
    "affinity",
    "stp_modes_tracklets",
)  # in the table
SEES_TRUTH = ("perfect_association_same_samples", "gt_tracks")


def measure(env: str, knob: str, jobs: int) -> Robustness:
    """Run the agents at the levels of a knob that are not measured yet."""
    is_drive = env == DRIVE
    options = RunOptions(
        scenes=DRIVE_SCENES if is_drive else None, workers=Workers(jobs)
    )
    agents = DRIVERS if is_drive else AGENTS
    return robustness(agents, env, knob, options=options, folder=FOLDER / env)


def stored(env: str, knob: str) -> Robustness | None:
    """Return the measured levels of a knob, None without any."""
    contents = [
        json.loads(path.read_text(encoding="utf-8"))
        for path in (FOLDER / env).glob(f"{knob}-*.json")
    ]
    levels = [Level.model_validate(content) for content in contents]
    levels.sort(key=lambda level: level.rows[0].level)
    agents = tuple(
        agent
        for agent in (DRIVERS if env == DRIVE else AGENTS)
        if agent not in SEES_TRUTH
    )
    if not levels:
        return None
    return Robustness(env, knob, agents, ("mtp",), tuple(levels), env == DRIVE)


def page(curves: list[Robustness]) -> str:
    """Return tables of the answers and of bADE by level, in Markdown."""
    lines = ["| environment | error | answer |", "|---|---|---|"]
    lines += [f"| `{each.env}` | `{each.knob}` | {each.answer} |" for each in curves]
    lines += [
        "",
        "| environment | error | agent | value by level | strongest minus recorded | mean by stp |",
    ]
    lines += ["|---|---|---|---|---|--:|"]
    for curve in curves:
        for agent in SHOWN:
            rows = [row for row in curve.on("all") if row.agent == agent]
            values = ", ".join(f"{row.level:g}: {row.value:.3f}" for row in rows)
            if not rows:  # an agent that does not drive
                continue
            mean, interval, p = numbers_of(
                curve.difference(rows[-1], None, curve.recorded)
            )
            rise = "" if mean is None else f"{mean:+.3f}"
            if interval is not None:
                rise += f" [{interval[0]:.3f}, {interval[1]:.3f}], p {p:.3f}"
            ratio = curve.mean_relative[agent]
            lines.append(
                f"| `{curve.env}` | `{curve.knob}` | `{agent}` | {values} | {rise} | {ratio:.3f} |"
            )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("measure")
    one.add_argument("--env", choices=PLAN, action="append")
    one.add_argument("--knob", choices=KNOBS, action="append")
    one.add_argument("--jobs", type=int, default=1)
    two = commands.add_parser("show")
    two.add_argument("--markdown", type=Path)
    two.add_argument("--figure", type=Path)
    two.add_argument("--dark", action="store_true")
    given = parser.parse_args()
    if given.command == "measure":
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
        return
    found = [stored(env, knob) for env, knobs in PLAN.items() for knob in knobs]
    curves = [curve for curve in found if curve is not None]
    text = page(curves)
    print(text)
    if given.markdown:
        given.markdown.write_text(text, encoding="utf-8")
    if given.figure:
        draw_curves(curves[:3], given.figure, given.dark)


if __name__ == "__main__":
    main()

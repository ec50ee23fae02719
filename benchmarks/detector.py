"""Simulated detectors: their time per scene, and their couplings beside those of real ones.

    python benchmarks/detector.py [--data ROOT] [--repeat 5]
    python benchmarks/detector.py --couplings [--set nuscenes] [--seeds 3] [--profiles FOLDER] [--json FILE]

Couplings: for every fold of scenes a profile is fitted to all others; ``--profiles`` keeps these and takes them from
there. Simulated figures are the mean over seeds and, after ±, the deviation.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import asdict
from pathlib import Path

from benchmarks.detection.folds import SETS, Recordings, folds
from benchmarks.detection.table import Row, rows_of, tracker_rows
from mtp_bench.detector import load_profile
from mtp_bench.detector.simulation import simulate
from mtp_bench.detector.visibility import visibility_of

TIMED = {
    "nuscenes": ("nuscenes_megvii", "nuscenes_megvii_raw"),
    "kitti": ("kitti_pointrcnn", "kitti_pointrcnn_raw"),
}


def timed(recordings: Recordings, data: str | None, repeat: int) -> list[list[str]]:
    """CPU milliseconds and detections per scene of each profile, the least over repetitions."""
    classes, scenes = recordings.read(data)
    scenes = scenes[:8]
    seen = [
        visibility_of(one.truth, one.ego, recordings.sensor, one.visible)
        for one in scenes
    ]
    profiles = {name: load_profile(name) for name in TIMED[recordings.name]}
    spent: dict[str, list[float]] = {name: [] for name in profiles}
    count = dict.fromkeys(profiles, 0)
    for seed in range(repeat + 1):
        for (
            name,
            profile,
        ) in profiles.items():  # by turns: what else runs slows all of them
            start, count[name] = time.process_time(), 0
            for scene, at in zip(scenes, seen, strict=True):
                args = (
                    scene.truth,
                    scene.ego,
                    classes,
                    profile,
                    recordings.sensor,
                    seed,
                    profile.dt,
                    at,
                )
                count[name] += len(simulate(*args).box)
            spent[name].append(time.process_time() - start)
    best = {
        name: min(times[1:]) for name, times in spent.items()
    }  # the first call loads what is loaded late
    return [
        [name, f"{1000 * least / len(scenes):.2f}", f"{count[name] / len(scenes):.0f}"]
        for name, least in best.items()
    ]


def coupled(recordings: Recordings, given: argparse.Namespace) -> dict[str, list[Row]]:
    """Rows at the operating point of a tracker, and at all scores."""
    classes, scenes = recordings.read(given.data)
    found = list(folds(recordings, classes, scenes, given.profiles))
    rows = {}
    for title, operating in (("operating point", True), ("all scores", False)):
        rows[title] = rows_of(recordings, classes, found, given.seeds, operating)
        if recordings.name == "nuscenes":
            rows[title] += tracker_rows(
                recordings, classes, found, given.seeds, operating, given.data
            )
    return rows


def show(title: str, columns: tuple[str, ...], rows: list[list[str]]) -> None:
    """Prints a table."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title)
    for column in columns:
        table.add_column(column, justify="left" if column == columns[0] else "right")
    for row in rows:
        table.add_row(*row)
    Console(width=130).print(table)


def cells(row: Row) -> list[str]:
    """A row as text."""
    mean, deviation = row.simulated
    met = "" if row.met else "no"
    return [
        row.what,
        f"{row.real:.3g}",
        f"{mean:.3g} ±{deviation:.2g}",
        row.within,
        met,
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data")
    parser.add_argument("--couplings", action="store_true")
    parser.add_argument("--set", choices=list(SETS), action="append")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--profiles", type=Path)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    if not given.couplings:
        for name in TIMED:
            rows = timed(SETS[name], given.data, given.repeat)
            show(f"{name}: CPU per scene", ("profile", "ms", "detections"), rows)
        return
    content = {}
    for name in given.set or SETS:
        content[name] = coupled(SETS[name], given)
        for title, table in content[name].items():
            columns = ("figure", "real", "simulated", "wanted", "met")
            show(f"{name}, {title}", columns, [cells(row) for row in table])
    if given.json:
        text = {
            one: {title: [asdict(row) for row in rows] for title, rows in two.items()}
            for one, two in content.items()
        }
        given.json.write_text(json.dumps(text, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

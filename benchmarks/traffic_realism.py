"""Simulated traffic beside recorded traffic: how people drive and walk, and how full their scenes are.

    python benchmarks/traffic_realism.py [--data ROOT] [--targets ROOT] [--scenes 36] [--first 400] [--json FILE]

`--data` holds nuScenes mini (truth of all objects) and KITTI, `--targets` the training scenes of nuScenes, where only
prediction targets are known. All are measured by the same code, `traffic_motion.py`, on boxes as they are labelled:
labels jitter by centimetres, simulated boxes do not. The traffic was fitted on seeds below 400; `--first` is the first
seed that is shown.

Errors are those of constant velocity, mean distances over the horizon: of vehicles that move at 0.5 m/s and more, and
of all people on foot, where the next six seconds are known. Parked is who stays within 1 m all the time. Towns are
compared with nuScenes, fast roads with KITTI, which is mostly town and country: errors, braking and headway apply
there; turns, parked cars, crowding and occlusion do not.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.tracking.report import show
from benchmarks.tracking.scenes import KITTI, NUSCENES, Row
from benchmarks.traffic_motion import HORIZONS, PERIOD, motion, samples
from mtp_bench.cards import Card, load_card, with_split
from mtp_bench.core import Floats, Scene
from mtp_bench.sources import open_source
from mtp_bench.traffic.highway.source import HighwayTraffic

TARGETS = "MTP-nuScenes-v0"
TOWNS, ROADS = ("Intersection", "Roundabout"), ("Merge", "Highway")
TOLERANCE = 0.2
Figures = dict[str, float]


@dataclass(frozen=True)
class Figure:
    """A line of the table."""

    name: str
    samples: str
    quantile: float | None = None  # None: the mean
    scale: float = 1.0
    wanted: tuple[float, float] | None = None  # in towns, before the tolerance
    on_roads: tuple[float, float] | None = (
        None  # None and `as_kitti` false: does not apply
    )
    as_kitti: bool = False  # on fast roads KITTI's figure is wanted

    def of(self, values: Floats) -> float | None:
        """The figure, None without samples."""
        if not len(values):
            return None
        made = (
            np.mean(values)
            if self.quantile is None
            else np.quantile(values, self.quantile)
        )
        return self.scale * float(made)


def _same(value: float) -> tuple[float, float]:
    return value, value


_ERRORS = dict(zip(HORIZONS, (0.54, 1.10, 1.82, 4.7), strict=True))
FIGURES = (
    *(
        Figure(
            f"vehicles, error at {h * PERIOD:g} s (m)",
            f"vehicles {h}",
            wanted=_same(_ERRORS[h]),
            as_kitti=True,
        )
        for h in HORIZONS
    ),
    *(
        Figure(f"people, error at {h * PERIOD:g} s (m)", f"people {h}")
        for h in HORIZONS[:-1]
    ),
    Figure("people, error at 6 s (m)", "people 12", wanted=(0.3, 0.7)),
    Figure("people, error at 6 s, 50 % (m)", "people 12", 0.5),
    Figure(
        "braking below -3 m/s2 (% of time)", "hard", None, 100, _same(1.0), _same(1.0)
    ),
    Figure("acceleration, 5 % (m/s2)", "acceleration", 0.05),
    Figure("acceleration, 95 % (m/s2)", "acceleration", 0.95),
    Figure("headway, 1 % (s)", "headway", 0.01, 1, (0.5, 0.6), (0.5, 0.6)),
    Figure("headway, 10 % (s)", "headway", 0.1),
    Figure("headway, 50 % (s)", "headway", 0.5),
    Figure("yaw rate, 90 % (rad/s)", "yaw rate", 0.9, 1, _same(0.19)),
    *(
        Figure(f"speed of moving, {q} % (m/s)", "speed", q / 100)
        for q in (10, 25, 50, 75, 95)
    ),
    *(
        Figure(f"vehicles {name} (%)", name, None, 100)
        for name in ("parked", "standing", "moving")
    ),
    Figure("people slower than 0.3 m/s (%)", "pausing", None, 100),
    Figure("speed of who walks, 50 % (m/s)", "walking", 0.5),
    Figure("vehicles per frame", "vehicles"),
    Figure("people per frame", "people"),
    Figure("others within 5 m", "within 5"),
    Figure("others within 10 m", "within 10"),
    *(Figure(f"occlusion level {k} (%)", f"occluded {k}", None, 100) for k in range(4)),
)


def figures(scenes: Iterable[Scene], card: Card) -> Figures:
    every = [samples(motion(scene, card.task.classes)) for scene in scenes]
    made = {
        figure.name: figure.of(np.concatenate([each[figure.samples] for each in every]))
        for figure in FIGURES
    }
    return {name: value for name, value in made.items() if value is not None}


def recorded(env_id: str, data: str | None, split: str | None = None) -> Figures:
    card = load_card(env_id) if split is None else with_split(load_card(env_id), split)
    source = open_source(card, data)
    return figures((source.load(name) for name in source.names), card)


def simulated(name: str, seeds: range) -> Figures:
    card = with_split(load_card(f"MTP-{name}-v0"), "train")
    source = HighwayTraffic(card)
    return figures((source.load(source.name_of(seed)) for seed in seeds), card)


def table(real: dict[str, Figures], made: dict[str, Figures], roads: bool) -> list[Row]:
    rows: list[Row] = []
    for figure in FIGURES:
        values = {
            name: column.get(figure.name) for name, column in (real | made).items()
        }
        wanted = figure.on_roads if roads else figure.wanted
        if roads and figure.as_kitti:
            wanted = _same(real["KITTI"][figure.name])
        rows.append(
            {
                "figure": figure.name,
                **values,
                **_judged(wanted, {n: values[n] for n in made}),
            }
        )
    return rows


def _judged(wanted: tuple[float, float] | None, values: dict[str, float | None]) -> Row:
    if wanted is None:
        return {}
    low, high = (1 - TOLERANCE) * wanted[0], (1 + TOLERANCE) * wanted[1]
    beside = [
        name
        for name, value in values.items()
        if value is not None and not low <= value <= high
    ]
    return {"wanted": f"{low:.2f} to {high:.2f}", "not reached": ", ".join(beside)}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--data", default=None, help="root with nuScenes mini and KITTI"
    )
    parser.add_argument(
        "--targets", default=None, help="root with the training scenes of nuScenes"
    )
    parser.add_argument(
        "--scenes", type=int, default=36, help="simulated scenes of each kind"
    )
    parser.add_argument("--first", type=int, default=400, help="first seed")
    parser.add_argument("--json", type=Path, default=None)
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.scenes)
    kitti = {"KITTI": recorded(KITTI, given.data)}
    town = {"nuScenes mini": recorded(NUSCENES, given.data)}
    if given.targets is not None:
        town["nuScenes targets"] = recorded(TARGETS, given.targets, "train")
    of_towns, of_roads = (
        {name: simulated(name, seeds) for name in names} for names in (TOWNS, ROADS)
    )
    shown = f"seeds {seeds.start} to {seeds.stop - 1}"
    show(f"Towns: {shown}", table(town | kitti, of_towns, roads=False))
    show(f"Fast roads: {shown}", table(kitti, of_roads, roads=True))
    if given.json:
        content = {
            "scenes": given.scenes,
            "first": given.first,
            "figures": town | kitti | of_towns | of_roads,
        }
        given.json.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

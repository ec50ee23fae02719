"""Couplings of a detector, real and simulated, and the wanted tolerance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np

from mtp_bench.core import Scene
from mtp_bench.training.detector_fit.samples import (
    Samples,
    above_floor,
    collect_samples,
)

from .couplings import DISTANCES, Couplings, couplings
from .events import switches_and_losses
from .folds import Fold, Recordings, detected

# Wanted: within this of the real figure, or within this share of it. Those without are for information.
ABSOLUTE = {
    "score_and_error": 0.07,
    "miss_ahead": 0.05,
    "misses_together": 0.07,
    "errors_together": 0.08,
}
EVERY = "all classes"
RELATIVE = {
    "change": 0.2,
    "false_together": 0.3,
    "false_long": 0.3,
    "duplicates": 0.5,
    "switches": 0.25,
    "losses": 0.25,
}


@dataclass(frozen=True)
class Row:
    """One figure of one class at one floor; of simulated ones the mean and the deviation over seeds."""

    what: str
    real: float
    simulated: tuple[float, float]
    within: str  # wanted tolerance; empty: none
    met: bool


Figures = dict[str, dict[str, list[float]]]  # by class and by what is measured


def rows_of(
    recordings: Recordings,
    classes: Sequence[str],
    found: Sequence[Fold],
    seeds: int,
    operating: bool,
) -> list[Row]:
    """Rows of every class with enough detections, at the operating point of a tracker or at all scores."""
    floor = recordings.floors(classes) if operating else None

    def measured(of: Callable[[Fold], list[Scene]]) -> Figures:
        scenes = [scene for fold in found for scene in of(fold)]
        samples = collect_samples(
            scenes, classes, recordings.sensor, floor, pooled=recordings.pooled
        )
        figures = {
            name: _numbers(couplings(*one))
            for name, one in samples.items()
            if _enough(one)
        }
        return {**figures, EVERY: {"duplicates": [_duplicates(list(samples.values()))]}}

    real = measured(lambda fold: fold.scenes)
    simulated = [
        measured(partial(detected, recordings=recordings, classes=classes, seed=seed))
        for seed in range(seeds)
    ]
    rows = []
    for name, figures in real.items():
        for what, numbers in figures.items():
            runs = [run[name][what] for run in simulated if name in run]
            wanted = (
                what if what != "duplicates" or name == EVERY else ""
            )  # of one class they are few
            rows += _rows(f"{name}: {what}", wanted, numbers, runs)
    return rows


def _duplicates(samples: Sequence[Samples]) -> float:
    """Per 1 000 hits of all classes."""
    return (
        1000.0
        * sum(int(one.duplicate.sum()) for _, one in samples)
        / sum(int(one.hit.sum()) for one, _ in samples)
    )


def _enough(samples: Samples) -> bool:
    return bool(samples[0].hit.sum() >= 100)


def _numbers(figures: Couplings) -> dict[str, list[float]]:
    values = {one.name: getattr(figures, one.name) for one in fields(Couplings)}
    return {
        name: list(value) if isinstance(value, tuple) else [value]
        for name, value in values.items()
    }


def _rows(
    what: str, name: str, real: list[float], runs: list[list[float]]
) -> list[Row]:
    rows = []
    for i, true in enumerate(real):
        if not np.isfinite(true):
            continue
        where = f", {DISTANCES[i]:g} to {DISTANCES[i + 1]:g} m" if len(real) > 1 else ""
        simulated = _summary([run[i] for run in runs])
        if simulated is not None:
            rows.append(row(what + where, name, true, simulated))
    return rows


def _summary(value: list[float]) -> tuple[float, float] | None:
    known = [one for one in value if np.isfinite(one)]
    return (float(np.mean(known)), float(np.std(known))) if known else None


def row(what: str, name: str, real: float, simulated: tuple[float, float]) -> Row:
    """A row with the wanted tolerance of the figure ``name``."""
    if name in ABSOLUTE:
        return Row(
            what,
            real,
            simulated,
            f"±{ABSOLUTE[name]:g}",
            abs(simulated[0] - real) <= ABSOLUTE[name],
        )
    if name in RELATIVE:
        met = abs(simulated[0] - real) <= RELATIVE[name] * abs(real)
        return Row(what, real, simulated, f"±{100 * RELATIVE[name]:.0f} %", met)
    return Row(what, real, simulated, "", True)


def tracker_rows(
    recordings: Recordings,
    classes: Sequence[str],
    found: Sequence[Fold],
    seeds: int,
    operating: bool,
    data: str | None,
) -> list[Row]:
    """Switches and losses of STP on all scenes."""
    floor = recordings.floors(classes) if operating else None

    def events(of: Callable[[Fold], list[Scene]]) -> tuple[int, int]:
        scenes = [scene for fold in found for scene in of(fold)]
        kept = [
            replace(one, detections=above_floor(one.detections, classes, floor))
            for one in scenes
        ]
        return switches_and_losses(recordings.env, data, kept)

    real = events(lambda fold: fold.scenes)
    runs = [
        events(partial(detected, recordings=recordings, classes=classes, seed=seed))
        for seed in range(seeds)
    ]
    rows = []
    for i, name in enumerate(("switches", "losses")):
        simulated = _summary([float(run[i]) for run in runs])
        assert simulated is not None
        rows.append(row(f"STP: {name}", name, float(real[i]), simulated))
    return rows

"""The couplings of a detector: real, by model 1, by model 2, and how near model 2 is wanted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from mtp_bench.detector.fit.samples import Samples, at_floor, collect
from mtp_bench.types import Scene

from .couplings import DISTANCES, Couplings, couplings
from .events import switches_and_losses
from .folds import Fold, Recordings, detected

# Wanted: within this of the real figure, or within this share of it. Those without are for information.
ABSOLUTE = {"score_and_error": 0.07, "miss_ahead": 0.05, "misses_together": 0.07, "errors_together": 0.08}
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
    model1: tuple[float, float] | None
    model2: tuple[float, float]
    within: str  # what is wanted; empty: nothing
    met: bool


Figures = dict[str, dict[str, list[float]]]  # by class and by what is measured


def rows_of(
    recordings: Recordings, classes: Sequence[str], found: Sequence[Fold], seeds: int, operating: bool
) -> list[Row]:
    """Rows of every class with enough detections, at the operating point of a tracker or at all scores."""
    floor = recordings.floors(classes) if operating else None

    def measured(of: Callable[[Fold], list[Scene]]) -> Figures:
        scenes = [scene for fold in found for scene in of(fold)]
        samples = collect(scenes, classes, recordings.sensor, floor, pooled=recordings.pooled)
        figures = {name: _numbers(couplings(*one)) for name, one in samples.items() if _enough(one)}
        return {**figures, EVERY: {"duplicates": [_duplicates(list(samples.values()))]}}

    def simulated(seed: int, first: bool) -> Figures:
        return measured(
            lambda fold: detected(fold, recordings, classes, recordings.model1 if first else fold.profile, seed)
        )

    real = measured(lambda fold: fold.scenes)
    second = [simulated(seed, first=False) for seed in range(seeds)]
    first = [simulated(seed, first=True) for seed in range(seeds)] if operating else []  # it has no raw profile
    rows = []
    for name, figures in real.items():
        for what, numbers in figures.items():
            runs = [[run[name][what] for run in model if name in run] for model in (first, second)]
            wanted = what if what != "duplicates" or name == EVERY else ""  # of one class they are few
            rows += _rows(f"{name}: {what}", wanted, numbers, *runs)
    return rows


def _duplicates(samples: Sequence[Samples]) -> float:
    """Per 1 000 hits of all classes."""
    return 1000.0 * sum(int(one.duplicate.sum()) for _, one in samples) / sum(int(one.hit.sum()) for one, _ in samples)


def _enough(samples: Samples) -> bool:
    return bool(samples[0].hit.sum() >= 100)


def _numbers(figures: Couplings) -> dict[str, list[float]]:
    values = {one.name: getattr(figures, one.name) for one in fields(Couplings)}
    return {name: list(value) if isinstance(value, tuple) else [value] for name, value in values.items()}


def _rows(what: str, name: str, real: list[float], first: list[list[float]], second: list[list[float]]) -> list[Row]:
    rows = []
    for i, true in enumerate(real):
        if not np.isfinite(true):
            continue
        where = f", {DISTANCES[i]:g} to {DISTANCES[i + 1]:g} m" if len(real) > 1 else ""
        one, two = (_summary([run[i] for run in runs]) for runs in (first, second))
        if two is not None:
            rows.append(row(what + where, name, true, one, two))
    return rows


def _summary(value: list[float]) -> tuple[float, float] | None:
    known = [one for one in value if np.isfinite(one)]
    return (float(np.mean(known)), float(np.std(known))) if known else None


def row(what: str, name: str, real: float, one: tuple[float, float] | None, two: tuple[float, float]) -> Row:
    """A row with what is wanted of the figure ``name``."""
    if name in ABSOLUTE:
        return Row(what, real, one, two, f"±{ABSOLUTE[name]:g}", abs(two[0] - real) <= ABSOLUTE[name])
    if name in RELATIVE:
        met = abs(two[0] - real) <= RELATIVE[name] * abs(real)
        return Row(what, real, one, two, f"±{100 * RELATIVE[name]:.0f} %", met)
    return Row(what, real, one, two, "", True)


def tracker_rows(
    recordings: Recordings, classes: Sequence[str], found: Sequence[Fold], seeds: int, operating: bool,
    data: str | None,
) -> list[Row]:  # fmt: skip
    """Switches and losses of STP on all scenes."""
    floor = recordings.floors(classes) if operating else None

    def events(of: Callable[[Fold], list[Scene]]) -> tuple[int, int]:
        scenes = [scene for fold in found for scene in of(fold)]
        kept = [replace(one, detections=at_floor(one.detections, classes, floor)) for one in scenes]
        return switches_and_losses(recordings.env, data, kept)

    def simulated(seed: int, first: bool) -> tuple[int, int]:
        return events(
            lambda fold: detected(fold, recordings, classes, recordings.model1 if first else fold.profile, seed)
        )

    real = events(lambda fold: fold.scenes)
    one = [simulated(seed, True) for seed in range(seeds)] if operating else []
    two = [simulated(seed, False) for seed in range(seeds)]
    rows = []
    for i, name in enumerate(("switches", "losses")):
        second = _summary([float(run[i]) for run in two])
        assert second is not None
        rows.append(row(f"STP: {name}", name, float(real[i]), _summary([float(run[i]) for run in one]), second))
    return rows

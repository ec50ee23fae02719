"""What lies behind an agent's row: parts of the error, bins, the curve over k, tracking, own events."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..types import Bools
from .definitions import DISTANCE_BINS, PLANNING_SIGMA
from .end_to_end import end_to_end_accuracy, forecast_average_precision
from .score import KINDS
from .stream import StreamCounts
from .table import AgentTable

Array = NDArray[np.float64]
Row = dict[str, Any]

OWN = ("own_ids", "own_frag", "all_h_ids", "all_h_frag")


def details(table: AgentTable, card: Card) -> Row:
    """Details of one agent over all targets, as a record that can be written as JSON."""
    given = table.given
    first = given.seeds[0]
    everything = table.mask["all"]
    frames = sum(score.frames for score in table.scores)
    spurious = sum(int(score.spurious.sum()) for score in table.scores)
    return {
        "agent": given.agent,
        "hypotheses": given.hypotheses,
        "samples": given.samples,
        "budget": given.budget,
        "seeds": len(given.seeds),
        "parts": _parts(table),
        "silence": float(table.miss_error.mean()) if len(table.miss_error) else None,  # what saying nothing scores
        "miss_rate": _ratio((table.covered - table.hit).sum(), table.covered.sum()),
        "PI_ADE": _planning_aware(table) if card.has_ego else None,
        "EPA": _accuracy(table, everything, spurious),
        "AP_f": _average_precision(table, card),
        "forecasts_per_frame": table.forecasts,
        "spurious_per_frame": _ratio(spurious, frames) if table.complete else None,
        "k_curve": {str(k): _ratio(table.curve[:, i].sum(), table.covered.sum()) for i, k in enumerate(first[0].ks)},
        "bins": _bins(table, card),
        "own": {name: _own(table, name) for name in OWN},
        "own_events": {kind: sum(len(score.events[kind]) for score in first) for kind in KINDS},
        "tracking": _tracking([score.counts for score in first], card, table.complete),
        "invalid": dict(
            zip(
                ("tracks", "hypotheses", "objects"),
                np.sum([score.invalid for score in table.scores], axis=0).tolist(),
                strict=True,
            )
        ),
        "dropped_detections": sum(score.dropped for score in table.scores),
    }


def _parts(table: AgentTable) -> Row:
    """The missing-aware error of "all" as a sum: localisation, missed, false."""
    count = len(table.capped)
    return {
        "localisation": _ratio((table.capped - table.missed).sum(), count),
        "missed": _ratio(table.missed.sum(), count),
        "false": _ratio(table.spurious_error.sum(), count) if table.complete else None,
    }


def _planning_aware(table: AgentTable) -> float | None:
    """PI-ADE: min(minADE, c) with c for missing targets, weighted by how near they come to the ego."""
    weight = np.exp(-(table.approach**2) / (2.0 * PLANNING_SIGMA**2))
    return _ratio((weight * table.capped).sum(), weight.sum())


def _accuracy(table: AgentTable, mask: Bools, spurious: int) -> float | None:
    if not table.complete:
        return None
    seeds = len(table.given.seeds)
    return end_to_end_accuracy(table.hit[mask].sum() / seeds, spurious / seeds, int(mask.sum()))


def _average_precision(table: AgentTable, card: Card) -> float | None:
    """Mean over the classes with targets; the forecasts state no confidence, so each class has one point."""
    if not table.complete:
        return None
    values = []
    for c in range(len(card.task.classes)):
        mask = table.class_id == c
        right = int(table.near[mask].sum())
        wrong = int(table.covered[mask].sum()) - right + sum(int(s.spurious_of_class[c]) for s in table.scores)
        correct = np.repeat([True, False], [right, wrong])
        value = forecast_average_precision(correct, np.zeros(len(correct)), int(mask.sum()) * len(table.given.seeds))
        if value is not None:
            values.append(value)
    return float(np.mean(values)) if values else None


def _bins(table: AgentTable, card: Card) -> list[Row]:
    """Errors by distance to the ego (where there is one), by class, moving or static."""
    bins: list[tuple[str, str, Bools]] = [
        ("distance", f"{low:g}-{high:g} m", (table.distance >= low) & (table.distance < high))
        for low, high in pairwise(DISTANCE_BINS)
        if card.has_ego
    ]
    bins += [("class", name, table.class_id == c) for c, name in enumerate(card.task.classes)]
    bins += [("motion", "moving", table.moving), ("motion", "static", ~table.moving)]
    rows = [{"by": by, "bin": name, **_errors(table, mask)} for by, name, mask in bins]
    for c, row in enumerate(row for row in rows if row["by"] == "class"):
        row["EPA"] = _accuracy(table, table.class_id == c, sum(int(s.spurious_of_class[c]) for s in table.scores))
    return rows


def _errors(table: AgentTable, mask: Bools) -> Row:
    targets, covered = int(mask.sum()), table.covered[mask].sum()
    return {
        "minADE": _ratio(table.min_ade[mask].sum(), covered),
        "minFDE": _ratio(table.min_fde[mask].sum(), covered),
        "missing_aware": _ratio(table.capped[mask].sum(), targets),
        "coverage": _ratio(covered / len(table.given.seeds), targets),
        "targets": targets,
        "objects": table.objects(mask),
        "scenes": len(np.unique(table.scene[mask])),
    }


def _own(table: AgentTable, name: str) -> Row:
    """Errors where the agent itself (its first seed) has the event: shown, never ranked."""
    return _errors(table, np.concatenate([getattr(score, name) for score in table.given.seeds[0]]))


def _tracking(counts: list[StreamCounts], card: Card, complete: bool) -> Row:
    """CLEAR numbers of the first seed, of all classes and per class; false output only where the truth is complete."""
    summed = {name: np.sum([getattr(c, name) for c in counts], axis=0) for name in _COUNTS}
    pooled = {name: value.sum() for name, value in summed.items()}
    return {
        "all": _clear(pooled, card, complete),
        **{
            name: _clear({k: v[i] for k, v in summed.items()}, card, complete)
            for i, name in enumerate(card.task.classes)
        },
        "false_positives": sum(c.false_positives for c in counts) if complete else None,
        "spurious_tracks": sum(c.spurious_tracks for c in counts) if complete else None,
    }


_COUNTS = ("truth", "tp", "fp", "fn", "ids", "frag", "cost")


def _clear(count: dict[str, Any], card: Card, complete: bool) -> Row:
    overlap = card.task.event_gate.measure == "iou_3d"
    mean = _ratio(count["cost"], count["tp"])
    errors = count["fn"] + count["fp"] + count["ids"]
    return {
        "TP": int(count["tp"]),
        "FP": int(count["fp"]) if complete else None,
        "FN": int(count["fn"]),
        "IDS": int(count["ids"]),
        "FRAG": int(count["frag"]),
        "MOTA": 1.0 - float(errors / count["truth"]) if complete and count["truth"] else None,
        # mean IoU or mean distance in metres, as the event gate measures
        "MOTP": None if mean is None else 1.0 - mean if overlap else mean,
    }


def _ratio(top: float, bottom: float) -> float | None:
    return float(top / bottom) if bottom > 0 else None

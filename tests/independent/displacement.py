"""Numbers of one forecast against the future of one target."""

import math
from dataclasses import dataclass

import numpy as np

from mtp_bench.core import Floats, Rollout


@dataclass(frozen=True)
class Numbers:
    """Numbers of one target and one forecast."""

    min_ade: float
    min_fde: float
    miss: bool
    energy: float
    one_sample: float  # expected ADE of a random sample, where the k-curve begins


def stated(rollout: Rollout, row: int, present: Floats | None = None) -> tuple[Floats, Floats]:
    """Paths [n, T, 2] and weights [n] of the samples that count, from the object's present place or from another."""
    weight = np.exp(rollout.forecast_log_weight[row].astype(float))
    paths = (rollout.object_box[row, :2] if present is None else present) + rollout.forecast[row].astype(float) / 100.0
    there = weight > 0
    paths, weight = paths[there], weight[there] / weight[there].sum()
    kept = weight >= 0.01 / len(weight) if len(weight) else there[:0]
    return paths[kept], weight[kept] / weight[kept].sum()


def numbers(paths: Floats, weight: Floats, future: Floats) -> Numbers:
    """All numbers per target; a forecast without a sample is infinitely far away."""
    if not len(paths):
        return Numbers(math.inf, math.inf, True, math.inf, math.inf)
    errors = [[math.dist(at, true) for at, true in zip(path, future, strict=True)] for path in paths]
    ade = sorted(sum(e) / len(e) for e in errors)
    fde = min(e[-1] for e in errors)
    return Numbers(ade[0], fde, fde > 2.0, _energy(paths, weight, future), sum(ade) / len(ade))


def _energy(paths: Floats, weight: Floats, future: Floats) -> float:
    flat, true = [list(path.ravel()) for path in paths], list(future.ravel())
    far = sum(w * math.dist(x, true) for w, x in zip(weight, flat, strict=True))
    apart = sum(
        wa * wb * math.dist(a, b)
        for wa, a in zip(weight, flat, strict=True)
        for wb, b in zip(weight, flat, strict=True)
    )
    return float(far - apart / 2) / math.sqrt(len(future))

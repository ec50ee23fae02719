"""Scores and false positives, fitted: normal numbers that end at the detector's floor and ceiling; rates and places."""

from __future__ import annotations

import numpy as np

from ...types import Floats
from ..profile import FalsePositives, ScoreNoise
from ..truncated import fit_truncated, latent_of
from .errors import fit_memory
from .samples import FalsePositiveSamples, ObjectSamples

_FEW = 20  # boxes from which the variation of the rate and the survival are taken
_LONGEST = 0.95  # survival from frame to frame that is believed
_NEAREST = 2.0  # m: the sensor's own vehicle is there


def fit_score(objects: ObjectSamples, floor: float) -> ScoreNoise:
    """Location as a parabola of the distance, deviation, and the memory of the latent numbers behind the scores."""
    distance, score = objects.feature[:, 1], objects.score
    hit = objects.hit
    probability = floor < 1 and bool(((score[hit] >= 0) & (score[hit] <= 1)).all())
    ceiling = 1.0 if probability else np.inf
    power = np.column_stack([np.ones(len(score)), distance, distance**2])
    parabola, deviation = fit_truncated(score[hit], power[hit], floor, ceiling)
    every = np.ones(len(score))
    latent = latent_of(score, power @ parabola, deviation * every, floor * every, ceiling * every)
    memory = fit_memory(objects, latent if deviation else 0 * score)
    return ScoreNoise(
        quadratic=(round(float(parabola[0]), 4), round(float(parabola[1]), 4), round(float(parabola[2]), 4)),
        deviation=round(deviation, 4), floor=floor, ceiling=1.0 if probability else None,
        bias=memory.bias, ar=memory.ar, phi=memory.phi, white=memory.white,
    )  # fmt: skip


def fit_false_score(score: Floats, limits: ScoreNoise) -> tuple[float, float]:
    """Location and deviation of the scores of false positives between the limits of the true ones'."""
    ceiling = np.inf if limits.ceiling is None else limits.ceiling
    location, deviation = fit_truncated(score, np.ones((len(score), 1)), limits.floor, ceiling)
    return float(location[0]), deviation


def fit_false_positives(false: FalsePositiveSamples, limits: ScoreNoise) -> FalsePositives | None:
    """False positives per frame without the duplicates of true boxes; None where there are none.

    ``limits`` has the floor and the ceiling of the scores.
    """
    own = ~false.duplicate
    if not own.any():
        return None
    judged = own & false.judged
    enough = judged.sum() >= _FEW
    dispersion = max(float(false.own.var() / false.own.mean()), 1.0) if enough else 1.0
    survive = min(float(np.mean(false.followed[judged])), _LONGEST) if enough else 0.0
    size = false.size[own].mean(axis=0)
    distance = np.maximum(np.quantile(false.distance[own], np.linspace(0.0, 1.0, 11)), _NEAREST)
    score, deviation = fit_false_score(false.score[own], limits)
    return FalsePositives(
        rate=round(float(false.own.mean()), 4),
        dispersion=round(dispersion, 4),
        survive=round(survive, 4),
        score=round(score, 4),
        score_deviation=round(deviation, 4),
        size=(round(float(size[0]), 4), round(float(size[1]), 4), round(float(size[2]), 4)),
        distance=tuple(round(float(one), 2) for one in distance),
    )

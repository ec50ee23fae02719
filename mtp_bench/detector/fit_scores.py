"""Scores of true and of false detections, fitted: normal numbers that end at the detector's floor and ceiling."""

from __future__ import annotations

import numpy as np

from ..types import Floats
from .fit_errors import fit_memory
from .profile import ScoreNoise
from .samples import ObjectSamples
from .truncated import fit_truncated, latent_of


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

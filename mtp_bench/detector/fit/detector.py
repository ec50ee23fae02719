"""The noise profile of a real detector, fitted to its detections of known objects."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from ...errors import DataError
from ...types import Bools, Floats, Scene
from ..profile import ClassNoise, FalsePositives, Profile, ScoreNoise, UndetectedNoise
from ..sight import Sensor
from ..truncated import fit_truncated, latent_of
from .errors import fit_heading, fit_height, fit_memory, fit_position, fit_size, fit_velocity, triple
from .samples import RADIAL, TANGENTIAL, FalsePositiveSamples, ObjectSamples, collect

LEAST_HITS = 100  # detections of true boxes that a class needs to be fitted
_FEW = 20  # boxes from which the variation of the rate and the survival are taken
_LONGEST = 0.95  # survival from frame to frame that is believed
_NEAREST = 2.0  # m: the sensor's own vehicle is there
_RIDGE = 1.0  # inverse variance of a weight around its prior; keeps a feature that never occurs at the prior
_STEPS = 50


def fit_profile(
    scenes: Iterable[Scene],
    classes: Sequence[str],
    dt: float,
    sensor: Sensor,
    name: str,
    summary: str,
    source: str,
    floor: Mapping[str, float] | None = None,
) -> Profile:
    """The profile of the detector that made the detections of ``scenes``, for the classes with enough data.

    ``sensor`` is what the detector can see, ``name``, ``summary`` and ``source`` are texts of the profile.
    ``dt`` is the frame period in seconds, ``floor`` the operating point per class: detections with a lower score are
    not used; without one the lowest score that occurs becomes it. Classes with fewer than 100 detections of true
    boxes are left out of the profile; DataError if none remains.
    """
    samples = collect(scenes, classes, sensor, floor)
    enough = [one for one in classes if samples[one][0].hit.sum() >= LEAST_HITS]
    if not enough:
        hits = ", ".join(f"{one} {int(samples[one][0].hit.sum())}" for one in classes)
        raise DataError(
            f"no detector profile can be fitted: detections of true boxes: {hits}; expected at least {LEAST_HITS} of "
            "one class. Give more scenes, or a lower floor of the scores"
        )
    noise = {one: _fit_class(*samples[one], None if floor is None else floor.get(one)) for one in enough}
    return Profile(
        name=name,
        summary=summary,
        source=source,
        dt=dt,
        field_of_view=round(float(np.rad2deg(min(sensor.field_of_view, 2 * np.pi))), 4),
        classes=noise,
    )


def _fit_class(objects: ObjectSamples, false: FalsePositiveSamples, floor: float | None) -> ClassNoise:
    hits = int(objects.hit.sum())
    lowest = min(objects.score[objects.hit].min(), false.score.min(initial=float("inf")))
    score = fit_score(objects, math.floor(1e4 * float(lowest)) / 1e4 if floor is None else floor)
    return ClassNoise(
        miss=fit_undetected(objects),
        radial=fit_position(objects, RADIAL),
        tangential=fit_position(objects, TANGENTIAL),
        heading=fit_heading(objects),
        size=fit_size(objects),
        score=score,
        false_positives=fit_false_positives(false, score),
        velocity=fit_velocity(objects),
        z=fit_height(objects),
        duplicates=round(min(float(false.duplicate.sum()) / hits, 1.0), 4),
    )


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
    return ScoreNoise(
        quadratic=triple(parabola),
        deviation=round(deviation, 4),
        floor=floor,
        ceiling=1.0 if probability else None,
        **fit_memory(objects, latent if deviation else 0 * score).model_dump(),
    )


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
    distance = np.maximum(np.quantile(false.distance[own], np.linspace(0.0, 1.0, 11)), _NEAREST)
    score, deviation = fit_false_score(false.score[own], limits)
    return FalsePositives(
        rate=round(float(false.own.mean()), 4),
        dispersion=round(dispersion, 4),
        survive=round(survive, 4),
        score=round(score, 4),
        score_deviation=round(deviation, 4),
        size=triple(false.size[own].mean(axis=0)),
        distance=tuple(round(float(one), 2) for one in distance),
    )


def fit_undetected(objects: ObjectSamples) -> UndetectedNoise:
    """Log-odds of being undetected in an object's first frame, and in later ones with the memory of the frame before.

    First frames are few, one per object: their weights are drawn towards those of all frames.
    """
    undetected = ~objects.hit
    earlier, later = objects.pairs()
    first = np.ones(len(undetected), dtype=bool)
    first[later] = False
    everywhere = logistic(objects.feature, undetected, np.zeros(6))
    with_memory = np.column_stack([objects.feature[later], undetected[earlier].astype(np.float64)])
    return UndetectedNoise(
        first=_row(logistic(objects.feature[first], undetected[first], everywhere)),
        later=_row(logistic(with_memory, undetected[later], np.append(everywhere, 0.0))),
    )


def logistic(feature: Floats, outcome: Bools, prior: Floats) -> Floats:
    """Weights ``[n]`` of the features ``[R, n]`` in the log-odds of ``outcome``, with a normal prior around ``prior``.

    Newton's method; the problem is convex. Steps are halved until the penalised likelihood grows.
    """
    weight = np.array(prior, dtype=np.float64)
    value = _penalised(feature, outcome, weight, prior)
    for _ in range(_STEPS):
        chance = 1 / (1 + np.exp(-feature @ weight))
        slope = feature.T @ (outcome - chance) - _RIDGE * (weight - prior)
        curvature = (feature * (chance * (1 - chance))[:, None]).T @ feature + _RIDGE * np.eye(len(weight))
        step = np.linalg.solve(curvature, slope)
        new = _penalised(feature, outcome, weight + step, prior)
        while new < value and np.abs(step).max() > 1e-9:
            step = step / 2
            new = _penalised(feature, outcome, weight + step, prior)
        weight, value = weight + step, new
        if np.abs(step).max() < 1e-9:
            break
    return weight


def _penalised(feature: Floats, outcome: Bools, weight: Floats, prior: Floats) -> float:
    """Log-likelihood less the penalty."""
    sign = np.where(outcome, -1.0, 1.0)
    return float(-np.logaddexp(0.0, sign * (feature @ weight)).sum() - _RIDGE / 2 * ((weight - prior) ** 2).sum())


def _row(weight: Floats) -> tuple[float, ...]:
    return tuple(round(float(value), 4) for value in weight)

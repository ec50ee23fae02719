"""Quality, score and errors of true objects, fitted to those that were hit and those that were not."""

from __future__ import annotations

import numpy as np

from ....types import Bools, Floats, Ints
from ...fit.errors import fit_heading, fit_size, fit_velocity, robust_deviation, shares_of
from ...fit.samples import HEIGHT, RADIAL, TANGENTIAL, ObjectSamples
from ..neighbours import Neighbours, neighbours_of
from ..profile import ClassNoise, PositionNoise
from .quality import LENGTH, fit_quality, random_part

_LAGS = (1, 2, 3, 4, 6, 8, 12, 16)  # frames
_FEW = 50  # pairs from which a correlation is taken
_CLOSE = 5.0  # m: neighbours whose errors are compared
_DRAWS = 100_000
_BOUND = 3.0  # of a latent number: one wild error does not make a correlation


def fit_objects(objects: ObjectSamples, floor: float) -> ClassNoise:
    """The noise of a class without false positives."""
    quality = fit_quality(objects, floor)
    random = np.clip(random_part(objects, quality), -4.0, 4.0)
    off = objects.error[:, [RADIAL, TANGENTIAL]]
    (radial, tangential), nu = _margins(off, objects.feature[:, 1], random, objects)
    near = neighbours_of(objects.place, _moment(objects), objects.object, LENGTH)
    axes = []
    for column, (s0, s1, gain) in enumerate((radial, tangential)):
        latent = off[:, column] / ((s0 + s1 * objects.feature[:, 1]) * np.exp(-gain * random))
        memory = _memory_of(objects, latent)
        lasting = (1.0 - memory["white"]) * _attenuation(nu)
        shared = _shared(np.clip(latent, -_BOUND, _BOUND), near, objects, lasting)
        axes.append(PositionNoise(s0=round(s0, 4), s1=round(s1, 4), quality=round(gain, 4), shared=shared, **memory))
    return ClassNoise(
        quality=quality,
        radial=axes[0],
        tangential=axes[1],
        nu=round(nu, 4),
        heading=fit_heading(objects),
        size=fit_size(objects),
        velocity=fit_velocity(objects),
        z=_height(objects),
    )


def _height(objects: ObjectSamples) -> tuple[float, float]:
    """Mean error of the centre's height, and the deviation of what is new in every frame, m."""
    error = objects.error[:, HEIGHT]
    earlier, later = objects.hit_pairs()
    change = robust_deviation(error[later] - error[earlier]) or 0.0
    return round(float(error[objects.hit].mean()), 4), round(change / np.sqrt(2.0), 4)


def _moment(objects: ObjectSamples) -> Ints:
    return np.asarray(objects.scene * (int(objects.frame.max(initial=0)) + 1) + objects.frame)


Axis = tuple[float, float, float]  # s0, s1, gain


def _margins(off: Floats, distance: Floats, random: Floats, objects: ObjectSamples) -> tuple[tuple[Axis, Axis], float]:
    """s0, s1 and gain of both axes, and nu, of errors distributed as ``(s0 + s1 d) exp(-gain q) T_nu``."""
    from scipy.optimize import minimize
    from scipy.special import gammaln

    hit = objects.hit
    error, distance, quality = np.abs(off[hit]), distance[hit], random[hit]

    def loss(known: Floats) -> float:
        nu = 1.05 + np.exp(known[6])
        norm = gammaln((nu + 1) / 2) - gammaln(nu / 2) - 0.5 * np.log(nu * np.pi)
        total = 0.0
        for column in (0, 1):
            s0, s1, gain = np.exp(known[3 * column]), np.exp(known[3 * column + 1]), known[3 * column + 2]
            log_scale = np.log(s0 + s1 * distance) - gain * quality
            each = norm - log_scale - (nu + 1) / 2 * np.log1p((error[:, column] / np.exp(log_scale)) ** 2 / nu)
            total -= float(each.mean())
        return total

    typical = np.log(np.maximum(1.4826 * np.median(error, axis=0), 1e-3))
    bounds = [(-7.0, 1.0), (-10.0, 1.0), (-1.0, 2.0)] * 2 + [(-2.0, 4.0)]
    start = [typical[0] - 0.7, typical[0] - 2.0, 0.1, typical[1] - 0.7, typical[1] - 2.0, 0.1, 1.0]
    best = minimize(loss, np.clip(start, *np.transpose(bounds)), method="L-BFGS-B", bounds=bounds).x
    axes = [(float(np.exp(a)), float(np.exp(b)), float(c)) for a, b, c in (best[:3], best[3:6])]
    return (axes[0], axes[1]), float(1.05 + np.exp(best[6]))


def _memory_of(objects: ObjectSamples, latent: Floats) -> dict[str, float]:
    """Shares of the variance over up to 16 frames; all white without enough pairs.

    The tails last, so that an object's errors are normal with a scale of its own: the median change over the median
    error is ``sqrt(2 - 2 correlation)``, whatever the scales.
    """
    lags, correlation, weight = [], [], []
    for lag in _LAGS:
        earlier, later = objects.hit_pairs(lag)
        typical = float(np.median(np.abs(latent[np.append(earlier, later)]))) if len(earlier) >= _FEW else 0.0
        if typical > 0:
            change = float(np.median(np.abs(latent[later] - latent[earlier]))) / typical
            lags.append(lag)
            correlation.append(1.0 - change**2 / 2)
            weight.append(np.sqrt(len(earlier)))
    if not lags:
        return {"bias": 0.0, "ar": 0.0, "phi": 0.0, "white": 1.0}
    return shares_of(np.array(lags), np.array(correlation), np.array(weight)).model_dump()


def _attenuation(nu: float) -> float:
    """Correlation of Student's t numbers, bounded, over that of the normal ones of which each has its own tail."""
    rng = np.random.default_rng(0)
    first, second = rng.standard_normal((2, _DRAWS))
    tails = np.sqrt(nu / rng.chisquare(nu, (2, _DRAWS)))
    one, other = np.clip(tails * [first, (first + np.sqrt(3.0) * second) / 2], -_BOUND, _BOUND)
    return float(2.0 * np.mean(one * other) / np.sqrt(np.mean(one**2) * np.mean(other**2)))


def _shared(latent: Floats, near: Neighbours, objects: ObjectSamples, lasting: float) -> float:
    """Weight of close neighbours, from the correlation of errors of pairs nearer than 5 m."""
    off = np.hypot(*(objects.place[near.row] - objects.place[near.other]).T)
    pair = (off <= _CLOSE) & objects.hit[near.row] & objects.hit[near.other]
    if pair.sum() < _FEW or lasting <= 0:
        return 0.0
    variance = float(np.nanmean(latent**2))
    real = float(np.mean(latent[near.row[pair]] * latent[near.other[pair]])) / variance
    shares = np.linspace(0.0, 1.0, 21)
    implied = [lasting * _implied(near, float(share), pair, len(latent)) for share in shares]
    return round(float(shares[int(np.argmin(np.abs(np.array(implied) - real)))]), 4)


def _implied(near: Neighbours, share: float, pair: Bools, rows: int) -> float:
    """Mean correlation of the mixed numbers of pairs."""
    from scipy.sparse import csr_array, eye_array

    weight = share * near.weight
    mix = csr_array(eye_array(rows) + csr_array((weight, (near.row, near.other)), (rows, rows)))
    norm = np.sqrt(np.asarray(mix.multiply(mix).sum(axis=1)).ravel())
    one, other = near.row[pair], near.other[pair]
    product = np.asarray(mix[one].multiply(mix[other]).sum(axis=1)).ravel()
    return float(np.mean(product / (norm[one] * norm[other])))

"""Fit of the quality and the errors of true objects."""

from functools import partial

import numpy as np
from scipy.optimize import least_squares, minimize
from scipy.special import gammaln

from ...core import Bools, Floats, wrap_angle
from ...detector import ClassNoise, HeadingNoise, Neighbours, PositionNoise, SizeNoise
from .quality import NEIGHBOUR_LENGTH_M, fit_quality, memory_of, random_part
from .samples import HEADING, HEIGHT, RADIAL, SIZE, TANGENTIAL, ObjectSamples

Axis = tuple[float, float, float]  # s0, s1, gain

_LAGS = (1, 2, 3, 4, 6, 8, 12, 16)  # frames
_MIN_PAIRS = 50  # for a correlation
_MIN_VALUES = 30  # for other figures
_PAIR_DISTANCE_M = 5.0  # between neighbours whose errors are compared
_DRAWS = 100_000
_MIXES = 50  # draws of shared numbers
# of latent numbers, so that one large error does not make a correlation
_BOUND = 3.0
_SIZE_BOUND = 4.0
_QUALITY_BOUND = 4.0
# standard deviation over median absolute deviation of a normal number
_NORMAL_MAD = 1.4826
# Logarithms of s0 and s1, and gain, of both axes; logarithm of nu - 1.05.
_AXIS_BOUNDS = [(-7.0, 1.0), (-10.0, 1.0), (-1.0, 2.0)]
_MARGIN_BOUNDS = [*_AXIS_BOUNDS, *_AXIS_BOUNDS, (-2.0, 4.0)]
_LEAST_NU = 1.05


def fit_objects(objects: ObjectSamples, floor: float) -> ClassNoise:
    """Fit the noise of a class without its false positives."""
    quality = fit_quality(objects, floor)
    random = random_part(objects, quality)
    random = np.clip(random, -_QUALITY_BOUND, _QUALITY_BOUND)
    error = objects.error[:, [RADIAL, TANGENTIAL]]
    distance_m = objects.feature[:, 1]
    margins, nu = _position_margins(error, distance_m, random, objects.hit)
    neighbours = Neighbours.within(
        NEIGHBOUR_LENGTH_M, objects.place, objects.moments(), objects.object
    )
    attenuation = _attenuation(nu)
    axes = []
    for column, (s0, s1, gain) in enumerate(margins):
        scale = (s0 + s1 * distance_m) * np.exp(-gain * random)
        latent = error[:, column] / scale
        memory = _position_memory(objects, latent)
        lasting = (1.0 - memory["white"]) * attenuation
        latent = np.clip(latent, -_BOUND, _BOUND)
        axes.append(
            PositionNoise(
                s0=round(s0, 4),
                s1=round(s1, 4),
                quality=round(gain, 4),
                shared=_shared_weight(latent, neighbours, objects, lasting),
                **memory,
            )
        )
    velocity = objects.velocity_error[np.isfinite(objects.velocity_error).all(axis=1)]
    velocity_noise = None
    if len(velocity) >= _MIN_VALUES:
        velocity_noise = round(robust_deviation(velocity.ravel()) or 0.0, 4)
    return ClassNoise(
        quality=quality,
        radial=axes[0],
        tangential=axes[1],
        nu=round(nu, 4),
        heading=_heading(objects),
        size=_size(objects),
        velocity=velocity_noise,
        z=_height(objects),
    )


def _heading(objects: ObjectSamples) -> HeadingNoise:
    """Fit heading errors modulo pi, and chances of flips.

    They are those after a flip and after none; the last one follows from the share of
    flips in the long run.
    """
    error = objects.error[:, HEADING]
    modulo_pi = np.remainder(error + np.pi / 2, np.pi) - np.pi / 2
    flipped = np.abs(wrap_angle(error)) > np.pi / 2
    share = float(np.mean(flipped[objects.hit]))
    earlier, later = objects.hit_pairs()
    after_flip = later[flipped[earlier]]
    flip_again = share
    if len(after_flip) >= _MIN_VALUES / 3:
        flip_again = float(np.mean(flipped[after_flip]))
    flip = min(share * (1.0 - flip_again) / max(1.0 - share, 1e-9), 1.0)
    scale = robust_deviation(modulo_pi[objects.hit]) or 0.0
    return HeadingNoise(
        scale=round(scale, 4), flip=round(flip, 4), flip_again=round(flip_again, 4)
    )


def _size(objects: ObjectSamples) -> SizeNoise:
    """Fit mean and deviation of errors of the size.

    The size is length, width and height. Also fits the share of the errors that is new
    in every frame.
    """
    error = objects.error[:, SIZE]
    mean = error[objects.hit].mean(axis=0)
    deviation = error[objects.hit].std(axis=0)
    latent = (error - mean) / np.maximum(deviation, 1e-9)
    latent = np.clip(latent, -_SIZE_BOUND, _SIZE_BOUND)
    pairs = [objects.hit_pairs(lag) for lag in range(1, 9)]
    product = np.concatenate([latent[a] * latent[b] for a, b in pairs])
    white = 1.0
    if len(product) >= _MIN_VALUES:
        white = min(max(1.0 - float(np.mean(product)), 0.0), 1.0)
    return SizeNoise(
        mean=tuple(mean.round(4).tolist()),
        deviation=tuple(deviation.round(4).tolist()),
        white=round(white, 4),
    )


def robust_deviation(value: Floats) -> float | None:
    """Return the standard deviation from the median absolute deviation.

    None without values.
    """
    if not len(value):
        return None
    return float(_NORMAL_MAD * np.median(np.abs(value - np.median(value))))


def _height(objects: ObjectSamples) -> tuple[float, float]:
    """Return mean and deviation of height errors of centres, m.

    The deviation is of the part that is new in every frame.
    """
    error = objects.error[:, HEIGHT]
    earlier, later = objects.hit_pairs()
    change = robust_deviation(error[later] - error[earlier]) or 0.0
    return round(float(error[objects.hit].mean()), 4), round(change / np.sqrt(2.0), 4)


def _position_margins(
    error: Floats, distance_m: Floats, random: Floats, hit: Bools
) -> tuple[list[Axis], float]:
    """Fit the distribution of errors ``[R, 2]``: both axes, and nu.

    It is ``(s0 + s1 d) exp(-gain q) T_nu`` at ``distance_m`` d, with the ``random``
    part q of the quality.
    """
    size = np.abs(error[hit])
    start = []
    for typical in np.log(np.maximum(_NORMAL_MAD * np.median(size, axis=0), 1e-3)):
        start += [typical - 0.7, typical - 2.0, 0.1]
    start = np.clip([*start, 1.0], *np.transpose(_MARGIN_BOUNDS))
    loss = partial(
        _student_loss, size=size, distance=distance_m[hit], quality=random[hit]
    )
    best = minimize(loss, start, method="L-BFGS-B", bounds=_MARGIN_BOUNDS).x
    axes = [
        (float(np.exp(s0)), float(np.exp(s1)), float(gain))
        for s0, s1, gain in (best[:3], best[3:6])
    ]
    return axes, float(_LEAST_NU + np.exp(best[6]))


def _student_loss(
    unknown: Floats, size: Floats, distance: Floats, quality: Floats
) -> float:
    """Return the negative log-likelihood of Student's t.

    It is the sum over axes of the mean. ``size`` ``[R, 2]``: absolute errors.
    """
    nu = _LEAST_NU + np.exp(unknown[6])
    norm = gammaln((nu + 1) / 2) - gammaln(nu / 2) - 0.5 * np.log(nu * np.pi)
    total = 0.0
    for column in (0, 1):
        log_s0, log_s1, gain = unknown[3 * column : 3 * column + 3]
        scale = np.exp(log_s0) + np.exp(log_s1) * distance
        log_scale = np.log(scale) - gain * quality
        square = (size[:, column] / np.exp(log_scale)) ** 2
        likelihood = norm - log_scale - (nu + 1) / 2 * np.log1p(square / nu)
        total -= float(likelihood.mean())
    return total


def _position_memory(objects: ObjectSamples, latent: Floats) -> dict[str, float]:
    """Return shares of the variance over up to 16 frames.

    All is white without enough pairs. The tail factors last, so an object's errors are
    normal with a scale of its own: the median change over the median error is
    ``sqrt(2 - 2 correlation)`` for all scales.
    """
    lags = []
    correlations = []
    weights = []
    for lag in _LAGS:
        earlier, later = objects.hit_pairs(lag)
        if len(earlier) < _MIN_PAIRS:
            continue
        typical = float(np.median(np.abs(latent[np.append(earlier, later)])))
        if typical > 0:
            change = float(np.median(np.abs(latent[later] - latent[earlier]))) / typical
            lags.append(lag)
            correlations.append(1.0 - change**2 / 2)
            weights.append(np.sqrt(len(earlier)))
    if not lags:
        return {"bias": 0.0, "ar": 0.0, "phi": 0.0, "white": 1.0}

    def loss(unknown: Floats) -> Floats:
        lasting, constant, phi = unknown
        memory = lasting * (constant + (1 - constant) * phi ** np.array(lags))
        return np.asarray(np.array(weights) * (memory - correlations))

    bounds = (0.0, (1.0, 1.0, 0.98))
    return memory_of(*least_squares(loss, (0.7, 0.5, 0.7), bounds=bounds).x.tolist())


def _attenuation(nu: float) -> float:
    """Return the correlation of bounded Student's t numbers.

    They have separate tail factors, and it is over that of the normal numbers.
    """
    rng = np.random.default_rng(0)
    first, second = rng.standard_normal((2, _DRAWS))
    tails = np.sqrt(nu / rng.chisquare(nu, (2, _DRAWS)))
    correlated = [first, (first + np.sqrt(3.0) * second) / 2]
    one, two = np.clip(tails * correlated, -_BOUND, _BOUND)
    variance = np.sqrt(np.mean(one**2) * np.mean(two**2))
    return float(2.0 * np.mean(one * two) / variance)


def _shared_weight(
    latent: Floats, neighbours: Neighbours, objects: ObjectSamples, lasting: float
) -> float:
    """Return the weight of close neighbours, from correlations of their errors."""
    row = neighbours.row
    neighbour = neighbours.other
    distance_m = np.hypot(*(objects.place[row] - objects.place[neighbour]).T)
    is_pair = (
        (distance_m <= _PAIR_DISTANCE_M) & objects.hit[row] & objects.hit[neighbour]
    )
    if is_pair.sum() < _MIN_PAIRS or lasting <= 0:
        return 0.0
    row = row[is_pair]
    neighbour = neighbour[is_pair]
    variance = float(np.nanmean(latent**2))
    real = float(np.mean(latent[row] * latent[neighbour])) / variance
    shares = np.linspace(0.0, 1.0, 21)
    implied = np.zeros(len(shares))
    for number in np.random.default_rng(0).standard_normal((_MIXES, len(latent))):
        for i, share in enumerate(shares):
            mixed = neighbours.mixed(number[None], np.full((1, len(number)), share))[0]
            implied[i] += lasting * np.mean(mixed[row] * mixed[neighbour]) / _MIXES
    return round(float(shares[np.argmin(np.abs(implied - real))]), 4)

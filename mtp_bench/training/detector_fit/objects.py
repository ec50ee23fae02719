"""Fit of the quality and the errors of true objects."""

from functools import partial

import numpy as np
from scipy.optimize import least_squares, minimize
from scipy.special import gammaln

from ...core import Bools, Floats, wrap_angle
from ...detector import ClassNoise, HeadingNoise, Neighbours, PositionNoise, SizeNoise
from .quality import NEIGHBOUR_LENGTH_M, fit_quality, memory_of, random_part
from .samples import DISTANCE, HEADING, HEIGHT, RADIAL, SIZE, TANGENTIAL, ObjectSamples

Axis = tuple[float, float, float]  # s0, s1, gain

# frames between two errors of an object, of places and of sizes
_LAGS = (1, 2, 3, 4, 6, 8, 12, 16)
_SIZE_LAGS = range(1, 9)
_MIN_PAIRS = 50  # for a correlation
_MIN_VALUES = 30  # for other figures
_MIN_FLIPS = 10
_PAIR_DISTANCE_M = 5.0  # between neighbours whose errors are compared
_DRAWS = 100_000  # simulated pairs of errors
_MIXES = 50  # draws of shared numbers
_MIN_SCALE = 1e-9
# of standardised errors, so that one large error does not make a correlation
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
    """Fit the noise of a class without its false positives.

    ``floor``: least score of the detections that count.
    """
    quality = fit_quality(objects, floor)
    random = random_part(objects, quality)
    random = np.clip(random, -_QUALITY_BOUND, _QUALITY_BOUND)
    error = objects.error[:, [RADIAL, TANGENTIAL]]
    distance = objects.feature[:, DISTANCE]
    margins, nu = _position_margins(error, distance, random, objects.hit)
    neighbours = Neighbours.within(
        NEIGHBOUR_LENGTH_M, objects.place, objects.moments(), objects.object
    )
    attenuation = _attenuation(nu)
    axes = []
    for column, (s0, s1, gain) in enumerate(margins):
        scale = (s0 + s1 * distance) * np.exp(-gain * random)
        scaled_error = error[:, column] / scale
        memory = _position_memory(objects, scaled_error)
        lasting = (1.0 - memory["white"]) * attenuation
        scaled_error = np.clip(scaled_error, -_BOUND, _BOUND)
        axes.append(
            PositionNoise(
                s0=round(s0, 4),
                s1=round(s1, 4),
                quality=round(gain, 4),
                shared=_shared_weight(scaled_error, neighbours, objects, lasting),
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
        heading=_heading_noise(objects),
        size=_size_noise(objects),
        velocity=velocity_noise,
        z=_height_noise(objects),
    )


def _heading_noise(objects: ObjectSamples) -> HeadingNoise:
    """Fit heading errors modulo pi, and probabilities of flips.

    A flip is an error of about pi. Its probability after a flip is counted; that after
    none follows from the share of flips in the long run.
    """
    error = objects.error[:, HEADING]
    modulo_pi = np.remainder(error + np.pi / 2, np.pi) - np.pi / 2
    flipped = np.abs(wrap_angle(error)) > np.pi / 2
    share = float(np.mean(flipped[objects.hit]))
    earlier, later = objects.hit_pairs()
    after_flip = later[flipped[earlier]]
    flip_again = share
    if len(after_flip) >= _MIN_FLIPS:
        flip_again = float(np.mean(flipped[after_flip]))
    # as many flips begin as end: (1 - share) flip = share (1 - flip_again)
    flip = min(share * (1.0 - flip_again) / max(1.0 - share, 1e-9), 1.0)
    scale = robust_deviation(modulo_pi[objects.hit]) or 0.0
    return HeadingNoise(
        scale=round(scale, 4), flip=round(flip, 4), flip_again=round(flip_again, 4)
    )


def _size_noise(objects: ObjectSamples) -> SizeNoise:
    """Fit the errors of length, width and height.

    Of each: mean and deviation. Of all: the share of the variance that is new in every
    frame (``white``), which is 1 less the correlation between frames.
    """
    error = objects.error[:, SIZE]
    mean = error[objects.hit].mean(axis=0)
    deviation = error[objects.hit].std(axis=0)
    standardised = (error - mean) / np.maximum(deviation, _MIN_SCALE)
    standardised = np.clip(standardised, -_SIZE_BOUND, _SIZE_BOUND)
    products = []
    for lag in _SIZE_LAGS:
        earlier, later = objects.hit_pairs(lag)
        products.append(standardised[earlier] * standardised[later])
    product = np.concatenate(products)
    white = 1.0
    if len(product) >= _MIN_VALUES:
        correlation = float(np.mean(product))
        white = min(max(1.0 - correlation, 0.0), 1.0)
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


def _height_noise(objects: ObjectSamples) -> tuple[float, float]:
    """Return mean and deviation of height errors of centres, m.

    The deviation is of the part that is new in every frame.
    """
    error = objects.error[:, HEIGHT]
    earlier, later = objects.hit_pairs()
    change = robust_deviation(error[later] - error[earlier]) or 0.0
    # a change has the new parts of two frames
    deviation = change / np.sqrt(2.0)
    return round(float(error[objects.hit].mean()), 4), round(deviation, 4)


def _position_margins(
    error: Floats, distance: Floats, random: Floats, hit: Bools
) -> tuple[list[Axis], float]:
    """Fit the distribution of errors ``[R, 2]``: both axes, and nu.

    It is ``(s0 + s1 d) exp(-gain q) T_nu`` at ``distance`` d in units of 10 m, with the
    ``random`` part q of the quality. T_nu is Student's t with nu degrees of freedom.
    """
    magnitude = np.abs(error[hit])
    start = []
    # at distance 0 half of the typical error
    for typical in np.log(np.maximum(_NORMAL_MAD * np.median(magnitude, axis=0), 1e-3)):
        start += [typical - 0.7, typical - 2.0, 0.1]
    start = np.clip([*start, 1.0], *np.transpose(_MARGIN_BOUNDS))
    loss = partial(
        _student_loss,
        magnitude=magnitude,
        distance=distance[hit],
        quality=random[hit],
    )
    best = minimize(loss, start, method="L-BFGS-B", bounds=_MARGIN_BOUNDS).x
    axes = [
        (float(np.exp(log_s0)), float(np.exp(log_s1)), float(gain))
        for log_s0, log_s1, gain in (best[:3], best[3:6])
    ]
    return axes, float(_LEAST_NU + np.exp(best[6]))


def _student_loss(
    unknown: Floats, magnitude: Floats, distance: Floats, quality: Floats
) -> float:
    """Return the negative log-likelihood of Student's t.

    It is the mean over errors, summed over both axes. ``unknown`` ``[7]``: as
    `_MARGIN_BOUNDS`; ``magnitude`` ``[R, 2]``: absolute errors.
    """
    nu = _LEAST_NU + np.exp(unknown[6])
    norm = gammaln((nu + 1) / 2) - gammaln(nu / 2) - 0.5 * np.log(nu * np.pi)
    total = 0.0
    for column in (0, 1):
        log_s0, log_s1, gain = unknown[3 * column : 3 * column + 3]
        scale = np.exp(log_s0) + np.exp(log_s1) * distance
        log_scale = np.log(scale) - gain * quality
        square = (magnitude[:, column] / np.exp(log_scale)) ** 2
        likelihood = norm - log_scale - (nu + 1) / 2 * np.log1p(square / nu)
        total -= float(likelihood.mean())
    return total


def _position_memory(objects: ObjectSamples, scaled_error: Floats) -> dict[str, float]:
    """Return the shares of the variance that last, decay and are new.

    They are fitted to correlations over up to 16 frames; without enough pairs all is
    new (``white``). The tail factors last, so an object's errors are normal with a
    scale of its own: the median change over the median error is
    ``sqrt(2 - 2 correlation)`` for all scales.
    """
    lags = []
    correlations = []
    weights = []
    for lag in _LAGS:
        earlier, later = objects.hit_pairs(lag)
        if len(earlier) < _MIN_PAIRS:
            continue
        both = scaled_error[np.append(earlier, later)]
        typical = float(np.median(np.abs(both)))
        if typical > 0:
            change = np.abs(scaled_error[later] - scaled_error[earlier])
            change_ratio = float(np.median(change)) / typical
            lags.append(lag)
            correlations.append(1.0 - change_ratio**2 / 2)
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
    """Return the factor by which tails and bounds lower a correlation.

    Normal numbers with a correlation of a half become Student's t by separate tail
    factors, and are bounded. The correlation then is divided by the half.
    """
    rng = np.random.default_rng(0)
    first, second = rng.standard_normal((2, _DRAWS))
    tails = np.sqrt(nu / rng.chisquare(nu, (2, _DRAWS)))
    # correlation 1/2, variance 1
    correlated = [first, (first + np.sqrt(3.0) * second) / 2]
    one, two = np.clip(tails * correlated, -_BOUND, _BOUND)
    variance = np.sqrt(np.mean(one**2) * np.mean(two**2))
    return float(2.0 * np.mean(one * two) / variance)


def _shared_weight(
    scaled_error: Floats,
    neighbours: Neighbours,
    objects: ObjectSamples,
    lasting: float,
) -> float:
    """Return the weight of shared noise, from correlations of close neighbours' errors.

    ``lasting``: share of an error's variance that can be shared.
    """
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
    variance = float(np.nanmean(scaled_error**2))
    product = scaled_error[row] * scaled_error[neighbour]
    real = float(np.mean(product)) / variance
    shares = np.linspace(0.0, 1.0, 21)
    implied = np.zeros(len(shares))
    for number in np.random.default_rng(0).standard_normal((_MIXES, len(objects.hit))):
        for i, share in enumerate(shares):
            mixed = neighbours.mixed(number[None], np.full((1, len(number)), share))[0]
            implied[i] += lasting * np.mean(mixed[row] * mixed[neighbour]) / _MIXES
    return round(float(shares[np.argmin(np.abs(implied - real))]), 4)

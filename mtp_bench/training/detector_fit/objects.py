"""Fit of the quality and the errors of true objects."""

from functools import partial

import numpy as np
from scipy.optimize import least_squares, minimize
from scipy.special import gammaln

from ...core import Bools, Floats, wrap_angle
from ...detector import ClassNoise, HeadingNoise, Neighbours, PositionNoise, SizeNoise
from .quality import NEIGHBOUR_LENGTH, fit_quality, memory_of, random_part
from .samples import HEADING, HEIGHT, RADIAL, SIZE, TANGENTIAL, ObjectSamples

Axis = tuple[float, float, float]  # s0, s1, gain

_LAGS = (1, 2, 3, 4, 6, 8, 12, 16)  # frames
# least pairs for a correlation, least values for other figures
_FEW_PAIRS = 50
_FEW = 30
_CLOSE = 5.0  # m between neighbours whose errors are compared
_DRAWS = 100_000
_MIXES = 50  # draws of shared numbers
# of latent numbers, so that one large error does not make a correlation
_BOUND = 3.0
_SIZE_BOUND = 4.0
_NORMAL_MAD = (
    1.4826  # standard deviation over median absolute deviation of a normal number
)


def fit_objects(objects: ObjectSamples, floor: float) -> ClassNoise:
    """Fit the noise of a class without its false positives."""
    quality = fit_quality(objects, floor)
    random = np.clip(random_part(objects, quality), -4.0, 4.0)
    error = objects.error[:, [RADIAL, TANGENTIAL]]
    distance = objects.feature[:, 1]
    fitted, nu = _position_margins(error, distance, random, objects.hit)
    moment = objects.scene * (int(objects.frame.max(initial=0)) + 1) + objects.frame
    near = Neighbours.within(NEIGHBOUR_LENGTH, objects.place, moment, objects.object)
    axes = []
    for column, (s0, s1, gain) in enumerate(fitted):
        latent = error[:, column] / ((s0 + s1 * distance) * np.exp(-gain * random))
        memory = _position_memory(objects, latent)
        lasting = (1.0 - memory["white"]) * _attenuation(nu)
        shared = _shared_weight(
            np.clip(latent, -_BOUND, _BOUND), near, objects, lasting
        )
        axes.append(
            PositionNoise(
                s0=round(s0, 4),
                s1=round(s1, 4),
                quality=round(gain, 4),
                shared=shared,
                **memory,
            )
        )
    velocity = objects.velocity_error[np.isfinite(objects.velocity_error).all(axis=1)]
    return ClassNoise(
        quality=quality,
        radial=axes[0],
        tangential=axes[1],
        nu=round(nu, 4),
        heading=_heading(objects),
        size=_size(objects),
        velocity=round(robust_deviation(velocity.ravel()) or 0.0, 4)
        if len(velocity) >= _FEW
        else None,
        z=_height(objects),
    )


def _heading(objects: ObjectSamples) -> HeadingNoise:
    """Fit the robust deviation of the heading modulo pi, and the chances of a flip after a flip and after none.

    The last one follows from the share of flips in the long run.
    """
    error = objects.error[:, HEADING]
    upright = np.remainder(error + np.pi / 2, np.pi) - np.pi / 2
    flipped = np.abs(wrap_angle(error)) > np.pi / 2
    share = float(np.mean(flipped[objects.hit]))
    earlier, later = objects.hit_pairs()
    after = flipped[earlier]
    again = float(np.mean(flipped[later][after])) if after.sum() >= _FEW / 3 else share
    flip = min(share * (1.0 - again) / max(1.0 - share, 1e-9), 1.0)
    scale = robust_deviation(upright[objects.hit]) or 0.0
    return HeadingNoise(
        scale=round(scale, 4), flip=round(flip, 4), flip_again=round(again, 4)
    )


def _size(objects: ObjectSamples) -> SizeNoise:
    """Fit mean and deviation of the errors of length, width and height, and their share that is new in every frame."""
    error = objects.error[:, SIZE]
    mean = error[objects.hit].mean(axis=0)
    deviation = error[objects.hit].std(axis=0)
    latent = np.clip(
        (error - mean) / np.maximum(deviation, 1e-9), -_SIZE_BOUND, _SIZE_BOUND
    )
    product = [latent[a] * latent[b] for a, b in map(objects.hit_pairs, range(1, 9))]
    lasting = (
        float(np.mean(np.concatenate(product)))
        if sum(map(len, product)) >= _FEW
        else 0.0
    )
    white = min(max(1.0 - lasting, 0.0), 1.0)
    return SizeNoise(
        mean=tuple(mean.round(4).tolist()),
        deviation=tuple(deviation.round(4).tolist()),
        white=round(white, 4),
    )


def robust_deviation(value: Floats) -> float | None:
    """Standard deviation from the median absolute deviation; None without values."""
    return (
        float(_NORMAL_MAD * np.median(np.abs(value - np.median(value))))
        if len(value)
        else None
    )


def _height(objects: ObjectSamples) -> tuple[float, float]:
    """Mean error of the centre's height, and the deviation of its part that is new in every frame, m."""
    error = objects.error[:, HEIGHT]
    earlier, later = objects.hit_pairs()
    change = robust_deviation(error[later] - error[earlier]) or 0.0
    return round(float(error[objects.hit].mean()), 4), round(change / np.sqrt(2.0), 4)


def _position_margins(
    error: Floats, distance: Floats, random: Floats, hit: Bools
) -> tuple[tuple[Axis, Axis], float]:
    """Parameters of both axes and nu of errors ``[R, 2]`` distributed as ``(s0 + s1 d) exp(-gain q) T_nu``."""
    size = np.abs(error[hit])
    typical = np.log(np.maximum(1.4826 * np.median(size, axis=0), 1e-3))
    bounds = [(-7.0, 1.0), (-10.0, 1.0), (-1.0, 2.0)] * 2 + [(-2.0, 4.0)]
    start = [
        typical[0] - 0.7,
        typical[0] - 2.0,
        0.1,
        typical[1] - 0.7,
        typical[1] - 2.0,
        0.1,
        1.0,
    ]
    loss = partial(
        _student_loss, size=size, distance=distance[hit], quality=random[hit]
    )
    best = minimize(
        loss, np.clip(start, *np.transpose(bounds)), method="L-BFGS-B", bounds=bounds
    ).x
    axes = [
        (float(np.exp(a)), float(np.exp(b)), float(c))
        for a, b, c in (best[:3], best[3:6])
    ]
    return (axes[0], axes[1]), float(1.05 + np.exp(best[6]))


def _student_loss(
    unknown: Floats, size: Floats, distance: Floats, quality: Floats
) -> float:
    """Negative log-likelihood of Student's t for absolute errors ``size`` ``[R, 2]``: sum over axes of the mean."""
    nu = 1.05 + np.exp(unknown[6])
    norm = gammaln((nu + 1) / 2) - gammaln(nu / 2) - 0.5 * np.log(nu * np.pi)
    total = 0.0
    for column in (0, 1):
        s0 = np.exp(unknown[3 * column])
        s1 = np.exp(unknown[3 * column + 1])
        gain = unknown[3 * column + 2]
        log_scale = np.log(s0 + s1 * distance) - gain * quality
        each = (
            norm
            - log_scale
            - (nu + 1) / 2 * np.log1p((size[:, column] / np.exp(log_scale)) ** 2 / nu)
        )
        total -= float(each.mean())
    return total


def _position_memory(objects: ObjectSamples, latent: Floats) -> dict[str, float]:
    """Shares of the variance over up to 16 frames; all white without enough pairs.

    The tail factors last, so an object's errors are normal with a scale of its own: the median change over the median
    error is ``sqrt(2 - 2 correlation)`` for all scales.
    """
    lags = []
    correlation = []
    weight = []
    for lag in _LAGS:
        earlier, later = objects.hit_pairs(lag)
        typical = (
            float(np.median(np.abs(latent[np.append(earlier, later)])))
            if len(earlier) >= _FEW_PAIRS
            else 0.0
        )
        if typical > 0:
            change = float(np.median(np.abs(latent[later] - latent[earlier]))) / typical
            lags.append(lag)
            correlation.append(1.0 - change**2 / 2)
            weight.append(np.sqrt(len(earlier)))
    if not lags:
        return {"bias": 0.0, "ar": 0.0, "phi": 0.0, "white": 1.0}

    def loss(unknown: Floats) -> Floats:
        last, stay, phi = unknown  # lasting share, and the constant share of that
        return np.asarray(
            np.array(weight)
            * (last * (stay + (1 - stay) * phi ** np.array(lags)) - correlation)
        )

    last, stay, phi = least_squares(
        loss, (0.7, 0.5, 0.7), bounds=(0.0, (1.0, 1.0, 0.98))
    ).x.tolist()
    return memory_of(last, stay, phi)


def _attenuation(nu: float) -> float:
    """Correlation of bounded Student's t numbers with separate tail factors, over that of the normal numbers."""
    rng = np.random.default_rng(0)
    first, second = rng.standard_normal((2, _DRAWS))
    tails = np.sqrt(nu / rng.chisquare(nu, (2, _DRAWS)))
    one, other = np.clip(
        tails * [first, (first + np.sqrt(3.0) * second) / 2], -_BOUND, _BOUND
    )
    return float(
        2.0 * np.mean(one * other) / np.sqrt(np.mean(one**2) * np.mean(other**2))
    )


def _shared_weight(
    latent: Floats, near: Neighbours, objects: ObjectSamples, lasting: float
) -> float:
    """Weight of close neighbours, from the correlation of errors of pairs nearer than 5 m."""
    distance = np.hypot(*(objects.place[near.row] - objects.place[near.other]).T)
    pair = (distance <= _CLOSE) & objects.hit[near.row] & objects.hit[near.other]
    if pair.sum() < _FEW_PAIRS or lasting <= 0:
        return 0.0
    variance = float(np.nanmean(latent**2))
    real = float(np.mean(latent[near.row[pair]] * latent[near.other[pair]])) / variance
    shares = np.linspace(0.0, 1.0, 21)
    implied = np.zeros(len(shares))
    for number in np.random.default_rng(0).standard_normal((_MIXES, len(latent))):
        for i, share in enumerate(shares):
            mixed = near.mixed(number[None], np.full((1, len(number)), share))[0]
            implied[i] += (
                lasting
                * np.mean(mixed[near.row[pair]] * mixed[near.other[pair]])
                / _MIXES
            )
    return round(float(shares[int(np.argmin(np.abs(implied - real)))]), 4)

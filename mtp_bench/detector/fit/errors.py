"""Errors of heading, size and velocity, fitted to the true boxes that were hit; shares of a memory."""

from __future__ import annotations

import numpy as np

from ...geometry import wrap_angle
from ...types import Floats
from ..sections import HeadingNoise, Memory, SizeNoise
from .samples import HEADING, SIZE, ObjectSamples

_LAGS = range(1, 9)  # frames
_FEW = 30  # pairs or values from which a figure is taken
_LATENT = 4.0  # bound of a latent normal number: one wild error does not make an autocorrelation
_NORMAL_MAD = 1.4826  # standard deviation over median absolute deviation of a normal number
_PHI = np.linspace(0.0, 0.98, 99)


def shares_of(lag: Floats, correlation: Floats, weight: Floats) -> Memory:
    """The least squares fit of ``bias + ar phi^lag`` to a correlation per lag, all shares in 0..1."""
    from scipy.optimize import lsq_linear

    best, least = (0.0, 0.0, 0.0), np.inf
    for phi in _PHI:
        # With the white share as a third unknown that must fill up to 1: bias + ar + white = 1, heavily weighted.
        rows = np.column_stack([weight, weight * phi**lag, 0 * weight])
        whole = 1e3 * weight.max() * np.ones((1, 3))
        aim = np.append(weight * correlation, whole[0, 0])
        answer = lsq_linear(np.vstack([rows, whole]), aim, bounds=(0.0, 1.0))
        if answer.cost < least:
            least, best = float(answer.cost), (float(answer.x[0]), float(answer.x[1]), float(phi))
    bias, ar = round(best[0], 4), round(best[1], 4)
    return Memory(bias=bias, ar=ar, phi=round(best[2], 4), white=round(max(1.0 - bias - ar, 0.0), 4))


def fit_heading(objects: ObjectSamples) -> HeadingNoise:
    """Robust deviation of the heading modulo pi; chance of a flip after a flip, and after none.

    The second one follows from the share of flips, so that a chain in equilibrium has that share.
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
    return HeadingNoise(scale=round(scale, 4), flip=round(flip, 4), flip_again=round(again, 4))


def fit_size(objects: ObjectSamples) -> SizeNoise:
    """Mean and deviation of the error of length, width and height, and the share that changes between frames."""
    error = objects.error[:, SIZE]
    mean, deviation = error[objects.hit].mean(axis=0), error[objects.hit].std(axis=0)
    latent = np.clip((error - mean) / np.maximum(deviation, 1e-9), -_LATENT, _LATENT)
    product = [latent[a] * latent[b] for a, b in (objects.hit_pairs(lag) for lag in _LAGS)]
    kept = float(np.mean(np.concatenate(product))) if sum(map(len, product)) >= _FEW else 0.0
    white = min(max(1.0 - kept, 0.0), 1.0)
    return SizeNoise(mean=_triple(mean), deviation=_triple(deviation), white=round(white, 4))


def fit_velocity(objects: ObjectSamples) -> float | None:
    """Robust deviation of the velocity per axis, m/s; None where too few velocities were measured."""
    known = objects.velocity_error[np.isfinite(objects.velocity_error).all(axis=1)]
    deviation = robust_deviation(known.ravel()) if len(known) >= _FEW else None
    return None if deviation is None else round(deviation, 4)


def robust_deviation(value: Floats) -> float | None:
    """Standard deviation by the median absolute deviation; None for nothing."""
    return float(_NORMAL_MAD * np.median(np.abs(value - np.median(value)))) if len(value) else None


def _triple(value: Floats) -> tuple[float, float, float]:
    """Three figures of a profile, rounded."""
    return round(float(value[0]), 4), round(float(value[1]), 4), round(float(value[2]), 4)

"""Random numbers of a scene: hashed, with a memory, and with an exponential tail.

A number is a hash of the seed, the kind of noise, the object and the frame, whatever other objects there are.
"""

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr, ndtri

from ..core import Floats, Ints

Keys = NDArray[np.uint64]  # what numbers are drawn for

_GOLDEN, _FIRST, _SECOND = (
    np.uint64(n) for n in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB)
)
_SHIFTS = np.uint64(30), np.uint64(27), np.uint64(31)
_LOW_BITS = np.uint64(11)  # more than a float can hold
_VERSION = 2  # of the hashed numbers
_TINY = 1e-300
_HALVINGS = 60  # of an interval of quantiles
_WHOLE = 1e-6  # tolerance: frame periods are quotients of decimal numbers


class NoiseKind(IntEnum):
    """Kinds of noise. The values are part of every hash: a change of one would change the simulated detections."""

    QUALITY = 0
    RADIAL = 1
    TANGENTIAL = 2
    HEADING = 3
    FLIP = 4
    SIZE = 5
    Z = 6
    VELOCITY = 7
    PLACE = 8
    SCENE = 9
    BIRTH = 10
    LIFE = 11
    CLASS = 12
    FAMILY = 13
    LAPSE = 14
    TAIL = 15


class NoiseSubject(IntEnum):
    """Boxes that noise is drawn for. The values are part of every hash, as those of `NoiseKind`."""

    OBJECTS = 0
    NEAR = 1  # false positives near objects
    FREE = 2  # other false positives


class Component(IntEnum):
    """Draws within a kind of noise. The values are part of every hash, as those of `NoiseKind`."""

    BIAS = 0
    PUSH = 1
    WHITE = 2
    OTHER = 3


@dataclass(frozen=True)
class Draws:
    """Random numbers of one subject in a scene."""

    seed: int
    subject: NoiseSubject = NoiseSubject.OBJECTS
    number: int = 0  # of the class noise, for free false positives; 0 for all others

    @cached_property
    def _key(self) -> int:
        return _seeded(self.seed, _VERSION, int(self.subject), self.number)

    def generator(self, kind: NoiseKind) -> np.random.Generator:
        """A generator for noise that belongs to the scene as a whole."""
        return np.random.default_rng(
            [self.seed, _VERSION, int(self.subject), self.number, int(kind)]
        )

    def uniforms(self, parts: tuple[int, ...], keys: Keys) -> Floats:
        """Uniform numbers in (0, 1) ``[m, ...]`` for each key of `keys_of`, of m `parts`."""
        bits = _mixed(_offsets(self._key, parts).reshape(-1, *[1] * keys.ndim) + keys)
        bits >>= _LOW_BITS
        number = bits.astype(np.float64)
        number += 0.5
        number *= 2.0**-53
        return number

    def uniform(self, kind: NoiseKind, component: int, keys: Keys) -> Floats:
        """Uniform numbers in (0, 1), one for each key of `keys_of`."""
        return np.asarray(self.uniforms(parts(component, kind), keys)[0])

    def normal(self, kind: NoiseKind, component: int, keys: Keys) -> Floats:
        """Standard normal numbers, one for each key of `keys_of`."""
        return np.asarray(ndtri(self.uniform(kind, component, keys)))


def parts(component: int, *kinds: NoiseKind) -> tuple[int, ...]:
    """Numbers of a component of several kinds of noise, which can be drawn at once; they enter the hash."""
    return tuple([64 * int(kind) + int(component) + 1 for kind in kinds])


@lru_cache(maxsize=64)
def _seeded(*words: int) -> int:
    return int(np.random.SeedSequence(words).generate_state(1, np.uint64)[0])


@lru_cache(maxsize=4096)
def _offsets(key: int, parts: tuple[int, ...]) -> Keys:
    return _mixed(
        np.array(
            [(key + part * int(_GOLDEN)) % 2**64 for part in parts], dtype=np.uint64
        )
    )


def keys_of(*index: Ints | Keys) -> Keys:
    """Hash key for each tuple of integers: ``index`` holds arrays of a common shape, of integers or of such keys."""
    state = np.zeros(1, dtype=np.uint64)
    for number in index:
        state = extended_key(state, number)
    return state


def extended_key(key: Keys, index: Ints | Keys) -> Keys:
    """Keys of `keys_of` with one more integer each."""
    return _mixed(key + (np.asarray(index).astype(np.uint64) * _GOLDEN + _GOLDEN))


def _mixed(state: Keys) -> Keys:
    """Mix all bits of ``state`` in place and return it (the finaliser of SplitMix64)."""
    for shift, factor in ((_SHIFTS[0], _FIRST), (_SHIFTS[1], _SECOND)):
        state ^= state >> shift
        state *= factor
    state ^= state >> _SHIFTS[2]
    return state


def stationary(after_no: Floats, after_yes: Floats) -> Floats:
    """Long-run chance of "yes" in a chain with these chances of "yes" after a "no" and after a "yes"."""
    return after_no / np.maximum(1.0 - after_yes + after_no, _TINY)


def at_period(
    after_no: Floats, after_yes: Floats, steps: float
) -> tuple[Floats, Floats]:
    """Both chances of a chain that is observed every ``steps`` frames.

    The long-run chance stays and the correlation decays. Exact for whole steps.
    """
    if steps == 1.0:
        return after_no, after_yes
    long_run = stationary(after_no, after_yes)
    correlation = decayed(after_yes - after_no, steps)
    return long_run * (1.0 - correlation), long_run + (1.0 - long_run) * correlation


def decayed(correlation: Floats, steps: float) -> Floats:
    """Correlation over ``steps`` frames of a process with this correlation between neighbouring frames.

    A negative correlation keeps its sign where ``steps`` is not a whole number.
    """
    whole = np.isfinite(steps) and abs(steps - round(steps)) < _WHOLE
    sign = np.sign(correlation) ** round(steps) if whole else np.sign(correlation)
    return sign * np.abs(correlation) ** steps


def exponential(latent: Floats) -> Floats:
    """Exponential numbers of mean 1 with the ranks of standard normal ones."""
    return np.asarray(-log_ndtr(-latent))


def skewed(normal: Floats, positive: Floats, share: Floats | float) -> Floats:
    """Skewed numbers of variance 1 from standard normal ones and exponential ones of mean 1.

    ``share``: of the variance, the exponential number's.
    """
    return np.asarray(np.sqrt(1.0 - share) * normal + np.sqrt(share) * (positive - 1.0))


def skewed_cdf(value: Floats, share: Floats | float) -> Floats:
    """Distribution function of `skewed` numbers."""
    rest, scale = np.sqrt(1.0 - share), np.sqrt(np.maximum(share, 1e-6))
    y = value + scale
    slope = np.minimum(
        -y / scale + 0.5 * (rest / scale) ** 2 + log_ndtr(y / rest - rest / scale), 0.0
    )
    return np.asarray(
        np.where(
            np.asarray(share) > 0,
            np.clip(ndtr(y / rest) - np.exp(slope), 0.0, 1.0),
            ndtr(value),
        )
    )


def skewed_density(value: Floats, share: float) -> Floats:
    """Density of `skewed` numbers."""
    if share == 0:
        return np.asarray(np.exp(-0.5 * value**2) / np.sqrt(2 * np.pi))
    rest, scale = np.sqrt(1.0 - share), np.sqrt(share)
    y = value + scale
    return np.asarray(
        np.exp(
            -y / scale + 0.5 * (rest / scale) ** 2 + log_ndtr(y / rest - rest / scale)
        )
        / scale
    )


@lru_cache(maxsize=256)
def skewed_quantile(chance: float, share: float) -> float:
    """Value that `skewed` numbers exceed with a chance."""
    low, high = -12.0, 60.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if float(skewed_cdf(np.asarray(middle), share)) < 1.0 - chance:
            low = middle
        else:
            high = middle
    return (low + high) / 2

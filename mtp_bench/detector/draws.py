"""Random numbers of a scene: hashed, with a memory, and with an exponential tail.

A number is a hash of the seed, the kind of noise, the object and the frame, whatever
other objects there are.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property, lru_cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr, ndtri

from ..core import Floats, Ints

Keys = NDArray[np.uint64]  # what numbers are drawn for

# constants of SplitMix64
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_SHIFTS_AND_FACTORS = (
    (np.uint64(30), np.uint64(0xBF58476D1CE4E5B9)),
    (np.uint64(27), np.uint64(0x94D049BB133111EB)),
)
_FINAL_SHIFT = np.uint64(31)
_LOW_BITS = np.uint64(11)  # more than a float can hold
_VERSION = 2  # of the hashed numbers
_MIN_DIVISOR = 1e-300
_HALVINGS = 60  # of an interval of quantiles
# tolerance of a whole number: frame periods are quotients of decimal numbers
_WHOLE_TOLERANCE = 1e-6


class NoiseKind(IntEnum):
    """Kinds of noise.

    The values are part of every hash: a change would change the simulated detections.
    """

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
    """Boxes that noise is drawn for.

    The values are part of every hash.
    """

    OBJECTS = 0
    NEAR_OBJECTS = 1  # false positives near objects
    FREE = 2  # other false positives


class Component(IntEnum):
    """Draws within a kind of noise.

    The values are part of every hash.
    """

    BIAS = 0
    PUSH = 1
    WHITE = 2
    SECOND = 3


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
        """Return a generator for noise of the whole scene."""
        return np.random.default_rng(
            [self.seed, _VERSION, int(self.subject), self.number, int(kind)]
        )

    def uniforms(self, constants: tuple[int, ...], keys: Keys) -> Floats:
        """Return uniform numbers in (0, 1) [m, ...] for keys of `keys_of`.

        Each key gets m numbers, one for each of the hash ``constants`` of `parts`.
        """
        offsets = _offsets(self._key, constants).reshape(-1, *[1] * keys.ndim)
        hash_bits = _mixed(offsets + keys)
        hash_bits >>= _LOW_BITS
        uniform_numbers = hash_bits.astype(np.float64)
        uniform_numbers += 0.5  # never 0
        uniform_numbers *= 2.0**-53  # the hash has 53 bits left
        return uniform_numbers

    def uniform(self, kind: NoiseKind, component: int, keys: Keys) -> Floats:
        """Return a uniform number in (0, 1) for each key of `keys_of`."""
        return np.asarray(self.uniforms(parts(component, kind), keys)[0])

    def normal(self, kind: NoiseKind, component: int, keys: Keys) -> Floats:
        """Return a standard normal number for each key of `keys_of`."""
        return np.asarray(ndtri(self.uniform(kind, component, keys)))


def parts(component: int, *kinds: NoiseKind) -> tuple[int, ...]:
    """Return the hash constants of one component, one per kind of noise.

    `Draws.uniforms` draws the numbers of all of them at once.
    """
    # 64: more than the components of a kind
    return tuple([64 * int(kind) + int(component) + 1 for kind in kinds])


@lru_cache(maxsize=64)
def _seeded(*words: int) -> int:
    """Return a hash of integers, of 64 bits."""
    return int(np.random.SeedSequence(words).generate_state(1, np.uint64)[0])


@lru_cache(maxsize=4096)
def _offsets(key: int, constants: tuple[int, ...]) -> Keys:
    """Return the hash of ``key`` and each constant."""
    offsets = [(key + constant * int(_GOLDEN)) % 2**64 for constant in constants]
    return _mixed(np.array(offsets, dtype=np.uint64))


def keys_of(*arrays: Ints | Keys) -> Keys:
    """Return a hash key for each tuple of integers.

    ``arrays``, of a common shape: of integers or of such keys.
    """
    hash_state = np.zeros(1, dtype=np.uint64)
    for array in arrays:
        hash_state = extended_key(hash_state, array)
    return hash_state


def extended_key(key: Keys, index: Ints | Keys) -> Keys:
    """Return keys of `keys_of` with one more integer each."""
    return _mixed(key + (np.asarray(index).astype(np.uint64) * _GOLDEN + _GOLDEN))


def _mixed(hash_state: Keys) -> Keys:
    """Mix all bits of ``hash_state`` in place and return it.

    This is the finaliser of SplitMix64.
    """
    for bit_shift, bit_factor in _SHIFTS_AND_FACTORS:
        hash_state ^= hash_state >> bit_shift
        hash_state *= bit_factor
    hash_state ^= hash_state >> _FINAL_SHIFT
    return hash_state


def stationary(after_no: Floats, after_yes: Floats) -> Floats:
    """Return the long-run chance of "yes" in a chain.

    The arguments are the chances of "yes" after a "no" and after a "yes".
    """
    # solves p = (1 - p) after_no + p after_yes
    return after_no / np.maximum(1.0 - after_yes + after_no, _MIN_DIVISOR)


def at_period(
    after_no: Floats, after_yes: Floats, steps: float
) -> tuple[Floats, Floats]:
    """Return both chances of a chain that is observed every ``steps`` frames.

    The long-run chance stays and the correlation decays. Exact for whole steps.
    """
    if steps == 1.0:
        return after_no, after_yes
    long_run = stationary(after_no, after_yes)
    # the difference of its chances is the correlation of a chain over one step
    correlation = decayed(after_yes - after_no, steps)
    return long_run * (1.0 - correlation), long_run + (1.0 - long_run) * correlation


def decayed(correlation: Floats, steps: float) -> Floats:
    """Return the correlation of a process over ``steps`` frames.

    ``correlation``: between neighbouring frames. A negative one keeps its sign where
    ``steps`` is not a whole number.
    """
    sign = np.sign(correlation)
    if np.isfinite(steps) and abs(steps - round(steps)) < _WHOLE_TOLERANCE:
        sign = sign ** round(steps)
    return np.asarray(sign * np.abs(correlation) ** steps)


def exponential(normal: Floats) -> Floats:
    """Return exponential numbers of mean 1, made of standard normal ones.

    A number has the same rank in its distribution as the normal number.
    """
    return np.asarray(-log_ndtr(-normal))


def skewed(normal: Floats, positive: Floats, share: Floats | float) -> Floats:
    """Return skewed numbers of variance 1.

    They are made of standard normal numbers ``normal`` and of exponential numbers
    ``positive`` of mean 1. ``share``: share of the variance that the exponential number
    has.
    """
    return np.asarray(np.sqrt(1.0 - share) * normal + np.sqrt(share) * (positive - 1.0))


def skewed_cdf(value: Floats, share: Floats | float) -> Floats:
    """Return the distribution function of `skewed` numbers.

    Shifted by the mean of the exponential part, it is that of a sum as in `_log_tail`.
    """
    normal = np.sqrt(1.0 - share)
    tail = np.sqrt(np.maximum(share, 1e-6))
    tail_chance = np.exp(np.minimum(_log_tail(value + tail, normal, tail), 0.0))
    chance = np.clip(ndtr((value + tail) / normal) - tail_chance, 0.0, 1.0)
    return np.asarray(np.where(np.asarray(share) > 0, chance, ndtr(value)))


def skewed_density(value: Floats, share: float) -> Floats:
    """Return the density of `skewed` numbers."""
    if share == 0:
        return np.asarray(np.exp(-0.5 * value**2) / np.sqrt(2 * np.pi))
    normal = np.sqrt(1.0 - share)
    tail = np.sqrt(share)
    return np.asarray(np.exp(_log_tail(value + tail, normal, tail)) / tail)


def _log_tail(value: Floats, normal: Any, tail: Any) -> Any:
    """Return the logarithm of the density of a sum, times ``tail``.

    The summands are a normal number of deviation ``normal`` and an exponential number
    of mean ``tail``.
    """
    ratio = normal / tail
    return -value / tail + 0.5 * ratio**2 + log_ndtr(value / normal - ratio)


@lru_cache(maxsize=256)
def skewed_quantile(chance: float, share: float) -> float:
    """Return the value that `skewed` numbers exceed with a chance."""
    # no chance in double precision has a quantile outside of these
    low_value = -12.0
    high_value = 60.0
    for _ in range(_HALVINGS):
        middle_value = (low_value + high_value) / 2
        if float(skewed_cdf(np.asarray(middle_value), share)) < 1.0 - chance:
            low_value = middle_value
        else:
            high_value = middle_value
    return (low_value + high_value) / 2


ResultT = TypeVar("ResultT")


@dataclass(eq=False)
class Memory:
    """State of a scene that is detected frame by frame.

    With it no number is drawn twice.
    """

    frame: int = -1  # the one that is detected
    # by id: column, first frame, class index
    objects: dict[int, tuple[int, int, int]] = field(default_factory=dict)
    # numbers of the last frame, one per column, by subject and kinds
    series: dict[Any, Floats] = field(default_factory=dict)
    # results that do not change, by name
    results: dict[Any, Any] = field(default_factory=dict)

    def previous(self, name: Any, shape: tuple[int, ...]) -> Floats:
        """Return the numbers of ``name`` in the frame before.

        They are filled up to ``shape`` with 0 for new columns.
        """
        numbers = np.zeros(shape)
        if name in self.series:
            stored = self.series[name]
            numbers[..., : stored.shape[-1]] = stored
        return numbers

    def grown(self, name: Any, keys: Keys, make: Callable[[Keys], Floats]) -> Floats:
        """Return the numbers ``name`` of the objects ``keys`` [J], on the last axis.

        ``make`` draws those of objects that are new since the last call.
        """
        numbers = remembered(self, name, lambda: make(keys))
        count = numbers.shape[-1]
        if count < len(keys):
            numbers = np.concatenate([numbers, make(keys[count:])], axis=-1)
            self.results[name] = numbers
        return numbers


def remembered(
    memory: Memory | None, name: Any, make: Callable[[], ResultT]
) -> ResultT:
    """Return the result of ``make``.

    With a memory it is made once under this name.
    """
    if memory is None:
        return make()
    if name not in memory.results:
        memory.results[name] = make()
    result: ResultT = memory.results[name]
    return result

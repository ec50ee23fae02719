"""Random behaviour of drivers and people on foot, beside the driver model and the social forces."""

import math
from collections.abc import Sequence

import numpy as np

from ...core import Bools, Floats, Ints
from .driving import Leaders, RoadState, free_acceleration

_DRAWN_AHEAD = 64  # values that are drawn at once

_PACE, _PACE_MEMORY = 0.06, 5.0  # share of the desired speed, s
_PEDAL, _PEDAL_MEMORY = 0.95, 0.5  # m/s2, s
_STRONGEST = 2.7  # m/s2
_STEADY = 3.0  # m/s; slower drivers move the pedals less
_Phase = tuple[
    float, tuple[float, float], tuple[float, float]
]  # 1/s, s, range of the strength
_LATE: _Phase = (
    1 / 17.0,
    (2.0, 5.0),
    (3.2, 4.6),
)  # late braking; m/s2 of needed braking that ends waiting
_FIRM = 1.15  # times the needed braking
_STANDS = 0.5  # share of one's own speed; only slower leaders can be noticed late
_ALERT = 2.7  # m/s; slower drivers are never late
_SUDDEN: _Phase = (1 / 110.0, (0.6, 1.4), (3.2, 5.0))  # braking without a cause; m/s2
_KEPT = 0.3  # m to the place to stop at

_HASTE, _HASTE_MEMORY = 0.12, 2.5  # share of the pace, s
_BEARING, _BEARING_MEMORY = 0.12, 3.0  # rad, s
_STOP = 1 / 300.0  # 1/s
_SHORT, _LONG, _LONG_SHARE = (0.8, 4.0), (15.0, 50.0), 0.6  # s, s, share of stops
_STANDING = 0.26  # share of the first groups that stand at the start
_BACK = 1 / 500.0  # 1/s, turning back
_READY = 2.5  # 1/s, stepping on a free crossing
_HESITATE, _HESITATION = 1 / 12.0, (0.5, 1.2)  # 1/s, s on a crossing
_SLOW = 0.45  # share of the pace while hesitating


class OrnsteinUhlenbeck:
    """Ornstein-Uhlenbeck processes with mean 0; a process of each kind per number."""

    def __init__(
        self,
        spread: Sequence[float],
        memory: Sequence[float],
        dt: float,
        rng: np.random.Generator,
    ) -> None:
        """``spread`` and ``memory``: deviation and seconds of each of the K kinds."""
        decay = [math.exp(-dt / seconds) for seconds in memory]
        push = [
            deviation * math.sqrt(1.0 - d**2)
            for deviation, d in zip(spread, decay, strict=True)
        ]
        self._spread, self._decay, self._push = (
            np.array(values)[:, None] for values in (spread, decay, push)
        )
        self._rng = rng
        self._value = np.zeros((len(spread), 0))

    def step(self, numbers: Ints) -> Floats:
        """Values ``[K, n]`` of the processes ``numbers`` ``[n]`` after ``dt`` seconds; others do not change."""
        kinds, known = self._value.shape
        missing = max(numbers.tolist(), default=-1) + 1 - known
        if missing > 0:
            sizes = (missing + _DRAWN_AHEAD, len(numbers))
            draws = [
                [self._rng.standard_normal(n) for n in sizes] for _ in range(kinds)
            ]
            first, draw = (np.array(column) for column in zip(*draws, strict=True))
            self._value = np.concatenate(
                [self._value, np.round(self._spread * first, 6)], axis=1
            )
        else:
            draw = self._rng.standard_normal((kinds, len(numbers)))
        moved: Floats = (
            self._decay * self._value[:, numbers] + self._push * draw
        ).round(6)
        self._value[:, numbers] = moved
        return moved


class _RandomPhases:
    """Phases of some kinds that begin at random and last for a while, each with its own strength."""

    def __init__(
        self, kinds: tuple[_Phase, ...], dt: float, rng: np.random.Generator
    ) -> None:
        rate, *ranges = (np.array(column) for column in zip(*kinds, strict=True))
        self._chance, self._dt, self._rng = rate[:, None] * dt, dt, rng
        self._ranges = [
            (low[:, None], (high - low)[:, None])
            for low, high in (values.T for values in ranges)
        ]
        self._left = np.zeros((len(kinds), 0))
        self._strength = np.zeros((len(kinds), 0))

    def step(self, numbers: Ints) -> tuple[Bools, Floats]:
        """Masks ``[K, n]`` of ``numbers`` ``[n]`` in a phase of each kind, and the strength of their phases."""
        kinds, known = self._left.shape
        missing = max(numbers.tolist(), default=-1) + 1 - known
        if missing > 0:
            more = np.zeros((kinds, missing + _DRAWN_AHEAD))
            self._left, self._strength = (
                np.append(v, more, axis=1) for v in (self._left, self._strength)
            )
        draw = self._rng.random((kinds, 3, len(numbers)))
        left = self._left[:, numbers] - self._dt
        begins = (left <= 0) & (draw[:, 0] < self._chance)
        (shortest, longer), (weak, stronger) = self._ranges
        left = np.where(begins, shortest + longer * draw[:, 1], left)
        strength = np.where(
            begins, weak + stronger * draw[:, 2], self._strength[:, numbers]
        )
        self._left[:, numbers], self._strength[:, numbers] = left, strength
        return left > 0, strength


class DriverBehaviour:
    """Varying speeds and pedals of all drivers of a world, late braking and sudden braking."""

    def __init__(self, dt: float, rng: np.random.Generator) -> None:
        self._varying = OrnsteinUhlenbeck(
            (_PACE, _PEDAL), (_PACE_MEMORY, _PEDAL_MEMORY), dt, rng
        )
        self._phases = _RandomPhases((_LATE, _SUDDEN), dt, rng)

    def free_acceleration(
        self, state: RoadState, desired: Floats
    ) -> tuple[Floats, Floats]:
        """``desired`` speeds ``[N]`` m/s and accelerations ``[N]`` m/s2 on an empty road, varied."""
        pace, pedal = self._varying.step(state.numbers)
        desired = desired * (1.0 + pace)
        free = free_acceleration(state.speed, desired, state.style)
        moved = pedal * np.minimum(state.speed / _STEADY, 1.0)
        return desired, np.minimum(free + moved, np.maximum(free, _STRONGEST))

    def braking(
        self,
        state: RoadState,
        careful: Floats,
        free: Floats,
        ahead: Leaders,
        lines: Floats,
    ) -> Floats:
        """Acceleration ``[N]`` m/s2: ``careful``, but ``free`` while a driver is late, and sudden braking.

        ``free``: on an empty road; ``ahead``: leaders; ``lines``: m to the place to stop at.
        """
        (late, sudden), (limit, hard) = self._phases.step(state.numbers)
        behind = _stopping(state.speed - ahead.speed, ahead.gap - state.style[:, 3])
        needed = np.maximum(behind, _stopping(state.speed, lines - _KEPT))
        slow = ~np.isfinite(ahead.gap) | (ahead.speed < _STANDS * state.speed)
        waits = late & slow & (state.speed > _ALERT)
        result = np.where(
            waits, np.where(needed > limit, -_FIRM * needed, free), careful
        )
        return np.where(
            sudden & (state.speed > _ALERT), np.minimum(result, -hard), result
        )


def _stopping(closing: Floats, room: Floats) -> Floats:
    """Braking ``[N]``, m/s2, that ends ``closing`` speeds within ``room`` m."""
    return np.maximum(closing, 0.0) ** 2 / (2.0 * np.maximum(room, 0.1))


class PedestrianBehaviour:
    """Varying pace and direction of people on foot; groups stop, go on and turn back together."""

    def __init__(self, dt: float, rng: np.random.Generator) -> None:
        self._dt, self._rng = dt, rng
        self._varying = OrnsteinUhlenbeck(
            (_BEARING, _HASTE), (_BEARING_MEMORY, _HASTE_MEMORY), dt, rng
        )
        self._stops: dict[int, float] = {}  # remaining seconds by group
        self._hesitations: dict[int, float] = {}
        self.ready: set[int] = set()  # groups that step on a free crossing now
        self.turning: set[int] = set()  # groups that turn back now

    def start_standing(self, group: int) -> None:
        """Let a group that is present from the start stand with some chance."""
        if self._rng.uniform() < _STANDING:
            self._stops[group] = float(self._rng.uniform(*_LONG))

    def step(self, present: list[int]) -> None:
        """Advance the ``present`` groups, in the order of their numbers, by ``dt`` seconds."""
        draw = self._rng.random((len(present), 5))
        self._stops = {
            group: left - self._dt for group, left in self._stops.items() if left > 0
        }
        self._hesitations = {
            group: left - self._dt
            for group, left in self._hesitations.items()
            if left > 0
        }
        for group, (stop, kind, duration, slow, _) in zip(
            present, draw.tolist(), strict=True
        ):
            if group not in self._stops and stop < _STOP * self._dt:
                shortest, longest = _LONG if kind < _LONG_SHARE else _SHORT
                self._stops[group] = shortest + (longest - shortest) * duration
            if group not in self._hesitations and slow < _HESITATE * self._dt:
                self._hesitations[group] = (
                    _HESITATION[0] + (_HESITATION[1] - _HESITATION[0]) * duration
                )
        last = draw[:, 4].tolist()  # low: ready, high: turns back
        self.ready = {
            group
            for group, u in zip(present, last, strict=True)
            if u < _READY * self._dt
        }
        self.turning = {
            group
            for group, u in zip(present, last, strict=True)
            if u > 1.0 - _BACK * self._dt
        }

    def walk(
        self, way: Floats, pace: Floats, numbers: Ints, groups: Ints, crossing: Bools
    ) -> tuple[Floats, Floats]:
        """Vectors to the goals ``[2, M]``, turned a little, and present speeds ``[M]`` from the usual ``pace`` ``[M]``.

        On a ``crossing`` ``[M]`` people walk straight on, and hesitate, but do not stop.
        """
        bearing, haste = self._varying.step(numbers)
        stops, slow = (
            np.array([g in chosen for g in groups.tolist()])
            for chosen in (self._stops, self._hesitations)
        )
        speed = (
            pace
            * np.where(slow & crossing, _SLOW, 1.0)
            * (1.0 + haste).clip(0.5, 1.3)
            * ~(stops & ~crossing)
        )
        cos, sin = np.cos(bearing * ~crossing), np.sin(bearing * ~crossing)
        return np.array(
            [cos * way[0] - sin * way[1], sin * way[0] + cos * way[1]]
        ), speed

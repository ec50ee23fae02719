"""Random behaviour of drivers and people on foot, beside the driver model and the social forces."""

import math

import numpy as np

from ...geometry import rotate
from ...types import Bools, Floats, Ints
from .driving import Leaders, RoadState

_DRAWN_AHEAD = 64  # values that are drawn at once

_PACE, _PACE_MEMORY = 0.06, 5.0  # share of the desired speed, s
_PEDAL, _PEDAL_MEMORY = 0.95, 0.5  # m/s2, s
_STRONGEST = 2.7  # m/s2
_STEADY = 3.0  # m/s; slower drivers move the pedals less
_LATE, _LATE_DURATION = 1 / 17.0, (2.0, 5.0)  # 1/s, s: phases of late braking
_NEEDED = (3.2, 4.6)  # m/s2 of needed braking that ends waiting
_FIRM = 1.15  # times the needed braking
_STANDS = 0.5  # share of one's own speed; only slower leaders can be noticed late
_ALERT = 2.7  # m/s; slower drivers are never late
_SUDDEN, _SUDDEN_DURATION, _SUDDEN_BRAKING = 1 / 110.0, (0.6, 1.4), (3.2, 5.0)  # 1/s, s, m/s2: without a cause
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
    """Ornstein-Uhlenbeck processes with mean 0, deviation ``spread`` and memory in seconds, one per number."""

    def __init__(self, spread: float, memory: float, dt: float, rng: np.random.Generator) -> None:
        self._spread, self._rng = spread, rng
        self._decay = math.exp(-dt / memory)
        self._push = spread * math.sqrt(1.0 - self._decay**2)
        self._value: Floats = np.zeros(0)

    def step(self, numbers: Ints) -> Floats:
        """Values ``[n]`` of the processes ``numbers`` ``[n]`` after ``dt`` seconds; other processes do not change."""
        missing = int(numbers.max(initial=-1)) + 1 - len(self._value)
        if missing > 0:
            drawn = self._spread * self._rng.standard_normal(missing + _DRAWN_AHEAD)
            self._value = np.concatenate([self._value, np.round(drawn, 6)])
        moved = self._decay * self._value[numbers] + self._push * self._rng.standard_normal(len(numbers))
        moved = moved.round(6)
        self._value[numbers] = moved
        return moved


class _RandomPhases:
    """Phases that begin at random and last for a while, each with its own strength."""

    def __init__(
        self, rate: float, duration: tuple[float, float], strength: tuple[float, float], dt: float,
        rng: np.random.Generator,
    ) -> None:  # fmt: skip
        self._chance, self._duration, self._range, self._dt, self._rng = rate * dt, duration, strength, dt, rng
        self._left: Floats = np.zeros(0)
        self._strength: Floats = np.zeros(0)

    def step(self, numbers: Ints) -> tuple[Bools, Floats]:
        """Mask of ``numbers`` ``[n]`` in a phase, and the strength of their phases."""
        missing = int(numbers.max(initial=-1)) + 1 - len(self._left)
        if missing > 0:
            more = np.zeros(missing + _DRAWN_AHEAD)
            self._left, self._strength = (np.append(values, more) for values in (self._left, self._strength))
        draw = self._rng.uniform(size=(3, len(numbers)))
        left = self._left[numbers] - self._dt
        begins = (left <= 0) & (draw[0] < self._chance)
        (shortest, longest), (weak, strong) = self._duration, self._range
        left = np.where(begins, shortest + (longest - shortest) * draw[1], left)
        self._left[numbers] = left
        strength = np.where(begins, weak + (strong - weak) * draw[2], self._strength[numbers])
        self._strength[numbers] = strength
        return left > 0, strength


class DriverBehaviour:
    """Varying speeds and pedals of all drivers of a world, late braking and sudden braking."""

    def __init__(self, dt: float, rng: np.random.Generator) -> None:
        self._pace = OrnsteinUhlenbeck(_PACE, _PACE_MEMORY, dt, rng)
        self._pedal = OrnsteinUhlenbeck(_PEDAL, _PEDAL_MEMORY, dt, rng)
        self._late = _RandomPhases(_LATE, _LATE_DURATION, _NEEDED, dt, rng)
        self._sudden = _RandomPhases(_SUDDEN, _SUDDEN_DURATION, _SUDDEN_BRAKING, dt, rng)

    def desired_speed(self, state: RoadState, desired: Floats) -> Floats:
        """Desired speeds ``[N]`` m/s, around those of the driver model."""
        return np.asarray(desired * (1.0 + self._pace.step(state.numbers)))

    def free_acceleration(self, state: RoadState, free: Floats) -> Floats:
        """Acceleration ``[N]`` m/s2 on an empty road, around that of the driver model."""
        moved = self._pedal.step(state.numbers) * np.minimum(state.speed / _STEADY, 1.0)
        return np.asarray(np.minimum(free + moved, np.maximum(free, _STRONGEST)))

    def braking(self, state: RoadState, careful: Floats, free: Floats, ahead: Leaders, lines: Floats) -> Floats:
        """Acceleration ``[N]`` m/s2: ``careful``, but ``free`` while a driver is late, and sudden braking.

        ``free``: on an empty road; ``ahead``: leaders; ``lines``: m to the place to stop at.
        """
        late, limit = self._late.step(state.numbers)
        sudden, hard = self._sudden.step(state.numbers)
        behind = _stopping(state.speed - ahead.speed, ahead.gap - state.style[:, 3])
        needed = np.maximum(behind, _stopping(state.speed, lines - _KEPT))
        slow = ~np.isfinite(ahead.gap) | (ahead.speed < _STANDS * state.speed)
        waits = late & slow & (state.speed > _ALERT)
        result = np.where(waits, np.where(needed > limit, -_FIRM * needed, free), careful)
        return np.where(sudden & (state.speed > _ALERT), np.minimum(result, -hard), result)


def _stopping(closing: Floats, room: Floats) -> Floats:
    """Braking ``[N]``, m/s2, that ends ``closing`` speeds within ``room`` m."""
    return np.asarray(np.maximum(closing, 0.0) ** 2 / (2.0 * np.maximum(room, 0.1)))


class PedestrianBehaviour:
    """Varying pace and direction of people on foot; groups stop, go on and turn back together."""

    def __init__(self, dt: float, rng: np.random.Generator) -> None:
        self._dt, self._rng = dt, rng
        self._haste = OrnsteinUhlenbeck(_HASTE, _HASTE_MEMORY, dt, rng)
        self._bearing = OrnsteinUhlenbeck(_BEARING, _BEARING_MEMORY, dt, rng)
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
        draw = self._rng.uniform(size=(len(present), 5))
        self._stops = {group: left - self._dt for group, left in self._stops.items() if left > 0}
        self._hesitations = {group: left - self._dt for group, left in self._hesitations.items() if left > 0}
        for group, (stop, kind, duration, slow, _) in zip(present, draw.tolist(), strict=True):
            if group not in self._stops and stop < _STOP * self._dt:
                shortest, longest = _LONG if kind < _LONG_SHARE else _SHORT
                self._stops[group] = shortest + (longest - shortest) * duration
            if group not in self._hesitations and slow < _HESITATE * self._dt:
                self._hesitations[group] = _HESITATION[0] + (_HESITATION[1] - _HESITATION[0]) * duration
        last = draw[:, 4].tolist()  # low: ready, high: turns back
        self.ready = {group for group, u in zip(present, last, strict=True) if u < _READY * self._dt}
        self.turning = {group for group, u in zip(present, last, strict=True) if u > 1.0 - _BACK * self._dt}

    def pace(self, pace: Floats, numbers: Ints, groups: Ints, crossing: Bools) -> Floats:
        """Present speeds ``[M]`` from the usual ``pace`` ``[M]``; people do not stop on a ``crossing`` ``[M]``."""
        stops = _among(groups, self._stops) & ~crossing
        slow = np.where(_among(groups, self._hesitations) & crossing, _SLOW, 1.0)
        haste = np.clip(1.0 + self._haste.step(numbers), 0.5, 1.3)
        return np.asarray(pace * slow * haste * ~stops)

    def turned(self, way: Floats, numbers: Ints, crossing: Bools) -> Floats:
        """Vectors to the goals ``[M, 2]``, turned a little; unchanged on a ``crossing`` ``[M]``."""
        return rotate(way, self._bearing.step(numbers) * ~crossing)


def _among(groups: Ints, chosen: dict[int, float]) -> Bools:
    return np.array([group in chosen for group in groups.tolist()], dtype=np.bool_)

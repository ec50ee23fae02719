"""Random behaviour of drivers and people on foot.

It comes beside the driver model and the social forces.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...core import Bools, Floats, Ints
from .driving import MIN_GAP, Leaders, RoadState, free_acceleration

_SPARE_NUMBERS = 64  # whose values are drawn at once

_PACE_SPREAD = 0.06  # share of the desired speed
_PACE_MEMORY_S = 5.0
_PEDAL_SPREAD_MPS2 = 0.95
_PEDAL_MEMORY_S = 0.5
_MAX_ACCELERATION_MPS2 = 2.7
_FULL_PEDAL_SPEED_MPS = 3.0  # slower drivers move the pedals less
_BRAKING_SURPLUS = 1.15  # of a late driver, times the needed braking
# share of the driver's own speed: only leaders slower than that can be noticed late
_LATE_LEADER_SHARE = 0.5
_MIN_LATE_SPEED_MPS = 2.7  # slower drivers are never late
_LINE_GAP_M = 0.3  # to the place to stop at

_HASTE_SPREAD = 0.12  # share of the pace
_HASTE_MEMORY_S = 2.5
_BEARING_SPREAD_RAD = 0.12
_BEARING_MEMORY_S = 3.0
_STOP_RATE = 1 / 300.0  # 1/s
_SHORT_STOP_S = (0.8, 4.0)
_LONG_STOP_S = (15.0, 50.0)
_LONG_SHARE = 0.6  # of the stops
_STANDING_SHARE = 0.26  # of the first groups, which stand at the start
_TURN_BACK_RATE = 1 / 500.0  # 1/s
_STEP_OFF_RATE = 2.5  # 1/s, stepping on a free crossing
_HESITATION_RATE = 1 / 12.0  # 1/s, on a crossing
_HESITATION_S = (0.5, 1.2)
_HESITATING_PACE = 0.45  # share of the pace
_HASTE_LIMITS = (0.5, 1.3)  # shares of the pace


class OrnsteinUhlenbeck:
    """Ornstein-Uhlenbeck processes with mean 0; a process of each kind per number."""

    def __init__(
        self,
        spread: Sequence[float],
        memory_s: Sequence[float],
        step_s: float,
        rng: np.random.Generator,
    ) -> None:
        """Set deviation ``spread`` and decay time ``memory_s`` of each of K kinds."""
        decay = [math.exp(-step_s / seconds) for seconds in memory_s]
        self._spread = np.array(spread)[:, None]
        self._decay = np.array(decay)[:, None]
        # deviation of the random part of a step, which keeps the spread
        self._push = self._spread * np.sqrt(1.0 - self._decay**2)
        self._rng = rng
        self._value = np.zeros((len(spread), 0))

    def step(self, process_numbers: Ints) -> Floats:
        """Advance the processes ``process_numbers`` [n] by ``step_s`` seconds.

        Return their values [K, n]; other processes do not change.
        """
        kinds, count = self._value.shape
        missing = max(process_numbers.tolist(), default=-1) + 1 - count
        added = missing + _SPARE_NUMBERS if missing > 0 else 0
        draws = self._rng.standard_normal((kinds, added + len(process_numbers)))
        # a new process begins at random within its spread
        first_values = np.round(self._spread * draws[:, :added], 6)
        self._value = np.append(self._value, first_values, axis=1)
        push = self._push * draws[:, added:]
        value = self._decay * self._value[:, process_numbers] + push
        self._value[:, process_numbers] = value.round(6)
        return self._value[:, process_numbers]


class _Phase(NamedTuple):
    """Kind of phases that begin at random and last for a while."""

    rate: float  # 1/s
    seconds: tuple[float, float]
    strength: tuple[float, float]  # m/s2


# late braking: a strength is the needed braking at which the driver wakes up
_LATE_BRAKING = _Phase(rate=1 / 17.0, seconds=(2.0, 5.0), strength=(3.2, 4.6))
# braking without a cause
_SUDDEN_BRAKING = _Phase(rate=1 / 110.0, seconds=(0.6, 1.4), strength=(3.2, 5.0))


class _RandomPhases:
    """Phases of K kinds, each with a strength drawn for it."""

    def __init__(
        self, kinds: Sequence[_Phase], step_s: float, rng: np.random.Generator
    ) -> None:
        self._dt = step_s
        self._rng = rng
        self._chance = np.array([kind.rate for kind in kinds])[:, None] * step_s
        self._seconds = np.array([kind.seconds for kind in kinds])[:, :, None]
        self._strengths = np.array([kind.strength for kind in kinds])[:, :, None]
        self._remaining = np.zeros((len(kinds), 0))
        self._strength = np.zeros((len(kinds), 0))

    def step(self, process_numbers: Ints) -> tuple[Bools, Floats]:
        """Advance by ``step_s`` seconds for ``process_numbers`` [n].

        Return masks [K, n] of those in a phase, and the strengths of their phases.
        """
        kinds, count = self._remaining.shape
        missing_numbers = max(process_numbers.tolist(), default=-1) + 1 - count
        if missing_numbers > 0:
            new = np.zeros((kinds, missing_numbers + _SPARE_NUMBERS))
            self._remaining = np.append(self._remaining, new, axis=1)
            self._strength = np.append(self._strength, new, axis=1)
        draws = self._rng.random((kinds, 3, len(process_numbers)))
        begin_draw, seconds_draw, strength_draw = draws.swapaxes(0, 1)
        remaining = self._remaining[:, process_numbers] - self._dt
        begins = (remaining <= 0) & (begin_draw < self._chance)
        seconds = _within(self._seconds, seconds_draw)
        strength = _within(self._strengths, strength_draw)
        remaining = np.where(begins, seconds, remaining)
        strength = np.where(begins, strength, self._strength[:, process_numbers])
        self._remaining[:, process_numbers] = remaining
        self._strength[:, process_numbers] = strength
        return remaining > 0, strength


def _within(limits: Floats, share: Floats) -> Floats:
    """Return values at ``share`` [K, n] of the way between ``limits`` [K, 2, 1]."""
    low = limits[:, 0]
    return np.asarray(low + (limits[:, 1] - low) * share)


class DriverBehaviour:
    """Varying speeds and pedals of all drivers, late braking and sudden braking."""

    def __init__(self, step_s: float, rng: np.random.Generator) -> None:
        spread = (_PACE_SPREAD, _PEDAL_SPREAD_MPS2)
        memory_s = (_PACE_MEMORY_S, _PEDAL_MEMORY_S)
        self._varying = OrnsteinUhlenbeck(spread, memory_s, step_s, rng)
        self._phases = _RandomPhases((_LATE_BRAKING, _SUDDEN_BRAKING), step_s, rng)

    def free_acceleration(
        self, state: RoadState, desired: Floats
    ) -> tuple[Floats, Floats]:
        """Vary ``desired`` speeds [N] m/s and the pedals.

        Return the speeds, and accelerations [N] m/s2 on an empty road.
        """
        pace_factor, pedal = self._varying.step(state.numbers)
        desired = desired * (1.0 + pace_factor)
        free_acceleration_mps2 = free_acceleration(state.speed, desired, state.style)
        # the pedal raises an acceleration only to a limit
        pressed = pedal * np.minimum(state.speed / _FULL_PEDAL_SPEED_MPS, 1.0)
        highest = np.maximum(free_acceleration_mps2, _MAX_ACCELERATION_MPS2)
        return desired, np.minimum(free_acceleration_mps2 + pressed, highest)

    def braking(
        self,
        state: RoadState,
        careful: Floats,
        free_acceleration_mps2: Floats,
        ahead: Leaders,
        line_distance_m: Floats,
    ) -> Floats:
        """Return accelerations [N] m/s2: ``careful``, with late and sudden braking.

        A late driver accelerates as on an empty road, ``free_acceleration_mps2``.
        ``ahead``: leaders; ``line_distance_m``: m to the place to stop at.
        """
        (late, sudden), strengths = self._phases.step(state.numbers)
        waking_braking, sudden_braking = strengths
        is_quick = state.speed > _MIN_LATE_SPEED_MPS
        room_m = ahead.gap - state.style[:, MIN_GAP]
        for_leader = _needed_braking(state.speed - ahead.speed, room_m)
        for_line = _needed_braking(state.speed, line_distance_m - _LINE_GAP_M)
        needed_braking = np.maximum(for_leader, for_line)
        slow_leader = ahead.speed < _LATE_LEADER_SHARE * state.speed
        late &= is_quick & (~np.isfinite(ahead.gap) | slow_leader)
        # braking hard once it is urgent, as if the road was empty until then
        late_acceleration = np.where(
            needed_braking > waking_braking,
            -_BRAKING_SURPLUS * needed_braking,
            free_acceleration_mps2,
        )
        result = np.where(late, late_acceleration, careful)
        braked = np.minimum(result, -sudden_braking)
        return np.where(sudden & is_quick, braked, result)


def _needed_braking(closing: Floats, room_m: Floats) -> Floats:
    """Return the braking [N], m/s2, that ends ``closing`` speeds in ``room_m``."""
    return np.maximum(closing, 0.0) ** 2 / (2.0 * np.maximum(room_m, 0.1))


class PedestrianBehaviour:
    """Varying pace and direction of people on foot.

    Groups stop, go on and turn back together.
    """

    def __init__(self, step_s: float, rng: np.random.Generator) -> None:
        spread = (_BEARING_SPREAD_RAD, _HASTE_SPREAD)
        memory_s = (_BEARING_MEMORY_S, _HASTE_MEMORY_S)
        self._dt = step_s
        self._rng = rng
        self._varying = OrnsteinUhlenbeck(spread, memory_s, step_s, rng)
        self._stops: dict[int, float] = {}  # remaining seconds by group
        self._hesitations: dict[int, float] = {}
        self.ready: set[int] = set()  # groups that step on a free crossing now
        self.turning: set[int] = set()  # groups that turn back now

    def start_standing(self, group: int) -> None:
        """Let a first group stand with some chance."""
        if self._rng.uniform() < _STANDING_SHARE:
            self._stops[group] = float(self._rng.uniform(*_LONG_STOP_S))

    def step(self, present: list[int]) -> None:
        """Advance the ``present`` groups, in ascending order, by ``step_s`` seconds."""
        self._stops = self._after_step(self._stops)
        self._hesitations = self._after_step(self._hesitations)
        self.ready = set()
        self.turning = set()
        draws = self._rng.random((len(present), 5)).tolist()
        for group, group_draws in zip(present, draws, strict=True):
            stop_draw, kind_draw, duration_share, hesitation_draw, turn_draw = (
                group_draws
            )
            if group not in self._stops and stop_draw < _STOP_RATE * self._dt:
                low, high = _LONG_STOP_S if kind_draw < _LONG_SHARE else _SHORT_STOP_S
                self._stops[group] = low + (high - low) * duration_share
            if (
                group not in self._hesitations
                and hesitation_draw < _HESITATION_RATE * self._dt
            ):
                low, high = _HESITATION_S
                self._hesitations[group] = low + (high - low) * duration_share
            # one number for two events that exclude each other
            if turn_draw < _STEP_OFF_RATE * self._dt:
                self.ready.add(group)
            if turn_draw > 1.0 - _TURN_BACK_RATE * self._dt:
                self.turning.add(group)

    def _after_step(self, seconds: dict[int, float]) -> dict[int, float]:
        """Return the remaining seconds of groups after a step."""
        return {
            group: remaining - self._dt
            for group, remaining in seconds.items()
            if remaining > 0
        }

    def walk(
        self,
        to_goal: Floats,
        pace_mps: Floats,
        process_numbers: Ints,
        groups: Ints,
        crossing: Bools,
    ) -> tuple[Floats, Floats]:
        """Vary the direction and the usual ``pace_mps`` [M] of people.

        Return vectors to the goals [2, M], turned a little, and present speeds [M]. On
        a ``crossing`` [M] people walk straight on, and hesitate, but do not stop.
        """
        bearing, haste = self._varying.step(process_numbers)
        stops = np.isin(groups, list(self._stops))
        hesitates = np.isin(groups, list(self._hesitations))
        pace_share = np.where(hesitates & crossing, _HESITATING_PACE, 1.0)
        haste_share = (1.0 + haste).clip(*_HASTE_LIMITS)
        speed = pace_mps * pace_share * haste_share * ~(stops & ~crossing)
        cos = np.cos(bearing * ~crossing)
        sin = np.sin(bearing * ~crossing)
        x, y = to_goal
        return np.array([cos * x - sin * y, sin * x + cos * y]), speed

"""How people drive beside the driver model: speeds and pedals that wander, and braking that comes late and hard."""

from __future__ import annotations

import numpy as np

from ...types import Bools, Floats, Ints
from .drift import Drift
from .following import Leaders
from .state import State

_PACE, _PACE_MEMORY = 0.06, 5.0  # share of the desired speed, s
_PEDAL, _PEDAL_MEMORY = 0.95, 0.5  # m/s2, s
_STRONGEST = 2.7  # m/s2
_STEADY = 3.0  # m/s, who is slower moves the pedals less
_LATE, _LATE_FOR = 1 / 17.0, (2.0, 5.0)  # 1/s, s: moments in which nobody brakes before it is needed
_NEEDED = (3.2, 4.6)  # m/s2 of braking from which on it is
_FIRM = 1.15  # times what is needed
_STANDS = 0.5  # share of one's own speed: nobody is late behind a faster leader
_ALERT = 2.7  # m/s, who is slower is never late
_SUDDEN, _SUDDEN_FOR, _SUDDENLY = 1 / 110.0, (0.6, 1.4), (3.2, 5.0)  # 1/s, s, m/s2: hard braking for nothing
_LEFT = 0.3  # m that are kept to what one brakes for


class Habits:
    """The habits of all drivers of a world, by their numbers."""

    def __init__(self, dt: float, rng: np.random.Generator) -> None:
        self._pace = Drift(_PACE, _PACE_MEMORY, dt, rng)
        self._pedal = Drift(_PEDAL, _PEDAL_MEMORY, dt, rng)
        self._moments = _Moments(_LATE, _LATE_FOR, _NEEDED, dt, rng), _Moments(_SUDDEN, _SUDDEN_FOR, _SUDDENLY, dt, rng)

    def wanted(self, state: State, wanted: Floats) -> Floats:
        """Desired speeds ``[N]`` m/s around those of the driver model."""
        return np.asarray(wanted * (1.0 + self._pace.step(_numbers(state))))

    def pedal(self, state: State, free: Floats) -> Floats:
        """Acceleration ``[N]`` m/s2 on an empty road, around the ``free`` one of the driver model."""
        moved = self._pedal.step(_numbers(state)) * np.minimum(state.speed / _STEADY, 1.0)
        return np.asarray(np.minimum(free + moved, np.maximum(free, _STRONGEST)))

    def braking(self, state: State, careful: Floats, free: Floats, ahead: Leaders, lines: Floats) -> Floats:
        """Acceleration ``[N]`` m/s2 in place of the ``careful`` one, for the late and for those who brake suddenly.

        ``free``: on an empty road; ``ahead``: whom they follow; ``lines``: m to where they have to stop.
        """
        numbers = _numbers(state)
        (late, bound), (sudden, hard) = (each.step(numbers) for each in self._moments)
        needed = np.maximum(
            _stopping(state.speed - ahead.speed, ahead.gap - state.temper[:, 3]), _stopping(state.speed, lines - _LEFT)
        )
        slow = ~np.isfinite(ahead.gap) | (ahead.speed < _STANDS * state.speed)
        waits = late & slow & (state.speed > _ALERT)
        result = np.where(waits, np.where(needed > bound, -_FIRM * needed, free), careful)
        return np.where(sudden & (state.speed > _ALERT), np.minimum(result, -hard), result)


class _Moments:
    """Moments that come at random and last a while, each with a strength of its own."""

    def __init__(
        self, rate: float, lasting: tuple[float, float], strength: tuple[float, float], dt: float,
        rng: np.random.Generator,
    ) -> None:  # fmt: skip
        self._chance, self._lasting, self._strength, self._dt, self._rng = rate * dt, lasting, strength, dt, rng
        self._left: Floats = np.zeros(0)
        self._how: Floats = np.zeros(0)

    def step(self, numbers: Ints) -> tuple[Bools, Floats]:
        """Who of ``numbers`` ``[n]`` has such a moment, and how strong it is."""
        missing = max(int(numbers.max(initial=-1)) + 1 - len(self._left), 0)
        self._left, self._how = (np.append(values, np.zeros(missing)) for values in (self._left, self._how))
        draw = self._rng.uniform(size=(3, len(numbers)))
        left = self._left[numbers] - self._dt
        begins = (left <= 0) & (draw[0] < self._chance)
        (least, most), (weak, strong) = self._lasting, self._strength
        left = np.where(begins, least + (most - least) * draw[1], left)
        self._left[numbers] = left
        self._how[numbers] = np.where(begins, weak + (strong - weak) * draw[2], self._how[numbers])
        return left > 0, self._how[numbers]


def _numbers(state: State) -> Ints:
    return np.array([vehicle.number for vehicle in state.vehicles], dtype=np.int64)


def _stopping(closing: Floats, room: Floats) -> Floats:
    """Braking ``[N]``, m/s2, that ends ``closing`` speeds within ``room`` m."""
    return np.asarray(np.maximum(closing, 0.0) ** 2 / (2.0 * np.maximum(room, 0.1)))

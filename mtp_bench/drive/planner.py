"""The fixed planner of the closed loop: of some speed profiles along the ego's way it drives the best one.

A profile is an acceleration for a second and another one after it. Its risk is the chance that the ego's box, grown by
a margin, meets a forecast one, by the weights of the samples and the confidence of the objects; early contacts count
more. Risk, progress and comfort are weighed by `PlannerSection`. Rear-end contacts are left to those behind.

The family is that of PDM-Closed (Dauner et al. 2023, "Parting with misconceptions about learning-based vehicle motion
planning"): proposals along a line, scored by a forecast.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import KDTree

from ..cards.card import PlannerSection
from ..sources.highway.driven import Way
from ..types import Floats, Ints

FIRST = np.array([-8.0, -6.0, -4.5, -3.0, -2.0, -1.0, 0.0, 0.7, 1.5])  # m/s2, in the first second
THEN = np.array([-4.0, -2.0, 0.0, 1.5])  # m/s2, later
PHASE = 1.0  # s
_FINE = 0.1  # s, step of a profile
_CELL = 0.5  # m, of the grid that finds the station next to a place
_ASIDE = 7.0  # m from the way, beyond which nothing is met
_DISCS = 3  # that cover a box
_SLOWER = 1.5  # m/s2, braking for lower limits ahead
_STILL = 0.5  # m/s; slower objects keep their heading


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Forecast of O objects in the frame of the way: K samples of T steps of ``dt`` s."""

    box: Floats  # [O, 7] now
    path: Floats  # [O, K, T, 2] m
    weight: Floats  # [O, K] chance of each sample, the confidence of the object included
    dt: float


@dataclass(frozen=True)
class Decision:
    """The chosen profile."""

    acceleration: float  # m/s2, until it decides again
    risk: float  # chance of a contact along the profile, weighed by its time
    cause: int  # row of the object with the largest share in the risk of the profile of a free way, -1: it is driven
    s: Floats  # [T + 1] m, stations of the ego along the profile, from now on


class Planner:
    """Decisions for one ego on its ``way``; ``size``: its length and width, m."""

    def __init__(self, way: Way, size: tuple[float, float], parameters: PlannerSection) -> None:
        self._way, self._size, self._weigh = way, size, parameters
        first, then = np.meshgrid(FIRST, THEN, indexing="ij")
        self._first, self._then = first.ravel(), then.ravel()

    @cached_property
    def _allowed(self) -> Floats:
        """Speed [n] at each station from which the limits ahead can be met, m/s."""
        square, gained = self._way.limit.astype(np.float64) ** 2, 2 * _SLOWER * np.diff(self._way.s)
        for i in range(len(square) - 2, -1, -1):
            square[i] = min(square[i], square[i + 1] + gained[i])
        return np.sqrt(square)

    @cached_property
    def _grid(self) -> tuple[Floats, Ints]:
        """Lower corner [2] and stations of the cells around the way, -1 where the way is far."""
        low = self._way.xy.min(axis=0) - _ASIDE - _CELL
        shape = np.ceil((self._way.xy.max(axis=0) + _ASIDE + _CELL - low) / _CELL).astype(np.int64) + 1
        reach = np.arange(-round(_ASIDE / _CELL) - 1, round(_ASIDE / _CELL) + 2)
        around = np.stack(np.meshgrid(reach, reach, indexing="ij"), axis=-1).reshape(-1, 2)
        cells = np.unique(
            (np.floor((self._way.xy - low) / _CELL).astype(np.int64)[::4, None] + around).reshape(-1, 2), axis=0
        )
        cells = cells[((cells >= 0) & (cells < shape)).all(axis=1)]
        grid = np.full(shape, -1)
        grid[tuple(cells.T)] = KDTree(self._way.xy).query(low + (cells + 0.5) * _CELL)[1]
        return low, grid

    def allowed(self, s: float) -> float:
        """Highest speed at ``s`` m along the way, m/s."""
        return float(np.interp(s, self._way.s, self._allowed))

    def profiles(self, s: float, speed: float, times: Floats) -> Floats:
        """Stations [C, T] at ``times`` [T] s of all profiles that begin at ``s`` m with ``speed`` m/s."""
        steps = round(float(times[-1]) / _FINE)
        place, pace = np.full(len(self._first), s), np.full(len(self._first), speed)
        track = np.empty((steps + 1, len(self._first)))
        track[0] = s
        for k in range(steps):
            gain = self._first if k * _FINE < PHASE else self._then
            top = np.interp(place, self._way.s, self._allowed)
            faster = np.clip(pace + gain * _FINE, 0.0, np.maximum(top, pace - 2 * _SLOWER * _FINE))
            place = place + (pace + faster) / 2 * _FINE
            pace = faster
            track[k + 1] = place
        chosen: Floats = track[np.rint(times / _FINE).astype(np.int64)]
        return chosen.T

    def decide(self, s: float, speed: float, seen: Obstacles) -> Decision:
        """The best profile for an ego at ``s`` m with ``speed`` m/s."""
        weigh, times = self._weigh, seen.dt * np.arange(1, seen.path.shape[2] + 1)
        stations = self.profiles(s, speed, times)
        risk, cause = self._risks(stations, times, seen)
        score = (stations[:, -1] - s) / times[-1] - weigh.caution * risk
        score -= weigh.comfort * np.maximum(-self._first - 2.0, 0.0) + weigh.smoothness * np.abs(self._first)
        best, free = int(np.argmax(score)), int(np.argmax(score + weigh.caution * risk))
        kept = -1 if best == free else int(cause[free])
        return Decision(float(self._first[best]), float(risk[best]), kept, np.append(s, stations[best]))

    def _risks(self, stations: Floats, times: Floats, seen: Obstacles) -> tuple[Floats, Ints]:
        """Risk [C] of profiles with ``stations`` [C, T], and the object with the largest share of it."""
        count, none = len(stations), np.full(len(stations), -1)
        if not len(seen.box):
            return np.zeros(count), none
        low, high, step, sample = self._contacts(times, seen)
        if not len(step):
            return np.zeros(count), none
        at = stations[:, step]
        first = np.where((at >= low) & (at <= high), times[step], np.inf)  # [C, M]
        group, start = np.unique(sample, return_index=True)  # ``sample`` ascends
        chance = np.exp(-np.minimum.reduceat(first, start, axis=1) / self._weigh.patience)
        chance *= seen.weight.ravel()[group]
        owner, begin = np.unique(group // seen.weight.shape[1], return_index=True)
        share = np.minimum(np.add.reduceat(chance, begin, axis=1), 1.0)
        risk = 1.0 - np.prod(1.0 - share, axis=1)
        return risk, np.where(risk > 0, owner[share.argmax(axis=1)], -1)

    def _contacts(self, times: Floats, seen: Obstacles) -> tuple[Floats, Floats, Ints, Ints]:
        """Stretches of the way [M], from ``low`` to ``high`` m, in which the ego touches a forecast box.

        With the time step and the sample (object times K plus k) of each, in the order of samples.
        """
        objects, samples, steps, _ = seen.path.shape
        before = np.concatenate(
            [np.broadcast_to(seen.box[:, None, None, :2], (objects, samples, 1, 2)), seen.path], axis=2
        )
        move = np.diff(before, axis=2)
        moves = np.hypot(move[..., 0], move[..., 1]) > _STILL * seen.dt
        heading = np.where(moves, np.arctan2(move[..., 1], move[..., 0]), seen.box[:, None, None, 3])
        length, width = seen.box[:, 4], seen.box[:, 5]
        along = (np.arange(_DISCS) - (_DISCS - 1) / 2) / _DISCS * length[:, None]  # [O, discs]
        direction = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
        disc = seen.path[..., None, :] + along[:, None, None, :, None] * direction[..., None, :]
        corner, grid = self._grid
        cell = np.floor((disc.reshape(-1, 2) - corner) / _CELL).astype(np.int64)
        inside = ((cell >= 0) & (cell < grid.shape)).all(axis=1)
        near = np.full(len(cell), -1)
        near[inside] = grid[tuple(cell[inside].T)]
        row = np.flatnonzero(near >= 0)
        station, place = near[row], disc.reshape(-1, 2)[row]
        sample, step = row // (steps * _DISCS), row // _DISCS % steps
        owner = sample // samples
        tangent = self._way.heading[station]
        away = place - self._way.xy[station]
        ahead = self._way.s[station] + away[:, 0] * np.cos(tangent) + away[:, 1] * np.sin(tangent)
        aside = np.abs(away[:, 1] * np.cos(tangent) - away[:, 0] * np.sin(tangent))
        radius = np.hypot(width / 2, length / (2 * _DISCS))[owner]
        grown = self._weigh.margin + self._weigh.growth * times[step]
        meets = aside < self._size[1] / 2 + radius + grown
        same_way = np.cos(heading.reshape(-1)[row // _DISCS] - tangent) > 0.5
        reach = self._size[0] / 2 + radius + grown
        low, high = ahead - reach, np.where(same_way, ahead, ahead + reach)
        return low[meets], high[meets], step[meets], sample[meets]

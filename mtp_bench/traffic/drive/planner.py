"""The fixed planner of the closed loop: of some speed profiles along the ego's way it drives the best one.

A profile is an acceleration for a second and another one after it. Its risk is a score of contacts of the ego's box,
grown by a margin, with forecast ones, by the weights of the samples and the confidence of the objects. Early contacts
count more, and those of a standing ego, which are not its fault, less. A time gap is kept to those who drive ahead;
those who follow the ego are left out. Risks by all objects are added up, and where none of the profiles keeps clear of
somebody ahead in the lane, the ego brakes hardest. Risk, progress and comfort are weighed by `PlannerSection`.

The family is that of PDM-Closed (Dauner et al. 2023, "Parting with misconceptions about learning-based vehicle motion
planning"): proposals along a line, scored by a forecast.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import ceil

import numpy as np
from scipy.spatial import KDTree

from ...cards import PlannerSection
from ...core import NO_ROWS, Bools, Floats, Ints
from ..highway.driven import Way

FIRST = np.array(
    [-8.0, -6.0, -4.5, -3.0, -2.0, -1.0, 0.0, 0.7, 1.5]
)  # m/s2, in the first second
THEN = np.array([-4.0, -2.0, 0.0, 1.5])  # m/s2, later
PHASE = 1.0  # s
_DENSE = 0.3  # s, longest time between two forecast places that count
_UNLIKELY = 0.002  # weight of a sample below which it does not count
_CELL = 1.0  # m, of the grid that finds the station next to a place, and of the table of speeds
_ASIDE = 9.0  # m from the way, beyond which nothing is met
_DISCS = 3  # that cover a box
_DISC_PLACES = (
    np.arange(_DISCS) - (_DISCS - 1) / 2
) / _DISCS  # their centres, as shares of the length
_SLOWER = 1.5  # m/s2, braking for lower limits ahead
_STILL = 0.5  # m/s; slower objects keep their heading
_HARMLESS, _HARMFUL = (
    0.15,
    4.0,
)  # weight of a contact of the standing ego; m/s from which the weight is 1
_LIKELY = 0.5  # risk by somebody ahead in the lane, from which the ego brakes hardest if no profile has less
_CLOSE = 0.5  # weight of the time gap alone, against a contact
_OPENING = 2.0  # s in which the time gap to those ahead may be opened


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Forecast of O objects in the frame of the way: K samples of T steps of ``dt`` s."""

    box: Floats  # [O, 7] now
    path: Floats  # [O, K, T, 2] m
    weight: (
        Floats  # [O, K] chance of each sample, the confidence of the object included
    )
    dt: float


@dataclass(frozen=True)
class Decision:
    """The chosen profile."""

    acceleration: float  # m/s2, until it decides again
    risk: float  # severity-weighted contact score in [0, 1]: 1 - prod(1 - share), of the shares of all objects
    cause: int  # row of the object with most of the risk of the profile for a free way; -1 where that one is driven
    s: Floats  # [T + 1] m, stations of the ego along the profile, from now on


@dataclass(frozen=True)
class _Contacts:
    """Stretches of the way [M], from ``low`` to ``high`` m, in which the ego touches a forecast box."""

    low: Floats
    high: Floats
    step: Ints  # of the forecast
    sample: Ints  # object times K plus k, ascending
    leads: Bools  # the object drives ahead in the direction of the way


def _evened(seen: Obstacles) -> Obstacles:
    """The forecast at places about `_DENSE` s apart: some left out, or more put in between on straight lines."""
    if seen.dt <= _DENSE:
        every = min(int(_DENSE / seen.dt + 1e-6), seen.path.shape[2])
        return Obstacles(
            seen.box, seen.path[:, :, every - 1 :: every], seen.weight, seen.dt * every
        )
    parts = ceil(seen.dt / _DENSE - 1e-6)
    now = np.broadcast_to(seen.box[:, None, None, :2], (*seen.path.shape[:2], 1, 2))
    before = np.concatenate([now, seen.path[:, :, :-1]], axis=2)[:, :, :, None]
    share = np.arange(1, parts + 1)[:, None] / parts
    path = share * (seen.path[:, :, :, None] - before)
    path += before
    path = path.reshape(*seen.path.shape[:2], parts * seen.path.shape[2], 2)
    return Obstacles(seen.box, path, seen.weight, seen.dt / parts)


@lru_cache(maxsize=32)
def _grid(way: Way) -> tuple[Floats, Ints]:
    """Lower corner [2] and stations of the cells around a way, -1 where it is far."""
    low = way.xy.min(axis=0) - _ASIDE - _CELL
    near = np.zeros(
        np.ceil((way.xy.max(axis=0) + _ASIDE - low) / _CELL).astype(np.int64) + 1,
        dtype=bool,
    )
    wide = round(_ASIDE / _CELL)
    for x, y in ((way.xy[::2] - low) / _CELL).astype(np.int64).tolist():
        near[max(x - wide, 0) : x + wide + 1, max(y - wide, 0) : y + wide + 1] = True
    grid = np.full(near.shape, -1)
    grid[near] = KDTree(way.xy).query(low + (np.argwhere(near) + 0.5) * _CELL)[1]
    return low, grid


class Planner:
    """Decisions for one ego on its ``way``; ``size``: its length and width, m."""

    def __init__(
        self, way: Way, size: tuple[float, float], parameters: PlannerSection
    ) -> None:
        self._way, self._size, self._weigh = way, size, parameters
        self._first, self._then = FIRST.repeat(len(THEN)), np.tile(THEN, len(FIRST))
        self._effort = parameters.comfort * np.maximum(-self._first - 2.0, 0.0)
        self._effort += parameters.smoothness * np.abs(self._first)

    @cached_property
    def _allowed(self) -> Floats:
        """Speed [n] at each station from which the limits ahead can be met, m/s."""
        limit = self._weigh.pace * self._way.limit.astype(np.float64)
        square, gained = limit**2, 2 * _SLOWER * np.diff(self._way.s)
        for i in range(len(square) - 2, -1, -1):
            square[i] = min(square[i], square[i + 1] + gained[i])
        return np.sqrt(square)

    @cached_property
    def _tops(self) -> Floats:
        """The same, every `_CELL` m from the start of the way."""
        return np.interp(
            np.arange(0.0, self._way.s[-1] + _CELL, _CELL), self._way.s, self._allowed
        )

    def allowed(self, s: float) -> float:
        """Highest speed at ``s`` m along the way, m/s."""
        return float(np.interp(s, self._way.s, self._allowed))

    def profiles(
        self, s: float, speed: float, dt: float, steps: int
    ) -> tuple[Floats, Floats]:
        """Stations [C, T + 1] and speeds of all profiles, every ``dt`` s from now, at ``s`` m with ``speed`` m/s."""
        stations, speeds = np.empty((2, steps + 1, len(self._first)))
        stations[0], speeds[0] = s, speed
        gains = self._first * dt, self._then * dt
        for k, (place, pace) in enumerate(zip(stations[:-1], speeds[:-1], strict=True)):
            top = np.maximum(
                self._tops.take((place / _CELL).astype(np.int64), mode="clip"),
                pace - 2 * _SLOWER * dt,
            )
            faster = np.maximum(
                np.minimum(pace + gains[k * dt > PHASE - 1e-6], top),
                0.0,
                out=speeds[k + 1],
            )
            np.add(place, (pace + faster) * (dt / 2), out=stations[k + 1])
        return stations.T, speeds.T

    def decide(self, s: float, speed: float, seen: Obstacles) -> Decision:
        """The best profile for an ego at ``s`` m along the way with ``speed`` m/s."""
        near = self._near(seen)
        even = _evened(
            Obstacles(seen.box[near], seen.path[near], seen.weight[near], seen.dt)
        )
        dt, path = even.dt, even.path
        stations, speeds = self.profiles(s, speed, dt, path.shape[2])
        ahead, aside, tangent = self._beside(*even.box.T[:2])
        in_lane = aside < (self._size[1] + even.box[:, 5]) / 2
        follows = (ahead < s) & in_lane & (np.cos(even.box[:, 3] - tangent) > 0.5)
        contacts = self._contacts(s, float(stations[:, -1].max()), even, follows)
        share, owner = self._shares(stations, speeds, contacts, even)
        wish = (stations[:, -1] - s) / (dt * path.shape[2]) - self._effort
        score = (wish - self._weigh.caution * share.sum(axis=1)).round(
            9
        )  # equal scores on all machines
        best, free = int(score.argmax()), int(wish.round(9).argmax())
        if (((ahead > s) & in_lane)[owner] & (share.min(axis=0) > _LIKELY)).any():
            best = 0  # it brakes hardest
        kept = (
            -1
            if best == free or not share[free].any()
            else int(near[owner[share[free].argmax()]])
        )
        risk = 1.0 - float((1.0 - share[best]).prod())
        time = seen.dt * np.arange(seen.path.shape[2] + 1)
        shown = np.interp(time, dt * np.arange(path.shape[2] + 1), stations[best])
        return Decision(float(self._first[best]), risk, kept, shown)

    def _near(self, seen: Obstacles) -> Ints:
        """Rows of the objects whose forecasts reach the rectangle around the way, as few at a junction do."""
        near, far = np.ones(len(seen.box), dtype=bool), _ASIDE + 2 * _CELL
        for axis in range(
            2 if seen.dt > _DENSE else 0
        ):  # `_evened` thins out denser forecasts, which is enough
            now, places, way = (
                seen.box[:, axis],
                seen.path[..., axis],
                self._way.xy[:, axis],
            )
            near &= (
                np.fmax(np.fmax.reduce(places, axis=(1, 2)), now) > way.min() - far
            )  # missing samples may be NaN
            near &= np.fmin(np.fmin.reduce(places, axis=(1, 2)), now) < way.max() + far
        return near.nonzero()[0]

    def _shares(
        self, stations: Floats, speeds: Floats, met: _Contacts, seen: Obstacles
    ) -> tuple[Floats, Ints]:
        """Shares [C, n] in [0, 1] of n objects in the risks of profiles [C, T + 1], and the rows [n] of the objects."""
        if not len(met.step):
            return np.zeros((len(stations), 0)), NO_ROWS
        times = seen.dt * np.arange(1, stations.shape[1])
        here, before = stations[:, 1:], stations[:, :-1]
        nose = here + self._weigh.headway * speeds[:, 1:] * np.minimum(
            times / _OPENING, 1.0
        )
        then = here[:, met.step]  # [C, M]
        front = np.where(met.leads, nose[:, met.step], then)
        back = np.where(
            met.leads, before[:, met.step], then
        )  # a leader may be passed in one step
        harm = np.minimum(_HARMLESS + (1 - _HARMLESS) * speeds[:, 1:] / _HARMFUL, 1.0)
        harm = np.exp(-times / self._weigh.patience) * harm
        close = np.where(then >= met.low, 1.0, _CLOSE)
        each = np.where(
            (front >= met.low) & (back <= met.high), close * harm[:, met.step], 0.0
        )
        start = np.diff(met.sample, prepend=-1).nonzero()[0]
        group = met.sample[start]
        chance = np.maximum.reduceat(each, start, axis=1) * seen.weight.ravel()[group]
        owner = group // seen.weight.shape[1]
        begin = np.diff(owner, prepend=-1).nonzero()[0]
        return np.minimum(np.add.reduceat(chance, begin, axis=1), 1.0), owner[begin]

    def _contacts(
        self, s: float, end: float, seen: Obstacles, follows: Bools
    ) -> _Contacts:
        """Contacts that an ego between ``s`` and ``end`` m can have, but not with those [O] that follow it."""
        _, samples, steps, _ = seen.path.shape
        length, width = seen.box[:, 4], seen.box[:, 5]
        x, y = seen.path.reshape(-1, 2).T
        station = self._station(x, y)
        counts = (seen.weight > _UNLIKELY) & ~follows[:, None]
        row = ((station >= 0) & counts.repeat(steps)).nonzero()[0]
        here = self._way.s[station[row]]
        row = row[(here > s - 2 * _ASIDE) & (here < end + 3 * _ASIDE)]
        owner, step = row // (samples * steps), row % steps
        heading = self._headings(row, owner, step, seen)
        along = _DISC_PLACES * length[owner, None]  # [n, discs]
        disc_x = x[row, None] + along * np.cos(heading)[:, None]
        disc_y = y[row, None] + along * np.sin(heading)[:, None]
        ahead, aside, tangent = self._beside(disc_x.ravel(), disc_y.ravel())
        grown = self._weigh.margin + self._weigh.growth * seen.dt * (step + 1)
        reach = (np.hypot(width / 2, length / (2 * _DISCS))[owner] + grown).repeat(
            _DISCS
        )
        meets = (aside < self._size[1] / 2 + reach).nonzero()[0]
        of = meets // _DISCS
        ahead, reach = ahead[meets], self._size[0] / 2 + reach[meets]
        leads = np.cos(heading[of] - tangent[meets]) > 0.5
        return _Contacts(
            ahead - reach,
            np.where(leads, ahead, ahead + reach),
            step[of],
            row[of] // steps,
            leads,
        )

    def _headings(self, row: Ints, owner: Ints, step: Ints, seen: Obstacles) -> Floats:
        """Headings [n] of the forecast places in the rows [n] of the flat paths."""
        place = seen.path.reshape(-1, 2)
        before = np.where((step == 0)[:, None], seen.box[owner, :2], place[row - 1])
        move = place[row] - before
        moves = np.hypot(move[:, 0], move[:, 1]) > _STILL * seen.dt
        return np.where(moves, np.arctan2(move[:, 1], move[:, 0]), seen.box[owner, 3])

    def _station(self, x: Floats, y: Floats) -> Ints:
        """Points of the way next to places [n], -1 where it is far, as in the outermost cells of the grid."""
        (left, below), grid = _grid(self._way)
        column = np.fmin(np.fmax((x - left) / _CELL, 0), len(grid) - 1).astype(np.int64)
        row = np.fmin(np.fmax((y - below) / _CELL, 0), grid.shape[1] - 1).astype(
            np.int64
        )
        return np.asarray(grid[column, row])

    def _beside(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Stations, distances to the way and headings of the way for places [n]; inf where it is far."""
        station = self._station(x, y)
        tangent = self._way.heading[station]
        away_x, away_y = x - self._way.xy[station, 0], y - self._way.xy[station, 1]
        cos, sin = np.cos(tangent), np.sin(tangent)
        aside = np.where(station >= 0, np.abs(away_y * cos - away_x * sin), np.inf)
        return self._way.s[station] + away_x * cos + away_y * sin, aside, tangent

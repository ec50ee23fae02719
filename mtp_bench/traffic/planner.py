"""Fixed planner of the closed loop, which drives the best of some speed profiles.

A profile is an acceleration for a second and another one after it. Its risk is a score
of contacts of the ego's box, grown by a margin, with forecast boxes, by the weights of
the samples and the confidence of the objects. Early contacts count more. Contacts of a
standing ego, which are not its fault, count less. The ego keeps a time gap to objects
that drive ahead, and leaves out those that follow it. The risks by all objects are
added up. If no profile keeps clear of an object ahead in the lane, the ego brakes
hardest. `PlannerSection` weighs risk, progress and comfort.

The family is that of PDM-Closed (Dauner et al. 2023, "Parting with misconceptions about
learning-based vehicle motion planning"): proposals along a line, scored by a forecast.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import ceil

import numpy as np
from scipy.spatial import KDTree

from ..cards import PlannerSection
from ..core import NO_ROWS, Bools, Floats, Ints
from .highway.driven import Way

# accelerations of all profiles, every pair: in the first second, and later
_FIRST_MPS2 = np.repeat([-8.0, -6.0, -4.5, -3.0, -2.0, -1.0, 0.0, 0.7, 1.5], 4)
_LATER_MPS2 = np.tile([-4.0, -2.0, 0.0, 1.5], 9)
_FIRST_SECONDS = 1.0
_MAX_STEP_S = 0.3  # between two forecast places that count
_MIN_SAMPLE_WEIGHT = 0.002  # of a sample that counts
# spacing of the grid that finds the station next to a place, and of the speed table
_CELL_M = 1.0
_REACH_M = 9.0  # from the way, beyond which no object is met
_DISCS = 3  # that cover a box
# centres of the discs, as shares of the length
_DISC_PLACES = (np.arange(_DISCS) - (_DISCS - 1) / 2) / _DISCS
_LIMIT_BRAKING_MPS2 = 1.5  # for lower limits ahead
_ROUNDING = 1e-6
_COMFORTABLE_BRAKING_MPS2 = 2.0  # costs no comfort
_MIN_TURN_SPEED_MPS = 0.5  # slower objects keep their heading
_STANDING_SEVERITY = 0.15  # of a contact while the ego stands
_FULL_SEVERITY_SPEED_MPS = 4.0  # ego speed from which a contact has severity 1
# risk by an object ahead in the lane, from which the ego brakes hardest if no profile
# has less
_EMERGENCY_RISK = 0.5
_GAP_SEVERITY = 0.5  # of entering the time gap alone, against a contact
_GAP_OPENING_S = 2.0  # in which the time gap to those ahead may be opened
_SAME_DIRECTION_COSINE = 0.5


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Forecast of O objects in the frame of the way: K samples of T steps of ``dt`` s.

    The weight of a sample is its probability times the object's confidence.
    """

    box: Floats  # [O, 7] now
    path: Floats  # [O, K, T, 2] m
    weight: Floats  # [O, K]
    dt: float


@dataclass(frozen=True)
class Decision:
    """The chosen profile.

    ``risk`` in [0, 1] is a severity-weighted contact score: 1 - prod(1 - share), of the
    shares of all objects. ``cause`` is the row of the object with most of the risk of
    the profile for a free way; -1 where that profile is driven.
    """

    acceleration: float  # m/s2, until the next decision
    risk: float
    cause: int
    s: Floats  # [T + 1] m, stations of the ego along the profile, from now on


@dataclass(frozen=True)
class _Contacts:
    """Stretches of the way [M] in which the ego touches a forecast box."""

    low: Floats  # m
    high: Floats  # m
    step: Ints  # step of the forecast
    sample: Ints  # object times K plus k, ascending
    leads: Bools  # the object drives ahead in the direction of the way


def _resampled(forecast: Obstacles) -> Obstacles:
    """Return the forecast at places about `_MAX_STEP_S` apart.

    Dense places are thinned out; more are put between sparse ones, on straight lines.
    """
    path = forecast.path
    if forecast.dt <= _MAX_STEP_S:
        stride = min(int(_MAX_STEP_S / forecast.dt + _ROUNDING), path.shape[2])
        dense = path[:, :, stride - 1 :: stride]
        return Obstacles(forecast.box, dense, forecast.weight, forecast.dt * stride)
    parts = ceil(forecast.dt / _MAX_STEP_S - _ROUNDING)
    objects, samples, steps, _ = path.shape
    now_m = np.broadcast_to(forecast.box[:, None, None, :2], (objects, samples, 1, 2))
    start_m = np.concatenate([now_m, path[:, :, :-1]], axis=2)[:, :, :, None]
    part_share = np.arange(1, parts + 1)[:, None] / parts
    filled = part_share * (path[:, :, :, None] - start_m)
    filled += start_m
    filled = filled.reshape(objects, samples, parts * steps, 2)
    return Obstacles(forecast.box, filled, forecast.weight, forecast.dt / parts)


@lru_cache(maxsize=32)
def _station_grid(way: Way) -> tuple[Floats, Ints]:
    """Return a grid around a way: its lower corner [2], and its cells.

    A cell holds the index of the way's point next to its middle, -1 beyond `_REACH_M`.
    """
    corner = way.xy.min(axis=0) - _REACH_M - _CELL_M
    extent = way.xy.max(axis=0) + _REACH_M - corner
    within_reach = np.zeros(np.ceil(extent / _CELL_M).astype(np.int64) + 1, dtype=bool)
    reach_cells = round(_REACH_M / _CELL_M)
    # every other point: they are closer together than cells
    for x, y in ((way.xy[::2] - corner) / _CELL_M).astype(np.int64).tolist():
        columns = slice(max(x - reach_cells, 0), x + reach_cells + 1)
        rows = slice(max(y - reach_cells, 0), y + reach_cells + 1)
        within_reach[columns, rows] = True
    grid = np.full(within_reach.shape, -1)
    centers = corner + (np.argwhere(within_reach) + 0.5) * _CELL_M
    grid[within_reach] = KDTree(way.xy).query(centers)[1]
    return corner, grid


class Planner:
    """Decisions for one ego on its ``way``; ``size``: its length and width, m."""

    def __init__(
        self, way: Way, size: tuple[float, float], parameters: PlannerSection
    ) -> None:
        self._way = way
        self._size = size
        self._weights = parameters
        hard_braking = np.maximum(-_FIRST_MPS2 - _COMFORTABLE_BRAKING_MPS2, 0.0)
        # [C] m/s of progress that the first acceleration of each profile costs
        self._effort = parameters.comfort * hard_braking
        self._effort += parameters.smoothness * np.abs(_FIRST_MPS2)

    @cached_property
    def _allowed_mps(self) -> Floats:
        """Highest speeds [n] at points of the way that meet the limits ahead."""
        limit = self._weights.pace * self._way.limit.astype(np.float64)
        squared_mps = limit**2
        # braking over s metres takes 2 a s from the squared speed
        gained = 2 * _LIMIT_BRAKING_MPS2 * np.diff(self._way.s)
        for i in range(len(squared_mps) - 2, -1, -1):
            squared_mps[i] = min(squared_mps[i], squared_mps[i + 1] + gained[i])
        return np.sqrt(squared_mps)

    @cached_property
    def _speed_table(self) -> Floats:
        """Allowed speeds, every `_CELL_M` from the start of the way, m/s."""
        stations_m = np.arange(0.0, self._way.s[-1] + _CELL_M, _CELL_M)
        return np.interp(stations_m, self._way.s, self._allowed_mps)

    def allowed(self, s: float) -> float:
        """Return the highest speed at ``s`` m along the way, m/s."""
        return float(np.interp(s, self._way.s, self._allowed_mps))

    def profiles(
        self, s: float, speed: float, step_s: float, steps: int
    ) -> tuple[Floats, Floats]:
        """Return stations [C, T + 1] m and speeds of all profiles.

        The profiles begin now, at ``s`` m with ``speed`` m/s, and have values every
        ``step_s`` s.
        """
        stations_m, speeds_mps = np.empty((2, steps + 1, len(_FIRST_MPS2)))
        stations_m[0] = s
        speeds_mps[0] = speed
        for k in range(steps):
            later = k * step_s > _FIRST_SECONDS - 1e-6
            gain_mps = (_LATER_MPS2 if later else _FIRST_MPS2) * step_s
            cell = (stations_m[k] / _CELL_M).astype(np.int64)
            table_speed = self._speed_table.take(cell, mode="clip")
            # an ego that is too fast slows down at twice the usual rate
            top_mps = np.maximum(
                table_speed, speeds_mps[k] - 2 * _LIMIT_BRAKING_MPS2 * step_s
            )
            speeds_mps[k + 1] = np.maximum(
                np.minimum(speeds_mps[k] + gain_mps, top_mps), 0.0
            )
            stations_m[k + 1] = stations_m[k] + (speeds_mps[k] + speeds_mps[k + 1]) * (
                step_s / 2
            )
        return stations_m.T, speeds_mps.T

    def decide(self, s: float, speed: float, obstacles: Obstacles) -> Decision:
        """Choose the best profile at ``s`` m with ``speed`` m/s."""
        rows = self._relevant(obstacles)
        box = obstacles.box[rows]
        path = obstacles.path[rows]
        weight = obstacles.weight[rows]
        forecast = _resampled(Obstacles(box, path, weight, obstacles.dt))
        steps = forecast.path.shape[2]
        stations_m, speeds_mps = self.profiles(s, speed, forecast.dt, steps)
        box_station, aside_m, tangent = self._along_route(*forecast.box.T[:2])
        in_lane = aside_m < (self._size[1] + forecast.box[:, 5]) / 2
        turn = forecast.box[:, 3] - tangent
        follows = (box_station < s) & in_lane & (np.cos(turn) > _SAME_DIRECTION_COSINE)
        contacts = self._contacts(s, float(stations_m[:, -1].max()), forecast, follows)
        share, object_row = self._shares(stations_m, speeds_mps, contacts, forecast)
        progress_mps = (stations_m[:, -1] - s) / (forecast.dt * steps) - self._effort
        score = progress_mps - self._weights.caution * share.sum(axis=1)
        best = int(score.round(9).argmax())  # equal scores on all machines
        best_if_free = int(progress_mps.round(9).argmax())
        blocks = ((box_station > s) & in_lane)[object_row]
        if (blocks & (share.min(axis=0) > _EMERGENCY_RISK)).any():
            best = 0  # brakes hardest
        cause = -1
        if best != best_if_free and share[best_if_free].any():
            cause = int(rows[object_row[share[best_if_free].argmax()]])
        risk = 1.0 - float((1.0 - share[best]).prod())
        time = obstacles.dt * np.arange(obstacles.path.shape[2] + 1)
        profile_time = forecast.dt * np.arange(steps + 1)
        planned_m = np.interp(time, profile_time, stations_m[best])
        return Decision(float(_FIRST_MPS2[best]), risk, cause, planned_m)

    def _relevant(self, obstacles: Obstacles) -> Ints:
        """Return rows of objects whose forecasts reach the rectangle around the way.

        At a junction only a few do. Dense forecasts keep all objects, as `_resampled`
        makes them smaller.
        """
        reaches = np.ones(len(obstacles.box), dtype=bool)
        if obstacles.dt > _MAX_STEP_S:
            margin_m = _REACH_M + 2 * _CELL_M
            path = obstacles.path
            now_m = obstacles.box[:, :2]
            # missing samples may be NaN, which fmax and fmin leave out
            high_corner = np.fmax(np.fmax.reduce(path, axis=(1, 2)), now_m)
            low_corner = np.fmin(np.fmin.reduce(path, axis=(1, 2)), now_m)
            reaches &= (high_corner > self._way.xy.min(axis=0) - margin_m).all(axis=1)
            reaches &= (low_corner < self._way.xy.max(axis=0) + margin_m).all(axis=1)
        return np.flatnonzero(reaches)

    def _shares(
        self,
        stations_m: Floats,
        speeds_mps: Floats,
        contacts: _Contacts,
        forecast: Obstacles,
    ) -> tuple[Floats, Ints]:
        """Return the shares of n objects in the risks of C profiles.

        ``stations_m`` and ``speeds_mps`` [C, T + 1]. Shares [C, n] are in [0, 1],
        beside the rows [n] of the objects.
        """
        if not len(contacts.step):
            return np.zeros((len(stations_m), 0)), NO_ROWS
        samples = forecast.weight.shape[1]
        severity = self._severity(stations_m, speeds_mps, contacts, forecast.dt)
        # the worst contact of a sample counts, then all samples of an object
        worst, sample = _reduce_runs(np.maximum, severity, contacts.sample)
        risk = worst * forecast.weight.ravel()[sample]
        share, object_row = _reduce_runs(np.add, risk, sample // samples)
        return np.minimum(share, 1.0), object_row

    def _severity(
        self, stations_m: Floats, speeds_mps: Floats, contacts: _Contacts, step_s: float
    ) -> Floats:
        """Return the severity [C, M] of each contact in each profile.

        It is 0 for a profile without the contact.
        """
        times_s = step_s * np.arange(1, stations_m.shape[1])
        places_m = stations_m[:, 1:]
        gap_m = self._weights.headway * speeds_mps[:, 1:]
        nose_m = places_m + gap_m * np.minimum(times_s / _GAP_OPENING_S, 1.0)
        center_m = places_m[:, contacts.step]
        front_m = np.where(contacts.leads, nose_m[:, contacts.step], center_m)
        # within one step the ego may jump over the stretch of a leader
        start_m = stations_m[:, :-1][:, contacts.step]
        back_m = np.where(contacts.leads, start_m, center_m)
        touches = (front_m >= contacts.low) & (back_m <= contacts.high)
        severity = contact_severity(speeds_mps[:, 1:], times_s, self._weights.patience)
        # less where the ego enters only the time gap
        weight = np.where(center_m >= contacts.low, 1.0, _GAP_SEVERITY)
        return np.where(touches, weight * severity[:, contacts.step], 0.0)

    def _contacts(
        self, s: float, end_m: float, forecast: Obstacles, follows: Bools
    ) -> _Contacts:
        """Return contacts of an ego between ``s`` and ``end_m`` m.

        Objects that follow the ego (``follows`` [O]) have none.
        """
        _, samples, steps, _ = forecast.path.shape
        length_m = forecast.box[:, 4]
        width_m = forecast.box[:, 5]
        x, y = forecast.path.reshape(-1, 2).T
        way_point = self._nearest_points(x, y)
        counts = (forecast.weight > _MIN_SAMPLE_WEIGHT) & ~follows[:, None]
        path_row = np.flatnonzero((way_point >= 0) & counts.repeat(steps))
        place_m = self._way.s[way_point[path_row]]
        # a long box may reach the ego from a place behind ``s`` or beyond ``end_m``
        is_close = (place_m > s - 2 * _REACH_M) & (place_m < end_m + 3 * _REACH_M)
        path_row = path_row[is_close]
        object_row = path_row // (samples * steps)
        forecast_step = path_row % steps
        heading = self._headings(path_row, object_row, forecast_step, forecast)
        along = _DISC_PLACES * length_m[object_row, None]  # [n, discs]
        disc_x = x[path_row, None] + along * np.cos(heading)[:, None]
        disc_y = y[path_row, None] + along * np.sin(heading)[:, None]
        places_m = (disc_x.ravel(), disc_y.ravel())
        disc_station, aside_m, tangent = self._along_route(*places_m)
        radius_m = np.hypot(width_m / 2, length_m / (2 * _DISCS))[object_row]
        margin_m = self._weights.margin
        grown_m = margin_m + self._weights.growth * forecast.dt * (forecast_step + 1)
        reach_m = (radius_m + grown_m).repeat(_DISCS)
        meets = np.flatnonzero(aside_m < self._size[1] / 2 + reach_m)
        met_row = meets // _DISCS
        center_m = disc_station[meets]
        reach_m = self._size[0] / 2 + reach_m[meets]
        leads = np.cos(heading[met_row] - tangent[meets]) > _SAME_DIRECTION_COSINE
        # an ego beyond the middle of a leader has passed it
        return _Contacts(
            low=center_m - reach_m,
            high=np.where(leads, center_m, center_m + reach_m),
            step=forecast_step[met_row],
            sample=path_row[met_row] // steps,
            leads=leads,
        )

    def _headings(
        self, path_row: Ints, object_row: Ints, forecast_step: Ints, forecast: Obstacles
    ) -> Floats:
        """Return headings [n] of objects in rows [n] of the flat paths.

        An object that hardly moves keeps the heading of its box.
        """
        places_m = forecast.path.reshape(-1, 2)
        first = (forecast_step == 0)[:, None]
        # the row before is the step before
        start_m = np.where(first, forecast.box[object_row, :2], places_m[path_row - 1])
        move_x, move_y = (places_m[path_row] - start_m).T
        moves = np.hypot(move_x, move_y) > _MIN_TURN_SPEED_MPS * forecast.dt
        heading = np.where(
            moves, np.arctan2(move_y, move_x), forecast.box[object_row, 3]
        )
        return np.asarray(heading)

    def _nearest_points(self, x: Floats, y: Floats) -> Ints:
        """Return indices of the way's points next to places [n], -1 beyond reach.

        Places outside the grid count as in its outermost cells, which are beyond reach.
        """
        corner, grid = _station_grid(self._way)
        cells = []
        for value, start_m, count in zip((x, y), corner, grid.shape, strict=True):
            cell = np.fmin(np.fmax((value - start_m) / _CELL_M, 0), count - 1)
            cells.append(cell.astype(np.int64))
        return np.asarray(grid[cells[0], cells[1]])

    def _along_route(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Return stations, distances to the way and its headings for places [n], m.

        The distance is inf beyond reach.
        """
        way_point = self._nearest_points(x, y)
        tangent = self._way.heading[way_point]
        away_x = x - self._way.xy[way_point, 0]
        away_y = y - self._way.xy[way_point, 1]
        cos = np.cos(tangent)
        sin = np.sin(tangent)
        across_m = np.abs(away_y * cos - away_x * sin)
        aside_m = np.where(way_point >= 0, across_m, np.inf)
        station_m = self._way.s[way_point] + away_x * cos + away_y * sin
        return station_m, aside_m, tangent


def contact_severity(speed: Floats, time: Floats, patience: float) -> Floats:
    """Return the severity of contacts of an ego with a ``speed``, m/s.

    The severity grows with the speed up to 1. It decays with the ``time`` until the
    contact, s, over ``patience`` s.
    """
    growth = (1 - _STANDING_SEVERITY) * speed / _FULL_SEVERITY_SPEED_MPS
    severity = np.minimum(_STANDING_SEVERITY + growth, 1.0)
    return np.asarray(np.exp(-time / patience) * severity)


def _reduce_runs(
    operation: np.ufunc, values: Floats, keys: Ints
) -> tuple[Floats, Ints]:
    """Reduce columns of ``values`` [C, M] over runs of equal ``keys`` [M].

    Also returns the key of each run.
    """
    first = np.flatnonzero(np.diff(keys, prepend=-1))
    reduced: Floats = operation.reduceat(values, first, axis=1)
    return reduced, keys[first]

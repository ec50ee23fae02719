"""Fixed planner of the closed loop, which drives the best of some speed profiles.

A profile is an acceleration for a second and another one after it. It costs contacts of
the ego's box with forecast boxes, by the weights of the samples and the confidence of
the objects: probabilities that are true give as many contacts as will happen. Near
misses cost less, and so do late contacts and those of a standing ego, which are not its
fault. The ego keeps a time gap to objects that drive ahead, and leaves out those that
follow it. If no profile keeps clear of an object ahead in the lane, the ego brakes
hardest. `PlannerSection` weighs risk, progress and comfort.

The family is that of PDM-Closed (Dauner et al. 2023, "Parting with misconceptions about
learning-based vehicle motion planning"): proposals along a line, scored by a forecast.
"""

from dataclasses import dataclass
from functools import cached_property
from math import ceil

import numpy as np

from ..cards import PlannerSection
from ..core import NO_ROWS, Bools, Floats, Ints, sliding_contact
from .highway.driven import REACH_M, Way

# accelerations of all profiles, every pair: in the first second, and later
_FIRST_MPS2 = np.repeat([-8.0, -6.0, -4.5, -3.0, -2.0, -1.0, 0.0, 0.7, 1.5], 4)
_LATER_MPS2 = np.tile([-4.0, -2.0, 0.0, 1.5], 9)
_FIRST_SECONDS = 1.0
_MAX_STEP_S = 0.3  # between two forecast places that count
_MIN_SAMPLE_WEIGHT = 0.002  # of a sample that counts
_PARTS = 3  # of a box, one behind the other
# centres of the parts, as shares of the length
_PART_PLACES = (np.arange(_PARTS) - (_PARTS - 1) / 2) / _PARTS
_LIMIT_BRAKING_MPS2 = 1.5  # for lower limits ahead
_ROUNDING = 1e-6
_COMFORTABLE_BRAKING_MPS2 = 2.0  # costs no comfort
_MIN_TURN_SPEED_MPS = 0.5  # slower objects keep their heading
_TURN_RADIUS_M = 5.0  # of the narrowest curve
_STANDING_SEVERITY = 0.15  # of a contact while the ego stands
_FULL_SEVERITY_SPEED_MPS = 4.0  # ego speed from which a contact has severity 1
_EMERGENCY_RISK = 0.5  # of all profiles, by an object ahead in the lane
_NEAR_MISS_SEVERITY = 5 / 12  # against a contact, as in the drive score
_NEAR_MISS_S = 1.0  # of not braking that lead to a contact
_GAP_OPENING_S = 2.0  # in which the time gap to those ahead may be opened
_SAME_DIRECTION_COSINE = 0.5


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Forecast of O objects in the frame of the way: K samples of T steps of ``dt`` s.

    ``weight``: probability of a sample times the object's confidence.
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
    chance: Floats  # that the boxes touch within the stretch, in [0, 1]
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


def _without_creeping(forecast: Obstacles, creep: float) -> Obstacles:
    """Return the forecast without motion that is too slow to be told from noise.

    A place counts as the present one if it is reached at less than ``creep`` widths of
    the box per second.
    """
    now_m = forecast.box[:, None, None, :2]
    moved_m = np.hypot(*np.moveaxis(forecast.path - now_m, -1, 0))
    time_s = forecast.dt * np.arange(1, forecast.path.shape[2] + 1)
    creeps = moved_m < creep * forecast.box[:, 5, None, None] * time_s
    path = np.where(creeps[..., None], now_m, forecast.path)
    return Obstacles(forecast.box, path, forecast.weight, forecast.dt)


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
        squared_mps: Floats = (self._weights.pace * self._way.limit) ** 2
        # braking over s metres takes 2 a s from the squared speed
        gained = 2 * _LIMIT_BRAKING_MPS2 * np.diff(self._way.s)
        for i in range(len(squared_mps) - 2, -1, -1):
            squared_mps[i] = min(squared_mps[i], squared_mps[i + 1] + gained[i])
        return np.sqrt(squared_mps)

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
            allowed_mps = np.interp(stations_m[k], self._way.s, self._allowed_mps)
            # an ego that is too fast slows down at twice the usual rate
            slowed_mps = speeds_mps[k] - 2 * _LIMIT_BRAKING_MPS2 * step_s
            top_mps = np.maximum(allowed_mps, slowed_mps)
            speeds_mps[k + 1] = np.maximum(
                np.minimum(speeds_mps[k] + gain_mps, top_mps), 0.0
            )
            mean_mps = (speeds_mps[k] + speeds_mps[k + 1]) / 2
            stations_m[k + 1] = stations_m[k] + mean_mps * step_s
        return stations_m.T, speeds_mps.T

    def decide(self, s: float, speed: float, obstacles: Obstacles) -> Decision:
        """Choose the best profile at ``s`` m with ``speed`` m/s."""
        forecast = _without_creeping(_resampled(obstacles), self._weights.creep)
        steps = forecast.path.shape[2]
        stations_m, speeds_mps = self.profiles(s, speed, forecast.dt, steps)
        leads, follows = self._in_lane(s, forecast.box)
        contacts = self._contacts(s, float(stations_m[:, -1].max()), forecast, follows)
        share, object_row = self._shares(stations_m, speeds_mps, contacts, forecast)
        progress_mps = (stations_m[:, -1] - s) / (forecast.dt * steps) - self._effort
        score = progress_mps - self._weights.caution * share.sum(axis=1)
        best = int(score.round(9).argmax())  # equal on all machines
        best_if_free = int(progress_mps.round(9).argmax())
        if (share.min(axis=0) > _EMERGENCY_RISK)[leads[object_row]].any():
            best = 0  # brakes hardest
        cause = -1
        if best != best_if_free and share[best_if_free].any():
            cause = int(object_row[share[best_if_free].argmax()])
        risk = 1.0 - float((1.0 - share[best]).prod())
        time = obstacles.dt * np.arange(obstacles.path.shape[2] + 1)
        profile_time = forecast.dt * np.arange(steps + 1)
        planned_m = np.interp(time, profile_time, stations_m[best])
        return Decision(float(_FIRST_MPS2[best]), risk, cause, planned_m)

    def _in_lane(self, s: float, box: Floats) -> tuple[Bools, Bools]:
        """Return masks [O] of objects ahead in the lane of the ego, and of followers."""
        station_m, aside_m, tangent = self._way.along(*box.T[:2])
        in_lane = np.abs(aside_m) < (self._size[1] + box[:, 5]) / 2
        goes_along = np.cos(box[:, 3] - tangent) > _SAME_DIRECTION_COSINE
        return in_lane & (station_m > s), in_lane & (station_m < s) & goes_along

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
        chance, back_m = self._touches(stations_m, contacts)
        unbraked_m, gap_m = self._ahead(stations_m, speeds_mps, step_s)
        front_m = unbraked_m[:, contacts.step]
        behind_gap_m = np.maximum(front_m, gap_m[:, contacts.step])
        front_m = np.where(contacts.leads, behind_gap_m, front_m)
        is_near = (front_m >= contacts.low) & (back_m <= contacts.high)
        harm = np.maximum(chance, _NEAR_MISS_SEVERITY * is_near * contacts.chance)
        times_s = step_s * np.arange(1, stations_m.shape[1])
        severity = contact_severity(speeds_mps[:, 1:], times_s, self._weights.patience)
        return np.asarray(harm * severity[:, contacts.step])

    def _touches(
        self, stations_m: Floats, contacts: _Contacts
    ) -> tuple[Floats, Floats]:
        """Return chances [C, M] that boxes touch, and where the ego's centre is, m.

        Within one step the ego may jump over the stretch of a leader, so there it is
        where the step began.
        """
        center_m = stations_m[:, 1:][:, contacts.step]
        start_m = stations_m[:, :-1][:, contacts.step]
        back_m = np.where(contacts.leads, start_m, center_m)
        inside_m = np.minimum(center_m - contacts.low, contacts.high - back_m)
        chance = np.clip(0.5 + inside_m / (2 * self._weights.margin), 0.0, 1.0)
        return chance * contacts.chance, back_m

    def _ahead(
        self, stations_m: Floats, speeds_mps: Floats, step_s: float
    ) -> tuple[Floats, Floats]:
        """Return stations [C, T] that an ego should not share with others.

        Where it would be if it had not braked in the last `_NEAR_MISS_S`; and as far
        ahead as it drives in the time gap, which may be opened in `_GAP_OPENING_S`.
        """
        steps = np.arange(1, stations_m.shape[1])
        before = np.maximum(steps - round(_NEAR_MISS_S / step_s), 0)
        driven_m = speeds_mps[:, before] * step_s * (steps - before)
        opened = np.minimum(step_s * steps / _GAP_OPENING_S, 1.0)
        gap_m = self._weights.headway * speeds_mps[:, 1:] * opened
        return stations_m[:, before] + driven_m, stations_m[:, 1:] + gap_m

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
        way_point = self._way.nearest_points(x, y)
        counts = (forecast.weight > _MIN_SAMPLE_WEIGHT) & ~follows[:, None]
        path_row = np.flatnonzero((way_point >= 0) & counts.repeat(steps))
        place_m = self._way.s[way_point[path_row]]
        # a long box may reach the ego from a place behind ``s`` or beyond ``end_m``
        is_close = (place_m > s - 2 * REACH_M) & (place_m < end_m + 3 * REACH_M)
        path_row = path_row[is_close]
        object_row = path_row // (samples * steps)
        forecast_step = path_row % steps
        heading = self._headings(path_row, object_row, forecast_step, forecast)
        along = _PART_PLACES * length_m[object_row, None]  # [n, parts]
        part_x = x[path_row, None] + along * np.cos(heading)[:, None]
        part_y = y[path_row, None] + along * np.sin(heading)[:, None]
        station_m, aside_m, tangent = self._way.along(part_x.ravel(), part_y.ravel())
        # the parts seen from the way
        part = np.zeros((len(station_m), 7))
        part[:, 0] = station_m
        part[:, 1] = aside_m
        part[:, 3] = heading.repeat(_PARTS) - tangent
        part[:, 4] = (length_m[object_row] / _PARTS).repeat(_PARTS)
        part[:, 5] = width_m[object_row].repeat(_PARTS)
        turn = part[:, 3]
        across_m = part[:, 4] * np.abs(np.sin(turn)) + part[:, 5] * np.abs(np.cos(turn))
        overlap_m = (across_m + self._size[1]) / 2 - np.abs(aside_m)
        chance = np.minimum(0.5 + overlap_m / (2 * self._weights.margin), 1.0)
        meets = np.flatnonzero(chance > 0)
        met_row = meets // _PARTS
        wide_ego = (self._size[0], self._size[1] + 2 * self._weights.margin)
        low_m, high_m = sliding_contact(wide_ego, part[meets])
        leads = np.cos(turn[meets]) > _SAME_DIRECTION_COSINE
        # an ego beyond the middle of a leader has passed it
        middle_m = station_m[_PARTS // 2 :: _PARTS][met_row]
        return _Contacts(
            low=low_m,
            high=np.where(leads, np.minimum(high_m, middle_m), high_m),
            chance=chance[meets],
            step=forecast_step[met_row],
            sample=path_row[met_row] // steps,
            leads=leads,
        )

    def _headings(
        self, path_row: Ints, object_row: Ints, forecast_step: Ints, forecast: Obstacles
    ) -> Floats:
        """Return headings [n], from those of the boxes on, of rows [n] of the flat paths.

        An object turns towards its direction of motion as far as a car can.
        """
        places_m = forecast.path.reshape(-1, 2)
        now_m = forecast.box[object_row, :2]
        first = (forecast_step == 0)[:, None]
        # the row before is the step before
        start_m = np.where(first, now_m, places_m[path_row - 1])
        move_x, move_y = (places_m[path_row] - start_m).T
        moves = np.hypot(move_x, move_y) > _MIN_TURN_SPEED_MPS * forecast.dt
        yaw = forecast.box[object_row, 3]
        turn = np.where(moves, np.arctan2(move_y, move_x) - yaw, 0.0)
        # a box has no front: it may also go backwards
        yaw = np.where(np.cos(turn) < 0, yaw + np.pi, yaw)
        turn = np.arctan(np.tan(turn))
        most = np.hypot(*(places_m[path_row] - now_m).T) / _TURN_RADIUS_M
        return np.asarray(yaw + np.clip(turn, -most, most))


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

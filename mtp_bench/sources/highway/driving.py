"""State of all vehicles, and the driver model: following a leader, desired speed, steering.

Gaps are measured from bumper to bumper along the path. Treiber, Hennecke, Helbing (2000), "Congested traffic states in
empirical observations and microscopic simulations" (intelligent driver model).
"""

from dataclasses import dataclass

import numpy as np

from ...types import Bools, Floats, Ints
from .lanes import NO_LANE, LaneGeometry, RouteTable
from .networks import RoadMap
from .vehicles import Driver, places

_DISCS = 7  # discs along a vehicle's axis that cover its box
_DISC_PLACES = (np.arange(_DISCS) - (_DISCS - 1) / 2) / _DISCS  # their centres, as shares of the length
_PERSON_RADIUS = 0.4  # m
_MARGIN = 0.3  # m, free space on both sides
_CLOSE = 0.05  # m, least gap in the driver model
_LATERAL_RATE = 0.8  # 1/s, decay of an offset from the target place in the lane
_LATERAL_SPEED = 1.3  # m/s at most
_HEADING_RATE = 3.3  # 1/s
_SWERVE = 2.2  # m/s2 of lateral acceleration at most, in addition to that of the bend
_SLOW = 5.5  # m/s; slower vehicles turn as at this speed
_PREVIEW = 0.3  # s
_MOST_SLIP = 0.45  # sine of the angle between heading and course, about 0.8 rad of steering
_SLIP_RATE = 0.3  # rad/s, about 0.6 rad/s of steering


class Fleet:
    """Constants of N vehicles."""

    def __init__(self, vehicles: list[Driver], geometry: LaneGeometry) -> None:
        self.vehicles = vehicles
        self.numbers: Ints = np.array([v.number for v in vehicles], dtype=np.int64)
        traits = np.array([v.parameters for v in vehicles], dtype=np.float64).reshape(-1, 13)
        self.length, self.width, self.wheelbase = traits[:, :3].T.copy()  # [N]
        self.style = traits[:, 3:10]  # [N, 7] pace, top speed, time gap, least gap, acceleration, braking, politeness
        self.offset = traits[:, 10].copy()  # [N] m right of the middle of the lane, preferred
        self.disc_places = (self.length[:, None] * _DISC_PLACES)[:, :, None]  # [N, discs, 1] m along the axis
        self.disc_radius = np.repeat(np.hypot(self.width / 2, self.length / (2 * _DISCS)), _DISCS)
        self.disc_owner = np.repeat(np.arange(len(vehicles)), _DISCS)
        sizes = (self.length[:, None], self.width[:, None], self.wheelbase[:, None])
        outer, inner = swept_sides(*sizes, geometry.radius)
        right_turn = geometry.turn > 0
        self.left, self.right = np.where(right_turn, outer, inner), np.where(right_turn, inner, outer)  # [N, L] m

    def __len__(self) -> int:
        return len(self.vehicles)


class RoadState(Fleet):
    """N vehicles in the order of the road's list, and discs that cover vehicles and M people; highway-env's frame."""

    def __init__(
        self, fleet: Fleet, road_map: RoadMap, routes: RouteTable, people: Floats, people_velocity: Floats
    ) -> None:
        """Read the state of the ``fleet`` and move the lane numbers of its vehicles on along their ``routes``.

        ``people`` and ``people_velocity`` ``[M, 2]``: places and velocities of people on foot.
        """
        vars(self).update(vars(fleet))
        vehicles, n, m = fleet.vehicles, len(fleet), len(people)
        rows = [(v.heading, v.speed, *v.action.values(), v.route, v.lane_number) for v in vehicles]
        columns = np.array(rows, dtype=np.float64).reshape(-1, 6).T.copy()
        self.xy = places(vehicles)  # [N, 2]
        self.heading, self.speed, self.steering, self.acceleration = columns[:4]  # [N], the last two of the last step
        route, lane = columns[4:].astype(np.int64)
        direction = np.stack([np.cos(self.heading), np.sin(self.heading)], axis=1)
        discs = self.xy[:, None, :] + fleet.disc_places * direction[:, None, :]
        points = np.concatenate([discs.reshape(-1, 2), people])
        self.along, self.across = road_map.geometry.coordinates(points)  # [L, P] lane coordinates of the discs
        center, length = np.arange(n) * _DISCS + _DISCS // 2, road_map.geometry.length
        for _ in range(2):  # a lane may be shorter than a step
            after = routes.following[route, lane]
            lane = np.where((self.along[lane, center] > length[lane]) & (after != NO_LANE), after, lane)
        for vehicle, number in zip(vehicles, lane.tolist(), strict=True):
            vehicle.lane_number = number
        self.route, self.lane = route, lane  # [N] lane that is driven in, or towards
        self.s, self.d = self.along[lane, center], self.across[lane, center]  # [N] coordinates in that lane
        self.path = routes.path[route, lane]  # [N, K] lanes ahead, the present one first; `NO_LANE` without one
        self.path_start = routes.path_start[route, lane] - self.s[:, None]  # [N, K] m from the vehicle to their start
        self.progress = routes.start[route, lane] + self.s  # [N] m from the start of the route
        self.velocity = np.concatenate([direction * self.speed[:, None], people_velocity])  # [N + M, 2]
        self.disc_owner = np.concatenate([fleet.disc_owner, n + np.arange(m)])  # [P] index into ``velocity``
        self.disc_radius = np.concatenate([fleet.disc_radius, np.full(m, _PERSON_RADIUS)])  # [P]
        self.finished: Bools = routes.last[route, lane] & (self.s > length[lane] - 1.0)  # [N] at the end of the route


@dataclass(frozen=True, eq=False)
class Leaders:
    """Nearest obstacle in the path of each vehicle."""

    gap: Floats  # [N] m from the bumper; inf without one
    speed: Floats  # [N] m/s along the path


def find_leaders(state: RoadState, geometry: LaneGeometry) -> Leaders:
    """Find the nearest disc of another vehicle or person in the strip that each vehicle is going to sweep."""
    lanes = state.path
    low, high = _swept_strip(state)
    row, k, disc = _discs_in_lanes(state, geometry, lanes, low, high)
    lane = lanes[row, k]
    ahead = state.along[lane, disc] + state.path_start[row, k]
    across, radius = state.across[lane, disc], state.disc_radius[disc]
    blocks = (ahead > 0.0) & (across + radius > low[row, k]) & (across - radius < high[row, k])
    blocks &= state.disc_owner[disc] != row
    row, k, disc = row[blocks], k[blocks], disc[blocks]
    gap = ahead[blocks] - radius[blocks]
    least = np.full(len(state), np.inf)
    np.minimum.at(least, row, gap)
    nearest = np.flatnonzero(gap == least[row])
    first = np.ones(len(nearest), dtype=np.bool_)  # of each vehicle
    first[1:] = row[nearest[1:]] > row[nearest[:-1]]
    nearest = nearest[first]
    row, k, disc = row[nearest], k[nearest], disc[nearest]
    lane = lanes[row, k]
    tangent = geometry.heading(lane, state.along[lane, disc])
    velocity = state.velocity[state.disc_owner[disc]]
    speed = np.zeros(len(state))
    speed[row] = velocity[:, 0] * np.cos(tangent) + velocity[:, 1] * np.sin(tangent)
    return Leaders(least - state.length / 2, speed)


def _discs_in_lanes(
    state: RoadState, geometry: LaneGeometry, lanes: Ints, low: Floats, high: Floats
) -> tuple[Ints, Ints, Ints]:
    """Candidates for `find_leaders`: vehicle, index into its path ``lanes`` ``[N, K]``, disc that may be there.

    ``low`` and ``high`` ``[N, K]``: the swept strip; per lane the widest one of all vehicles counts.
    """
    row, k = np.nonzero(lanes >= 0)
    lane = lanes[row, k]
    least, most = np.full(len(geometry), np.inf), np.full(len(geometry), -np.inf)
    np.minimum.at(least, lane, low[row, k])
    np.maximum.at(most, lane, high[row, k])
    inside = (state.along > -0.3) & (state.along < geometry.length[:, None] + 0.3)
    radius = state.disc_radius
    inside &= (state.across + radius > least[:, None]) & (state.across - radius < most[:, None])
    disc, count = np.nonzero(inside)[1], inside.sum(axis=1)
    begin = np.cumsum(count) - count
    candidates = count[lane]
    pair = np.repeat(np.arange(len(lane)), candidates)
    shift = begin[lane] - (np.cumsum(candidates) - candidates)
    return row[pair], k[pair], disc[np.arange(len(pair)) + shift[pair]]


def _swept_strip(state: RoadState) -> tuple[Floats, Floats]:
    """Least and greatest lateral position ``[N, K]`` m that each vehicle sweeps in the lanes of its path.

    In its present lane it moves to its desired offset, in later lanes between that offset and the middle.
    """
    low, high = np.empty(state.path.shape), np.empty(state.path.shape)
    low.T[:], high.T[:] = np.minimum(state.offset, 0.0), np.maximum(state.offset, 0.0)
    low[:, 0], high[:, 0] = np.minimum(state.d, state.offset), np.maximum(state.d, state.offset)
    rows = np.arange(len(state))[:, None]
    return low - state.left[rows, state.path] - _MARGIN, high + state.right[rows, state.path] + _MARGIN


def swept_sides(length: Floats, width: Floats, wheelbase: Floats, radius: Floats) -> tuple[Floats, Floats]:
    """Reach of a box to the outer and to the inner side of a bend that its centre follows, m."""
    rear = np.where(np.isinf(radius), 0.0, np.sqrt(np.maximum(radius**2 - wheelbase**2 / 4, 0.0)))
    front = (wheelbase + length) / 2
    with np.errstate(invalid="ignore"):
        outer = np.where(np.isinf(radius), width / 2, np.hypot(rear + width / 2, front) - radius)
        inner = np.where(np.isinf(radius), width / 2, radius - rear + width / 2)
    return outer, inner


def desired_speed(state: RoadState, geometry: LaneGeometry) -> Floats:
    """Desired speed ``[N]`` m/s, which decreases in time for the limits ahead."""
    distance = np.maximum(state.path_start - state.length[:, None] / 2, 0)
    limit = geometry.limit[state.path] * state.style[:, 0, None]
    allowed = np.sqrt(limit**2 + 2.0 * 1.3 * distance)
    allowed[state.path < 0] = np.inf
    return np.asarray(np.minimum(allowed.min(axis=1), state.style[:, 1]))


def free_acceleration(speed: Floats, desired: Floats, style: Floats) -> Floats:
    """Acceleration ``[N]`` m/s2 of the driver model on an empty road."""
    a = style[..., 4]
    return np.maximum(a * (1.0 - (speed / np.maximum(desired, 0.1)) ** 4), -style[..., 5])


def braking(speed: Floats, gap: Floats, leader: Floats, style: Floats, least: float | None = None) -> Floats:
    """Decrease ``[N]`` m/s2 of the acceleration for a leader at a ``gap`` ``[N]`` m.

    ``speed`` and ``leader`` ``[N]``: m/s of both; ``style``: of the drivers; ``least``: m, another gap at rest.
    """
    a, b = style[..., 4], style[..., 5]
    closing = speed * (speed - leader) / (2.0 * np.sqrt(a * b))
    jam = style[..., 3] if least is None else least
    wanted = jam + np.maximum(speed * style[..., 2] + closing, 0.0)
    return a * (wanted / np.maximum(gap, _CLOSE)) ** 2


def steering_angles(state: RoadState, geometry: LaneGeometry, routes: RouteTable, dt: float) -> Floats:
    """Steering angle ``[N]`` rad that brings each vehicle to its place in the lane and along it.

    The angles of ``dt`` seconds ago limit the new ones.
    """
    v = np.maximum(state.speed, 1.0)
    ahead = state.s + v * _PREVIEW
    after = routes.following[state.route, state.lane]
    beyond = (ahead > geometry.length[state.lane]) & (after >= 0)
    lane = np.where(beyond, after, state.lane)
    s = np.where(beyond, ahead - geometry.length[state.lane], ahead)
    slip = np.arcsin(np.clip(state.wheelbase / 2 * geometry.curvature[lane], -0.9, 0.9))
    rate = np.clip(-_LATERAL_RATE * (state.d - state.offset), -_LATERAL_SPEED, _LATERAL_SPEED)
    wanted = geometry.heading(lane, s) - slip + np.arcsin(np.clip(rate / np.maximum(v, 3.0), -0.35, 0.35))
    error = np.remainder(wanted - state.heading + np.pi, 2 * np.pi) - np.pi
    bend = v * geometry.curvature[lane]
    most = _SWERVE / np.maximum(v, _SLOW)
    rate = np.clip(_HEADING_RATE * error, bend - most, bend + most)
    turn = np.arcsin(np.clip(state.wheelbase / 2 * rate / v, -_MOST_SLIP, _MOST_SLIP))
    now = np.arctan(np.tan(state.steering) / 2)
    return np.asarray(np.arctan(2 * np.tan(np.clip(turn, now - _SLIP_RATE * dt, now + _SLIP_RATE * dt))))

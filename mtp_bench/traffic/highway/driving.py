"""State of all vehicles, and the driver model: following a leader, desired speed, steering.

Gaps are measured from bumper to bumper along the path. Treiber, Hennecke, Helbing (2000), "Congested traffic states in
empirical observations and microscopic simulations" (intelligent driver model).
"""

from dataclasses import dataclass

import numpy as np

from ...core import Bools, Floats, Ints
from .lanes import NO_LANE, LaneGeometry, RouteTable
from .networks import RoadMap
from .vehicles import Driver

_DISCS = 7  # discs along a vehicle's axis that cover its box
_DISC_PLACES = (
    np.arange(_DISCS) - (_DISCS - 1) / 2
) / _DISCS  # their centres, as shares of the length
_PERSON_RADIUS = 0.4  # m
_MARGIN = 0.3  # m, free space on both sides
_CLOSE = 0.05  # m, least gap in the driver model
_LATERAL_RATE = 0.8  # 1/s, decay of an offset from the target place in the lane
_LATERAL_SPEED = 1.3  # m/s at most
_HEADING_RATE = 3.3  # 1/s
_SWERVE = 2.2  # m/s2 of lateral acceleration at most, in addition to that of the bend
_SLOW = 5.5  # m/s; slower vehicles turn as at this speed
_PREVIEW = 0.3  # s
_MOST_SLIP = (
    0.45  # sine of the angle between heading and course, about 0.8 rad of steering
)
_SLIP_RATE = 0.3  # rad/s, about 0.6 rad/s of steering


class Fleet:
    """Constants of N vehicles, of M people on foot, and of the P discs that cover them."""

    def __init__(
        self, vehicles: list[Driver], people: int, geometry: LaneGeometry
    ) -> None:
        self.vehicles, self.people, n = vehicles, people, len(vehicles)
        self.numbers = np.array([v.number for v in vehicles], dtype=np.int64)
        traits = np.array([v.parameters for v in vehicles], dtype=np.float64).reshape(
            -1, 13
        )
        self.length, self.width, self.wheelbase = traits[:, :3].T.copy()  # [N]
        self.style = traits[
            :, 3:10
        ]  # [N, 7] pace, top speed, time gap, least gap, acceleration, braking, politeness
        self.offset = traits[
            :, 10
        ].copy()  # [N] m right of the middle of the lane, preferred
        self.disc_places = (
            self.length[:, None] * _DISC_PLACES
        )  # [N, discs] m along the axis
        self.center = np.arange(n) * _DISCS + _DISCS // 2  # [N] the disc in the middle
        radius = np.repeat(np.hypot(self.width / 2, self.length / (2 * _DISCS)), _DISCS)
        self.disc_radius = np.concatenate(
            [radius, np.full(people, _PERSON_RADIUS)]
        )  # [P]
        self.disc_owner = np.concatenate(
            [np.repeat(np.arange(n), _DISCS), n + np.arange(people)]
        )  # [P] vehicle, person
        sizes = (self.length[:, None], self.width[:, None], self.wheelbase[:, None])
        outer, inner = swept_sides(*sizes, geometry.radius)
        right_turn = geometry.turn > 0
        self.left, self.right = (
            np.where(right_turn, outer, inner),
            np.where(right_turn, inner, outer),
        )  # [N, L] m
        self.slip = np.arcsin(
            np.clip(sizes[2] / 2 * geometry.curvature, -0.9, 0.9)
        )  # [N, L] rad, in the lanes
        self.limit = (
            geometry.limit * self.style[:, :1]
        ) ** 2  # [N, L] m2/s2, of the desired speed, squared

    def __len__(self) -> int:
        return len(self.vehicles)


class RoadState(Fleet):
    """N vehicles in the order of the road's list, and the discs that cover vehicles and people; highway-env's frame."""

    def __init__(
        self,
        fleet: Fleet,
        road_map: RoadMap,
        routes: RouteTable,
        people: Floats,
        people_velocity: Floats,
    ) -> None:
        """Read the state of the ``fleet`` and move the lane numbers of its vehicles on along their ``routes``.

        ``people`` and ``people_velocity`` ``[2, M]``: places and velocities of people on foot.
        """
        vars(self).update(vars(fleet))
        vehicles, center, length = (
            fleet.vehicles,
            fleet.center,
            road_map.geometry.length,
        )
        rows = [
            (
                *v.position,
                v.heading,
                v.speed,
                *v.action.values(),
                v.route,
                v.lane_number,
            )
            for v in vehicles
        ]
        columns = np.array(rows, dtype=np.float64).reshape(-1, 8).T.copy()
        self.xy = columns[:2]  # [2, N]
        self.heading, self.speed, self.steering, self.acceleration = columns[
            2:6
        ]  # [N], the last two of the last step
        route, lane = columns[6:].astype(np.int64)
        direction = np.array([np.cos(self.heading), np.sin(self.heading)])
        discs = self.xy[:, :, None] + fleet.disc_places * direction[:, :, None]
        points = np.concatenate([discs.reshape(2, -1), people], axis=1)
        self.along, self.across = road_map.geometry.coordinates(
            points
        )  # [L, P] lane coordinates of the discs
        for _ in range(2):  # a lane may be shorter than a step
            after = routes.following[route, lane]
            passed = (self.along[lane, center] > length[lane]) & (after != NO_LANE)
            if not passed.any():
                break
            lane = np.where(passed, after, lane)
        for vehicle, number in zip(vehicles, lane.tolist(), strict=True):
            vehicle.lane_number = number
        self.route, self.lane = route, lane  # [N] lane that is driven in, or towards
        self.s, self.d = (
            self.along[lane, center],
            self.across[lane, center],
        )  # [N] coordinates in that lane
        self.path = routes.path[
            route, lane
        ]  # [N, K] lanes ahead, the present one first; `NO_LANE` without one
        self.path_start = (
            routes.path_start[route, lane] - self.s[:, None]
        )  # [N, K] m from the vehicle to their start
        self.progress = (
            routes.start[route, lane] + self.s
        )  # [N] m from the start of the route
        self.velocity = np.concatenate(
            [direction * self.speed, people_velocity], axis=1
        )  # [2, N + M]
        self.finished = routes.last[route, lane] & (
            self.s > length[lane] - 1.0
        )  # [N] at the end of the route


@dataclass(frozen=True, eq=False)
class Leaders:
    """Nearest obstacle in the path of each vehicle."""

    gap: Floats  # [N] m from the bumper; inf without one
    speed: Floats  # [N] m/s along the path


def find_leaders(state: RoadState, geometry: LaneGeometry) -> Leaders:
    """Find the nearest disc of another vehicle or person in the strip that each vehicle is going to sweep."""
    row, k = np.nonzero(
        state.path >= 0
    )  # R lanes of all paths, in the order of the vehicles
    if not len(row):
        return Leaders(np.zeros(0), np.zeros(0))
    lane, radius, now = state.path[row, k], state.disc_radius, k == 0
    low, high = _swept_strip(state, row, lane, now)
    inside = (state.along > -0.3) & (state.along < geometry.length[:, None] + 0.3)
    ahead = (
        np.where(inside, state.along, -np.inf)[lane] + state.path_start[row, k, None]
    )  # [R, P]
    blocks = (state.across + radius)[lane] > low[:, None]
    blocks &= (state.across - radius)[lane] < high[:, None]
    blocks &= (ahead > 0.0) & (state.disc_owner != row[:, None])
    gap, gaps = (
        np.where(blocks, ahead - radius, np.inf),
        np.full(state.path.shape, np.inf),
    )
    disc = gap.argmin(axis=1)
    least = gaps[row, k] = gap[np.arange(len(row)), disc]
    nearest = now.nonzero()[0] + gaps.argmin(axis=1)  # [N]
    lane, disc, least = lane[nearest], disc[nearest], least[nearest]
    tangent = geometry.heading(lane, state.along[lane, disc])
    velocity = state.velocity[:, state.disc_owner[disc]]
    speed = velocity[0] * np.cos(tangent) + velocity[1] * np.sin(tangent)
    return Leaders(least - state.length / 2, np.where(least < np.inf, speed, 0.0))


def _swept_strip(
    state: RoadState, row: Ints, lane: Ints, now: Bools
) -> tuple[Floats, Floats]:
    """Least and greatest lateral position ``[R]`` m that vehicles ``row`` sweep in lanes ``lane`` of their paths.

    In its present lane (``now``) one moves to its desired offset, in later lanes between that offset and the middle.
    """
    offset = state.offset
    low = np.where(now, np.minimum(state.d, offset)[row], np.minimum(offset, 0.0)[row])
    high = np.where(now, np.maximum(state.d, offset)[row], np.maximum(offset, 0.0)[row])
    return low - state.left[row, lane] - _MARGIN, high + state.right[
        row, lane
    ] + _MARGIN


def swept_sides(
    length: Floats, width: Floats, wheelbase: Floats, radius: Floats
) -> tuple[Floats, Floats]:
    """Reach of a box to the outer and to the inner side of a bend that its centre follows, m."""
    rear = np.where(
        np.isinf(radius), 0.0, np.sqrt(np.maximum(radius**2 - wheelbase**2 / 4, 0.0))
    )
    front = (wheelbase + length) / 2
    with np.errstate(invalid="ignore"):
        outer = np.where(
            np.isinf(radius), width / 2, np.hypot(rear + width / 2, front) - radius
        )
        inner = np.where(np.isinf(radius), width / 2, radius - rear + width / 2)
    return outer, inner


def desired_speed(state: RoadState) -> Floats:
    """Desired speed ``[N]`` m/s, which decreases in time for the limits ahead."""
    distance = np.maximum(state.path_start - state.length[:, None] / 2, 0)
    allowed = np.sqrt(
        state.limit[np.arange(len(state))[:, None], state.path] + 2.0 * 1.3 * distance
    )
    allowed[state.path < 0] = np.inf
    return np.asarray(np.minimum(allowed.min(axis=1), state.style[:, 1]))


def free_acceleration(speed: Floats, desired: Floats, style: Floats) -> Floats:
    """Acceleration ``[N]`` m/s2 of the driver model on an empty road."""
    a = style[..., 4]
    return np.maximum(
        a * (1.0 - (speed / np.maximum(desired, 0.1)) ** 4), -style[..., 5]
    )


def braking(
    speed: Floats,
    gap: Floats,
    leader: Floats,
    style: Floats,
    least: float | None = None,
) -> Floats:
    """Decrease ``[N]`` m/s2 of the acceleration for a leader at a ``gap`` ``[N]`` m.

    ``speed`` and ``leader`` ``[N]``: m/s of both; ``style``: of the drivers; ``least``: m, another gap at rest.
    """
    a, b = style[..., 4], style[..., 5]
    closing = speed * (speed - leader) / (2.0 * np.sqrt(a * b))
    jam = style[..., 3] if least is None else least
    wanted = jam + np.maximum(speed * style[..., 2] + closing, 0.0)
    return a * (wanted / np.maximum(gap, _CLOSE)) ** 2


def steering_angles(
    state: RoadState, geometry: LaneGeometry, routes: RouteTable, dt: float
) -> Floats:
    """Steering angle ``[N]`` rad that brings each vehicle to its place in the lane and along it.

    The angles of ``dt`` seconds ago limit the new ones.
    """
    v = np.maximum(state.speed, 1.0)
    ahead = state.s + v * _PREVIEW
    after = routes.following[state.route, state.lane]
    beyond = (ahead > geometry.length[state.lane]) & (after >= 0)
    lane = np.where(beyond, after, state.lane)
    s = np.where(beyond, ahead - geometry.length[state.lane], ahead)
    slip = state.slip[np.arange(len(state)), lane]
    rate = (-_LATERAL_RATE * (state.d - state.offset)).clip(
        -_LATERAL_SPEED, _LATERAL_SPEED
    )
    wanted = (
        geometry.heading(lane, s)
        - slip
        + np.arcsin((rate / np.maximum(v, 3.0)).clip(-0.35, 0.35))
    )
    error = np.remainder(wanted - state.heading + np.pi, 2 * np.pi) - np.pi
    bend = v * geometry.curvature[lane]
    most = _SWERVE / np.maximum(v, _SLOW)
    rate = (_HEADING_RATE * error).clip(bend - most, bend + most)
    turn = np.arcsin((state.wheelbase / 2 * rate / v).clip(-_MOST_SLIP, _MOST_SLIP))
    now = np.arctan(np.tan(state.steering) / 2)
    return np.asarray(
        np.arctan(2 * np.tan(turn.clip(now - _SLIP_RATE * dt, now + _SLIP_RATE * dt)))
    )

"""State of all vehicles, and the driver model: leaders, desired speed, steering.

Gaps are measured from bumper to bumper along the path. Treiber, Hennecke, Helbing
(2000), "Congested traffic states in empirical observations and microscopic simulations"
(intelligent driver model).
"""

from dataclasses import dataclass

import numpy as np

from ...core import Bools, Floats, Ints, wrap_angle
from .lanes import NO_LANE, LaneGeometry, RoadMap, RouteTable
from .vehicles import Driver

# columns of a driving style
_PACE, _TOP_SPEED, _TIME_GAP, MIN_GAP, ACCELERATION, _BRAKING, POLITENESS = range(7)

_DISCS = 7  # along a vehicle's axis, that cover its box
# centres of the discs, as shares of the length
_DISC_PLACES = (np.arange(_DISCS) - (_DISCS - 1) / 2) / _DISCS
_PERSON_RADIUS_M = 0.4
_SIDE_MARGIN_M = 0.3  # free space on both sides
_MIN_GAP_M = 0.05  # in the driver model
_LANE_MARGIN_M = 0.3  # beyond the ends of a lane, within which discs count
_FINISHED_M = 1.0  # to the end of the route
_LIMIT_BRAKING_MPS2 = 1.3  # for limits ahead
_LATERAL_RATE = 0.8  # 1/s, decay of an offset from the target place in the lane
_MAX_LATERAL_MPS = 1.3
_HEADING_RATE = 3.3  # 1/s
# lateral acceleration at most, in addition to that of the bend
_MAX_SWERVE_MPS2 = 2.2
_MIN_SWERVE_SPEED_MPS = 5.5  # slower vehicles turn as at this speed
_PREVIEW_S = 0.3
# slower vehicles drift to their place in the lane, and steer, as at these speeds
_MIN_DRIFT_SPEED_MPS = 3.0
_MIN_STEERING_SPEED_MPS = 1.0
_MAX_DRIFT_SINE = 0.35
_MAX_LANE_SLIP_SINE = 0.9
# sine of the angle between heading and course, about 0.8 rad of steering
_MAX_SLIP_SINE = 0.45
_SLIP_RATE = 0.3  # rad/s, about 0.6 rad/s of steering


class RoadState:
    """N vehicles, and the P discs that cover them and M people on foot.

    The vehicles have the order of the road's list. The frame is highway-env's.
    """

    def __init__(
        self,
        vehicles: list[Driver],
        road_map: RoadMap,
        routes: RouteTable,
        people: Floats,
        people_velocity: Floats,
    ) -> None:
        """Read the state and move lane numbers on along the ``routes``.

        ``people`` and ``people_velocity`` [2, M]: places and velocities of people.
        """
        geometry = road_map.geometry
        self.vehicles = vehicles
        self.numbers = np.array([v.number for v in vehicles], dtype=np.int64)
        self._read_traits(geometry)
        rows = [(*v.position, v.heading, v.speed, *v.action.values()) for v in vehicles]
        columns = np.array(rows, dtype=np.float64).reshape(-1, 6).T.copy()
        self.xy = columns[:2]  # [2, N]
        # [N], the last two of the last step
        self.heading, self.speed, self.steering, self.acceleration = columns[2:]
        direction = np.array([np.cos(self.heading), np.sin(self.heading)])
        # [2, N + M]
        self.velocity = np.concatenate(
            [direction * self.speed, people_velocity], axis=1
        )
        self._cover(geometry, direction, people)

        # [N] lane that is driven in, or towards
        self.route, self.lane = self._advance_lanes(geometry, routes)
        center = self._center_discs()
        self.s = self.along[self.lane, center]  # [N] coordinates in that lane
        self.d = self.across[self.lane, center]
        # [N, K] lanes ahead, the present one first; `NO_LANE` without one
        self.path = routes.path[self.route, self.lane]
        # [N, K] m from the vehicle to their start
        path_start = routes.path_start[self.route, self.lane]
        self.path_start = path_start - self.s[:, None]
        # [N] m from the start of the route
        self.progress = routes.start[self.route, self.lane] + self.s
        # [N] at the end of the route
        at_end = self.s > geometry.length[self.lane] - _FINISHED_M
        self.finished = routes.on_last_road[self.route, self.lane] & at_end

    def __len__(self) -> int:
        return len(self.vehicles)

    def _read_traits(self, geometry: LaneGeometry) -> None:
        rows = [v.parameters for v in self.vehicles]  # fields of `VehicleTraits`
        traits = np.array(rows, dtype=np.float64).reshape(-1, 13)
        self.length, self.width, self.wheelbase = traits[:, :3].T.copy()  # [N]
        # [N, 7] pace, top speed, time gap, least gap, acceleration, braking, politeness
        self.style = traits[:, 3:10]
        # [N] m right of the middle of the lane, preferred
        self.offset = traits[:, 10].copy()
        sizes = (self.length[:, None], self.width[:, None], self.wheelbase[:, None])
        outer, inner = swept_sides(*sizes, geometry.radius)
        right_turn = geometry.turn > 0
        self.left = np.where(right_turn, outer, inner)  # [N, L] m
        self.right = np.where(right_turn, inner, outer)
        # [N, L] rad, in the lanes
        slip_sine = sizes[2] / 2 * geometry.curvature
        self.slip = np.arcsin(
            np.clip(slip_sine, -_MAX_LANE_SLIP_SINE, _MAX_LANE_SLIP_SINE)
        )
        # [N, L] m2/s2, of the desired speed
        self.squared_limit = (geometry.limit * self.style[:, :1]) ** 2

    def _cover(self, geometry: LaneGeometry, direction: Floats, people: Floats) -> None:
        """Find the lane coordinates of the discs.

        ``direction`` [2, N]: unit vectors along the vehicles.
        """
        places = self.length[:, None] * _DISC_PLACES  # [N, discs] m along the axis
        discs = self.xy[:, :, None] + places * direction[:, :, None]
        points = np.concatenate([discs.reshape(2, -1), people], axis=1)
        # [L, P] lane coordinates of the discs
        self.along, self.across = geometry.coordinates(points)
        radius = np.hypot(self.width / 2, self.length / (2 * _DISCS))
        people_radius = np.full(people.shape[1], _PERSON_RADIUS_M)
        # [P]
        self.disc_radius = np.concatenate([radius.repeat(_DISCS), people_radius])
        # [P] the vehicle or person that a disc covers: vehicles, then people
        numbers = np.arange(len(self) + people.shape[1])
        counts = np.where(numbers < len(self), _DISCS, 1)
        self.disc_owner = numbers.repeat(counts)

    def _center_discs(self) -> Ints:
        """Return the disc in the middle of each vehicle [N]."""
        return np.arange(len(self)) * _DISCS + _DISCS // 2

    def _advance_lanes(
        self, geometry: LaneGeometry, routes: RouteTable
    ) -> tuple[Ints, Ints]:
        """Give vehicles that passed the end of a lane the next one.

        Return routes and lanes [N].
        """
        center = self._center_discs()
        route = np.array([v.route for v in self.vehicles], dtype=np.int64)
        lane = np.array([v.lane_number for v in self.vehicles], dtype=np.int64)
        for _ in range(2):  # a lane may be shorter than a step
            following = routes.following[route, lane]
            passed = self.along[lane, center] > geometry.length[lane]
            passed &= following != NO_LANE
            lane = np.where(passed, following, lane)
        for vehicle, number in zip(self.vehicles, lane.tolist(), strict=True):
            vehicle.lane_number = number
        return route, lane


@dataclass(frozen=True, eq=False)
class Leaders:
    """Nearest obstacle in the path of each vehicle."""

    gap: Floats  # [N] m from the bumper; inf without one
    speed: Floats  # [N] m/s along the path


def find_leaders(state: RoadState, geometry: LaneGeometry) -> Leaders:
    """Find the nearest disc in the strip of each vehicle.

    The disc may belong to another vehicle or to a person.
    """
    # R lanes of all paths, in the order of the vehicles
    vehicle_row, path_index = np.nonzero(state.path >= 0)
    if not len(vehicle_row):
        return Leaders(np.zeros(0), np.zeros(0))
    lane = state.path[vehicle_row, path_index]
    radius = state.disc_radius
    low_m, high_m = _swept_strip(state, vehicle_row, lane, present=path_index == 0)
    end_m = geometry.length[:, None] + _LANE_MARGIN_M
    inside = (state.along > -_LANE_MARGIN_M) & (state.along < end_m)
    along = np.where(inside, state.along, -np.inf)[lane]
    ahead_m = along + state.path_start[vehicle_row, path_index, None]  # [R, P]
    blocks = (state.across + radius)[lane] > low_m[:, None]
    blocks &= (state.across - radius)[lane] < high_m[:, None]
    blocks &= (ahead_m > 0.0) & (state.disc_owner != vehicle_row[:, None])
    lane_gap_m = np.where(blocks, ahead_m - radius, np.inf)
    disc_index = lane_gap_m.argmin(axis=1)
    gap_m = np.full(state.path.shape, np.inf)
    gap_m[vehicle_row, path_index] = lane_gap_m[np.arange(len(vehicle_row)), disc_index]
    # [N] of the R lanes, the one with the nearest disc
    nearest = np.flatnonzero(path_index == 0) + gap_m.argmin(axis=1)
    lane = lane[nearest]
    disc_index = disc_index[nearest]
    distance_m = gap_m.min(axis=1)
    tangent = geometry.heading(lane, state.along[lane, disc_index])
    velocity = state.velocity[:, state.disc_owner[disc_index]]
    speed = velocity[0] * np.cos(tangent) + velocity[1] * np.sin(tangent)
    speed = np.where(distance_m < np.inf, speed, 0.0)
    return Leaders(distance_m - state.length / 2, speed)


def _swept_strip(
    state: RoadState, vehicle_row: Ints, lane: Ints, present: Bools
) -> tuple[Floats, Floats]:
    """Return the least and greatest lateral position [R] m that vehicles sweep.

    They are vehicles ``vehicle_row`` in lanes ``lane`` of their paths. In its
    ``present`` lane one moves to its desired offset, in later lanes between that offset
    and the middle.
    """
    present_offset = np.where(present, state.d[vehicle_row], 0.0)
    low_m = np.minimum(present_offset, state.offset[vehicle_row])
    high_m = np.maximum(present_offset, state.offset[vehicle_row])
    low_m = low_m - state.left[vehicle_row, lane] - _SIDE_MARGIN_M
    return low_m, high_m + state.right[vehicle_row, lane] + _SIDE_MARGIN_M


def swept_sides(
    length: Floats, width: Floats, wheelbase: Floats, radius: Floats
) -> tuple[Floats, Floats]:
    """Return the reach of a box to the outer and the inner side of a bend, m.

    The centre of the box follows the bend. The inner side of the rear axle and the
    outer front corner reach farthest.
    """
    straight = np.isinf(radius)
    square = np.maximum(radius**2 - wheelbase**2 / 4, 0.0)
    rear_radius_m = np.where(straight, 0.0, np.sqrt(square))  # of the rear axle
    front_m = (wheelbase + length) / 2  # from the rear axle
    with np.errstate(invalid="ignore"):
        outer = np.hypot(rear_radius_m + width / 2, front_m) - radius
        inner = radius - rear_radius_m + width / 2
    half_width = width / 2
    return np.where(straight, half_width, outer), np.where(straight, half_width, inner)


def desired_speed(state: RoadState) -> Floats:
    """Return desired speeds [N] m/s within the limits ahead."""
    distance_m = np.maximum(state.path_start - state.length[:, None] / 2, 0)
    squared_limit = state.squared_limit[np.arange(len(state))[:, None], state.path]
    # a driver brakes to a lower limit before its lane begins
    allowed = np.sqrt(squared_limit + 2.0 * _LIMIT_BRAKING_MPS2 * distance_m)
    allowed[state.path < 0] = np.inf
    return np.asarray(np.minimum(allowed.min(axis=1), state.style[:, _TOP_SPEED]))


def free_acceleration(speed: Floats, desired: Floats, style: Floats) -> Floats:
    """Return accelerations [N] m/s2 of the driver model on an empty road."""
    speed_share = speed / np.maximum(desired, 0.1)
    acceleration = style[..., ACCELERATION] * (1.0 - speed_share**4)
    return np.maximum(acceleration, -style[..., _BRAKING])


def braking(
    speed: Floats,
    gap_m: Floats,
    leader_speed: Floats,
    style: Floats,
    min_gap: float | None = None,
) -> Floats:
    """Return decreases [N] m/s2 of the acceleration behind leaders.

    ``speed`` and ``leader_speed`` [N] m/s; ``gap_m`` [N]: to the leaders; ``style``: of
    the drivers; ``min_gap``: m, another gap at rest than that of the style.
    """
    acceleration = style[..., ACCELERATION]
    effort = np.sqrt(acceleration * style[..., _BRAKING])
    closing_gap_m = speed * (speed - leader_speed) / (2.0 * effort)
    rest_gap = style[..., MIN_GAP] if min_gap is None else min_gap
    moving_gap = np.maximum(speed * style[..., _TIME_GAP] + closing_gap_m, 0.0)
    gap_ratio = (rest_gap + moving_gap) / np.maximum(gap_m, _MIN_GAP_M)
    return acceleration * gap_ratio**2


def steering_angles(
    state: RoadState, geometry: LaneGeometry, routes: RouteTable, step_s: float
) -> Floats:
    """Return steering angles [N] rad along the lanes.

    Drivers aim at the heading of the lane `_PREVIEW_S` ahead, and drift to their place
    in the lane. The angles of ``step_s`` seconds ago limit the new ones.
    """
    speed = np.maximum(state.speed, _MIN_STEERING_SPEED_MPS)
    length = geometry.length[state.lane]
    following = routes.following[state.route, state.lane]
    preview_m = state.s + speed * _PREVIEW_S
    beyond = (preview_m > length) & (following >= 0)
    lane = np.where(beyond, following, state.lane)
    preview_station_m = np.where(beyond, preview_m - length, preview_m)
    lateral_speed = -_LATERAL_RATE * (state.d - state.offset)
    lateral_speed = lateral_speed.clip(-_MAX_LATERAL_MPS, _MAX_LATERAL_MPS)
    drift_sine = lateral_speed / np.maximum(speed, _MIN_DRIFT_SPEED_MPS)
    drift_rad = np.arcsin(drift_sine.clip(-_MAX_DRIFT_SINE, _MAX_DRIFT_SINE))
    slip = state.slip[np.arange(len(state)), lane]
    target_heading = geometry.heading(lane, preview_station_m) - slip + drift_rad
    heading_error = wrap_angle(target_heading - state.heading)
    bend_rate = speed * geometry.curvature[lane]
    # beyond the turn of the bend the lateral acceleration is limited
    max_rate = _MAX_SWERVE_MPS2 / np.maximum(speed, _MIN_SWERVE_SPEED_MPS)
    turn_rate = (_HEADING_RATE * heading_error).clip(
        bend_rate - max_rate, bend_rate + max_rate
    )
    # bicycle model: tan(slip) is half of tan(steering)
    slip_sine = state.wheelbase / 2 * turn_rate / speed
    new_slip = np.arcsin(slip_sine.clip(-_MAX_SLIP_SINE, _MAX_SLIP_SINE))
    old_slip = np.arctan(np.tan(state.steering) / 2)
    change = _SLIP_RATE * step_s
    new_slip = new_slip.clip(old_slip - change, old_slip + change)
    return np.asarray(np.arctan(2 * np.tan(new_slip)))

"""Vehicles: sizes, driving styles, motion, their entries to the map, and parked cars."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Any, NamedTuple

import numpy as np

from ...core import Floats, wrap_angle
from .lanes import Kerb, RoadMap
from .library import Vehicle
from .world import CLASSES, RATE

_KIND_SHARES = {  # in the order of _SIZES_M
    "urban": (0.66, 0.12, 0.10, 0.07, 0.05),
    "fast": (0.62, 0.13, 0.05, 0.17, 0.03),
}
# mean and deviation of length, width, height; the least and the largest length
_SIZES_M = {
    "car": ((4.5, 0.3), (1.82, 0.07), (1.52, 0.09), (3.6, 5.2)),
    "van": ((5.3, 0.4), (1.98, 0.06), (2.05, 0.2), (4.7, 6.4)),
    "motorcycle": ((2.15, 0.12), (0.8, 0.06), (1.5, 0.1), (1.8, 2.5)),
    "truck": ((8.6, 1.6), (2.46, 0.06), (3.3, 0.3), (6.5, 12.0)),
    "bus": ((11.4, 0.7), (2.52, 0.03), (3.15, 0.12), (9.5, 12.5)),
}

_MAX_WIDTH_M = 2.55  # the largest that EU law allows


@dataclass(frozen=True)
class VehicleTraits:
    """Size and driving style of a vehicle."""

    length: float  # m
    width: float
    wheelbase: float
    pace: float  # desired speed as a share of the limit
    top_speed: float  # m/s
    time_gap: float  # s
    min_gap: float  # m, to a standing leader
    acceleration: float  # m/s2
    braking: float  # m/s2, comfortable
    politeness: float  # 0: selfish, 1: others count as much as oneself
    offset: float  # m, preferred distance to the right of the middle of the lane
    height: float  # m
    class_id: int


class _DrivingStyle(NamedTuple):
    axle_share: float  # wheelbase, of the length
    mean_pace: float
    top_speed: float  # m/s
    min_time_gap: float  # s
    acceleration: tuple[float, float]  # m/s2, range


_LIGHT = _DrivingStyle(
    axle_share=0.6,
    mean_pace=0.98,
    top_speed=40.0,
    min_time_gap=0.3,
    acceleration=(1.2, 2.2),
)
_HEAVY = _DrivingStyle(
    axle_share=0.55,
    mean_pace=0.88,
    top_speed=23.5,
    min_time_gap=0.8,
    acceleration=(0.8, 1.3),
)


class Driver:
    """A vehicle of the traffic; `move_vehicles` moves all of them at once."""

    def __init__(
        self,
        position: Any,
        heading: float,
        speed: float,
        traits: VehicleTraits,
        number: int,
    ) -> None:
        self.position = position  # [2] m
        self.heading = heading  # rad
        self.speed = speed  # m/s
        self.action = {"steering": 0.0, "acceleration": 0.0}  # of the last step
        self.traits = traits
        self.number = number  # unique in a world
        self.route = -1
        self.lane_number = -1
        self.parameters = astuple(traits)
        self.size = (traits.length, traits.width, traits.height)

    def drive(self) -> tuple[float, ...]:
        """Return x, y, heading, speed and acceleration of a vehicle driven apart.

        Empty for a vehicle of the driver model.
        """
        return ()


def move_vehicles(
    vehicles: Sequence[Driver], state: Any, steering: Floats, acceleration: Floats
) -> None:
    """Move all vehicles for 1 / `RATE` seconds, by highway-env's bicycle model.

    ``state``: their `driving.RoadState`; ``steering`` [N] rad; ``acceleration`` [N].
    """
    step_s = 1.0 / RATE
    speed = state.speed
    heading = state.heading
    # as in highway-env, a vehicle above the highest speed slows down to it
    speed_room = Vehicle.MAX_SPEED - speed
    limited = np.minimum(acceleration, speed_room)
    acceleration = np.where(speed > Vehicle.MAX_SPEED, limited, acceleration)
    slip = np.arctan(1 / 2 * np.tan(steering))
    course_vector = np.array([np.cos(heading + slip), np.sin(heading + slip)])
    positions = state.xy + speed * course_vector * step_s
    heading = heading + speed * np.sin(slip) / (state.wheelbase / 2) * step_s
    speed = speed + acceleration * step_s
    for i, vehicle in enumerate(vehicles):
        if driven := vehicle.drive():  # the ego of a closed loop moves itself
            positions[:, i] = driven[:2]
            heading[i], speed[i], acceleration[i] = driven[2:]
            steering[i] = 0.0
    _set_states(vehicles, positions, heading, speed)
    actions = zip(steering.tolist(), acceleration.tolist(), strict=True)
    for vehicle, (angle, gain) in zip(vehicles, actions, strict=True):
        vehicle.action = {"steering": angle, "acceleration": gain}


def round_states(vehicles: Sequence[Driver]) -> None:
    """Round states to 1e-6, so that differences between processors cannot grow."""
    states = [(*v.position, v.heading, v.speed) for v in vehicles]
    x, y, heading, speed = np.array(states, dtype=np.float64).reshape(-1, 4).T
    _set_states(vehicles, np.array([x, y]), heading, speed)
    for vehicle in vehicles:
        vehicle.position = np.array(vehicle.position)


def _set_states(
    vehicles: Sequence[Driver], positions: Floats, heading: Floats, speed: Floats
) -> None:
    """Give vehicles rounded places [2, N], headings and speeds."""
    places = (positions.T.round(6) + 0.0).tolist()
    headings = wrap_angle(heading).tolist()
    states = zip(vehicles, places, headings, speed.tolist(), strict=True)
    for vehicle, position, angle, speed_mps in states:
        vehicle.position = position
        vehicle.heading = round(angle, 6) + 0.0
        vehicle.speed = round(speed_mps, 6) + 0.0


def vehicle_boxes(vehicles: Sequence[Driver]) -> Floats:
    """Return boxes [N, 7] of vehicles in highway-env's frame (y down)."""
    box_rows = [(*v.position, v.size[2] / 2, v.heading, *v.size) for v in vehicles]
    return np.array(box_rows, dtype=np.float64).reshape(-1, 7)


def draw_traits(fast_road: bool, rng: np.random.Generator) -> VehicleTraits:
    """Draw a vehicle and its driver.

    ``fast_road``: for a motorway, with more trucks.
    """
    kinds = tuple(_SIZES_M)
    kind_shares = _KIND_SHARES["fast" if fast_road else "urban"]
    kind = kinds[int(rng.choice(len(kinds), p=kind_shares))]
    length_m, width_m, height_m = draw_size(kind, rng)
    style = _HEAVY if kind in ("truck", "bus") else _LIGHT
    max_offset_m = 0.5 if kind == "motorcycle" else 0.2
    time_gap = float(np.clip(np.exp(rng.normal(-0.32, 0.5)), 0.3, 2.4))
    return VehicleTraits(
        class_id=CLASSES.index("car" if kind == "van" else kind),
        length=round(length_m, 2),
        width=round(width_m, 2),
        height=round(height_m, 2),
        wheelbase=round(style.axle_share * length_m, 2),
        pace=round(float(np.clip(rng.normal(style.mean_pace, 0.14), 0.6, 1.3)), 6),
        top_speed=style.top_speed,
        time_gap=round(max(time_gap, style.min_time_gap), 6),
        min_gap=float(rng.uniform(0.6, 1.6)),
        acceleration=float(rng.uniform(*style.acceleration)),
        braking=float(rng.uniform(1.6, 2.6)),
        politeness=float(rng.uniform(0.0, 0.6)),
        offset=float(rng.uniform(-max_offset_m, max_offset_m)),
    )


def draw_size(kind: str, rng: np.random.Generator) -> tuple[float, float, float]:
    """Draw length, width and height of a vehicle, m."""
    length, width, height, (shortest, longest) = _SIZES_M[kind]
    mean_width = width[0]
    mean_height = height[0]
    widest = min(mean_width + 0.25, _MAX_WIDTH_M)
    return (
        float(np.clip(rng.normal(*length), shortest, longest)),
        float(np.clip(rng.normal(*width), mean_width - 0.25, widest)),
        float(np.clip(rng.normal(*height), 0.8 * mean_height, 1.25 * mean_height)),
    )


_MAX_TURNING_LENGTH_M = 6.6  # longer vehicles do not turn at the intersection
# filled share of the entry lanes at the start
_FILLED_JUNCTION = 0.95
_FILLED_ROAD = 0.25
_LEAVING_SHARE = 0.4  # of the first vehicles at a junction, which have passed it
_FILLED_EXIT = 0.9  # share of the exit lanes
_MAX_TRIES = 6  # steps that a vehicle waits for room before another one is drawn
_LANE_HALF_WIDTH_M = 2.5  # from the middle of a lane, within which a vehicle is in it
_ENTRY_GAP_SHARE = 0.6  # of the time gap that an entering vehicle needs
_FIRST_ROOM_M = 10.0  # least room between two vehicles at the start
_ENTRY_M = 0.5  # from the start of a lane to the rear of a new vehicle
_ENTRY_ROOM_M = 2.0  # of a new vehicle, beside the gap at rest
_ENTRY_BRAKING_MPS2 = 1.0  # of a new vehicle behind its leader

_PARKING_PITCH_M = 6.2  # from one parking place to the next
_PARKING_SHARE = 0.8  # of the parking places of a kerb, that are used first
_PARKING_SHIFT_M = 0.3  # along a place
_KERB_GAP_M = (0.1, 0.35)
_PARKING_TURN_RAD = 0.02
_VAN_SHARE = 0.15  # of the parked cars
_MAX_PARKED_LENGTH_M = 5.5
_MAX_PARKED_WIDTH_M = 2.0


class Entries:
    """Entries of the map, which keep the number of vehicles on the road."""

    def __init__(
        self,
        road_map: RoadMap,
        target: int,
        vehicles: list[Driver],
        rng: np.random.Generator,
    ) -> None:
        """``target``: number of ``vehicles`` to keep; the list changes in place."""
        self._map = road_map
        self._target = target
        self._vehicles = vehicles
        self._rng = rng
        self._count = 0
        self._waiting: tuple[VehicleTraits, int] | None = None
        self._tries = 0

    def fill(self) -> None:
        """Put the first vehicles on entry and exit lanes."""
        lengths = self._map.geometry.length
        filled = _FILLED_JUNCTION if self._map.regulated else _FILLED_ROAD
        for _ in range(20 * self._target):
            if len(self._vehicles) >= self._target:
                return
            traits, route = self._draw()
            lane = self._entry_lanes(traits, route)[0]
            longest_m = filled * lengths[lane]
            if self._map.regulated and self._rng.uniform() < _LEAVING_SHARE:
                lane = self._map.routes[route].roads[-1][0]
                longest_m = _FILLED_EXIT * lengths[lane]
            station_m = float(self._rng.uniform(traits.length / 2, longest_m))
            self._enter(traits, route, lane, station_m, _FIRST_ROOM_M)

    def admit(self, finished: Sequence[Driver]) -> None:
        """Remove ``finished`` vehicles and add one if there is room."""
        for vehicle in finished:
            self._vehicles.remove(vehicle)
        if len(self._vehicles) >= self._target:
            return
        if self._waiting is None or self._tries >= _MAX_TRIES:
            self._waiting = self._draw()
            self._tries = 0
        traits, route = self._waiting
        self._tries += 1
        station_m = traits.length / 2 + _ENTRY_M
        for lane in self._entry_lanes(traits, route):
            if self._enter(
                traits, route, lane, station_m, traits.min_gap + _ENTRY_ROOM_M
            ):
                self._waiting = None
                return

    def _draw(self) -> tuple[VehicleTraits, int]:
        """Draw a vehicle and its route."""
        routes = self._map.routes
        traits = draw_traits(not self._map.regulated, self._rng)
        turns = traits.length < _MAX_TURNING_LENGTH_M
        # long vehicles take none of the narrow routes
        weight = np.array([r.weight * (r.heavy or turns) for r in routes])
        return traits, int(self._rng.choice(len(routes), p=weight / weight.sum()))

    def _entry_lanes(self, traits: VehicleTraits, route: int) -> list[int]:
        """Return possible entry lanes in the order to try."""
        lanes = self._map.routes[route].roads[0]
        if traits.top_speed < self._map.geometry.limit[lanes[0]]:
            return [lanes[-1]]
        return [lanes[int(k)] for k in self._rng.permutation(len(lanes))]

    def _enter(
        self,
        traits: VehicleTraits,
        route: int,
        lane: int,
        station_m: float,
        room_m: float,
    ) -> bool:
        """Add a vehicle to a lane.

        False without room.
        """
        speed_mps = self._entry_speed(traits, lane, station_m, room_m)
        if speed_mps is None:
            return False
        road_lane = self._map.geometry.lanes[lane]
        position = road_lane.position(station_m, traits.offset)
        heading = float(road_lane.heading_at(station_m))
        vehicle = Driver(position, heading, speed_mps, traits, self._count)
        vehicle.route = route
        vehicle.lane_number = lane
        round_states([vehicle])
        self._vehicles.append(vehicle)
        self._count += 1
        return True

    def _entry_speed(
        self, traits: VehicleTraits, lane: int, station_m: float, room_m: float
    ) -> float | None:
        """Return the speed to enter with, m/s.

        None without room: ``room_m`` to all others in the lane, more to a leader.
        """
        road_lane = self._map.geometry.lanes[lane]
        limit_mps = float(self._map.geometry.limit[lane])
        speed_mps = min(traits.pace * limit_mps, traits.top_speed)
        for other_vehicle in self._vehicles:
            other_station, aside_m = road_lane.local_coordinates(other_vehicle.position)
            if abs(aside_m) > _LANE_HALF_WIDTH_M:
                continue
            half_lengths = (other_vehicle.traits.length + traits.length) / 2
            gap_m = abs(other_station - station_m) - half_lengths
            is_ahead = other_station > station_m
            time_gap = _ENTRY_GAP_SHARE * traits.time_gap if is_ahead else 0.0
            if gap_m < room_m + time_gap * speed_mps:
                return None
            if is_ahead:  # slow enough to brake behind the leader
                braking_room = max(gap_m - room_m, 0.0)
                gained = 2.0 * _ENTRY_BRAKING_MPS2 * braking_room
                safe_speed = float(np.sqrt(other_vehicle.speed**2 + gained))
                speed_mps = min(speed_mps, safe_speed)
        return speed_mps


def draw_parked_boxes(
    kerbs: tuple[Kerb, ...], car_count: int, rng: np.random.Generator
) -> Floats:
    """Draw boxes [K, 7] of parked cars in highway-env's frame (y down).

    K is ``car_count``, or the number of places if they are fewer. Kerbs are filled one
    after another, so that cars stand in rows; some places of each are used last.
    """
    kerb_index = []
    stations = []
    for k, kerb in enumerate(kerbs):
        end_m = kerb.length - _PARKING_PITCH_M / 2
        places = np.arange(_PARKING_PITCH_M / 2, end_m, _PARKING_PITCH_M)
        kerb_index += [k] * len(places)
        stations += places.tolist()
    kerb_rank = rng.permutation(len(kerbs))
    used_last = rng.uniform(size=len(stations)) > _PARKING_SHARE
    rank = kerb_rank[np.array(kerb_index, dtype=np.int64)]
    order = np.lexsort((rank, used_last))
    rows = [
        _parked_box(kerbs[kerb_index[place]], stations[place], rng)
        for place in sorted(order[:car_count].tolist())
    ]
    return np.round(np.array(rows, dtype=np.float64).reshape(-1, 7), 6) + 0.0


def _parked_box(
    kerb: Kerb, station_m: float, rng: np.random.Generator
) -> tuple[float, ...]:
    kind = "van" if rng.uniform() < _VAN_SHARE else "car"
    length_m, width_m, height_m = draw_size(kind, rng)
    length_m = min(length_m, _MAX_PARKED_LENGTH_M)
    width_m = min(width_m, _MAX_PARKED_WIDTH_M)
    x, y = kerb.start
    ux, uy = kerb.direction
    along_m = station_m + rng.uniform(-_PARKING_SHIFT_M, _PARKING_SHIFT_M)
    across_m = rng.uniform(*_KERB_GAP_M) + width_m / 2
    turn_rad = rng.uniform(-_PARKING_TURN_RAD, _PARKING_TURN_RAD)
    return (
        x + along_m * ux + across_m * uy,
        y + along_m * uy - across_m * ux,
        height_m / 2,
        np.arctan2(uy, ux) + turn_rad,
        length_m,
        width_m,
        height_m,
    )

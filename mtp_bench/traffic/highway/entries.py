"""Entries of vehicles to the map, and parked cars."""

from collections.abc import Sequence

import numpy as np

from ...core import Floats
from .road_map import Kerb, RoadMap
from .vehicles import Driver, VehicleTraits, draw_size, draw_traits, round_states

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
        station_m = traits.length / 2 + 0.5
        for lane in self._entry_lanes(traits, route):
            if self._enter(traits, route, lane, station_m, traits.min_gap + 2.0):
                self._waiting = None
                return

    def _draw(self) -> tuple[VehicleTraits, int]:
        """Draw a vehicle and its route."""
        routes = self._map.routes
        traits = draw_traits(self._map.overtaking, self._rng)
        turns = traits.length < _MAX_TURNING_LENGTH_M
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
        """Return the speed at which a vehicle can enter, m/s.

        None if there is no room for it.
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
            time_gap_s = _ENTRY_GAP_SHARE * traits.time_gap if is_ahead else 0.0
            if gap_m < room_m + time_gap_s * speed_mps:
                return None
            if is_ahead:  # slow enough to brake behind the leader with 1 m/s2
                braking_m = max(gap_m - room_m, 0.0)
                safe_mps = float(np.sqrt(other_vehicle.speed**2 + 2.0 * braking_m))
                speed_mps = min(speed_mps, safe_mps)
        return speed_mps


def draw_parked_boxes(
    kerbs: tuple[Kerb, ...], car_count: int, rng: np.random.Generator
) -> Floats:
    """Draw boxes [K, 7] of parked cars in highway-env's frame (y down).

    There are ``car_count``, or as many as there are places. Kerbs are filled one after
    another, so that cars stand in rows; some places of each are used last.
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

"""Vehicles: random sizes and driving styles, their entries to the map, and parked cars."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np

from ...core import Floats, wrap_angle
from .library import Vehicle
from .networks import Kerb, RoadMap
from .world import CLASSES, FILLED, LEAVING, RATE

LONG = 6.6  # m; longer vehicles do not turn at the intersection
_SHARES = {
    "urban": (0.66, 0.12, 0.10, 0.07, 0.05),
    "fast": (0.62, 0.13, 0.05, 0.17, 0.03),
}  # in the order of _SIZES
_SIZES = {  # mean and deviation of length, width, height; the least and the largest length
    "car": ((4.5, 0.3), (1.82, 0.07), (1.52, 0.09), (3.6, 5.2)),
    "van": ((5.3, 0.4), (1.98, 0.06), (2.05, 0.2), (4.7, 6.4)),
    "motorcycle": ((2.15, 0.12), (0.8, 0.06), (1.5, 0.1), (1.8, 2.5)),
    "truck": ((8.6, 1.6), (2.46, 0.06), (3.3, 0.3), (6.5, 12.0)),
    "bus": ((11.4, 0.7), (2.52, 0.03), (3.15, 0.12), (9.5, 12.5)),
}
_TRIES = 6  # steps that a vehicle waits for room before another one is drawn
_LANE_WIDTH = 2.5  # m from the middle of a lane within which a vehicle is in it
_GAP_SHARE = 0.6  # of the time gap that an entering vehicle needs
_FIRST_ROOM = 10.0  # m, least room between two vehicles at the start
_PITCH = 6.2  # m from one parking place to the next
_OCCUPIED = 0.8  # share of the parking places of a kerb
_SHIFT = 0.3  # m along a place
_KERB_GAP = (0.1, 0.35)  # m
_ASKEW = 0.02  # rad
_VANS = 0.15  # share of the parked cars
_LONGEST, _WIDEST = 5.5, 2.0  # m, of parked cars


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
        self.position, self.heading, self.speed = (
            position,
            heading,
            speed,
        )  # [2] m, rad, m/s
        self.action = {"steering": 0.0, "acceleration": 0.0}  # of the last step
        self.traits, self.number = traits, number  # unique in a world
        self.route = self.lane_number = -1
        self.parameters = astuple(traits)
        self.size = (traits.length, traits.width, traits.height)

    def drive(self) -> tuple[float, ...]:
        """New x, y, heading, speed and the acceleration of a vehicle that drives by itself; empty of others."""
        return ()


def move_vehicles(
    vehicles: Sequence[Driver], state: Any, steering: Floats, gain: Floats
) -> None:
    """Move all vehicles for 1 / `RATE` seconds, by highway-env's bicycle model.

    ``state``: their `driving.RoadState`; ``steering`` and ``gain`` ``[N]``: angles and accelerations.
    """
    speed, heading = state.speed, state.heading
    dt, most = 1.0 / RATE, Vehicle.MAX_SPEED
    slip = np.arctan(1 / 2 * np.tan(steering))
    gain = np.where(speed > most, np.minimum(gain, most - speed), gain)
    place = (
        state.xy
        + speed * np.array([np.cos(heading + slip), np.sin(heading + slip)]) * dt
    )
    heading = heading + speed * np.sin(slip) / (state.wheelbase / 2) * dt
    speed = speed + gain * dt
    for i, vehicle in enumerate(vehicles):
        if driven := vehicle.drive():
            place[:, i], (heading[i], speed[i], gain[i]), steering[i] = (
                driven[:2],
                driven[2:],
                0.0,
            )
    states = (*_rounded(place, heading, speed), steering.tolist(), gain.tolist())
    for vehicle, *rounded, angle, acceleration in zip(vehicles, *states, strict=True):
        vehicle.position, vehicle.heading, vehicle.speed = rounded
        vehicle.action = {"steering": angle, "acceleration": acceleration}


def round_states(vehicles: Sequence[Driver]) -> None:
    """Round states to 1e-6, so that differences between processors in the last bits cannot grow."""
    states = (
        np.array(
            [(*v.position, v.heading, v.speed) for v in vehicles], dtype=np.float64
        )
        .reshape(-1, 4)
        .T
    )
    for vehicle, place, *state in zip(
        vehicles, *_rounded(states[:2], *states[2:]), strict=True
    ):
        vehicle.position, (vehicle.heading, vehicle.speed) = np.array(place), state


def _rounded(
    place: Floats, heading: Floats, speed: Floats
) -> tuple[list[list[float]], list[float], list[float]]:
    """Rounded places ``[2, N]``, a pair each, headings and speeds."""
    columns = wrap_angle(heading), speed
    angles, speeds = (
        [round(value, 6) + 0.0 for value in column.tolist()] for column in columns
    )
    return (place.T.round(6) + 0.0).tolist(), angles, speeds


def vehicle_boxes(vehicles: Sequence[Driver]) -> Floats:
    """Boxes ``[N, 7]`` of vehicles in highway-env's frame (y down)."""
    rows = [(*v.position, v.size[2] / 2, v.heading, *v.size) for v in vehicles]
    return np.array(rows, dtype=np.float64).reshape(-1, 7)


def draw_traits(fast: bool, rng: np.random.Generator) -> VehicleTraits:
    """Draw a vehicle and its driver; ``fast``: for a motorway, which has more trucks."""
    kinds = tuple(_SIZES)
    kind = kinds[int(rng.choice(len(kinds), p=_SHARES["fast" if fast else "urban"]))]
    length, width, height = draw_size(kind, rng)
    heavy = kind in ("truck", "bus")
    gap = float(np.clip(np.exp(rng.normal(-0.32, 0.5)), 0.3, 2.4))
    return VehicleTraits(
        class_id=CLASSES.index("car" if kind == "van" else kind),
        length=round(length, 2),
        width=round(width, 2),
        height=round(height, 2),
        wheelbase=round((0.55 if heavy else 0.6) * length, 2),
        pace=round(
            float(np.clip(rng.normal(0.88 if heavy else 0.98, 0.14), 0.6, 1.3)), 6
        ),
        top_speed=23.5 if heavy else 40.0,
        time_gap=round(max(gap, 0.8) if heavy else gap, 6),
        min_gap=float(rng.uniform(0.6, 1.6)),
        acceleration=float(rng.uniform(0.8, 1.3) if heavy else rng.uniform(1.2, 2.2)),
        braking=float(rng.uniform(1.6, 2.6)),
        politeness=float(rng.uniform(0.0, 0.6)),
        offset=float(
            rng.uniform(-0.5, 0.5) if kind == "motorcycle" else rng.uniform(-0.2, 0.2)
        ),
    )


def draw_size(kind: str, rng: np.random.Generator) -> tuple[float, float, float]:
    """Draw length, width and height of a vehicle, m."""
    length, width, height, (least, most) = _SIZES[kind]
    return (
        float(np.clip(rng.normal(*length), least, most)),
        float(np.clip(rng.normal(*width), width[0] - 0.25, min(width[0] + 0.25, 2.55))),
        float(np.clip(rng.normal(*height), 0.8 * height[0], 1.25 * height[0])),
    )


class Entries:
    """Entries of the map, which keep the number of vehicles on the road."""

    def __init__(
        self,
        road_map: RoadMap,
        most: int,
        vehicles: list[Driver],
        rng: np.random.Generator,
    ) -> None:
        self._map, self._target, self._vehicles, self._rng = (
            road_map,
            most,
            vehicles,
            rng,
        )
        self._made = 0
        self._next: tuple[VehicleTraits, int] | None = None  # waits for room
        self._tries = 0

    def fill(self) -> None:
        """Put the first vehicles on the first part of the entry lanes, and some on the exit lanes."""
        junction, leaving = self._map.regulated, LEAVING * self._map.regulated
        for _ in range(20 * self._target):
            if len(self._vehicles) >= self._target:
                return
            traits, route = self._draw()
            lane = self._lanes(traits, route)[0]
            part = FILLED[0 if junction else 1]
            if leaving and self._rng.uniform() < leaving:
                lane, part = self._map.routes[route].roads[-1][0], 0.9
            s = float(
                self._rng.uniform(
                    traits.length / 2, part * self._map.geometry.length[lane]
                )
            )
            self._enter(traits, route, lane, s, _FIRST_ROOM)

    def admit(self, finished: Sequence[Driver]) -> None:
        """Remove the ``finished`` vehicles and add at most one, if there is room."""
        for vehicle in finished:
            self._vehicles.remove(vehicle)
        if len(self._vehicles) >= self._target:
            return
        if self._next is None or self._tries >= _TRIES:
            self._next, self._tries = self._draw(), 0
        traits, route = self._next
        self._tries += 1
        for lane in self._lanes(traits, route):
            if self._enter(
                traits, route, lane, traits.length / 2 + 0.5, traits.min_gap + 2.0
            ):
                self._next = None
                return

    def _draw(self) -> tuple[VehicleTraits, int]:
        routes = self._map.routes
        traits = draw_traits(self._map.overtaking, self._rng)
        weight = np.array(
            [r.weight if r.heavy or traits.length < LONG else 0.0 for r in routes]
        )
        return traits, int(self._rng.choice(len(routes), p=weight / weight.sum()))

    def _lanes(self, traits: VehicleTraits, route: int) -> list[int]:
        """Possible entry lanes in the order to try."""
        lanes = self._map.routes[route].roads[0]
        if traits.top_speed < self._map.geometry.limit[lanes[0]]:
            return [lanes[-1]]
        return [lanes[int(k)] for k in self._rng.permutation(len(lanes))]

    def _enter(
        self, traits: VehicleTraits, route: int, lane: int, s: float, room: float
    ) -> bool:
        speed = self._entry_speed(traits, lane, s, room)
        if speed is None:
            return False
        way = self._map.geometry.lanes[lane]
        vehicle = Driver(
            way.position(s, traits.offset),
            float(way.heading_at(s)),
            speed,
            traits,
            self._made,
        )
        vehicle.route, vehicle.lane_number = route, lane
        round_states([vehicle])
        self._vehicles.append(vehicle)
        self._made += 1
        return True

    def _entry_speed(
        self, traits: VehicleTraits, lane: int, place: float, room: float
    ) -> float | None:
        """Speed to enter with at a place in a lane; None without room."""
        way = self._map.geometry.lanes[lane]
        speed = min(
            traits.pace * float(self._map.geometry.limit[lane]), traits.top_speed
        )
        for other in self._vehicles:
            s, d = way.local_coordinates(other.position)
            if abs(d) > _LANE_WIDTH:
                continue
            gap = abs(s - place) - (other.traits.length + traits.length) / 2
            if gap < room + (
                _GAP_SHARE * traits.time_gap * speed if s > place else 0.0
            ):
                return None
            if s > place:  # slow enough to brake behind the leader
                speed = min(
                    speed, float(np.sqrt(other.speed**2 + 2.0 * max(gap - room, 0.0)))
                )
        return speed


def draw_parked_boxes(
    kerbs: tuple[Kerb, ...], number: int, rng: np.random.Generator
) -> Floats:
    """Draw boxes ``[K, 7]`` of parked cars in highway-env's frame (y down): ``number``, or as many as there are places.

    Kerbs are filled one after another, so that cars stand in rows; some places of each are used last.
    """
    places = [
        (k, s)
        for k, kerb in enumerate(kerbs)
        for s in np.arange(_PITCH / 2, kerb.length - _PITCH / 2, _PITCH)
    ]
    rank = rng.permutation(len(kerbs))
    late = rng.uniform(size=len(places)) > _OCCUPIED
    order = sorted(range(len(places)), key=lambda p: (late[p], rank[places[p][0]], p))
    rows = [
        _parked_box(kerbs[places[p][0]], float(places[p][1]), rng)
        for p in sorted(order[:number])
    ]
    return np.round(np.array(rows, dtype=np.float64).reshape(-1, 7), 6) + 0.0


def _parked_box(kerb: Kerb, s: float, rng: np.random.Generator) -> tuple[float, ...]:
    length, width, height = draw_size("van" if rng.uniform() < _VANS else "car", rng)
    length, width = min(length, _LONGEST), min(width, _WIDEST)
    (ux, uy), (x, y) = kerb.direction, kerb.start
    along, across = (
        s + rng.uniform(-_SHIFT, _SHIFT),
        rng.uniform(*_KERB_GAP) + width / 2,
    )
    heading = np.arctan2(uy, ux) + rng.uniform(-_ASKEW, _ASKEW)
    return (
        x + along * ux + across * uy,
        y + along * uy - across * ux,
        height / 2,
        heading,
        length,
        width,
        height,
    )

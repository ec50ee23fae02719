"""Road maps of the four scenarios: lanes, routes, crossings and kerbs, in highway-env's frame (y down)."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ...core import Floats
from .lanes import LaneGeometry, Route
from .library import CircularLane, RoadNetwork, SineLane, StraightLane
from .world import APPROACH, ARM_WEIGHTS, STRIP, ScenarioName

_TURN_WEIGHTS = (
    0.235,
    1.0,
    0.57,
)  # frequency of left turns, straight on and right turns at the intersection
_QUARTER_WEIGHTS = (
    0.6,
    1.0,
    0.4,
)  # frequency of one, two and three quarters around the roundabout
_STREET_LIMIT = 9.0  # m/s, on the arms
_BEND_LIMITS = (4.8, 3.4)  # m/s, of left and right turns
_RING_RADIUS = 24.0  # m, of the roundabout
_ENTRY_RADIUS = 20.0  # m, of its entries and exits
_ROUNDABOUT_LIMITS = (4.4, 5.0, 5.3)  # m/s, of the entries, the ring and the exits
_WIDTH = 3.5  # m, of a lane
_LANES = 2  # of each direction of the intersection
_ROUND_WIDTH = 4.5  # m, of the lanes of the roundabout
_ISLAND = (
    4.5  # m, from the middle of an arm of the roundabout to the middle of its lanes
)
_RIGHT_RADIUS = 9.0  # m, of the intersection's right turns
_ZEBRA = (
    1.0,
    4.0,
)  # m, from the junction's mouth to the near and the far edge of a crossing
_RAMP_SWING = 3.25  # m, half of the lateral shift of a ramp
_NO_PARKING = (10.0, 5.0)  # m, at the junction's and at the other end of an arm


@dataclass(frozen=True)
class Crossing:
    """A zebra crossing over an arm: its axis runs from ``origin`` in ``direction`` over ``span`` metres of road."""

    origin: tuple[float, float]
    direction: tuple[float, float]
    span: float
    width: float


@dataclass(frozen=True)
class Pavement:
    """Pavement beside two roads that cross at (0, 0) along the axes; the kerbs bend around the corners."""

    corner: float  # m, the middle of a kerb's bend is at (+-corner, +-corner)
    radius: float  # m, of the bend
    strip: float  # m, beside the kerb along the arms, where cars park; people walk behind it

    @property
    def kerb(self) -> float:
        """Distance in m from the middle of a road to its straight kerbs."""
        return self.corner - self.radius


@dataclass(frozen=True)
class Kerb:
    """A straight kerb to the right of the way from ``start`` in ``direction``, where cars park."""

    start: tuple[float, float]
    direction: tuple[float, float]
    length: float


@dataclass(frozen=True, eq=False)
class RoadMap:
    """A road network with its routes."""

    network: Any  # a RoadNetwork
    geometry: LaneGeometry
    routes: tuple[Route, ...]
    crossings: tuple[Crossing, ...]
    sensor: tuple[float, float, float]  # x, y, z of a roadside sensor
    regulated: bool  # vehicles give way by conflicts of routes
    overtaking: bool  # vehicles change lanes
    first_in_first_out: bool  # False: vehicles may also go before one that is far away
    pavement: Pavement | None = None
    kerbs: tuple[Kerb, ...] = ()


def build_map(scenario: ScenarioName, seconds: float) -> RoadMap:
    """Build the map of ``scenario``; fast roads are long enough for a vehicle to stay on them for ``seconds``."""
    if scenario in ("intersection", "roundabout"):
        return _intersection() if scenario == "intersection" else _roundabout()
    return _merge(seconds) if scenario == "merge" else _highway(seconds)


def _turned(corner: int, x: float, y: float) -> Floats:
    cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[corner % 4]
    return np.array([cos * x - sin * y, sin * x + cos * y], dtype=np.float64)


def _intersection() -> RoadMap:
    network, lanes = RoadNetwork(), _LANES
    outermost = _WIDTH * (lanes - 0.5)
    mouth = outermost + _RIGHT_RADIUS
    for arm in range(4):
        _intersection_arm(network, arm, mouth)
    geometry = LaneGeometry(network)
    routes = []
    for arm in range(4):
        into, left, ahead, right = (
            f"m{arm}",
            *(f"w{(arm + turn) % 4}" for turn in (1, 2, 3)),
        )
        for to, places, turn, heavy in (
            (left, (0,), _TURN_WEIGHTS[0], False),
            (ahead, tuple(range(lanes)), _TURN_WEIGHTS[1], True),
            (right, (lanes - 1,), _TURN_WEIGHTS[2], False),
        ):
            for k in places:
                within = k if heavy else 0  # a turn has a single lane
                indices = (
                    (f"o{arm}", into, k),
                    (into, to, within),
                    (to, "x" + to[1], k),
                )
                weight = ARM_WEIGHTS[arm] * turn / len(places)
                routes.append(
                    Route(tuple((geometry.number[i],) for i in indices), weight, heavy)
                )
    half = _WIDTH * lanes
    middle = mouth + sum(_ZEBRA) / 2
    crossings = tuple(
        Crossing(
            (float(o[0]), float(o[1])),
            (float(u[0]), float(u[1])),
            span=2 * half,
            width=_ZEBRA[1] - _ZEBRA[0],
        )
        for o, u in (
            (_turned(arm, -half, middle), _turned(arm, 1.0, 0.0)) for arm in range(4)
        )
    )
    corner = (
        mouth + STRIP + 2.0
    )  # behind the sidewalks, so that no person stands right in front of the sensor
    pavement = Pavement(mouth, mouth - half, STRIP)
    sensor = (corner, corner, 4.0)
    kerbs = _kerbs(half + STRIP, mouth)
    return RoadMap(
        network,
        geometry,
        tuple(routes),
        crossings,
        sensor,
        True,
        False,
        True,
        pavement,
        kerbs,
    )


def _kerbs(aside: float, mouth: float) -> tuple[Kerb, ...]:
    """Both kerbs of every arm, ``aside`` m from its middle; the arm begins ``mouth`` m from that of the junction."""
    near, far = mouth + _NO_PARKING[0], mouth + APPROACH - _NO_PARKING[1]
    found = []
    for arm in range(4):
        for start, along in (((aside, far), -1.0), ((-aside, near), 1.0)):
            (x, y), (dx, dy) = (
                _turned(arm, *start).tolist(),
                _turned(arm, 0.0, along).tolist(),
            )
            found.append(Kerb((x, y), (dx, dy), far - near))
    return tuple(found)


def _intersection_arm(network: Any, arm: int, mouth: float) -> None:
    quarter, lanes = np.pi / 2 * arm, _LANES
    into, left, ahead, right = (
        f"m{arm}",
        *(f"w{(arm + turn) % 4}" for turn in (1, 2, 3)),
    )
    inner, outer = _WIDTH / 2, _WIDTH * (lanes - 0.5)
    for k in range(lanes):
        x = _WIDTH * (k + 0.5)
        start, end, over = (
            _turned(arm, x, mouth + APPROACH),
            _turned(arm, x, mouth),
            _turned(arm, x, -mouth),
        )
        network.add_lane(
            f"o{arm}", into, StraightLane(start, end, _WIDTH, speed_limit=_STREET_LIMIT)
        )
        network.add_lane(
            into, ahead, StraightLane(end, over, _WIDTH, speed_limit=_STREET_LIMIT)
        )
        start, end = _turned(arm, -x, mouth), _turned(arm, -x, mouth + APPROACH)
        network.add_lane(
            f"w{arm}",
            f"x{arm}",
            StraightLane(start, end, _WIDTH, speed_limit=_STREET_LIMIT),
        )
    center, phases = (
        _turned(arm, mouth, mouth),
        (quarter + np.pi, quarter + 1.5 * np.pi),
    )
    network.add_lane(into, right, _arc(center, mouth - outer, phases, _BEND_LIMITS[1]))
    center, phases = _turned(arm, -mouth, mouth), (quarter, quarter - np.pi / 2)
    network.add_lane(into, left, _arc(center, mouth + inner, phases, _BEND_LIMITS[0]))


def _arc(
    center: Floats,
    radius: float,
    phases: tuple[float, float],
    limit: float,
    width: float = _WIDTH,
) -> Any:
    return CircularLane(
        center,
        radius,
        *phases,
        clockwise=phases[1] > phases[0],
        width=width,
        speed_limit=limit,
    )


def _roundabout() -> RoadMap:
    network = RoadNetwork()
    for arm in range(4):
        _roundabout_arm(network, arm)
    geometry = LaneGeometry(network)
    ring = [node for k in range(4) for node in (f"n{-k % 4}", f"e{(-k - 1) % 4}")]
    routes = []
    for arm in range(4):
        for quarters, share in zip((1, 2, 3), _QUARTER_WEIGHTS, strict=True):
            out = (arm - quarters) % 4
            first = ring.index(f"n{arm}")
            nodes = [
                f"o{arm}",
                f"a{arm}",
                *(ring[(first + k) % 8] for k in range(2 * quarters)),
                f"z{out}",
                f"x{out}",
            ]
            weight = ARM_WEIGHTS[arm] * share
            routes.append(
                Route(
                    tuple((geometry.number[a, b, 0],) for a, b in pairwise(nodes)),
                    weight,
                    heavy=True,
                )
            )
    kerbs = _kerbs(_ISLAND + _ROUND_WIDTH / 2 + STRIP, _mouth())
    return RoadMap(
        network,
        geometry,
        tuple(routes),
        (),
        (0.0, 0.0, 4.0),
        True,
        False,
        False,
        None,
        kerbs,
    )


def _mouth() -> float:
    """Distance in m from the middle of the roundabout to the straight part of its arms."""
    return float(
        np.sqrt((_RING_RADIUS + _ENTRY_RADIUS) ** 2 - (_ISLAND + _ENTRY_RADIUS) ** 2)
    )


def _roundabout_arm(network: Any, arm: int) -> None:
    aside, away = _ISLAND + _ENTRY_RADIUS, _mouth()
    into, ring, out = _ROUNDABOUT_LIMITS
    angle = float(
        np.arctan2(away, aside)
    )  # where the entry touches the ring; the exit mirrors it
    quarter = np.pi / 2 * arm

    def straight(start: tuple[float, float], end: tuple[float, float]) -> Any:
        return StraightLane(
            _turned(arm, *start),
            _turned(arm, *end),
            _ROUND_WIDTH,
            speed_limit=_STREET_LIMIT,
        )

    def arc(
        center: tuple[float, float],
        radius: float,
        start: float,
        end: float,
        limit: float,
    ) -> Any:
        return _arc(
            _turned(arm, *center),
            radius,
            (quarter + start, quarter + end),
            limit,
            _ROUND_WIDTH,
        )

    network.add_lane(
        f"o{arm}", f"a{arm}", straight((_ISLAND, away + APPROACH), (_ISLAND, away))
    )
    network.add_lane(
        f"a{arm}",
        f"n{arm}",
        arc((aside, away), _ENTRY_RADIUS, np.pi, np.pi + angle, into),
    )
    network.add_lane(
        f"e{arm}", f"z{arm}", arc((-aside, away), _ENTRY_RADIUS, -angle, 0.0, out)
    )
    network.add_lane(
        f"z{arm}", f"x{arm}", straight((-_ISLAND, away), (-_ISLAND, away + APPROACH))
    )
    network.add_lane(
        f"n{arm}",
        f"e{(arm - 1) % 4}",
        arc((0.0, 0.0), _RING_RADIUS, angle, np.pi / 2 - angle, ring),
    )
    network.add_lane(
        f"e{arm}", f"n{arm}", arc((0.0, 0.0), _RING_RADIUS, np.pi - angle, angle, ring)
    )


def _fast_road(
    ends: tuple[float, float, float, float],
    lanes: int,
    limit: float,
    ramp: dict[str, Any],
) -> tuple[Any, LaneGeometry, list[tuple[int, ...]]]:
    """Three roads a-b, b-c and c-d along x with one more lane in the middle, and the numbers of their lanes.

    ``ramp``: further lanes by the names of their ends.
    """
    network, counts = RoadNetwork(), {"ab": lanes, "bc": lanes + 1, "cd": lanes}
    for (road, count), start, end in zip(
        counts.items(), ends[:-1], ends[1:], strict=True
    ):
        for k in range(count):
            lane = StraightLane(
                (start, k * _WIDTH), (end, k * _WIDTH), _WIDTH, speed_limit=limit
            )
            network.add_lane(*road, lane)
    for road, lane in ramp.items():
        network.add_lane(*road, lane)
    geometry = LaneGeometry(network)
    counts |= dict.fromkeys(ramp, 1)
    numbers = [
        tuple(geometry.number[road[0], road[1], k] for k in range(count))
        for road, count in counts.items()
    ]
    return network, geometry, numbers


def _ramp(x: tuple[float, float], y: float, approaching: bool, limit: float) -> Any:
    middle = y + _RAMP_SWING
    phase = np.pi / 2 if approaching else -np.pi / 2
    pulsation = np.pi / (x[1] - x[0])
    return SineLane(
        (x[0], middle),
        (x[1], middle),
        _RAMP_SWING,
        pulsation,
        phase,
        _WIDTH,
        speed_limit=limit,
    )


def _merge(seconds: float) -> RoadMap:
    lanes, total = 2, max(560.0, 26.0 * seconds + 200.0)
    bend, joined, narrow = total * 0.4, total * 0.4 + 80.0, total * 0.4 + 220.0
    y = lanes * _WIDTH
    far = y + 2 * _RAMP_SWING
    entry = StraightLane((0.0, far), (bend, far), _WIDTH, speed_limit=20.0)
    ramp = {"jk": entry, "kb": _ramp((bend, joined), y, True, 20.0)}
    network, geometry, roads = _fast_road(
        (0.0, joined, narrow, total), lanes, 25.0, ramp
    )
    main, middle, after, *before = roads
    routes = (
        Route((main, middle[:-1], after), 0.7),
        Route((*before, middle, after), 0.3),
    )
    return RoadMap(
        network,
        geometry,
        routes,
        (),
        ((joined + narrow) / 2, -7.0, 4.0),
        False,
        True,
        True,
    )


def _highway(seconds: float) -> RoadMap:
    lanes, total = 3, max(600.0, 29.0 * seconds + 200.0)
    wide, split = total * 0.45, total * 0.45 + 200.0
    y = lanes * _WIDTH
    far, parted = y + 2 * _RAMP_SWING, split + 90.0
    leaving = StraightLane((parted, far), (total, far), _WIDTH, speed_limit=20.0)
    ramp = {"ce": _ramp((split, parted), y, False, 22.0), "ef": leaving}
    network, geometry, roads = _fast_road((0.0, wide, split, total), lanes, 28.0, ramp)
    main, middle, after, *out = roads
    routes = (
        Route((main, middle[:-1], after), 0.75),
        Route((main, middle, *out), 0.25, otherwise=0),
    )
    return RoadMap(network, geometry, routes, (), (split, -7.0, 4.0), False, True, True)

"""Road maps of the four scenarios: lanes, routes, crossings and kerbs."""

from itertools import pairwise
from typing import Any

import numpy as np

from ...core import Floats
from .lanes import Crossing, Kerb, LaneGeometry, Pavement, RoadMap, Route
from .library import CircularLane, RoadNetwork, SineLane, StraightLane
from .world import APPROACH_M, ARM_WEIGHTS, STRIP_M, ScenarioName

# frequency of left turns, straight on and right turns at the intersection
_LEFT_WEIGHT = 0.235
_AHEAD_WEIGHT = 1.0
_RIGHT_WEIGHT = 0.57
# frequency of one, two and three quarters around the roundabout
_QUARTER_WEIGHTS = (0.6, 1.0, 0.4)
_STREET_LIMIT_MPS = 9.0  # on the arms
_LEFT_LIMIT_MPS = 4.8
_RIGHT_LIMIT_MPS = 3.4
_ENTRY_LIMIT_MPS = 4.4  # of the roundabout
_RING_LIMIT_MPS = 5.0
_EXIT_LIMIT_MPS = 5.3
_RING_RADIUS_M = 24.0  # of the roundabout
_ENTRY_RADIUS_M = 20.0  # of its entries and exits
_LANE_WIDTH_M = 3.5
_ARM_LANES = 2  # of each direction of the intersection
_ROUND_LANE_WIDTH_M = 4.5  # of the roundabout
# from the middle of an arm of the roundabout to the middle of its lanes
_ISLAND_M = 4.5
_RIGHT_RADIUS_M = 9.0  # of the intersection's right turns
# from the junction's mouth to the near and the far edge of a crossing
_ZEBRA_M = (1.0, 4.0)
_RAMP_SWING_M = 3.25  # half of the lateral shift of a ramp
_NO_PARKING_JUNCTION_M = 10.0  # at the junction's end of an arm
_NO_PARKING_FAR_M = 5.0
_RAMP_LIMIT_MPS = 20.0
_FAST_SENSOR_M = (-7.0, 4.0)  # y and z of the sensor beside a fast road
_QUARTER_TURNS = ((1, 0), (0, 1), (-1, 0), (0, -1))  # cosines and sines

# half of the road of an arm of the intersection, and from its middle to where arms end
_HALF_ROAD_M = _LANE_WIDTH_M * _ARM_LANES
_MOUTH_M = _LANE_WIDTH_M * (_ARM_LANES - 0.5) + _RIGHT_RADIUS_M
# the same of the roundabout, to the straight part of its arms
_ROUND_ASIDE_M = _ISLAND_M + _ENTRY_RADIUS_M
_ROUND_MOUTH_M = float(
    np.sqrt((_RING_RADIUS_M + _ENTRY_RADIUS_M) ** 2 - _ROUND_ASIDE_M**2)
)


def build_map(scenario: ScenarioName, seconds: float) -> RoadMap:
    """Build the map of ``scenario``.

    Fast roads are long enough for a vehicle to stay on them for ``seconds``.
    """
    if scenario == "intersection":
        return _intersection()
    if scenario == "roundabout":
        return _roundabout()
    return _merge(seconds) if scenario == "merge" else _highway(seconds)


def _rotated(arm: int, x: float, y: float) -> Floats:
    """Turn a point or direction of the first arm to another ``arm``."""
    cos, sin = _QUARTER_TURNS[arm % 4]
    return np.array([cos * x - sin * y, sin * x + cos * y], dtype=np.float64)


def _pair(arm: int, x: float, y: float) -> tuple[float, float]:
    x, y = _rotated(arm, x, y).tolist()
    return x, y


def _intersection() -> RoadMap:
    network = RoadNetwork()
    for arm in range(4):
        _add_intersection_arm(network, arm)
    geometry = LaneGeometry(network)
    routes = []
    crossings = []
    for arm in range(4):
        # turn to the target arm, frequency, lanes within the junction and out of it,
        # True if long vehicles can go there
        movements = [
            (1, _LEFT_WEIGHT, 0, 0, False),
            *((2, _AHEAD_WEIGHT / _ARM_LANES, k, k, True) for k in range(_ARM_LANES)),
            (3, _RIGHT_WEIGHT, 0, _ARM_LANES - 1, False),
        ]
        for turn, movement_weight, within, lane, heavy in movements:
            target = (arm + turn) % 4
            indices = (
                (f"o{arm}", f"m{arm}", lane),
                (f"m{arm}", f"w{target}", within),
                (f"w{target}", f"x{target}", lane),
            )
            roads = tuple((geometry.number[index],) for index in indices)
            routes.append(Route(roads, ARM_WEIGHTS[arm] * movement_weight, heavy))
        origin = _pair(arm, -_HALF_ROAD_M, _MOUTH_M + sum(_ZEBRA_M) / 2)
        width_m = _ZEBRA_M[1] - _ZEBRA_M[0]
        crossings.append(
            Crossing(origin, _pair(arm, 1.0, 0.0), 2 * _HALF_ROAD_M, width_m)
        )
    # behind the sidewalks, so that no person stands right in front of the sensor
    corner = _MOUTH_M + STRIP_M + 2.0
    return RoadMap(
        geometry,
        tuple(routes),
        sensor=(corner, corner, 4.0),
        regulated=True,
        crossings=tuple(crossings),
        pavement=Pavement(_MOUTH_M, _MOUTH_M - _HALF_ROAD_M),
        kerbs=_kerbs(_HALF_ROAD_M + STRIP_M, _MOUTH_M),
    )


def _kerbs(aside_m: float, mouth_m: float) -> tuple[Kerb, ...]:
    """Return both kerbs of every arm, ``aside_m`` m from its middle.

    The arm begins ``mouth_m`` m from the middle of the junction.
    """
    start_m = mouth_m + _NO_PARKING_JUNCTION_M
    end_m = mouth_m + APPROACH_M - _NO_PARKING_FAR_M
    kerbs = []
    for arm in range(4):
        inward = _pair(arm, 0.0, -1.0)
        outward = _pair(arm, 0.0, 1.0)
        kerbs.append(Kerb(_pair(arm, aside_m, end_m), inward, end_m - start_m))
        kerbs.append(Kerb(_pair(arm, -aside_m, start_m), outward, end_m - start_m))
    return tuple(kerbs)


def _add_intersection_arm(network: Any, arm: int) -> None:
    """Add the lanes of an arm, and those that lead from it through the junction.

    Its nodes: o and m at the ends of the way in, w and x at the ends of the way out.
    """
    quarter_rad = np.pi / 2 * arm
    into = f"m{arm}"
    left_arm, ahead_arm, right_arm = (f"w{(arm + turn) % 4}" for turn in (1, 2, 3))
    far_y = _MOUTH_M + APPROACH_M
    for k in range(_ARM_LANES):
        x = _LANE_WIDTH_M * (k + 0.5)
        for origin, target, side, start_m, end_m in (
            (f"o{arm}", into, x, far_y, _MOUTH_M),
            (into, ahead_arm, x, _MOUTH_M, -_MOUTH_M),
            (f"w{arm}", f"x{arm}", -x, _MOUTH_M, far_y),
        ):
            lane = _street(arm, (side, start_m), (side, end_m), _LANE_WIDTH_M)
            network.add_lane(origin, target, lane)
    left_radius_m = _MOUTH_M + _LANE_WIDTH_M / 2
    right_radius_m = _MOUTH_M - _LANE_WIDTH_M * (_ARM_LANES - 0.5)
    center = _rotated(arm, _MOUTH_M, _MOUTH_M)
    phase_range = (quarter_rad + np.pi, quarter_rad + 1.5 * np.pi)
    network.add_lane(
        into, right_arm, _arc(center, right_radius_m, phase_range, _RIGHT_LIMIT_MPS)
    )
    center = _rotated(arm, -_MOUTH_M, _MOUTH_M)
    phase_range = (quarter_rad, quarter_rad - np.pi / 2)
    network.add_lane(
        into, left_arm, _arc(center, left_radius_m, phase_range, _LEFT_LIMIT_MPS)
    )


def _street(
    arm: int, start_m: tuple[float, float], end_m: tuple[float, float], width_m: float
) -> Any:
    points = (_rotated(arm, *start_m), _rotated(arm, *end_m))
    return StraightLane(*points, width_m, speed_limit=_STREET_LIMIT_MPS)


def _arc(
    center: Floats,
    radius_m: float,
    phase_range: tuple[float, float],
    limit_mps: float,
    width_m: float = _LANE_WIDTH_M,
) -> Any:
    clockwise = phase_range[1] > phase_range[0]
    return CircularLane(
        center,
        radius_m,
        *phase_range,
        clockwise=clockwise,
        width=width_m,
        speed_limit=limit_mps,
    )


def _roundabout() -> RoadMap:
    network = RoadNetwork()
    for arm in range(4):
        _add_roundabout_arm(network, arm)
    geometry = LaneGeometry(network)
    # nodes of the arms, see `_add_roundabout_arm`, in the order of travel
    ring = []
    for arm in (0, 3, 2, 1):
        ring += [f"n{arm}", f"e{(arm - 1) % 4}"]
    routes = []
    for arm in range(4):
        first = ring.index(f"n{arm}")
        for quarters, movement_weight in zip((1, 2, 3), _QUARTER_WEIGHTS, strict=True):
            out = (arm - quarters) % 4
            # two nodes per quarter
            around = [ring[(first + k) % 8] for k in range(2 * quarters)]
            nodes = [f"o{arm}", f"a{arm}", *around, f"z{out}", f"x{out}"]
            roads = tuple((geometry.number[a, b, 0],) for a, b in pairwise(nodes))
            routes.append(Route(roads, ARM_WEIGHTS[arm] * movement_weight))
    return RoadMap(
        geometry,
        tuple(routes),
        sensor=(0.0, 0.0, 4.0),
        regulated=True,
        first_in_first_out=False,
        kerbs=_kerbs(_ISLAND_M + _ROUND_LANE_WIDTH_M / 2 + STRIP_M, _ROUND_MOUTH_M),
    )


def _add_roundabout_arm(network: Any, arm: int) -> None:
    """Add entry, exit and ring at an arm.

    Its nodes: o and a at the ends of the straight entry, n where it joins the ring, e
    where the exit leaves the ring, z and x at the ends of the straight exit.
    """
    quarter_rad = np.pi / 2 * arm
    # where the entry touches the ring; the exit mirrors it
    touch_rad = float(np.arctan2(_ROUND_MOUTH_M, _ROUND_ASIDE_M))
    far_y = _ROUND_MOUTH_M + APPROACH_M
    entry = _rotated(arm, _ROUND_ASIDE_M, _ROUND_MOUTH_M)
    leave = _rotated(arm, -_ROUND_ASIDE_M, _ROUND_MOUTH_M)
    middle = _rotated(arm, 0.0, 0.0)

    def straight(x: float, start_m: float, end_m: float) -> Any:
        return _street(arm, (x, start_m), (x, end_m), _ROUND_LANE_WIDTH_M)

    def bend(
        center: Floats,
        radius_m: float,
        start_rad: float,
        end_rad: float,
        limit_mps: float,
    ) -> Any:
        phase_range = (quarter_rad + start_rad, quarter_rad + end_rad)
        return _arc(center, radius_m, phase_range, limit_mps, _ROUND_LANE_WIDTH_M)

    half_turn = np.pi
    quarter_end = half_turn / 2 - touch_rad
    first_arc = bend(middle, _RING_RADIUS_M, touch_rad, quarter_end, _RING_LIMIT_MPS)
    second_arc = bend(
        middle, _RING_RADIUS_M, half_turn - touch_rad, touch_rad, _RING_LIMIT_MPS
    )
    into = bend(
        entry, _ENTRY_RADIUS_M, half_turn, half_turn + touch_rad, _ENTRY_LIMIT_MPS
    )
    out = bend(leave, _ENTRY_RADIUS_M, -touch_rad, 0.0, _EXIT_LIMIT_MPS)
    network.add_lane(f"o{arm}", f"a{arm}", straight(_ISLAND_M, far_y, _ROUND_MOUTH_M))
    network.add_lane(f"a{arm}", f"n{arm}", into)
    network.add_lane(f"e{arm}", f"z{arm}", out)
    network.add_lane(f"z{arm}", f"x{arm}", straight(-_ISLAND_M, _ROUND_MOUTH_M, far_y))
    network.add_lane(f"n{arm}", f"e{(arm - 1) % 4}", first_arc)
    network.add_lane(f"e{arm}", f"n{arm}", second_arc)


def _fast_road(
    ends: tuple[float, float, float, float],
    lane_count: int,
    limit_mps: float,
    ramp: dict[str, Any],
) -> tuple[LaneGeometry, list[tuple[int, ...]]]:
    """Return the lanes of roads a-b, b-c, c-d along x, and their numbers by road.

    Road b-c has one more lane. ``ends``: x of a, b, c and d, m; ``ramp``: further lanes
    by the names of their ends.
    """
    network = RoadNetwork()
    # a name of a road has a letter for each end
    counts = {"ab": lane_count, "bc": lane_count + 1, "cd": lane_count}
    for (road, count), (start_m, end_m) in zip(
        counts.items(), pairwise(ends), strict=True
    ):
        for k in range(count):
            y = k * _LANE_WIDTH_M
            points = ((start_m, y), (end_m, y))
            lane = StraightLane(*points, _LANE_WIDTH_M, speed_limit=limit_mps)
            network.add_lane(*road, lane)
    for road, lane in ramp.items():
        network.add_lane(*road, lane)
    geometry = LaneGeometry(network)
    counts |= dict.fromkeys(ramp, 1)
    numbers = [
        tuple(geometry.number[road[0], road[1], k] for k in range(count))
        for road, count in counts.items()
    ]
    return geometry, numbers


def _ramp(
    start_m: float, end_m: float, y: float, phase: float, limit_mps: float
) -> Any:
    """Return the bend of a ramp beside a road's lane at ``y`` m.

    ``phase``: pi / 2 of a ramp that comes to the road, -pi / 2 of one that leaves it.
    """
    middle = y + _RAMP_SWING_M
    pulsation = np.pi / (end_m - start_m)
    points = ((start_m, middle), (end_m, middle))
    wave = (_RAMP_SWING_M, pulsation, phase)
    return SineLane(*points, *wave, _LANE_WIDTH_M, speed_limit=limit_mps)


def _merge(seconds: float) -> RoadMap:
    """Build two lanes that a ramp joins, with a third one beside them for a while."""
    lane_count = 2
    total_m = max(560.0, 26.0 * seconds + 200.0)
    bend = total_m * 0.4  # the ramp begins to approach
    joined_x = total_m * 0.4 + 80.0  # the third lane begins
    narrow_x = total_m * 0.4 + 220.0  # it ends
    y = lane_count * _LANE_WIDTH_M
    far_y = y + 2 * _RAMP_SWING_M
    entry = StraightLane(
        (0.0, far_y), (bend, far_y), _LANE_WIDTH_M, speed_limit=_RAMP_LIMIT_MPS
    )
    swing = _ramp(bend, joined_x, y, phase=np.pi / 2, limit_mps=_RAMP_LIMIT_MPS)
    ramp = {"jk": entry, "kb": swing}
    ends = (0.0, joined_x, narrow_x, total_m)
    geometry, roads = _fast_road(ends, lane_count, limit_mps=25.0, ramp=ramp)
    main, middle, final, *entries = roads
    routes = (
        Route((main, middle[:-1], final), weight=0.7),
        Route((*entries, middle, final), weight=0.3),
    )
    sensor = ((joined_x + narrow_x) / 2, *_FAST_SENSOR_M)
    return RoadMap(geometry, routes, sensor, regulated=False)


def _highway(seconds: float) -> RoadMap:
    """Build three lanes, with a fourth one for a while that leads to an exit."""
    lane_count = 3
    total_m = max(600.0, 29.0 * seconds + 200.0)
    wide_x = total_m * 0.45  # the fourth lane begins
    split_x = total_m * 0.45 + 200.0  # it leaves the road
    parted_x = split_x + 90.0  # the exit is parallel again
    y = lane_count * _LANE_WIDTH_M
    far_y = y + 2 * _RAMP_SWING_M
    leaving = StraightLane(
        (parted_x, far_y), (total_m, far_y), _LANE_WIDTH_M, speed_limit=_RAMP_LIMIT_MPS
    )
    swing = _ramp(split_x, parted_x, y, phase=-np.pi / 2, limit_mps=22.0)
    ramp = {"ce": swing, "ef": leaving}
    ends = (0.0, wide_x, split_x, total_m)
    geometry, roads = _fast_road(ends, lane_count, limit_mps=28.0, ramp=ramp)
    main, middle, final, *exits = roads
    routes = (
        Route((main, middle[:-1], final), weight=0.75),
        Route((main, middle, *exits), weight=0.25, otherwise=0),
    )
    sensor = (split_x, *_FAST_SENSOR_M)
    return RoadMap(geometry, routes, sensor, regulated=False)

"""Vehicles: random sizes and driving styles, and their motion."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Any, NamedTuple

import numpy as np

from ...core import Floats, wrap_angle
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


_LIGHT = _DrivingStyle(0.6, 0.98, 40.0, 0.3, (1.2, 2.2))
_HEAVY = _DrivingStyle(0.55, 0.88, 23.5, 0.8, (0.8, 1.3))


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
    speed_room = Vehicle.MAX_SPEED - speed
    limited = np.minimum(acceleration, speed_room)
    acceleration = np.where(speed > Vehicle.MAX_SPEED, limited, acceleration)
    slip = np.arctan(1 / 2 * np.tan(steering))
    course_vector = np.array([np.cos(heading + slip), np.sin(heading + slip)])
    positions = state.xy + speed * course_vector * step_s
    heading = heading + speed * np.sin(slip) / (state.wheelbase / 2) * step_s
    speed = speed + acceleration * step_s
    for i, vehicle in enumerate(vehicles):
        if driven := vehicle.drive():
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
    box_rows = zip(vehicles, places, headings, speed.tolist(), strict=True)
    for vehicle, position, angle, pace in box_rows:
        vehicle.position = position
        vehicle.heading = round(angle, 6) + 0.0
        vehicle.speed = round(pace, 6) + 0.0


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
    length_m, width_m, height_m, (shortest, longest) = _SIZES_M[kind]
    widest = min(width_m[0] + 0.25, 2.55)
    return (
        float(np.clip(rng.normal(*length_m), shortest, longest)),
        float(np.clip(rng.normal(*width_m), width_m[0] - 0.25, widest)),
        float(np.clip(rng.normal(*height_m), 0.8 * height_m[0], 1.25 * height_m[0])),
    )

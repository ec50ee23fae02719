"""Where everybody is on the lanes: one look at the road, shared by all rules of a step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...types import Bools, Floats, Ints
from .networks import RoadMap
from .population import Driver
from .routes import NOWHERE, RouteTable

DISCS = 7  # discs along a vehicle's axis that cover its box
_STEPS = (np.arange(DISCS) - (DISCS - 1) / 2) / DISCS  # their middles, as shares of the length
PERSON_RADIUS = 0.4  # m


@dataclass(frozen=True, eq=False)
class State:
    """Vehicles in the order of the road's list; highway-env's frame."""

    vehicles: list[Driver]
    xy: Floats  # [N, 2]
    heading: Floats  # [N]
    speed: Floats  # [N]
    length: Floats  # [N]
    width: Floats  # [N]
    wheelbase: Floats  # [N]
    temper: Floats  # [N, 7] pace, top speed, time gap, least gap, acceleration, braking, politeness
    aside: Floats  # [N] m right of the middle of the lane, aimed at
    route: Ints  # [N]
    lane: Ints  # [N] lane that is driven in, or towards
    s: Floats  # [N] in that lane
    d: Floats  # [N]
    way: Floats  # [N] m from the start of the route
    velocity: Floats  # [N + M, 2] of vehicles, then pedestrians
    owner: Ints  # [P] who a disc belongs to: vehicles, then pedestrians
    radius: Floats  # [P]
    along: Floats  # [L, P] lane coordinates of the discs
    across: Floats  # [L, P]
    finished: Bools  # [N] reached the end of the route

    def __len__(self) -> int:
        return len(self.vehicles)


def observe(
    vehicles: list[Driver], town: RoadMap, routes: RouteTable, persons: Floats, persons_velocity: Floats
) -> State:
    """The state of ``vehicles`` and pedestrians; moves vehicles on in their ``routes`` through ``town``.

    ``persons`` and ``persons_velocity`` ``[M, 2]``: places and velocities of people on foot.
    """
    n = len(vehicles)
    xy = np.array([v.position for v in vehicles], dtype=np.float64).reshape(-1, 2)
    motion = np.array([(v.heading, v.speed, v.route, v.lane_number) for v in vehicles], dtype=np.float64).reshape(-1, 4)
    traits = np.array([v.traits for v in vehicles], dtype=np.float64).reshape(-1, 11)
    heading, speed = motion[:, 0], motion[:, 1]
    route, lane = motion[:, 2].astype(np.int64), motion[:, 3].astype(np.int64)
    direction = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    discs = xy[:, None, :] + (traits[:, 0, None] * _STEPS)[:, :, None] * direction[:, None, :]
    points = np.concatenate([discs.reshape(-1, 2), persons])
    along, across = town.geometry.coordinates(points)
    center = np.arange(n) * DISCS + DISCS // 2
    length = town.geometry.length
    for _ in range(2):  # a lane may be shorter than a step
        after = routes.following[route, lane]
        lane = np.where((along[lane, center] > length[lane]) & (after != NOWHERE), after, lane)
    for vehicle, number in zip(vehicles, lane.tolist(), strict=True):
        vehicle.lane_number = number
    s = along[lane, center]
    disc = np.hypot(traits[:, 1] / 2, traits[:, 0] / (2 * DISCS))
    return State(
        vehicles=vehicles, xy=xy, heading=heading, speed=speed,
        length=traits[:, 0], width=traits[:, 1], wheelbase=traits[:, 2], temper=traits[:, 3:10], aside=traits[:, 10],
        route=route, lane=lane, s=s, d=across[lane, center], way=routes.start[route, lane] + s,
        velocity=np.concatenate([direction * speed[:, None], persons_velocity]),
        owner=np.concatenate([np.repeat(np.arange(n), DISCS), n + np.arange(len(persons))]),
        radius=np.concatenate([np.repeat(disc, DISCS), np.full(len(persons), PERSON_RADIUS)]),
        along=along, across=across,
        finished=routes.last[route, lane] & (s > length[lane] - 1.0),
    )  # fmt: skip

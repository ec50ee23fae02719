"""Longitudinal and lateral control: the intelligent driver model behind whatever lies in the path, and path tracking.

The gap is taken from bumper to bumper along the path. Treiber, Hennecke, Helbing (2000), "Congested traffic states in
empirical observations and microscopic simulations".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...types import Floats, Ints
from .lane_geometry import LaneGeometry
from .routes import RouteTable
from .state import State

MARGIN = 0.3  # m, free space that is wanted on both sides
HARDEST = 8.0  # m/s2, emergency braking
_CLOSE = 0.05  # m, smaller gaps count as this
_LATERAL_RATE = 0.8  # 1/s, how fast an offset from the lane's middle is worked off
_LATERAL_SPEED = 1.3  # m/s at most
_HEADING_RATE = 3.3  # 1/s
_SWERVE = 2.2  # m/s2 of lateral acceleration at most, beyond that of the bend
_SLOW = 5.5  # m/s, who is slower turns as at this
_PREVIEW = 0.3  # s
_MOST_SLIP = 0.45  # sine of the angle between heading and course, some 0.8 rad of steering
_SLIP_RATE = 0.3  # rad/s, some 0.6 rad/s of steering


@dataclass(frozen=True, eq=False)
class Leaders:
    """What is first in everybody's path."""

    gap: Floats  # [N] m from bumper; inf: nothing in sight
    speed: Floats  # [N] m/s along the path


def leaders(state: State, geometry: LaneGeometry, routes: RouteTable) -> Leaders:
    """The nearest disc of somebody else in the strip that everybody is going to sweep."""
    lanes = routes.path[state.route, state.lane]  # [N, K]
    low, high = _strip(state, geometry, lanes)
    row, k, p = _in_lanes(state, geometry, lanes, low, high)
    ahead = state.along[lanes[row, k], p] + (routes.path_start[state.route, state.lane] - state.s[:, None])[row, k]
    across, radius = state.across[lanes[row, k], p], state.radius[p]
    taken = (ahead > 0.0) & (across + radius > low[row, k]) & (across - radius < high[row, k])
    taken &= state.owner[p] != row
    row, k, p = row[taken], k[taken], p[taken]
    gap = ahead[taken] - radius[taken]
    least = np.full(len(state), np.inf)
    np.minimum.at(least, row, gap)
    nearest = np.flatnonzero(gap == least[row])
    row, first = np.unique(row[nearest], return_index=True)
    lane, p = lanes[row, k[nearest[first]]], p[nearest[first]]
    tangent = geometry.heading(lane, state.along[lane, p])
    velocity = state.velocity[state.owner[p]]
    speed = np.zeros(len(state))
    speed[row] = velocity[:, 0] * np.cos(tangent) + velocity[:, 1] * np.sin(tangent)
    return Leaders(least - state.length / 2, speed)


def _in_lanes(state: State, geometry: LaneGeometry, lanes: Ints, low: Floats, high: Floats) -> tuple[Ints, Ints, Ints]:
    """Vehicles, places in their paths ``lanes`` ``[N, K]`` and discs that may lie there, in this order.

    Between ``low`` and ``high`` ``[N, K]`` of the widest strip that anybody is going to sweep in the lane.
    """
    row, k = np.nonzero(lanes >= 0)
    lane = lanes[row, k]
    least, most = np.full(len(geometry), np.inf), np.full(len(geometry), -np.inf)
    np.minimum.at(least, lane, low[row, k])
    np.maximum.at(most, lane, high[row, k])
    inside = (state.along > -0.3) & (state.along < geometry.length[:, None] + 0.3)
    inside &= (state.across + state.radius > least[:, None]) & (state.across - state.radius < most[:, None])
    disc, count = np.nonzero(inside)[1], inside.sum(axis=1)
    begin = np.cumsum(count) - count
    pair = np.repeat(np.arange(len(lane)), count[lane])
    rank = np.arange(len(pair)) - np.repeat(np.cumsum(count[lane]) - count[lane], count[lane])
    return row[pair], k[pair], disc[begin[lane][pair] + rank]


def _strip(state: State, geometry: LaneGeometry, lanes: Ints) -> tuple[Floats, Floats]:
    """Lateral range ``[N, K]`` that a vehicle sweeps in the lanes of its path, the way to their middle included."""
    outer, inner = sweep(state.length, state.width, state.wheelbase, geometry.radius[lanes].T)
    right_turn = geometry.turn[lanes] > 0
    left, right = np.where(right_turn, outer.T, inner.T), np.where(right_turn, inner.T, outer.T)
    low, high = np.minimum(state.d, state.aside), np.maximum(state.d, state.aside)
    here = np.arange(lanes.shape[1]) == 0
    low = np.where(here, low[:, None], np.minimum(state.aside, 0.0)[:, None])
    high = np.where(here, high[:, None], np.maximum(state.aside, 0.0)[:, None])
    return low - left - MARGIN, high + right + MARGIN


def sweep(length: Floats, width: Floats, wheelbase: Floats, radius: Floats) -> tuple[Floats, Floats]:
    """How far a box reaches to the outer and to the inner side of a bend that its centre follows."""
    rear = np.where(np.isinf(radius), 0.0, np.sqrt(np.maximum(radius**2 - wheelbase**2 / 4, 0.0)))
    front = (wheelbase + length) / 2
    with np.errstate(invalid="ignore"):
        outer = np.where(np.isinf(radius), width / 2, np.hypot(rear + width / 2, front) - radius)
        inner = np.where(np.isinf(radius), width / 2, radius - rear + width / 2)
    return outer, inner


def desired_speed(state: State, geometry: LaneGeometry, routes: RouteTable) -> Floats:
    """Speed ``[N]`` that everybody would like, slowing down in time for the limits ahead."""
    lanes = routes.path[state.route, state.lane]
    distance = np.maximum(routes.path_start[state.route, state.lane] - state.s[:, None] - state.length[:, None] / 2, 0)
    limit = geometry.limit[lanes] * state.temper[:, 0, None]
    allowed = np.sqrt(limit**2 + 2.0 * 1.3 * distance)
    allowed = np.where(lanes >= 0, allowed, np.inf)
    return np.asarray(np.minimum(allowed.min(axis=1), state.temper[:, 1]))


def free_acceleration(speed: Floats, wanted: Floats, temper: Floats) -> Floats:
    """Acceleration ``[N]`` of the driver model on an empty road."""
    a = temper[..., 4]
    return np.maximum(a * (1.0 - (speed / np.maximum(wanted, 0.1)) ** 4), -temper[..., 5])


def braking(speed: Floats, gap: Floats, leader: Floats, temper: Floats, least: Floats | float | None = None) -> Floats:
    """What the driver model takes off the acceleration ``[N]``, m/s2, for a leader at a ``gap`` ``[N]`` m.

    ``speed`` and ``leader`` ``[N]``: m/s of both; ``temper``: parameters of the drivers; ``least``: distance at rest,
    m.
    """
    a, b = temper[..., 4], temper[..., 5]
    closing = speed * (speed - leader) / (2.0 * np.sqrt(a * b))
    jam = temper[..., 3] if least is None else least
    wanted = jam + np.maximum(speed * temper[..., 2] + closing, 0.0)
    return a * (wanted / np.maximum(gap, _CLOSE)) ** 2


def steering(state: State, geometry: LaneGeometry, routes: RouteTable, before: Floats, dt: float) -> Floats:
    """Steering angle ``[N]`` that brings everybody to its place in the lane and along it.

    ``state``: where everybody is on the lanes of ``geometry``, on their ``routes``.
    ``before``: the angles ``[N]`` of ``dt`` seconds ago, which limit those of now.
    """
    v = np.maximum(state.speed, 1.0)
    ahead = state.s + v * _PREVIEW
    after = routes.following[state.route, state.lane]
    beyond = (ahead > geometry.length[state.lane]) & (after >= 0)
    lane = np.where(beyond, after, state.lane)
    s = np.where(beyond, ahead - geometry.length[state.lane], ahead)
    slip = np.arcsin(np.clip(state.wheelbase / 2 * geometry.curvature(lane), -0.9, 0.9))
    rate = np.clip(-_LATERAL_RATE * (state.d - state.aside), -_LATERAL_SPEED, _LATERAL_SPEED)
    wanted = geometry.heading(lane, s) - slip + np.arcsin(np.clip(rate / np.maximum(v, 3.0), -0.35, 0.35))
    error = np.remainder(wanted - state.heading + np.pi, 2 * np.pi) - np.pi
    bend = v * geometry.curvature(lane)
    most = _SWERVE / np.maximum(v, _SLOW)
    rate = np.clip(_HEADING_RATE * error, bend - most, bend + most)
    turn = np.arcsin(np.clip(state.wheelbase / 2 * rate / v, -_MOST_SLIP, _MOST_SLIP))
    now = np.arctan(np.tan(before) / 2)
    return np.asarray(np.arctan(2 * np.tan(np.clip(turn, now - _SLIP_RATE * dt, now + _SLIP_RATE * dt))))

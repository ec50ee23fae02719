"""Lanes of a map of 123D."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ...types import Floats, Lane
from ..argoverse2.road import even, lane_between
from .arrow import read_arrow, reading

REACH = 200.0  # m from the way of the ego, beyond which lanes are left out: a map may be that of a city
STEP = 2.0  # m between points, at most
_LANE, _GROUP, _BIKE = 0, 1, 3  # two layers of a map, and a type of lane


class Feature(msgspec.Struct):
    """A lane, or a group of lanes; lines are arrays as msgpack-numpy packs them."""

    lane_type: int = 0
    lane_group_id: int | None = None
    intersection_id: int | None = None
    successor_ids: list[int] = []
    centerline: dict[bytes, Any] = {}
    left_boundary: dict[bytes, Any] = {}
    right_boundary: dict[bytes, Any] = {}


def read_lanes(path: Path, way: Floats, origin: Floats) -> tuple[Lane, ...]:
    """Lanes near the ``way`` [F, 2] of the ego, those of bicycles left out, less the ``origin`` [3].

    Raises DataError for a map that is wrong.
    """
    columns, about = read_arrow(path, {"object_id": 1, "map_layer": 1, "features": 0})
    lanes: dict[int, tuple[Feature, Lane]] = {}
    crossings: set[int] = set()
    with reading(path):
        for number, layer, content in zip(*columns.values(), strict=True):
            if layer == _GROUP and msgspec.msgpack.decode(content, type=Feature).intersection_id is not None:
                crossings.add(int(number[0]))
            elif layer == _LANE and (feature := msgspec.msgpack.decode(content, type=Feature)).lane_type != _BIKE:
                lane = _lane(feature, origin, about.get("dataset") == "av2-sensor")
                if (np.linalg.norm(lane.center[:, None] - way, axis=2) <= REACH).any():
                    lanes[int(number[0])] = feature, lane
    index = {number: place for place, number in enumerate(lanes)}
    return tuple(
        Lane(
            lane.center, lane.left, lane.right, tuple(index[i] for i in feature.successor_ids if i in index),
            feature.lane_group_id in crossings,
        )
        for feature, lane in lanes.values()
    )  # fmt: skip


def _lane(feature: Feature, origin: Floats, middle: bool) -> Lane:
    """The lane less the ``origin``; ``middle``: its middle line is made of the borders anyway."""
    lines = [points(line) for line in (feature.centerline, feature.left_boundary, feature.right_boundary)]
    center, left, right = (line - origin[: line.shape[1]] for line in lines)
    if middle:
        return lane_between(left, right)
    count = max(1, int(np.ceil(np.linalg.norm(np.diff(center, axis=0), axis=1).sum() / STEP))) + 1
    return Lane(*(even(line, count)[:, :2] for line in (center, left, right)))  # type: ignore[arg-type]


def points(packed: dict[bytes, Any]) -> Floats:
    """Points [n, 2 or 3] of a line; raises ValueError for a broken one."""
    if not {b"data", b"dtype", b"shape"} <= packed.keys() or packed[b"dtype"] not in ("<f8", "<f4"):
        raise ValueError("a lane lacks one of its lines")
    line = np.frombuffer(packed[b"data"], packed[b"dtype"]).reshape(packed[b"shape"]).astype(np.float64)
    if line.ndim != 2 or line.shape[1] not in (2, 3) or len(line) < 2 or not np.isfinite(line).all():
        raise ValueError(f"a line of a lane has the shape {list(line.shape)}, expected two or more finite points")
    return line

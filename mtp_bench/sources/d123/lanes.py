"""Lanes of a map of 123D."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ...types import Floats, Lane
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
    """Lanes near the ``way`` [F, 2] of the ego, those of bicycles left out, less the ``origin`` [2].

    Raises DataError for a map that is wrong.
    """
    columns, _ = read_arrow(path, {"object_id": 1, "map_layer": 1, "features": 0})
    lanes: dict[int, tuple[Feature, Lane]] = {}
    crossings: set[int] = set()
    with reading(path):
        for number, layer, content in zip(*columns.values(), strict=True):
            if layer == _GROUP and msgspec.msgpack.decode(content, type=Feature).intersection_id is not None:
                crossings.add(int(number[0]))
            elif layer == _LANE and (feature := msgspec.msgpack.decode(content, type=Feature)).lane_type != _BIKE:
                lane = _lane(feature, origin)
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


def _lane(feature: Feature, origin: Floats) -> Lane:
    """The lane with as many points on its borders as on its middle line, at equal shares of their lengths."""
    lines = [points(line) - origin for line in (feature.centerline, feature.left_boundary, feature.right_boundary)]
    along = [np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))) for line in lines]
    share = np.linspace(0.0, 1.0, max(1, int(np.ceil(along[0][-1] / STEP))) + 1)
    parts = zip(lines, along, strict=True)
    center, left, right = (np.column_stack([np.interp(share * at[-1], at, x) for x in line.T]) for line, at in parts)
    return Lane(center, left, right)


def points(packed: dict[bytes, Any]) -> Floats:
    """Points [n, 2] of a line; raises ValueError for a broken one."""
    if not {b"data", b"dtype", b"shape"} <= packed.keys() or packed[b"dtype"] not in ("<f8", "<f4"):
        raise ValueError("a lane lacks one of its lines")
    line = np.frombuffer(packed[b"data"], packed[b"dtype"]).reshape(packed[b"shape"])
    if len(line) < 2 or not np.isfinite(line).all():
        raise ValueError(f"a line of a lane has {len(line)} points, expected two or more, all finite")
    return line[:, :2].astype(np.float64)

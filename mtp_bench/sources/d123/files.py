"""Files of 123D: the columns that are asked for, and the lanes of a map.

Nothing else of an Arrow file is read.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ...core import Floats, Lane, even_points, open_regular
from ..argoverse2.source import lane_between
from ..base import is_near, link_lanes
from ..text import LIMIT, reading

FORM = "a file of 123D"


def read_arrow(
    path: Path, columns: Mapping[str, int], prefix: str = ""
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Read columns by name, and the metadata of the file.

    ``columns``: their names without the ``prefix`` that they have in the file, and how
    many numbers [R, n] each entry is; 0 for words or bytes [R]. Entries of lists stand
    one after the other, and a further array "row" [R] has the row of each. Raises
    DataError for a file that is wrong.
    """
    from pyarrow import compute, ipc

    with reading(path, FORM), open_regular(path) as stream:
        schema = ipc.open_file(stream).schema
        content = (schema.metadata or {})[b"metadata"]
        metadata = msgspec.msgpack.decode(content, type=dict[str, Any])
        arrays: dict[str, Any] = {}
        if not columns:
            return arrays, metadata
        for name in columns:
            if prefix + name not in schema.names:
                names = ", ".join(schema.names)
                raise ValueError(f"no column {prefix + name!r}, found: {names}")
        index = [schema.get_field_index(prefix + name) for name in columns]
        options = ipc.IpcReadOptions(included_fields=index)
        table = ipc.open_file(stream, options=options).read_all()
        for name, width in columns.items():
            column = table.column(prefix + name).combine_chunks()
            column.validate(full=True)  # offsets of a broken file may point anywhere
            if str(column.type).startswith("list"):
                rows = compute.list_parent_indices(column).to_numpy()
                column = column.flatten()
                if not np.array_equal(rows, arrays.setdefault("row", rows)):
                    raise ValueError(
                        f"{prefix + name} has other lengths of its lists than the "
                        "columns before"
                    )
            arrays[name] = _to_numpy(column, width, prefix + name)
        return arrays, metadata


def _to_numpy(column: Any, width: int, name: str) -> Any:
    """Return numbers [R, width] of a column, or words or bytes [R] for width 0."""
    from pyarrow import float64, list_

    if width > 1:
        column = column.cast(list_(float64(), width)).flatten()
    values = column.to_numpy(zero_copy_only=False)
    if not width:
        return values
    numbers = np.asarray(values, dtype=np.float64).reshape(-1, width)
    # single numbers are times and ids, which may be larger
    if width > 1 and not (np.abs(numbers) <= LIMIT).all():
        raise ValueError(f"{name} has a number that is not finite, or beyond {LIMIT:g}")
    return numbers


# from the path of the ego, beyond which lanes are left out: a map may be that of a city
ROAD_REACH_M = 200.0
MAX_STEP_M = 2.0  # between points of a lane
# two layers of a map, and a type of lane
_LANE_LAYER = 0
_GROUP_LAYER = 1
_BIKE_LANE = 3


class Feature(msgspec.Struct):
    """A lane, or a group of lanes; lines are arrays as msgpack-numpy packs them."""

    lane_type: int = 0
    lane_group_id: int | None = None
    intersection_id: int | None = None
    successor_ids: list[int] = []
    centerline: dict[bytes, Any] = {}
    left_boundary: dict[bytes, Any] = {}
    right_boundary: dict[bytes, Any] = {}


def read_lanes(path: Path, ego_place: Floats, origin: Floats) -> tuple[Lane, ...]:
    """Return lanes near the places [F, 2] of the ego, without those of bicycles.

    The ``origin`` [3] is subtracted. Raises DataError for a map that is wrong.
    """
    columns, metadata = read_arrow(
        path, {"object_id": 1, "map_layer": 1, "features": 0}
    )
    # Argoverse 2 stores borders alone: the middle line is made of them
    has_center = metadata.get("dataset") != "av2-sensor"
    group_of_lane: dict[int, int | None] = {}
    lanes: dict[int, Lane] = {}
    successors: dict[int, list[int]] = {}
    junction_groups: set[int | None] = set()
    with reading(path, FORM):
        for number, layer, content in zip(*columns.values(), strict=True):
            if layer not in (_LANE_LAYER, _GROUP_LAYER):
                continue
            feature = msgspec.msgpack.decode(content, type=Feature)
            object_id = int(number[0])
            if layer == _GROUP_LAYER:
                if feature.intersection_id is not None:
                    junction_groups.add(object_id)
            elif feature.lane_type != _BIKE_LANE:
                lane = _lane(feature, origin, has_center)
                if is_near(lane, ego_place, ROAD_REACH_M):
                    group_of_lane[object_id] = feature.lane_group_id
                    lanes[object_id] = lane
                    successors[object_id] = feature.successor_ids
    for object_id, lane in lanes.items():
        junction = group_of_lane[object_id] in junction_groups
        lanes[object_id] = replace(lane, junction=junction)
    return link_lanes(lanes, successors)


def _lane(feature: Feature, origin: Floats, has_center: bool) -> Lane:
    """Return the lane less the ``origin``."""
    packed_lines = feature.centerline, feature.left_boundary, feature.right_boundary
    lines: list[Floats] = []
    for packed in packed_lines:
        line = points(packed)
        # a line may lack z
        lines.append(line - origin[: line.shape[1]])
    if not has_center:
        return lane_between(lines[1], lines[2])
    length_m = np.linalg.norm(np.diff(lines[0], axis=0), axis=1).sum()
    count = max(1, int(np.ceil(length_m / MAX_STEP_M))) + 1
    center, left_border, right_border = (
        even_points(line, count)[:, :2] for line in lines
    )
    return Lane(center, left_border, right_border)


def points(packed: dict[bytes, Any]) -> Floats:
    """Return points [n, 2 or 3] of a line.

    Raises ValueError for a broken one.
    """
    is_packed = {b"data", b"dtype", b"shape"} <= packed.keys()
    if not is_packed or packed[b"dtype"] not in ("<f8", "<f4"):
        raise ValueError("a lane lacks one of its lines")
    numbers = np.frombuffer(packed[b"data"], packed[b"dtype"])
    line = numbers.reshape(packed[b"shape"]).astype(np.float64)
    is_line = line.ndim == 2 and line.shape[1] in (2, 3) and len(line) > 1
    if not is_line or not np.isfinite(line).all():
        raise ValueError(
            f"a line of a lane has the shape {list(line.shape)}, expected two or more "
            "finite points"
        )
    return line

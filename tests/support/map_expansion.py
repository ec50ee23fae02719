"""A map expansion in the official layout: two lanes and a bend through a junction, beside the way of an ego.

Along the heading of the ego, from 40 m behind it to 20 m ahead, run two lanes: ``own`` around the ego,
``other`` to its left, towards it. At the end of ``own`` ``bend`` turns left, radius 10 m. ``far``, which
follows it, lies 1 km away. To the right of ``own`` runs a ``cycleway``.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

Record = dict[str, Any]
LAYERS = (
    "polygon", "line", "node", "drivable_area", "road_segment", "road_block", "lane", "lane_connector", "ped_crossing",
    "walkway", "stop_line", "carpark_area", "road_divider", "lane_divider", "traffic_light",
)  # fmt: skip


def make_map(pose: Sequence[float]) -> Record:
    """The content of a file, around an ego at ``pose`` x y yaw."""
    content: Record = {"version": "1.3", "canvas_edge": [2000.0, 2000.0], "connectivity": {}, "arcline_path_3": {}}
    content |= {layer: [] for layer in LAYERS}
    _add_lane(content, "own", pose, (-40.0, 0.0), 0.0, 60.0)
    _add_lane(content, "other", pose, (20.0, 4.0), np.pi, 60.0)
    _add_lane(content, "far", pose, (1000.0, 0.0), 0.0, 60.0)
    _add_lane(content, "cycleway", pose, (-40.0, -4.0), 0.0, 60.0, "BIKE")
    content["lane_connector"].append({"token": "bend"})
    content["arcline_path_3"]["bend"] = [_path(pose, (20.0, 0.0), 0.0, "SLS", [2.0, 5 * np.pi, 3.0], 10.0)]
    content["connectivity"]["own"] = {"incoming": [], "outgoing": ["bend"]}
    content["connectivity"]["bend"] = {"incoming": ["own"], "outgoing": ["nowhere", "far", "cycleway"]}
    return content


def write_map(root: Path, location: str, content: Record) -> Path:
    path = root / "maps/expansion" / f"{location}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def _add_lane(
    content: Record, token: str, pose: Sequence[float], place: tuple[float, float], turn: float, length: float,
    kind: str = "CAR",
) -> None:  # fmt: skip
    cos, sin = np.cos(turn), np.sin(turn)
    edges = {"from_edge_line_token": "", "to_edge_line_token": "", "lane_type": kind}
    content["lane"].append({"token": token, "polygon_token": f"{token}-ring", **edges})
    half = length / 2
    content["arcline_path_3"][token] = [
        _path(pose, place, turn, "LSR", [0.0, half, 0.0], 999.0),
        _path(pose, (place[0] + cos * half, place[1] + sin * half), turn, "RSL", [0.0, half, 0.0], 999.0),
    ]


def _path(
    pose: Sequence[float], place: tuple[float, float], turn: float, shape: str, lengths: list[float], radius: float
) -> Record:
    """A part of a middle line; the end, which the file has too, is not needed."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    x, y = pose[0] + cos * place[0] - sin * place[1], pose[1] + sin * place[0] + cos * place[1]
    start = [float(x), float(y), float(pose[2] + turn)]
    return {"start_pose": start, "end_pose": start, "shape": shape, "radius": radius, "segment_length": lengths}

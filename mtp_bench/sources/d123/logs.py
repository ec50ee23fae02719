"""Logs of 123D as tables of own scenes: true boxes within reach, poses of the ego, and lanes."""

import tomllib
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ...core import (
    Bools,
    DataError,
    Floats,
    Ints,
    Lane,
    file_stem,
    new_folder,
    wrap_angle,
)
from ..argoverse2.road import even, lane_between
from ..files.checks import TOLERANCE
from ..files.columns import BOX
from ..files.pictures import lane_columns
from ..files.table import write_table
from ..nuscenes.tables import require_rotations, yaw_of
from ..text import refuse
from .arrow import read_arrow, reading

SECOND = 1e6  # microseconds
ROUNDING = 1  # us by which a time of the ego may be off
STALE = 100_000  # us, age of the last pose from which a frame has none, and is left out
BACK = 50_000  # us over which the motion of the ego is taken
LABELS = Path(__file__).with_name("labels.toml")
BOXES, SYNC, EGO = "box_detections_se3", "sync", "ego_state_se3"
NEUTRAL = "neutral "  # before the class that a label is like: a match with it is neither right nor wrong
ROAD = 200.0  # m from the way of the ego, beyond which lanes are left out: a map may be that of a city
STEP = 2.0  # m between points of a lane, at most
_LANE, _GROUP, _BIKE = 0, 1, 3  # two layers of a map, and a type of lane

Columns = dict[str, NDArray[Any]]


def import_logs(
    source: Path,
    folder: Path,
    rate: float,
    reach: float,
    done: Callable[[str], object] = lambda _: None,
) -> Counter[str]:
    """Write the log, or the logs of a split, in the folder ``source`` as scenes at ``rate`` Hz into ``folder``.

    ``reach``: m from the ego, within which objects are true. Returns the numbers of rows, by table, and of logs.
    Raises DataError for a log that is wrong, and MtpBenchError if ``folder`` is not empty; it then writes no file.
    """
    found, source = Counter[str](), source.expanduser().absolute()
    logs = (
        [source]
        if (source / f"{BOXES}.arrow").exists()
        else sorted(source.glob(f"*/{BOXES}.arrow"))
    )
    if not logs:
        splits = sorted(
            {path.parents[1].name for path in source.glob(f"*/*/{BOXES}.arrow")}
        )
        advice = f"; logs are in {', '.join(splits)}: name one" if splits else ""
        expected = (
            f"expected a log of 123D, or a folder of logs such as a split{advice}"
        )
        raise DataError(f"{source} has no {BOXES}.arrow, {expected}")
    with new_folder(folder.expanduser().absolute()) as part:
        for log in (path if path.is_dir() else path.parent for path in logs):
            scene = part / file_stem(log.name)
            scene.mkdir()
            with reading(log):
                tables = log_tables(log, rate, reach)
            for name, columns in tables.items():
                write_table(scene / f"{name}.parquet", columns)
                found[name] += (
                    len(np.unique(columns["lane"]))
                    if name == "lanes"
                    else len(columns["frame"])
                )
            found["logs"] += 1
            done(log.name)
    return found


def log_tables(log: Path, rate: float, reach: float) -> dict[str, Columns]:
    """Tables of a log by name; raises DataError for a log that is wrong."""
    _, about = read_arrow(log / f"{SYNC}.arrow", {})
    if "interpolated" in str(about.get("split")):
        expected = "whose boxes between keyframes show the next keyframe; convert the split without interpolation"
        raise DataError(f"{log} is of the split {about['split']!r}, {expected}")
    names = {
        "timestamp_us": 1,
        "bounding_box_se3": 10,
        "track_token": 0,
        "label": 1,
        "num_lidar_points": 1,
    }
    boxes, metadata = read_arrow(log / f"{BOXES}.arrow", names, f"{BOXES}.")
    time = boxes["timestamp_us"][:, 0]
    if not (np.diff(time) > 0).all():
        raise DataError(
            f"{log / BOXES}.arrow: the times of its rows do not increase, expected one row per frame"
        )
    ego, posed, origin = _poses(log / f"{EGO}.arrow", time)
    own = SECOND / float(np.median(np.diff(time))) if len(time) > 1 else rate
    stride = max(1, round(own / rate))
    if not abs(own / stride / rate - 1) <= TOLERANCE:
        raise DataError(
            f"{log} has {own:.3g} frames per second: expected a rate that every n-th of them gives"
        )
    chosen = np.flatnonzero(posed)[::stride]
    ego, time = ego[chosen], time[chosen]
    word = _words(log / f"{BOXES}.arrow", metadata, boxes["label"][:, 0])
    truth = _truth(boxes, word, chosen, ego, origin, reach)
    pose = dict(zip(("x", "y", "z", "yaw"), ego.T, strict=True))
    tables = {
        "truth": truth,
        "ego": {
            "frame": np.arange(len(time)),
            "time": (time - time[0]) / SECOND,
            **pose,
        },
    }
    data, road = about.get("dataset"), log / "map.arrow"
    if not road.exists():  # some datasets have a map for each city
        road = (
            log.parent.parent.parent
            / "maps"
            / str(data)
            / f"{data}_{about.get('location')}.arrow"
        )
    lanes = read_lanes(road, ego[:, :2], origin) if road.exists() else ()
    return tables | ({"lanes": lane_columns(lanes)} if lanes else {})


def _truth(
    boxes: Columns,
    word: NDArray[np.str_],
    chosen: Ints,
    ego: Floats,
    origin: Floats,
    reach: float,
) -> Columns:
    """The table of the boxes in the frames ``chosen`` [C], less the ``origin`` [3]; ``word`` [R], ``ego`` [C, 4].

    An object is true from the frame on in which it is within ``reach`` m of the ego for the first time, and neutral
    where it is farther away later.
    """
    frame = np.searchsorted(chosen, boxes["row"])
    used = np.isin(boxes["row"], chosen) & (word != "skipped")
    frame, word, track = (
        frame[used],
        word[used],
        boxes["track_token"][used].astype(np.str_),
    )
    place, rotation, size = np.split(boxes["bounding_box_se3"][used], [3, 7], axis=1)
    box = np.column_stack([place - origin, yaw_of(rotation), size])
    near = np.linalg.norm(box[:, :2] - ego[frame, :2], axis=1) <= reach
    _, number = np.unique(track, return_inverse=True)
    begin = np.full(len(frame), len(chosen))
    np.minimum.at(begin, number[near], frame[near])
    neutral = (
        np.char.startswith(word, NEUTRAL)
        | (boxes["num_lidar_points"][used, 0] == 0)
        | ~near
    )
    rows = frame >= begin[number]
    columns = {"frame": frame, "id": track, "class": np.char.replace(word, NEUTRAL, "")}
    columns |= {
        **dict(zip(BOX, box.T, strict=True)),
        "neutral": neutral.astype(np.int64),
    }
    return {name: column[rows] for name, column in columns.items()}


def _poses(path: Path, time: Floats) -> tuple[Floats, Bools, Floats]:
    """Poses x y z yaw [F, 4] of the ego at ``time`` [F] us, frames [F] that have one, and the origin [3].

    A pose is the one of that time, else the last one before it and the motion until then: no later one is used. The
    origin is the first pose in whole metres, and is subtracted.
    """
    columns, _ = read_arrow(path, {"timestamp_us": 1, "imu_se3": 7}, f"{EGO}.")
    order = np.argsort(columns["timestamp_us"][:, 0], kind="stable")
    at, pose = columns["timestamp_us"][order, 0], columns["imu_se3"][order]
    require_rotations(pose[:, 3:], lambda row: f"{path}, pose {row + 1}")
    now = np.searchsorted(at, time + ROUNDING, "right") - 1
    age = time - at[now] if len(at) else np.full(len(time), np.inf)
    posed = (now >= 0) & (age <= STALE)
    if not posed.any():
        raise DataError(
            f"{path}: no frame of the boxes has a pose of the {STALE / SECOND:g} s before it"
        )
    origin = np.round(pose[0, :3])
    own = np.column_stack([pose[:, :3] - origin, np.unwrap(yaw_of(pose[:, 3:]))])
    before = np.maximum(np.searchsorted(at, at[now] - BACK, "right") - 1, 0)
    ahead = np.where(age > ROUNDING, age, 0.0) / np.maximum(at[now] - at[before], 1.0)
    moved = own[now] + ahead[:, None] * (own[now] - own[before])
    moved[:, 3] = wrap_angle(moved[:, 3])
    return moved, posed, origin


def _words(path: Path, metadata: Mapping[str, Any], label: Floats) -> NDArray[np.str_]:
    """A class, `NEUTRAL` and a class, or "skipped" [R] for labels of the registry that the metadata names."""
    registry = str(metadata.get("box_detection_label_class")).rsplit(".", maxsplit=1)[
        -1
    ]
    known: dict[str, dict[str, str]] = tomllib.loads(LABELS.read_text(encoding="utf-8"))
    if registry not in known:
        raise DataError(
            f"{path}: unknown labels {registry!r}, expected one of {', '.join(known)}"
        )
    words = {float(number): word for number, word in known[registry].items()}
    refuse(
        ~np.isin(label, list(words)),
        lambda row: f"{path}: {registry} has no label {label[row]:g}",
    )
    return np.array([words[number] for number in label.tolist()], dtype=np.str_)


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
            if (
                layer == _GROUP
                and msgspec.msgpack.decode(content, type=Feature).intersection_id
                is not None
            ):
                crossings.add(int(number[0]))
            elif (
                layer == _LANE
                and (feature := msgspec.msgpack.decode(content, type=Feature)).lane_type
                != _BIKE
            ):
                lane = _lane(feature, origin, about.get("dataset") == "av2-sensor")
                if (np.linalg.norm(lane.center[:, None] - way, axis=2) <= ROAD).any():
                    lanes[int(number[0])] = feature, lane
    index = {number: place for place, number in enumerate(lanes)}
    return tuple(
        Lane(
            lane.center,
            lane.left,
            lane.right,
            tuple(index[i] for i in feature.successor_ids if i in index),
            feature.lane_group_id in crossings,
        )
        for feature, lane in lanes.values()
    )


def _lane(feature: Feature, origin: Floats, middle: bool) -> Lane:
    """The lane less the ``origin``; ``middle``: its middle line is made of the borders anyway."""
    lines = [
        points(line)
        for line in (feature.centerline, feature.left_boundary, feature.right_boundary)
    ]
    center, left, right = (line - origin[: line.shape[1]] for line in lines)
    if middle:
        return lane_between(left, right)
    count = (
        max(
            1,
            int(np.ceil(np.linalg.norm(np.diff(center, axis=0), axis=1).sum() / STEP)),
        )
        + 1
    )
    return Lane(*(even(line, count)[:, :2] for line in (center, left, right)))  # type: ignore[arg-type]


def points(packed: dict[bytes, Any]) -> Floats:
    """Points [n, 2 or 3] of a line; raises ValueError for a broken one."""
    if not {b"data", b"dtype", b"shape"} <= packed.keys() or packed[b"dtype"] not in (
        "<f8",
        "<f4",
    ):
        raise ValueError("a lane lacks one of its lines")
    line = (
        np.frombuffer(packed[b"data"], packed[b"dtype"])
        .reshape(packed[b"shape"])
        .astype(np.float64)
    )
    if (
        line.ndim != 2
        or line.shape[1] not in (2, 3)
        or len(line) < 2
        or not np.isfinite(line).all()
    ):
        raise ValueError(
            f"a line of a lane has the shape {list(line.shape)}, expected two or more finite points"
        )
    return line

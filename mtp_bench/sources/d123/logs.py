"""Logs of 123D as tables of own scenes: true boxes within reach, the ego, and lanes."""

import tomllib
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import Bools, DataError, Floats, Ints, file_stem, new_folder, wrap_angle
from ..argoverse2.source import first_frames
from ..files.columns import BOX_COLUMNS, PERIOD_TOLERANCE
from ..files.pictures import lane_columns
from ..files.save import Columns
from ..readers import write_table
from ..rotation import require_rotations, yaw_of
from ..tables import refuse
from ..text import reading
from .files import FORM, read_arrow, read_lanes

SECOND_US = 1e6
ROUNDING_US = 1  # by which a time of the ego may be off
# age of the last pose from which a frame has none, and is left out
MAX_POSE_AGE_US = 100_000
# over which the velocity of the ego is taken
MOTION_SPAN_US = 50_000
LABELS = Path(__file__).with_name("labels.toml")
BOXES = "box_detections_se3"
SYNC = "sync"
EGO = "ego_state_se3"
# before the class that a label is like: a match with it is neither right nor wrong
NEUTRAL = "neutral "
_BOX_COLUMNS = {
    "timestamp_us": 1,
    "bounding_box_se3": 10,
    "track_token": 0,
    "label": 1,
    "num_lidar_points": 1,
}


def import_logs(
    source: Path,
    folder: Path,
    rate_hz: float,
    reach_m: float,
    report_done: Callable[[str], object] = lambda _: None,
) -> Counter[str]:
    """Write the log, or the logs of a split, as scenes into ``folder``.

    ``source``: their folder. ``reach_m``: from the ego, within which objects are true.
    ``report_done`` gets the name of each written log. Returns the numbers of "logs", of
    rows of "truth" and "ego", and of "lanes". Raises DataError for a log that is wrong,
    and MtpBenchError if ``folder`` is not empty; it then writes no file.
    """
    counts = Counter[str]()
    logs = _log_folders(source.expanduser().absolute())
    with new_folder(folder.expanduser().absolute()) as part_folder:
        for log in logs:
            scene_folder = part_folder / file_stem(log.name)
            scene_folder.mkdir()
            with reading(log, FORM):
                tables = log_tables(log, rate_hz, reach_m)
            for name, columns in tables.items():
                write_table(scene_folder / f"{name}.parquet", columns)
            counts["logs"] += 1
            counts["truth"] += len(tables["truth"]["frame"])
            counts["ego"] += len(tables["ego"]["frame"])
            if "lanes" in tables:
                counts["lanes"] += len(np.unique(tables["lanes"]["lane"]))
            report_done(log.name)
    return counts


def _log_folders(source: Path) -> list[Path]:
    """Return the folders of the log, or of the logs, in ``source``."""
    if (source / f"{BOXES}.arrow").exists():
        return [source]
    logs = sorted(path.parent for path in source.glob(f"*/{BOXES}.arrow"))
    if not logs:
        expected = "expected a log of 123D, or a folder of logs such as a split"
        paths = source.glob(f"*/*/{BOXES}.arrow")
        splits = sorted({path.parents[1].name for path in paths})
        if splits:
            expected += f"; logs are in {', '.join(splits)}: name one"
        raise DataError(f"{source} has no {BOXES}.arrow, {expected}")
    return logs


def log_tables(log: Path, rate_hz: float, reach_m: float) -> dict[str, Columns]:
    """Return the tables of a log by name.

    Raises DataError for a log that is wrong.
    """
    _, log_metadata = read_arrow(log / f"{SYNC}.arrow", {})
    if "interpolated" in str(log_metadata.get("split")):
        raise DataError(
            f"{log} is of the split {log_metadata['split']!r}, whose boxes between "
            "keyframes show the next keyframe; convert the split without interpolation"
        )
    path = log / f"{BOXES}.arrow"
    boxes, box_metadata = read_arrow(path, _BOX_COLUMNS, f"{BOXES}.")
    time = boxes["timestamp_us"][:, 0]
    if not (np.diff(time) > 0).all():
        raise DataError(
            f"{path}: the times of its rows do not increase, expected one row per frame"
        )
    ego, has_pose, origin = _read_poses(log / f"{EGO}.arrow", time)
    rows = np.flatnonzero(has_pose)[:: _stride(log, time, rate_hz)]
    ego = ego[rows]
    labels = _read_labels(path, box_metadata, boxes["label"][:, 0])
    time_s = (time[rows] - time[rows[0]]) / SECOND_US
    pose = dict(zip(("x", "y", "z", "yaw"), ego.T, strict=True))
    tables = {
        "truth": _truth(boxes, labels, rows, ego, origin, reach_m),
        "ego": {"frame": np.arange(len(rows)), "time": time_s, **pose},
    }
    map_path = log / "map.arrow"
    if not map_path.exists():  # some datasets have a map for each city
        dataset = log_metadata.get("dataset")
        city_map = f"maps/{dataset}/{dataset}_{log_metadata.get('location')}.arrow"
        map_path = log.parent.parent.parent / city_map  # logs/<split>/<log>
    if map_path.exists():
        lanes = read_lanes(map_path, ego[:, :2], origin)
        if lanes:
            tables["lanes"] = lane_columns(lanes)
    return tables


def _stride(log: Path, time: Floats, rate_hz: float) -> int:
    """Return the n for which every n-th frame of a log gives the rate.

    ``time`` [F] us. Raises DataError for another rate.
    """
    if len(time) < 2:
        return 1
    log_rate_hz = SECOND_US / float(np.median(np.diff(time)))
    stride = max(1, round(log_rate_hz / rate_hz))
    if not abs(log_rate_hz / stride / rate_hz - 1) <= PERIOD_TOLERANCE:
        raise DataError(
            f"{log} has {log_rate_hz:.3g} frames per second: expected a rate that "
            "every n-th of them gives"
        )
    return stride


def _truth(
    boxes: Columns,
    labels: NDArray[np.str_],
    chosen_rows: Ints,
    ego: Floats,
    origin: Floats,
    reach_m: float,
) -> Columns:
    """Return the table of the boxes in the frames ``chosen_rows`` [C].

    ``origin`` [3] is subtracted; ``labels`` [R], ``ego`` [C, 4]. An object is true from
    the frame on in which it is within reach of the ego for the first time, and neutral
    where it is farther away later.
    """
    is_used = np.isin(boxes["row"], chosen_rows) & (labels != "skipped")
    labels = labels[is_used]
    frame = np.searchsorted(chosen_rows, boxes["row"][is_used])
    object_ids = boxes["track_token"][is_used].astype(np.str_)
    place, rotation, size = np.split(boxes["bounding_box_se3"][is_used], [3, 7], axis=1)
    box = np.column_stack([place - origin, yaw_of(rotation), size])
    distance_m = np.linalg.norm(box[:, :2] - ego[frame, :2], axis=1)
    within_reach = distance_m <= reach_m
    without_points = boxes["num_lidar_points"][is_used, 0] == 0
    # lists, since functions of texts fail for an array without rows
    classes = [label.removeprefix(NEUTRAL) for label in labels.tolist()]
    is_marked = np.array(classes, dtype=np.str_) != labels
    neutral = is_marked | without_points | ~within_reach
    columns = {
        "frame": frame,
        "id": object_ids,
        "class": np.array(classes, dtype=np.str_),
        **dict(zip(BOX_COLUMNS, box.T, strict=True)),
        "neutral": neutral.astype(np.int64),
    }
    object_number = np.unique(object_ids, return_inverse=True)[1]
    first_frame = first_frames(frame, object_number, within_reach, len(chosen_rows))
    return {name: values[frame >= first_frame] for name, values in columns.items()}


def _read_poses(path: Path, time: Floats) -> tuple[Floats, Bools, Floats]:
    """Return poses x y z yaw [F, 4] of the ego at ``time`` [F] us.

    Also returns a mask [F] of the frames that have a pose, and the origin [3]. A pose
    is the one of that time, else the last one before it, moved on with the velocity
    until then: no later one is used. The origin is the first pose in whole metres, and
    is subtracted.
    """
    pose_columns, _ = read_arrow(path, {"timestamp_us": 1, "imu_se3": 7}, f"{EGO}.")
    pose_order = np.argsort(pose_columns["timestamp_us"][:, 0], kind="stable")
    pose_time = pose_columns["timestamp_us"][pose_order, 0]
    pose = pose_columns["imu_se3"][pose_order]
    require_rotations(pose[:, 3:], lambda row: f"{path}, pose {row + 1}")
    last_pose = np.searchsorted(pose_time, time + ROUNDING_US, "right") - 1
    has_pose = last_pose >= 0
    age_us = np.zeros(len(time))
    if len(pose):
        age_us = time - pose_time[last_pose]
        has_pose &= age_us <= MAX_POSE_AGE_US
    if not has_pose.any():
        raise DataError(
            f"{path}: no frame of the boxes has a pose of the "
            f"{MAX_POSE_AGE_US / SECOND_US:g} s before it"
        )
    origin = np.round(pose[0, :3])
    yaw = np.unwrap(yaw_of(pose[:, 3:]))
    pose_state = np.column_stack([pose[:, :3] - origin, yaw])
    span_start = pose_time[last_pose] - MOTION_SPAN_US
    earlier_pose = np.maximum(np.searchsorted(pose_time, span_start, "right") - 1, 0)
    span_us = np.maximum(pose_time[last_pose] - pose_time[earlier_pose], 1.0)
    motion_share = np.where(age_us > ROUNDING_US, age_us, 0.0) / span_us
    ego = pose_state[last_pose] + motion_share[:, None] * (
        pose_state[last_pose] - pose_state[earlier_pose]
    )
    ego[:, 3] = wrap_angle(ego[:, 3])
    return ego, has_pose, origin


def _read_labels(
    path: Path, metadata: Mapping[str, Any], label_numbers: Floats
) -> NDArray[np.str_]:
    """Return a class, `NEUTRAL` and a class, or "skipped" [R] for numbers of labels.

    The metadata names their registry.
    """
    registry_name = str(metadata.get("box_detection_label_class"))
    registry = registry_name.rsplit(".", maxsplit=1)[-1]
    registries: dict[str, dict[str, str]] = tomllib.loads(
        LABELS.read_text(encoding="utf-8")
    )
    if registry not in registries:
        raise DataError(
            f"{path}: unknown labels {registry!r}, expected one of "
            f"{', '.join(registries)}"
        )
    label_of_number = {
        float(number): word for number, word in registries[registry].items()
    }
    refuse(
        ~np.isin(label_numbers, list(label_of_number)),
        lambda row: f"{path}: {registry} has no label {label_numbers[row]:g}",
    )
    return np.array(
        [label_of_number[number] for number in label_numbers.tolist()], dtype=np.str_
    )

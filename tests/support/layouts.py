"""Writers of valid files for the layout of each dataset.

Writers share nothing with the readers: rotations are those of scipy, and axes and columns are stated here again.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa
from pyarrow import feather
from scipy.spatial.transform import Rotation

from mtp_bench.cards import Card, load_card, parse_card, with_detector, with_files
from mtp_bench.core import Floats, Scene
from mtp_bench.sources import open_source
from mtp_bench.sources.d123.logs import import_logs
from tests.support.drawn_recordings import Layout, Recording, Row, small_recording
from tests.support.nuscenes_root import (
    DETECTIONS,
    box_fields,
    detection,
    nuscenes_card,
    sample,
    write_json,
    write_scenes,
)
from tests.support.small_scenes import write_card
from tests.support.source_files import card_of, with_source, with_task, write

CITY = np.array([1000.0, 2000.0, 50.0])  # where the scene of a city begins: whole metres
Columns = dict[str, Any]


def to_ego(row: Row, recording: Recording) -> tuple[Floats, Rotation]:
    """The centre of a box and its rotation in the frame of the ego."""
    back = recording.turn[row.frame].inv()
    return back.apply(row.box[:3] - recording.pose[row.frame, :3]), back * Rotation.from_euler("z", row.box[3])


# ---- KITTI: axes of the camera are right, down, forward; the camera is 1.5 m ahead of the GPS/IMU unit
KITTI_PERIOD = 0.1036
CODES = {"Car": 2, "Pedestrian": 1, "Cyclist": 3}
SENSOR_OF_CAMERA = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
CALIBRATION = """\
P2: 707 0 600 0 0 707 180 0 0 0 1 0
R_rect 1 0 0 0 1 0 0 0 1
Tr_velo_cam 0 -1 0 0 0 0 -1 0 1 0 0 0
Tr_imu_velo 1 0 0 -1.5 0 1 0 0 0 0 1 0
"""


def write_kitti(data: Path, recording: Recording, own_frames: bool = False, odometry: bool = False) -> Path:
    folder, frames = data / "kitti_tracking", len(recording.time)
    turn, place = recording.turn, recording.pose[:, :3]

    def fields(row: Row) -> list[float]:
        x, y, z, yaw, l, w, h = row.box
        if not own_frames:  # the heading in the sensor frame is the one whose shadow in the world is that of the box
            x, y, z = to_ego(row, recording)[0]
            shadow = np.linalg.solve(turn.as_matrix()[row.frame, :2, :2], [np.cos(yaw), np.sin(yaw)])
            yaw = np.arctan2(shadow[1], shadow[0])
        return [float(number) for number in (h, w, l, -y, h / 2 - z, x, -yaw - np.pi / 2)]

    write(folder / "evaluate_tracking.seqmap.val", f"0000 empty 000000 {frames:06d}")
    labels = [
        " ".join(map(str, [row.frame, row.name, row.kind, 0, 1, -1.5, 10, 20, 30, 40, *fields(row)]))
        for row in recording.truth
    ]
    write(folder / "training/label_02/0000.txt", *labels)
    for kind, code in CODES.items():
        rows = [row for row in recording.detections if row.kind == kind]
        lines = [",".join(map(str, [row.frame, code, 10, 20, 30, 40, row.score, *fields(row), -1.5])) for row in rows]
        write(folder / f"detections/pointrcnn/{kind}/0000.txt", *lines)
    write(folder / "training/calib/0000.txt", CALIBRATION)
    angle, north = recording.pose[:, [5, 4, 3]] + [0, 0, 0.7], Rotation.from_euler("z", 0.7)
    velocity = np.zeros((frames, 3))
    if odometry:  # the unit stands; camera poses are those since the first one
        angle[:] = angle[0]
        turns = SENSOR_OF_CAMERA.T @ (turn[0].inv() * turn).as_matrix() @ SENSOR_OF_CAMERA
        path = turn[0].inv().apply(place) @ SENSOR_OF_CAMERA
        poses = np.concatenate([turns, path[:, :, None]], axis=2).reshape(frames, 12).tolist()
        write(folder / "poses_orbslam3/0000.txt", *(" ".join(map(repr, pose)) for pose in poses))
    else:
        path = north.apply(place - turn.apply([1.5, 0, 0]))
        for t in range(1, frames):  # the mean of two velocities leads from one place to the next
            velocity[t] = 2 * (path[t] - path[t - 1]) / KITTI_PERIOD - velocity[t - 1]
    oxts = [
        [49, 8.4, 110, *angles, north_mps, east_mps, 0, 0, up_mps, *[0] * 19]
        for angles, (east_mps, north_mps, up_mps) in zip(angle.tolist(), velocity.tolist(), strict=True)
    ]
    write(folder / "training/oxts/0000.txt", *(" ".join(map(repr, row)) for row in oxts))
    return folder


def kitti_card(classes: tuple[str, ...] = ("car", "pedestrian", "cyclist"), **source: Any) -> Card:
    return card_of("MTP-KITTI-v0", classes, 10 / source.get("stride", 1), **source)


KITTI = Layout(
    write_kitti, lambda _: kitti_card(), "0000",
    {"Car": ("car", False), "Van": ("car", True), "Pedestrian": ("pedestrian", False), "Tram": ("", False),
     "Person_sitting": ("pedestrian", True), "Cyclist": ("cyclist", False)},
    KITTI_PERIOD, level=True, marks_unseen=False, detector="pointrcnn", ahead=True, neutral_targets=False,
)  # fmt: skip


# ---- nuScenes
def write_nuscenes(data: Path, recording: Recording) -> Path:
    write_scenes(data, {"scene-0003": recording})
    results: dict[str, list[Columns]] = {sample("scene-0003", t): [] for t in range(len(recording.time))}
    for row in recording.detections:
        token, name = sample("scene-0003", row.frame), NUSCENES.kinds[row.kind][0]
        results[token].append(detection(token, name, detection_score=row.score, **box_fields(row)))
    write_json(data / DETECTIONS, {"meta": {}, "results": results})
    return data / "nuscenes"


NUSCENES = Layout(
    write_nuscenes, lambda _: nuscenes_card(), "scene-0003",
    {"vehicle.car": ("car", False), "vehicle.emergency.police": ("car", True), "animal": ("", False),
     "human.pedestrian.child": ("pedestrian", False)},
    0.5, jitter=0.1, detector="megvii",
)  # fmt: skip


# ---- Argoverse 2
POSE = ("qx", "qy", "qz", "qw", "tx_m", "ty_m", "tz_m")
STAMP = 315_966_070_000_000_001  # ns
AV2_CARD = load_card("MTP-AV2-10Hz-v0")  # past and future: 10 frames


def write_feather(path: Path, columns: Columns) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    feather.write_feather(pa.table(columns), str(path))
    return path


def stamps(recording: Recording) -> Any:
    return STAMP + np.round(1e9 * recording.time).astype(np.int64)


def av2_columns(rows: list[Row], recording: Recording) -> Columns:
    """Columns of boxes, each in the ego frame of its sweep."""
    poses = [to_ego(row, recording) for row in rows]
    cells = np.array([[*turn.as_quat(), *place] for place, turn in poses]).reshape(-1, 7)
    sizes = np.array([row.box[4:] for row in rows]).reshape(-1, 3)
    return {
        "timestamp_ns": stamps(recording)[[row.frame for row in rows]],
        "category": pa.array([row.kind for row in rows], pa.string()),
        **dict(zip(POSE, cells.T, strict=True)),
        **dict(zip(("length_m", "width_m", "height_m"), sizes.T, strict=True)),
    }


def write_argoverse2(data: Path, recording: Recording) -> Path:
    folder = data / "argoverse2/sensor/val/a-log"
    own = {
        "track_uuid": [str(row.name) for row in recording.truth],
        "num_interior_pts": [int(row.seen) for row in recording.truth],
    }
    write_feather(folder / "annotations.feather", av2_columns(recording.truth, recording) | own)
    turn, place = recording.turn.as_quat(), recording.pose[:, :3] + CITY
    pose = np.hstack([np.tile(turn, (2, 1)), np.vstack([place, place + 1])])  # a second clock is late, and elsewhere
    time = np.append(stamps(recording), stamps(recording) + 1)
    poses = {"timestamp_ns": time, **dict(zip(POSE, pose.T, strict=True))}
    write_feather(folder / "city_SE3_egovehicle.feather", poses)
    stored = recording.detections
    own = {"log_id": ["a-log"] * len(stored), "score": [row.score for row in stored]}
    write_feather(data / "argoverse2/detections/mine.feather", av2_columns(stored, recording) | own)
    return data / "argoverse2"


ARGOVERSE2 = Layout(
    write_argoverse2, lambda _: AV2_CARD, "a-log",
    {"REGULAR_VEHICLE": ("car", False), "BICYCLIST": ("bicycle", True), "SCHOOL_BUS": ("bus", False),
     "DOG": ("", False)},
    0.1, jitter=0.01, least=1, detector="mine",
)  # fmt: skip


# ---- 123D, whose logs become own scenes
def write_log(folder: Path, tables: Mapping[str, tuple[Columns, Columns]]) -> Path:
    """Columns and metadata by name of the file."""
    folder.mkdir(parents=True)
    for name, (columns, metadata) in tables.items():
        prefix = "" if name == "map" else f"{name}."
        kinds = {"bounding_box_se3": pa.list_(pa.list_(pa.float64(), 10)), "imu_se3": pa.list_(pa.float64(), 7)}
        table = pa.table({prefix + key: pa.array(column, kinds.get(key)) for key, column in columns.items() if column})
        table = table.replace_schema_metadata({"metadata": msgspec.msgpack.encode(metadata)})
        with pa.ipc.new_file(folder / f"{name}.arrow", table.schema) as file:
            file.write(table)
    return folder


def d123_tables(recording: Recording) -> dict[str, tuple[Columns, Columns]]:
    time = [1_700_000_000_000_000 + round(1e6 * seconds) for seconds in recording.time]
    frames = [recording.of(t) for t in range(len(time))]

    def values(cell: Callable[[Row], Any]) -> list[list[Any]]:
        return [[cell(row) for row in rows] for rows in frames]

    def pose_and_size(row: Row) -> list[float]:
        rotation = np.roll(Rotation.from_euler("z", row.box[3]).as_quat(), 1)
        return [*(row.box[:3] + CITY).tolist(), *rotation.tolist(), *row.box[4:].tolist()]

    boxes = {
        "timestamp_us": time, "bounding_box_se3": values(pose_and_size),
        "track_token": values(lambda row: str(row.name)), "label": values(lambda row: int(row.kind)),
        "num_lidar_points": values(lambda row: int(row.seen)),
    }  # fmt: skip
    pose = np.hstack([recording.pose[:, :3] + CITY, np.roll(recording.turn.as_quat(), 1, axis=1)])
    labels = {"box_detection_label_class": "py123d.parser.registry.WODPerceptionBoxDetectionLabel"}
    return {
        "sync": ({"uuid": ["a"]}, {"split": "made_up", "dataset": "made", "location": "up"}),
        "box_detections_se3": (boxes, labels),
        "ego_state_se3": ({"timestamp_us": time, "imu_se3": pose.tolist()}, {}),
    }  # fmt: skip


def write_d123(data: Path, recording: Recording) -> Path:
    import_logs(write_log(data / "split/one", d123_tables(recording)), data / "own", 10, 60)
    return data


def d123_card(data: Path) -> Card:
    return with_detector(with_files(load_card(write_card(data)), data / "own"), "kitti_pointrcnn")


D123 = Layout(
    write_d123, d123_card, "one", {"1": ("car", False), "2": ("pedestrian", False), "3": ("", False)}, 0.1, jitter=0.01
)


# ---- people on the ground plane
def mot3d_card(task: Columns | None = None, detector: Columns | None = None, **source: Any) -> Card:
    """Two past and one future frames, scenes of four frames, the first of them for training."""
    content = load_card("MTP-PETS-v0").model_dump(mode="json")
    content["source"] = {"name": "mot3d", "sequence": "TUD-Stadtmitte", "scene_frames": 4, "train_scenes": 1} | source
    content["task"] |= {"rate": 5.0 / content["source"].get("stride", 1), "past": 2, "future": 1} | (task or {})
    content["detector"] = detector
    return parse_card(content)


def write_mot3d(data: Path, recording: Recording) -> Path:
    folder = data / "mot3d2015/train/TUD-Stadtmitte"
    lines: dict[str, list[str]] = {"gt": [], "det": []}
    for file, rows in (("gt", recording.truth), ("det", recording.detections)):
        for row in rows:
            confidence, name = (int(row.seen), row.name) if file == "gt" else (row.score, -1)
            lines[file].append(f"{row.frame + 1},{name},10,20,30,40,{confidence},{row.box[0]},{row.box[1]},0")
        write(folder / file / f"{file}.txt", *lines[file])
    write(
        folder / "seqinfo.ini", "[Sequence]", "name=TUD-Stadtmitte", "frameRate=5", f"seqLength={len(recording.time)}"
    )
    return data / "mot3d2015"


PEOPLE_KINDS = {"": ("pedestrian", False)}
MOT3D = Layout(
    write_mot3d, lambda _: mot3d_card(scene_frames=9, train_scenes=0), "TUD-Stadtmitte-0001", PEOPLE_KINDS, 0.2,
    people=True, detector="acf", neutral_targets=False,
)  # fmt: skip


def people_card(split: str = "val") -> Card:
    """Two past and one future frames."""
    content = load_card("MTP-ETH-UCY-v0").model_dump(mode="json")
    return parse_card(
        {**content, "task": content["task"] | {"past": 2, "future": 1}, "source": content["source"] | {"split": split}}
    )


def write_people(data: Path, recording: Recording) -> Path:
    lines = [f"{10 * row.frame}.0\t{row.name}.0\t{row.box[0]}\t{row.box[1]}" for row in recording.truth]
    write(data / "eth_ucy/biwi_eth.txt", *lines)
    return data / "eth_ucy"


PEOPLE = Layout(
    write_people, lambda _: people_card("eth"), "biwi_eth-00000", PEOPLE_KINDS, 0.4, people=True, least=1,
    marks_unseen=False,
)  # fmt: skip


def person(identity: Any, position: Any, **views: Any) -> Columns:
    unseen = [{"viewNum": v, "xmin": -1, "ymin": -1, "xmax": -1, "ymax": -1} for v in range(7)]
    return {"personID": identity, "positionID": position, "views": unseen, **views}


def write_wildtrack(data: Path, recording: Recording) -> Path:
    """The scene of the last 40 frames, the first ones of which have people."""
    folder = data / "wildtrack"

    def cell(row: Row) -> list[int]:
        return [round((row.box[0] + 3) / 0.025), round((row.box[1] + 9) / 0.025)]

    for t in range(40):
        people = [person(row.name, cell(row)[0] + 480 * cell(row)[1]) for row in recording.of(t)]
        write(folder / f"annotations_positions/{1800 + 5 * t:08d}.json", json.dumps(people))
    lines = [" ".join(map(str, [1800 + 5 * row.frame, *cell(row)])) for row in recording.detections]
    write(folder / "detections/mvdet_test.txt", *lines)
    return folder


WILDTRACK = Layout(
    write_wildtrack, lambda _: with_source("MTP-WILDTRACK-v0", split="test"), "wildtrack-1800", PEOPLE_KINDS, 0.5,
    people=True, marks_unseen=False, detector="mvdet", scored=False,
)  # fmt: skip

LAYOUTS = {
    "KITTI": KITTI,
    "KITTI, odometry": replace(
        KITTI, write=lambda data, recording: write_kitti(data, recording, odometry=True),
        card=lambda _: kitti_card(("cyclist", "car")),
    ),
    "KITTI, own frames": replace(
        KITTI, write=lambda data, recording: write_kitti(data, recording, own_frames=True), own_frames=True,
        card=lambda _: kitti_card(ego_motion=False, stride=2), stride=2,
    ),
    "nuScenes": NUSCENES,
    "Argoverse 2": ARGOVERSE2,
    "Argoverse 2, 5 Hz": replace(
        ARGOVERSE2, card=lambda _: with_task(with_source(AV2_CARD.id, stride=2), rate=5.0), stride=2,
    ),
    "123D": D123,
    "3DMOT2015": MOT3D,
    "3DMOT2015, 2.5 Hz": replace(
        MOT3D, card=lambda _: mot3d_card(scene_frames=9, train_scenes=0, stride=2), stride=2
    ),
    "ETH/UCY": PEOPLE,
    "WILDTRACK": WILDTRACK,
}  # fmt: skip


def small_root(name: str, folder: Path) -> tuple[Path, Callable[[], Scene]]:
    """The root of a small recording, and a function that reads it."""
    layout = LAYOUTS[name]
    root, card = layout.write(folder, small_recording(layout)), layout.card(folder)
    return root, lambda: open_source(card, root).load(layout.scene)

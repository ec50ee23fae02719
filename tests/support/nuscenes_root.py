"""A nuScenes data root of three scenes, small enough to think through.

``scene-0001`` is in the split train_val, ``scene-0301`` in train, ``scene-0003`` in val. Each has four keyframes at 0,
0.5, 0.9 and 1.5 s. The ego drives along y at 4 m/s. Objects of a scene, with their x, y:

car      frames 0 1 2 3            heads along y, (10, 0) (10, 2) (10, 4) (10, 7)
walker   frames 0 1 3              stands at (5, 5): a gap, ``next`` jumps
police   frames 0 1                stands at (-5, 5)
dog      frame 2                   an animal, not used
"""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from mtp_bench.cards import Card
from mtp_bench.core import Scene
from mtp_bench.sources import open_source
from tests.support.drawn_recordings import Recording, Row
from tests.support.source_files import card_of

VERSION = "v1.0-mini"
PREDICTION = "nuscenes/maps/prediction/prediction_scenes.json"
DETECTIONS = "nuscenes/detections/megvii_all.json"
SCENES = ("scene-0301", "scene-0001", "scene-0003")  # in the order of the table
TIMES = (0.0, 0.5, 0.9, 1.5)  # s
CAR_Y = (0.0, 2.0, 4.0, 7.0)
LEFT = [0.7071, 0.0, 0.0, 0.7071]  # heading along y, as four digits give it
MOUNT = {"translation": [0.0, 0.0, 0.0], "rotation": [1.0, 0.0, 0.0, 0.0], "camera_intrinsic": []}

Record = dict[str, Any]
Tables = dict[str, list[Record]]


def sample(scene: str, frame: int) -> str:
    return f"{scene}-t{frame}"


def small_scene() -> Recording:
    """The objects above; the ego is 0.5 m above the ground."""
    places = [
        *((t, "car", "vehicle.car", [10, CAR_Y[t], 1, np.pi / 2, 4, 2, 1.5]) for t in range(4)),
        *((t, "walker", "human.pedestrian.adult", [5, 5, 1, 0, 0.6, 0.5, 1.8]) for t in (0, 1, 3)),
        *((t, "police", "vehicle.emergency.police", [-5, 5, 1, np.pi / 2, 5, 2, 1.5]) for t in (0, 1)),
        (2, "dog", "animal", [0, 9, 0.5, 0, 0.8, 0.3, 0.5]),
    ]
    truth = [Row(t, name, kind, np.array(box, dtype=float)) for t, name, kind, box in places]
    pose = np.array([[0, 4 * seconds, 0.5, np.pi / 2, 0, 0] for seconds in TIMES])
    return Recording(np.array(TIMES), pose, truth, [])


def make_tables(recordings: Mapping[str, Recording]) -> Tables:
    """The tables as lists of records; camera keyframes and sweeps come before the ones that count."""
    tables: Tables = {
        "sensor": [{"token": "lidar", "channel": "LIDAR_TOP"}, {"token": "cam", "channel": "CAM_FRONT"}],
        "calibrated_sensor": [
            {"token": "lidar-1", "sensor_token": "lidar", **MOUNT}, {"token": "cam-1", "sensor_token": "cam", **MOUNT}],
    }  # fmt: skip
    for name in ("scene", "sample", "sample_data", "ego_pose", "instance", "sample_annotation"):
        tables[name] = []
    kinds = {row.kind for recording in recordings.values() for row in recording.truth}
    tables["category"] = [{"token": kind, "name": kind} for kind in sorted(kinds)]
    for index, (scene, recording) in enumerate(recordings.items()):
        _add_scene(tables, scene, 1_500_000_000_000_000 + index * 100_000_000, recording)
    return tables


def _add_scene(tables: Tables, scene: str, start: int, recording: Recording) -> None:
    tables["scene"].append({"token": f"{scene}-token", "name": scene})
    for t, seconds in enumerate(recording.time.tolist()):
        tables["sample"].append(
            {"token": sample(scene, t), "timestamp": start + round(seconds * 1e6), "scene_token": f"{scene}-token"}
        )
        for sensor, key_frame, pose in (("cam-1", True, "far"), ("lidar-1", False, "far"), ("lidar-1", True, "pose")):
            tables["sample_data"].append(
                {
                    "token": f"{scene}-{sensor}-{key_frame}-{t}", "sample_token": sample(scene, t),
                    "calibrated_sensor_token": sensor, "is_key_frame": key_frame,
                    "ego_pose_token": f"{scene}-{pose}-{t}", "filename": "", "width": 0, "height": 0,
                }
            )  # fmt: skip
        place, rotation = recording.pose[t, :3], np.roll(recording.turn[t].as_quat(), 1)
        rotation *= (-1) ** t  # either sign is the same rotation
        for pose, at in (("far", place + 1e6), ("pose", place)):
            tables["ego_pose"].append(
                {"token": f"{scene}-{pose}-{t}", "translation": at.tolist(), "rotation": rotation.tolist()}
            )
    kinds = {row.name: row.kind for row in recording.truth}
    tables["instance"] += [{"token": f"{scene}-{name}", "category_token": kind} for name, kind in kinds.items()]
    tables["sample_annotation"] += [
        {
            "token": f"{scene}-{row.name}-t{row.frame}", "sample_token": sample(scene, row.frame),
            "instance_token": f"{scene}-{row.name}", "num_lidar_pts": 0, "num_radar_pts": int(row.seen),
            **box_fields(row),
        }
        for row in recording.truth
    ]  # fmt: skip


def box_fields(row: Row) -> Record:
    x, y, z, yaw, l, w, h = row.box.tolist()
    return {"translation": [x, y, z], "size": [w, l, h], "rotation": [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]}


def make_targets(scenes: tuple[str, ...] = SCENES) -> dict[str, list[str]]:
    """The list of prediction targets: the car in frames 1 and 2, the police car in frame 0; and a scene elsewhere."""
    targets = {
        scene: [
            f"{scene}-car_{sample(scene, 1)}", f"{scene}-car_{sample(scene, 2)}", f"{scene}-police_{sample(scene, 0)}"
        ]
        for scene in scenes
    }  # fmt: skip
    return {**targets, "scene-0999": ["other_tokens"]}


def detection(token: str, name: str = "car", x: float = 10.0, **changes: Any) -> Record:
    return {
        "sample_token": token, "translation": [x, 1.0, 1.0], "size": [2.0, 4.0, 1.5], "rotation": LEFT,
        "velocity": [0.0, 0.0], "detection_name": name, "detection_score": 0.5, "attribute_name": "", **changes,
    }  # fmt: skip


def write_detections(path: Path, scenes: tuple[str, ...] = SCENES, frames: int = 4) -> None:
    """Write a submission: a walker, a car and a cone in each sample, nothing in the last one of a scene."""
    results = {
        sample(scene, t): [detection(sample(scene, t), name) for name in ("pedestrian", "car", "traffic_cone")]
        if t < 3
        else []
        for scene in scenes
        for t in range(frames)
    }
    write_json(path, {"meta": {"use_lidar": True}, "results": results})


def write_json(path: Path, content: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=1), encoding="utf-8")


@contextmanager
def edited(path: Path) -> Iterator[Any]:
    """The content of a file of the root, which is written again with its changes."""
    content = json.loads(path.read_text(encoding="utf-8"))
    yield content
    write_json(path, content)


def write_scenes(data: Path, recordings: Mapping[str, Recording]) -> None:
    for name, records in make_tables(recordings).items():
        write_json(data / "nuscenes" / VERSION / f"{name}.json", records)


def write_root(data: Path, scenes: tuple[str, ...] = SCENES) -> Path:
    write_scenes(data, dict.fromkeys(scenes, small_scene()))
    write_json(data / PREDICTION, make_targets(scenes))
    write_detections(data / DETECTIONS, scenes)
    return data


def nuscenes_card(classes: tuple[str, ...] = ("car", "pedestrian"), rate: float = 2.0, **source: Any) -> Card:
    """A card of the small root: every box of all scenes unless ``source`` says otherwise."""
    every = {"version": VERSION, "split": "all", "truth": "all", **source}
    return card_of("MTP-nuScenes-mini-v0", classes, rate, **every)


def scene(data: Path, name: str = "scene-0003", **source: Any) -> Scene:
    return open_source(nuscenes_card(**source), data).load(name)

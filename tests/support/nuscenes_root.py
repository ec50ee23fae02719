"""A nuScenes data root of three scenes, small enough to think through.

``scene-0001`` is in the split train_val, ``scene-0301`` in train, ``scene-0003`` in val. Each has four keyframes at 0,
0.5, 0.9 and 1.5 s. The ego drives along y at 4 m/s. Objects of a scene, with their x, y:

car      frames 0 1 2 3            heads along y, (10, 0) (10, 2) (10, 4) (10, 7)
walker   frames 0 1 3              stands at (5, 5): a gap, ``next`` jumps
police   frames 0 1                stands at (-5, 5)
dog      frame 2                   an animal, not used
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mtp_bench.cards import Card
from mtp_bench.core import Scene
from mtp_bench.sources import open_source
from tests.support.source_files import card_of

VERSION = "v1.0-mini"
PREDICTION = "nuscenes/maps/prediction/prediction_scenes.json"
DETECTIONS = "nuscenes/detections/megvii_all.json"
SCENES = ("scene-0301", "scene-0001", "scene-0003")  # in the order of the table
TIMES = (0.0, 0.5, 0.9, 1.5)  # s
CAR_Y = (0.0, 2.0, 4.0, 7.0)
LEFT = [0.7071, 0.0, 0.0, 0.7071]  # heading along y, as four digits give it
AHEAD = [1.0, 0.0, 0.0, 0.0]
MOUNT = {"translation": [0.0, 0.0, 0.0], "rotation": AHEAD, "camera_intrinsic": []}
CATEGORIES = {
    "car": "vehicle.car", "walker": "human.pedestrian.adult", "police": "vehicle.emergency.police", "dog": "animal",
}  # fmt: skip

Record = dict[str, Any]
Tables = dict[str, list[Record]]


def sample(scene: str, frame: int) -> str:
    return f"{scene}-t{frame}"


def object_boxes(scene: str, name: str) -> list[Record]:
    places = {
        "car": [(t, [10.0, CAR_Y[t], 1.0], [2.0, 4.0, 1.5], LEFT) for t in range(4)],
        "walker": [(t, [5.0, 5.0, 1.0], [0.5, 0.6, 1.8], AHEAD) for t in (0, 1, 3)],
        "police": [(t, [-5.0, 5.0, 1.0], [2.0, 5.0, 1.5], LEFT) for t in (0, 1)],
        "dog": [(2, [0.0, 9.0, 0.5], [0.3, 0.8, 0.5], AHEAD)],
    }[name]
    tokens = ["", *(f"{scene}-{name}-t{t}" for t, *_ in places), ""]
    return [
        {
            "token": tokens[i + 1], "sample_token": sample(scene, t), "instance_token": f"{scene}-{name}",
            "translation": place, "size": size, "rotation": rotation, "prev": tokens[i], "next": tokens[i + 2],
        }
        for i, (t, place, size, rotation) in enumerate(places)
    ]  # fmt: skip


def make_tables(scenes: tuple[str, ...] = SCENES) -> Tables:
    """The tables as lists of records; camera keyframes and sweeps come before the ones that count."""
    tables: Tables = {
        "sensor": [{"token": "lidar", "channel": "LIDAR_TOP"}, {"token": "cam", "channel": "CAM_FRONT"}],
        "calibrated_sensor": [
            {"token": "lidar-1", "sensor_token": "lidar", **MOUNT}, {"token": "cam-1", "sensor_token": "cam", **MOUNT}],
        "category": [{"token": key, "name": name} for key, name in CATEGORIES.items()],
    }  # fmt: skip
    for name in ("scene", "sample", "sample_data", "ego_pose", "instance", "sample_annotation"):
        tables[name] = []
    for index, scene in enumerate(scenes):
        _add_scene(tables, scene, 1_500_000_000_000_000 + index * 100_000_000)
    return tables


def _add_scene(tables: Tables, scene: str, start: int) -> None:
    ends = {"first_sample_token": sample(scene, 0), "last_sample_token": sample(scene, 3)}
    tables["scene"].append({"token": f"{scene}-token", "name": scene, "nbr_samples": 4, **ends})
    for t, seconds in enumerate(TIMES):
        tables["sample"].append(
            {
                "token": sample(scene, t), "timestamp": start + round(seconds * 1e6),
                "scene_token": f"{scene}-token", "prev": sample(scene, t - 1) if t else "",
                "next": sample(scene, t + 1) if t < 3 else "",
            }
        )  # fmt: skip
        for sensor, key_frame, pose in (("cam-1", True, "far"), ("lidar-1", False, "far"), ("lidar-1", True, "pose")):
            tables["sample_data"].append(
                {
                    "token": f"{scene}-{sensor}-{key_frame}-{t}", "sample_token": sample(scene, t),
                    "calibrated_sensor_token": sensor, "is_key_frame": key_frame,
                    "ego_pose_token": f"{scene}-{pose}-{t}", "filename": "", "width": 0, "height": 0,
                }
            )  # fmt: skip
        for pose, x in (("far", 1e6), ("pose", 0.0)):
            tables["ego_pose"].append(
                {"token": f"{scene}-{pose}-{t}", "translation": [x, 4 * seconds, 0.5], "rotation": LEFT}
            )
    for name in CATEGORIES:
        boxes = object_boxes(scene, name)
        tables["sample_annotation"] += boxes
        ends = {"first_annotation_token": boxes[0]["token"], "last_annotation_token": boxes[-1]["token"]}
        tables["instance"].append(
            {"token": f"{scene}-{name}", "category_token": name, "nbr_annotations": len(boxes), **ends}
        )


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


def write_root(data: Path, scenes: tuple[str, ...] = SCENES) -> Path:
    for name, records in make_tables(scenes).items():
        write_json(data / "nuscenes" / VERSION / f"{name}.json", records)
    write_json(data / PREDICTION, make_targets(scenes))
    write_detections(data / DETECTIONS, scenes)
    return data


def nuscenes_card(classes: tuple[str, ...] = ("car", "pedestrian"), rate: float = 2.0, **source: Any) -> Card:
    """A card of the small root: every box of all scenes unless ``source`` says otherwise."""
    every = {"version": VERSION, "split": "all", "truth": "all", **source}
    return card_of("MTP-nuScenes-mini-v0", classes, rate, **every)


def scene(data: Path, name: str = "scene-0003", **source: Any) -> Scene:
    return open_source(nuscenes_card(**source), data).load(name)

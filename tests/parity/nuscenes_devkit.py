"""Write what the official nuScenes devkit reads from a data root, as plain arrays; see README.md.

Runs where `nuscenes-devkit` is installed, without mtp_bench:

    python tests/parity/nuscenes_devkit.py DATA_ROOT OUT.npz

Arrays of OUT.npz, each once per version of the tables (``<version>/<name>``):

    scene            [S] names of the scenes, in the order of their table
    sample           [n, 2] scene and frame of each sample
    time             [n] microseconds, time stamp of the sample
    ego              [n, 4] x y z yaw of LIDAR_TOP's ego pose
    truth            [m, 2] scene and frame of each annotation
    truth_box        [m, 7] x y z yaw l w h
    truth_category   [m] category name
    truth_instance   [m] index of the instance in its table
    target           [t, 2] scene and frame of each prediction target, in the order of the official list
    target_instance  [t]
    future           [t, 12, 2] get_future_for_agent over 6 s, NaN past its end
    speed            [t] m/s, get_velocity_for_agent, NaN where there is no earlier annotation
    past             [t, 4, 2] get_past_for_agent over 2 s, the latest first, NaN past its end
    split_<name>     [n, 3] scene, frame and instance of get_prediction_challenge_split, those in the tables
    absent_<name>    number of its targets that are not in the tables
    detections/<file>/{row,box,score,class}   [n, 2] scene and frame, [n, 7], [n], [n]

and once: ``versions``, names and versions of packages; ``challenge/<name>``, the scenes of which
`get_prediction_challenge_split` takes the targets; ``classes``, [n, 2] categories and their detection class.
"""

from __future__ import annotations

import argparse
import json
import platform
import tempfile
from importlib.metadata import version as installed
from pathlib import Path
from typing import Any

import numpy as np
from nuscenes import NuScenes  # type: ignore[import-not-found]
from nuscenes.eval.common.loaders import load_prediction  # type: ignore[import-not-found]
from nuscenes.eval.common.utils import quaternion_yaw  # type: ignore[import-not-found]
from nuscenes.eval.detection.data_classes import DetectionBox  # type: ignore[import-not-found]
from nuscenes.eval.detection.utils import category_to_detection_name  # type: ignore[import-not-found]
from nuscenes.eval.prediction.splits import get_prediction_challenge_split  # type: ignore[import-not-found]
from nuscenes.prediction import PredictHelper  # type: ignore[import-not-found]
from nuscenes.utils.color_map import get_colormap  # type: ignore[import-not-found]
from nuscenes.utils.splits import create_splits_scenes  # type: ignore[import-not-found]
from pyquaternion import Quaternion  # type: ignore[import-not-found]

PREDICTION = "maps/prediction/prediction_scenes.json"
SPLITS = {"v1.0-mini": ("mini_train", "mini_val"), "v1.0-trainval": ("train", "train_val", "val")}
FUTURE_SECONDS, FUTURE_FRAMES = 6, 12
PAST_SECONDS, PAST_FRAMES = 2, 4
MOST_BOXES = 500  # per sample, the limit of the official evaluation

Arrays = dict[str, Any]  # of numpy arrays
Places = dict[str, tuple[int, int]]


def main() -> None:
    """Read every version of the tables under the data root and write the arrays."""
    arguments = argparse.ArgumentParser(description="Export what the nuScenes devkit reads.")
    arguments.add_argument("data_root", type=Path, help="folder that holds nuscenes/, or that folder itself")
    arguments.add_argument("out", type=Path, help="the .npz file to write")
    given = arguments.parse_args()
    root = given.data_root / "nuscenes" if (given.data_root / "nuscenes").is_dir() else given.data_root
    packages = {name: installed(name) for name in ("nuscenes-devkit", "numpy", "pyquaternion", "shapely")}
    out: Arrays = {"versions": np.array([f"python {platform.python_version()}", *map(" ".join, packages.items())])}
    out |= challenge_scenes() | classes()
    for version in SPLITS:
        if (root / version).is_dir():
            part = read_version(root, version)
            out |= {f"{version}/{name}": array for name, array in part.items()}
    np.savez_compressed(given.out, **out)


def challenge_scenes() -> Arrays:
    """Scenes of the splits of the prediction challenge: what it makes of a list with each scene as its own target."""
    names = [scene for scenes in create_splits_scenes().values() for scene in scenes]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / PREDICTION
        path.parent.mkdir(parents=True)
        path.write_text(json.dumps({name: [name] for name in names}))
        splits = [split for several in SPLITS.values() for split in several]
        return {f"challenge/{split}": np.array(get_prediction_challenge_split(split, folder)) for split in splits}


def classes() -> Arrays:
    """Detection class of every category that the devkit knows, empty where there is none."""
    return {"classes": np.array([(name, category_to_detection_name(name) or "") for name in get_colormap()])}


def read_version(root: Path, version: str) -> Arrays:
    """The arrays of one version of the tables."""
    tables = NuScenes(version=version, dataroot=str(root), verbose=False)
    places = sample_places(tables)
    instances = {row["token"]: i for i, row in enumerate(tables.instance)}
    arrays = samples(tables, places) | truth(tables, places, instances) | targets(root, tables, places, instances)
    for split in SPLITS[version]:
        arrays |= challenge_split(root, split, places, instances)
    for path in sorted((root / "detections").glob("*.json")):
        arrays |= detections(path, places)
    return arrays


def sample_places(tables: Any) -> Places:
    """Scene and frame of each sample token; frames follow the chain of samples."""
    places: Places = {}
    for i, scene in enumerate(tables.scene):
        token, frame = scene["first_sample_token"], 0
        while token:
            places[token] = (i, frame)
            token, frame = tables.get("sample", token)["next"], frame + 1
    return places


def samples(tables: Any, places: Places) -> Arrays:
    """Scenes, time stamps and ego poses."""
    ego = np.zeros((len(places), 4))
    time = np.zeros(len(places), dtype=np.int64)
    for n, token in enumerate(places):
        sample = tables.get("sample", token)
        pose = tables.get("ego_pose", tables.get("sample_data", sample["data"]["LIDAR_TOP"])["ego_pose_token"])
        ego[n] = [*pose["translation"], quaternion_yaw(Quaternion(pose["rotation"]))]
        time[n] = sample["timestamp"]
    names = np.array([scene["name"] for scene in tables.scene])
    return {"scene": names, "sample": np.array(list(places.values())), "time": time, "ego": ego}


def truth(tables: Any, places: Places, instances: dict[str, int]) -> Arrays:
    """Annotation boxes, as `NuScenes.get_boxes` gives them for the LIDAR_TOP of each sample."""
    row, box, category, instance = [], [], [], []
    for token, place in places.items():
        for found in tables.get_boxes(tables.get("sample", token)["data"]["LIDAR_TOP"]):
            annotation = tables.get("sample_annotation", found.token)
            width, length, height = found.wlh
            row.append(place)
            box.append([*found.center, quaternion_yaw(found.orientation), length, width, height])
            category.append(annotation["category_name"])
            instance.append(instances[annotation["instance_token"]])
    return {
        "truth": np.array(row),
        "truth_box": np.array(box),
        "truth_category": np.array(category),
        "truth_instance": np.array(instance),
    }


def targets(root: Path, tables: Any, places: Places, instances: dict[str, int]) -> Arrays:
    """Prediction targets of the scenes that the tables have, with the positions that `PredictHelper` gives."""
    listed = json.loads((root / PREDICTION).read_text())
    helper = PredictHelper(tables)
    row, instance, future, past, speed = [], [], [], [], []
    for scene in tables.scene:
        for target in listed.get(scene["name"], []):
            agent, sample = target.split("_")
            row.append(places[sample])
            instance.append(instances[agent])
            ahead = helper.get_future_for_agent(agent, sample, FUTURE_SECONDS, in_agent_frame=False)
            behind = helper.get_past_for_agent(agent, sample, PAST_SECONDS, in_agent_frame=False)
            future.append(padded(ahead, FUTURE_FRAMES))
            past.append(padded(behind, PAST_FRAMES))
            speed.append(helper.get_velocity_for_agent(agent, sample))
    return {
        "target": np.array(row),
        "target_instance": np.array(instance),
        "future": np.array(future),
        "past": np.array(past),
        "speed": np.array(speed, dtype=float),
    }


def padded(positions: np.ndarray[Any, Any], length: int) -> np.ndarray[Any, Any]:
    """Positions [n, 2] with rows of NaN up to ``length`` rows."""
    rows = np.full((length, 2), np.nan)
    rows[: len(positions)] = positions.reshape(-1, 2)
    return rows


def challenge_split(root: Path, split: str, places: Places, instances: dict[str, int]) -> Arrays:
    """Targets of a split of the prediction challenge that are in the tables, and the number of those that are not."""
    present, absent = [], 0
    for target in get_prediction_challenge_split(split, dataroot=str(root)):
        agent, sample = target.split("_")
        if sample in places and agent in instances:
            present.append((*places[sample], instances[agent]))
        else:
            absent += 1
    return {f"split_{split}": np.array(present, dtype=int).reshape(-1, 3), f"absent_{split}": np.array(absent)}


def detections(path: Path, places: Places) -> Arrays:
    """Boxes of a submission file, as `load_prediction` gives them; nothing where no sample is in the tables."""
    boxes, _ = load_prediction(str(path), MOST_BOXES, DetectionBox)
    row, box, score, kind = [], [], [], []
    for token in boxes.sample_tokens:
        if token not in places:
            continue
        for found in boxes[token]:
            width, length, height = found.size
            yaw = quaternion_yaw(Quaternion(found.rotation))
            row.append(places[token])
            box.append([*found.translation, yaw, length, width, height])
            score.append(found.detection_score)
            kind.append(found.detection_name)
    if not row:
        return {}
    parts = {"row": np.array(row), "box": np.array(box), "score": np.array(score), "class": np.array(kind)}
    return {f"detections/{path.stem}/{part}": array for part, array in parts.items()}


if __name__ == "__main__":
    main()

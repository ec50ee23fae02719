"""Write the tables, targets and detections that the official nuScenes devkit reads, as plain arrays; see README.md.

With `nuscenes-devkit`, without mtp_bench: ``python benchmarks/parity/nuscenes_devkit.py DATA_ROOT OUT.npz``. Arrays
come in pairs ``<name>/key`` [n], texts that name each row, and ``<name>/value`` [n, ...]:

    versions                    packages; their versions
    scenes of <split>           scenes of a split of the prediction challenge; no values
    categories                  "<category> <class of the detection task>"; no values
    <version>/samples           tokens; microseconds, x y z yaw of LIDAR_TOP's ego pose
    <version>/boxes             "<sample> <instance> <class>"; x y z yaw l w h; boxes of categories with a class
    <version>/targets           "<sample> <instance>"; future [12, 2] of 6 s and speed in m/s, NaN if unknown
    <version>/targets of <split>  the same of a split of the challenge, those in the tables; no values
    <version>/<detections file>   "<sample> <class> <place in the file>"; x y z yaw l w h and score
"""

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
SPLITS = {
    "v1.0-mini": ("mini_train", "mini_val"),
    "v1.0-trainval": ("train", "train_val", "val"),
}
MOST_BOXES = 500  # per sample, the limit of the official evaluation

Rows = dict[str, Any]  # values by key


def main() -> None:
    """Read every version of the tables under the data root and write the arrays."""
    arguments = argparse.ArgumentParser(
        description="Export the data that the nuScenes devkit reads."
    )
    arguments.add_argument(
        "data_root",
        type=Path,
        help="folder that holds nuscenes/, or that folder itself",
    )
    arguments.add_argument("out", type=Path, help="the .npz file to write")
    given = arguments.parse_args()
    root = (
        given.data_root / "nuscenes"
        if (given.data_root / "nuscenes").is_dir()
        else given.data_root
    )
    packages = {
        name: installed(name)
        for name in ("nuscenes-devkit", "numpy", "pyquaternion", "shapely")
    }
    categories = ((name, category_to_detection_name(name)) for name in get_colormap())
    parts: dict[str, Rows] = {
        "versions": dict.fromkeys(
            [f"python {platform.python_version()}", *map(" ".join, packages.items())], 0
        ),
        "categories": dict.fromkeys(
            [f"{category} {name}" for category, name in categories if name], 0
        ),
        **challenge_scenes(),
    }
    for version in SPLITS:
        if (root / version).is_dir():
            parts |= {
                f"{version}/{name}": rows
                for name, rows in read_version(root, version).items()
            }
    arrays: dict[str, Any] = {
        f"{name}/key": np.array(list(rows), dtype=str) for name, rows in parts.items()
    }
    arrays |= {
        f"{name}/value": np.array(list(rows.values()), dtype=float)
        for name, rows in parts.items()
    }
    np.savez_compressed(given.out, **arrays)


def challenge_scenes() -> dict[str, Rows]:
    """Scenes of the challenge's splits, of a list of targets in which each scene is its own target."""
    names = [scene for scenes in create_splits_scenes().values() for scene in scenes]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / PREDICTION
        path.parent.mkdir(parents=True)
        path.write_text(json.dumps({name: [name] for name in names}))
        splits = [split for several in SPLITS.values() for split in several]
        return {
            f"scenes of {s}": dict.fromkeys(
                get_prediction_challenge_split(s, folder), 0
            )
            for s in splits
        }


def read_version(root: Path, version: str) -> dict[str, Rows]:
    """The rows of one version of the tables."""
    tables = NuScenes(version=version, dataroot=str(root), verbose=False)
    samples: Rows = {}
    boxes: Rows = {}
    for sample in tables.sample:
        lidar = sample["data"]["LIDAR_TOP"]
        pose = tables.get(
            "ego_pose", tables.get("sample_data", lidar)["ego_pose_token"]
        )
        samples[sample["token"]] = [
            sample["timestamp"],
            *pose["translation"],
            quaternion_yaw(Quaternion(pose["rotation"])),
        ]
        for box in tables.get_boxes(lidar):
            annotation = tables.get("sample_annotation", box.token)
            name = category_to_detection_name(annotation["category_name"])
            if name:
                key = f"{sample['token']} {annotation['instance_token']} {name}"
                boxes[key] = box_row(box.center, box.orientation, box.wlh)
    parts = {"samples": samples, "boxes": boxes, "targets": targets(root, tables)}
    for split in SPLITS[version]:
        listed = (
            target.split("_")
            for target in get_prediction_challenge_split(split, dataroot=str(root))
        )
        own = [
            f"{sample} {instance}" for instance, sample in listed if sample in samples
        ]
        parts[f"targets of {split}"] = dict.fromkeys(own, 0)
    for path in sorted((root / "detections").glob("*.json")):
        parts[path.stem] = detections(path, samples)
    return parts


def targets(root: Path, tables: Any) -> Rows:
    """Prediction targets of the scenes that the tables have, with the answers of `PredictHelper`."""
    listed = json.loads((root / PREDICTION).read_text())
    helper = PredictHelper(tables)
    rows: Rows = {}
    for scene in tables.scene:
        for target in listed.get(scene["name"], []):
            instance, sample = target.split("_")
            future = np.full((12, 2), np.nan)
            ahead = helper.get_future_for_agent(
                instance, sample, 6, in_agent_frame=False
            )
            future[: len(ahead)] = ahead
            speed = helper.get_velocity_for_agent(instance, sample)
            rows[f"{sample} {instance}"] = [*future.ravel(), speed]
    return rows


def detections(path: Path, samples: Rows) -> Rows:
    """Boxes of a submission file, as `load_prediction` gives them, of the samples in the tables."""
    boxes, _ = load_prediction(str(path), MOST_BOXES, DetectionBox)
    return {
        f"{token} {box.detection_name} {place:03d}": [
            *box_row(box.translation, Quaternion(box.rotation), box.size),
            box.detection_score,
        ]
        for token in boxes.sample_tokens
        if token in samples
        for place, box in enumerate(boxes[token])
    }


def box_row(center: Any, orientation: Any, size: Any) -> list[float]:
    """The numbers x y z yaw l w h of a box whose ``size`` is width, length, height."""
    width, length, height = size
    return [*center, quaternion_yaw(orientation), length, width, height]


if __name__ == "__main__":
    main()

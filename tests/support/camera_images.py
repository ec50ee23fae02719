"""Cameras in the small root of nuScenes, in the official layout: plain images at every keyframe.

``CAM_FRONT`` looks ahead from 1.5 m above the ego, ``CAM_BACK`` back from there; both with a focal length of 1000
pixels. The ego drives along y, so that what lies at ``x`` and ``d`` metres ahead is at the pixel 800 + 1000 x / d.
"""

import json
from pathlib import Path
from typing import Any

from PIL import Image

from tests.support.nuscenes_root import VERSION, Record, write_json

CAMERAS = {"CAM_FRONT": [0.5, -0.5, 0.5, -0.5], "CAM_BACK": [0.5, -0.5, -0.5, 0.5]}  # with their quaternions
PIXELS = (1600, 900)
INTRINSIC = [[1000.0, 0.0, 800.0], [0.0, 1000.0, 450.0], [0.0, 0.0, 1.0]]
GREY = (120, 121, 122)


def write_cameras(data: Path) -> None:
    """Write cameras into the tables of the small root, and the images of all its keyframes."""
    folder = data / "nuscenes" / VERSION
    tables = {name: read(folder / f"{name}.json") for name in ("sensor", "calibrated_sensor", "sample_data")}
    lidar = [record for record in tables["sample_data"] if record["calibrated_sensor_token"] == "lidar-1"]
    tables["sample_data"] = list(lidar)
    tables["sensor"] = [record for record in tables["sensor"] if record["channel"] == "LIDAR_TOP"]
    tables["calibrated_sensor"] = [each for each in tables["calibrated_sensor"] if each["token"] == "lidar-1"]
    for name, rotation in CAMERAS.items():
        tables["sensor"].append({"token": name, "channel": name})
        mount = {"translation": [0.0, 0.0, 1.5], "rotation": rotation, "camera_intrinsic": INTRINSIC}
        tables["calibrated_sensor"].append({"token": f"{name}-1", "sensor_token": name, **mount})
        for record in lidar:
            if record["is_key_frame"]:
                tables["sample_data"].append(_image(data / "nuscenes", name, record))
    for name, records in tables.items():
        write_json(folder / f"{name}.json", records)


def write_image(path: Path, size: tuple[int, int] = PIXELS) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", size, GREY).save(path)


def read(path: Path) -> list[Record]:
    records: list[Record] = json.loads(path.read_text(encoding="utf-8"))
    return records


def _image(root: Path, camera: str, lidar: Record) -> dict[str, Any]:
    """The record of an image beside that of the lidar, and its file."""
    file = f"samples/{camera}/{lidar['sample_token']}.jpg"
    write_image(root / file)
    own = {"token": f"{lidar['token']}-{camera}", "calibrated_sensor_token": f"{camera}-1", "filename": file}
    return {**lidar, **own, "width": PIXELS[0], "height": PIXELS[1]}

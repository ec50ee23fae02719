"""Files of forecasts in the forms of other programs, written from the keys that their code publishes.

All are of ``scene-0003`` of `nuscenes_root`, whose frame 1 has three objects:

car          at (10, 2), turned along y, drives along y: 2 m in each period of half a second
pedestrian   at (5, 5), 1 m high, heads along x, walks along -x: 0.5 m in each period
parked car   at (-5, 5), without a forecast

Of the six samples of an object, sample m is m/10 of the step slower, and the first has half of the weight. The lidar is
mounted 1 m ahead of the ego's centre and 2 m above it, and looks back. The ego of frame 1 is at (0, 2) and heads along y, so
the lidar is at (0, 3) with its x axis along -y and its y axis along x: the place (X, Y) is (3 - Y, X) in its frame.
"""

import gzip
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.support.drawn_recordings import small_recording
from tests.support.layouts import ARGOVERSE2, CITY, STAMP, write_argoverse2
from tests.support.nuscenes_root import LEFT, SCENES, VERSION, edited, sample, write_root

SCENE = "scene-0003"
STEPS = 12
MODES = 6
WEIGHTS = [0.5, 0.1, 0.1, 0.1, 0.1, 0.1]
LOG_WEIGHTS = [math.log(weight) for weight in WEIGHTS]
AHEAD = [1.0, 0.0, 0.0, 0.0]  # heading along x
Record = dict[str, Any]


def straight(place: tuple[float, float], step: tuple[float, float], steps: int = STEPS, modes: int = MODES) -> Any:
    """Samples [modes][steps][2] of an object that goes straight on, from the place after one period on."""
    return [
        [[place[axis] + step[axis] * (1 - m / 10) * s for axis in (0, 1)] for s in range(1, steps + 1)]
        for m in range(modes)
    ]


CAR = straight((10, 2), (0, 2))
WALKER = straight((5, 5), (-0.5, 0))
STANDING = straight((-5, 5), (0, 0))
# in the frame of the lidar
CAR_IN_LIDAR = straight((1, 10), (-2, 0))
WALKER_IN_LIDAR = straight((-2, 5), (0, -0.5))


def mounted(data: Path) -> Path:
    """The small root with the lidar as above."""
    with edited(write_root(data) / "nuscenes" / VERSION / "calibrated_sensor.json") as sensors:
        sensors[0].update(translation=[1.0, 0.0, 2.0], rotation=[0.0, 0.0, 0.0, 1.0])
    return data


def tracked(name: str, identity: str, place: list[float], rotation: list[float], score: float) -> Record:
    """The keys of nuScenes' detection and tracking results, as trackers write both."""
    size = [2.0, 4.0, 1.5] if name == "car" else [0.5, 0.6, 1.0]  # width, length, height
    return {
        "sample_token": sample(SCENE, 1), "translation": place, "size": size, "rotation": rotation,
        "velocity": [0.0, 0.0], "detection_name": name, "detection_score": score, "attribute_name": "",
        "tracking_name": name, "tracking_score": score, "tracking_id": identity,
    }  # fmt: skip


def boxes() -> list[Record]:
    return [
        tracked("car", "7", [10.0, 2.0, 1.0], LEFT, 0.9),
        tracked("pedestrian", "8", [5.0, 5.0, 0.5], AHEAD, 0.6),
        tracked("car", "9", [-5.0, 5.0, 1.0], LEFT, 0.3),
    ]


def mfeval() -> list[Record]:
    """`traj` and `traj_prob`; a class, a place and a score, but no box. Weights in no order."""
    return [
        {"class_name": "car", "translation": [10.0, 2.0], "detection_score": 0.9, "traj": CAR, "traj_prob": WEIGHTS},
        {"class_name": "pedestrian", "translation": [5.0, 5.0], "detection_score": 0.6, "traj": WALKER,
         "traj_prob": None},
        {"class_name": "car", "translation": [-5.0, 5.0], "detection_score": 0.3, "traj": [], "traj_prob": None},
    ]  # fmt: skip


def uniad() -> list[Record]:
    """`predict_traj` in the frame of the lidar; log-softmax as weights; null or no key without a forecast."""
    objects = boxes()
    objects[0] |= {"predict_traj": CAR_IN_LIDAR, "predict_traj_score": LOG_WEIGHTS}
    objects[1] |= {"predict_traj": WALKER_IN_LIDAR, "predict_traj_score": LOG_WEIGHTS}
    objects[2] |= {"predict_traj": None, "predict_traj_score": None}
    return objects


def vip3d() -> list[Record]:
    """`pred_outputs` in the global frame; its own place, six times, without a forecast."""
    objects = boxes()
    objects[0] |= {"pred_outputs": CAR, "pred_probs": LOG_WEIGHTS}
    objects[1] |= {"pred_future_trajs": WALKER, "pred_probs": None}  # as its own script reads
    objects[2] |= {"pred_outputs": STANDING, "pred_probs": LOG_WEIGHTS}
    return objects


def vad() -> list[Record]:
    """`fut_traj`, a flat list of steps in the axes of the lidar, 3 s; no tracks and no weights."""
    objects = [{key: value for key, value in item.items() if "tracking" not in key} for item in boxes()]
    slower = [1 - m / 10 for m in range(MODES)]
    objects[0]["fut_traj"] = [number for share in slower for _ in range(6) for number in (-2.0 * share, 0.0)]
    objects[1]["fut_traj"] = [number for share in slower for _ in range(6) for number in (0.0, -0.5 * share)]
    return objects


FORMS: dict[str, Callable[[], list[Record]]] = {"mfeval": mfeval, "uniad": uniad, "vip3d": vip3d, "vad": vad}


def results(objects: list[Record], scene: str = SCENE) -> dict[str, list[Record]]:
    """The objects in frame 1 of a scene, an empty list in the others."""
    return {sample(scene, t): objects if t == 1 else [] for t in range(4)}


def write_results(path: Path, content: Any) -> Path:
    """Write JSON, packed if the name says so; NaN and Infinity are written as Python does."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(content).encode()
    path.write_bytes(gzip.compress(text) if path.suffix == ".gz" else text)
    return path


# ---- all frames of a scene, to be scored
def driving(frames: int = 4, **changes: Any) -> dict[str, list[Record]]:
    """An MFEval file of all small scenes: the car drives where it is, a walker stands, each sure in its own way."""
    car_y = (0.0, 2.0, 4.0, 7.0)
    content: dict[str, list[Record]] = {}
    for scene in SCENES:
        for t in range(frames):
            car = {
                "class_name": "car", "translation": [10.0, car_y[t], 1.0], "size": [2.0, 4.0, 1.5], "rotation": LEFT,
                "detection_score": 0.9 - t / 10, "traj": straight((10, car_y[t]), (0, 2)), "traj_prob": WEIGHTS,
            }  # fmt: skip
            walker = {
                "class_name": "pedestrian", "translation": [5.0, 5.0, 1.0], "size": [0.5, 0.6, 1.8], "rotation": AHEAD,
                "detection_score": 0.5, "traj": straight((5, 5), (0, 0)), "traj_prob": WEIGHTS,
            }  # fmt: skip
            content[sample(scene, t)] = [{**car, **changes}, {**walker, **changes}]
    return content


# ---- Argoverse 2
LOG = "a-log"


def write_log(data: Path) -> Path:
    """A log of eleven sweeps, whose frames at 2 Hz are the sweeps 0, 5 and 10; the ego stands at `CITY`."""
    write_argoverse2(data, small_recording(ARGOVERSE2, 11))
    return data


def stamp(frame: int) -> int:
    """Time of a frame at 2 Hz, ns."""
    return STAMP + round(frame * 5e8)


def av2_object(place: tuple[float, float], step: tuple[float, float], score: float, **changes: Any) -> Record:
    """An object with the keys of the end-to-end forecasting task, in the city; ``place`` is relative to `CITY`."""
    city = np.array(straight((place[0] + CITY[0], place[1] + CITY[1]), step, 6, 5))
    return {
        "prediction_m": city, "score": np.array([0.1, 0.5, 0.2, 0.1, 0.1]), "detection_score": score,
        "instance_id": 3, "current_translation_m": np.array(place) + CITY[:2], "label": 0,
        "name": "REGULAR_VEHICLE", "size": np.array([4.0, 2.0, 1.5]), "yaw": 0.5, **changes,
    }  # fmt: skip


def av2() -> dict[str, Any]:
    """A car that drives, a school bus in the second frame with an array for each number, and a bollard; sweeps between."""
    bus: Record = {
        "name": np.str_("SCHOOL_BUS"), "instance_id": np.int64(11), "detection_score": np.float32(0.25),
        "yaw": np.array(-1.0), "size": (9.0, 3.0, 3.0), "current_translation_m": [1020.0, 1990.0, 51.0],
    }  # fmt: skip
    return {
        LOG: {
            stamp(0): [av2_object((10, 4), (-2.5, 0), 0.9)],
            STAMP + 100_000_000: [av2_object((0, 0), (0, 0), 0.5)],
            stamp(1): [
                av2_object((7.5, 4), (-2.5, 0), 0.8),
                av2_object((20, -10), (0, 0), 0.25, **bus),
                av2_object((1, 1), (0, 0), 0.5, name="BOLLARD", instance_id=4),
            ],
            stamp(2): [],
        },
        "other-log": {stamp(0): [], stamp(1): []},
    }

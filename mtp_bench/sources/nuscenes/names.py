"""Official names: classes of the detection task, categories of the tables, and scenes of the splits."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Literal, get_args

ClassName = Literal[
    "car", "truck", "bus", "trailer", "construction_vehicle", "pedestrian", "motorcycle", "bicycle", "traffic_cone",
    "barrier",
]  # fmt: skip
CLASSES: tuple[str, ...] = get_args(ClassName)  # class_id in the cache is an index into these

# The official detection task evaluates these (``nuscenes.eval.detection.utils.category_to_detection_name``).
CLASS_OF = {
    "vehicle.car": "car",
    "vehicle.truck": "truck",
    "vehicle.bus.bendy": "bus",
    "vehicle.bus.rigid": "bus",
    "vehicle.trailer": "trailer",
    "vehicle.construction": "construction_vehicle",
    "human.pedestrian.adult": "pedestrian",
    "human.pedestrian.child": "pedestrian",
    "human.pedestrian.construction_worker": "pedestrian",
    "human.pedestrian.police_officer": "pedestrian",
    "vehicle.motorcycle": "motorcycle",
    "vehicle.bicycle": "bicycle",
    "movable_object.trafficcone": "traffic_cone",
    "movable_object.barrier": "barrier",
}
# The task leaves these out, but a detector reports them as one of its classes: a match is neither right nor wrong.
NEUTRAL_OF = {
    "vehicle.emergency.police": "car",
    "vehicle.emergency.ambulance": "truck",
    "human.pedestrian.personal_mobility": "pedestrian",
    "human.pedestrian.stroller": "pedestrian",
    "human.pedestrian.wheelchair": "pedestrian",
}

SPLITS = ("train", "train_val", "val", "mini_train", "mini_val")
TRAIN_VAL = 200  # scenes: the prediction challenge validates on the first of the official "train"


def class_index(category: str) -> int:
    """Index of the class of a category, neutral ones included; -1 for a category that is not used."""
    name = CLASS_OF.get(category) or NEUTRAL_OF.get(category)
    return -1 if name is None else CLASSES.index(name)


@cache
def official_scenes() -> Mapping[str, tuple[str, ...]]:
    """Scene names of each of `SPLITS`, in the official order (``nuscenes.eval.prediction.splits``)."""
    lists = json.loads(Path(__file__).with_name("splits.json").read_text(encoding="utf-8"))
    train = lists["train"]
    named = {**lists, "train": train[TRAIN_VAL:], "train_val": train[:TRAIN_VAL]}
    return MappingProxyType({split: tuple(named[split]) for split in SPLITS})


def split_scenes(split: str, scenes: Collection[str]) -> tuple[str, ...]:
    """The ``scenes`` of ``split``, in its order; "all" has every one, sorted."""
    if split == "all":
        return tuple(sorted(scenes))
    there = frozenset(scenes)
    return tuple(name for name in official_scenes()[split] if name in there)

"""Classes of the detection task and the categories of the tables that they stand for."""

from __future__ import annotations

from typing import Literal, get_args

ClassName = Literal[
    "car",
    "truck",
    "bus",
    "trailer",
    "construction_vehicle",
    "pedestrian",
    "motorcycle",
    "bicycle",
    "traffic_cone",
    "barrier",
]
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


def class_index(category: str) -> int:
    """Index of the class of a category, neutral ones included; -1 for a category that is not used."""
    name = CLASS_OF.get(category) or NEUTRAL_OF.get(category)
    return -1 if name is None else CLASSES.index(name)

"""Association parameters per detector and class."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from ..errors import UnknownNameError

Affinity = Literal["giou_3d", "iou_3d", "center_distance"]
Assignment = Literal["hungarian", "greedy"]


@dataclass(frozen=True)
class ClassParameters:
    """How tracks of one class are associated and when they live."""

    assignment: Assignment
    affinity: Affinity
    gate: float  # smallest affinity that may match; largest distance for "center_distance"
    min_hits: int  # a track is output from this many detections on
    max_age: int  # a track ends after this many frames without a detection


# AB3DMOT's settings per detector (Weng et al. 2020, its code's KITTI and nuScenes configuration).
AB3DMOT: dict[str, dict[str, ClassParameters]] = {
    "pointrcnn": {
        "car": ClassParameters("hungarian", "giou_3d", -0.2, 3, 2),
        "pedestrian": ClassParameters("greedy", "giou_3d", -0.4, 1, 4),
        "cyclist": ClassParameters("hungarian", "center_distance", 2.0, 3, 4),
    },
}


def ab3dmot_parameters(detector: str, classes: Sequence[str]) -> tuple[ClassParameters, ...]:
    """AB3DMOT's settings of each class for a detector; raises UnknownNameError for what it was never tuned on."""
    if detector not in AB3DMOT:
        raise UnknownNameError("detector", detector, AB3DMOT, "pass `parameters` for your own")
    table = AB3DMOT[detector]
    for name in classes:
        if name not in table:
            raise UnknownNameError(f"class for detector {detector!r}", name, table, "pass `parameters` for your own")
    return tuple(table[name] for name in classes)

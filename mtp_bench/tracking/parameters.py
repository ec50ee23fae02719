"""Association parameters per detector and class."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from ..errors import UnknownNameError
from ..similar import similar_class

Affinity = Literal["giou_3d", "iou_3d", "center_distance"]
Assignment = Literal["hungarian", "greedy"]


@dataclass(frozen=True)
class ClassParameters:
    """How tracks of one class are associated and when they live."""

    assignment: Assignment
    affinity: Affinity
    gate: float  # smallest affinity that may match; of distances the largest, m
    min_hits: int  # a track is output from this many detections on
    max_age: int  # a track ends after this many frames without a detection


_KITTI = {
    "car": ClassParameters("hungarian", "giou_3d", -0.2, 3, 2),
    "pedestrian": ClassParameters("greedy", "giou_3d", -0.4, 1, 4),
    "cyclist": ClassParameters("hungarian", "center_distance", 2.0, 3, 4),
}
_MEGVII = {
    "car": ClassParameters("greedy", "giou_3d", -0.5, 1, 2),
    "truck": ClassParameters("greedy", "giou_3d", -0.2, 1, 2),
    "bus": ClassParameters("greedy", "giou_3d", -0.2, 1, 2),
    "trailer": ClassParameters("greedy", "giou_3d", -0.2, 3, 2),
    "motorcycle": ClassParameters("greedy", "giou_3d", -0.8, 3, 2),
    "bicycle": ClassParameters("greedy", "giou_3d", -0.6, 3, 2),
    "pedestrian": ClassParameters("greedy", "center_distance", 2.0, 1, 2),
}
_CENTERPOINT = {
    **dict.fromkeys(("car", "truck", "bus"), ClassParameters("greedy", "giou_3d", -0.4, 1, 2)),
    "trailer": ClassParameters("greedy", "giou_3d", -0.3, 3, 2),
    "motorcycle": ClassParameters("greedy", "giou_3d", -0.7, 3, 2),
    "bicycle": ClassParameters("greedy", "center_distance", 6.0, 3, 2),
    "pedestrian": ClassParameters("greedy", "giou_3d", -0.5, 1, 2),
}

# AB3DMOT's settings per detector (Weng et al. 2020, its code's KITTI and nuScenes configuration). It has none for
# construction vehicles: those of trucks.
AB3DMOT: dict[str, dict[str, ClassParameters]] = {
    "pointrcnn": _KITTI,
    "megvii": {**_MEGVII, "construction_vehicle": _MEGVII["truck"]},
    "centerpoint": {**_CENTERPOINT, "construction_vehicle": _CENTERPOINT["truck"]},
}

# AB3DMOT knows no detectors of people on a ground plane: chosen by MOTA on training scenes of PETS09-S2L1 (without a
# score cut) and WILDTRACK (simulated detections).
_GROUND_PLANE: dict[str, dict[str, ClassParameters]] = {
    "acf": {"pedestrian": ClassParameters("hungarian", "center_distance", 1.5, 3, 2)},
    "wildtrack_mvdet": {"pedestrian": ClassParameters("hungarian", "center_distance", 1.5, 2, 2)},
}

# For simulated detectors: those of the detector that their noise was fitted to; simulated motorcycles, which move like
# cars, take those of cars where nuScenes' detectors are meant. A detector without errors is tracked like Megvii's.
_LIKE_MEGVII = {**AB3DMOT["megvii"], "motorcycle": _MEGVII["car"]}
_SIMULATED: dict[str, dict[str, ClassParameters]] = {
    **dict.fromkeys(("kitti_pointrcnn", "kitti_pointrcnn_raw"), _KITTI),
    **dict.fromkeys(("nuscenes_megvii", "nuscenes_megvii_raw"), _LIKE_MEGVII),
    "nuscenes_centerpoint": {**AB3DMOT["centerpoint"], "motorcycle": _CENTERPOINT["car"]},
    "clean": {**_LIKE_MEGVII, "cyclist": _MEGVII["car"]},
}


def ab3dmot_parameters(detector: str, classes: Sequence[str]) -> tuple[ClassParameters, ...]:
    """AB3DMOT's settings of each class for a detector, or our own where it has none.

    A class without settings takes those of a similar one, see `similar_class`. What follows the first hyphen of the
    detector's name does not matter: "kitti_pointrcnn-hard" is tracked like "kitti_pointrcnn". Raises UnknownNameError
    for a detector without settings, and for a class that looks misspelt.
    """
    known = {**AB3DMOT, **_GROUND_PLANE, **_SIMULATED}
    family = detector.split("-", maxsplit=1)[0]
    if family not in known:
        raise UnknownNameError("detector", detector, known, "pass `parameters` for your own")
    table, similar = known[family], []
    for name in classes:
        like = similar_class(name, table)
        if like is None:
            raise UnknownNameError(f"class for detector {detector!r}", name, table, "pass `parameters` for your own")
        similar.append(table[like])
    return tuple(similar)


def sort_parameters(
    classes: Sequence[str], gate: float = 1.5, min_hits: int = 3, max_age: int = 1
) -> tuple[ClassParameters, ...]:
    """SORT's life cycle (Bewley et al. 2016) for people on a ground plane, the same for each class.

    ``gate``: m, largest distance of a detection from the forecast place. ``min_hits``: a track is output from so many
    detections on. ``max_age``: frames without a detection that a track survives, as SORT counts them; a
    `ClassParameters.max_age` is one more.

    What differs from SORT: it tracks boxes in an image, by their centre, area and aspect ratio, and matches by IoU of
    at least 0.3; people on a ground plane at 2 Hz leave their own box between two frames, so the distance of centres
    takes its place, as in Yu, Zhou 2021. The filter is AB3DMOT's, whose velocity noise is SORT's. SORT needs
    ``min_hits`` detections in a row and hides a track in a frame without a detection; here they need not be in a row,
    and a track is output until it ends.
    """
    return (ClassParameters("hungarian", "center_distance", gate, min_hits, max_age + 1),) * len(classes)

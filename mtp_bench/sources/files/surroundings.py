"""What surrounds the objects of a scene, as arrays: the camera image that labels are of, and the road map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import DataError
from ...types import ImageField, Lane, Ragged, starts_of_sorted
from .columns import ARRAYS

Arrays = dict[str, NDArray[Any]]


def image_arrays(image: ImageField, names: NDArray[np.str_]) -> Arrays:
    """What the image can confirm; ``names`` [C] of the classes that its box sizes are of."""
    return {
        "image_projection": image.projection,
        "image_height": image.height,
        "image_heading": image.heading,
        "image_size": np.array(image.size),
        "image_region": image.region,
        "image_region_frame": Ragged(image.region_start).frame_of_rows,
        "image_classes": names,
        "image_box_size": image.box_size,
    }


def image_of(arrays: Arrays, frames: int, where: str) -> ImageField:
    """What the image can confirm. Raises DataError, naming the file ``where``, for arrays that do not fit."""
    needed = [array.name for array in ARRAYS if array.name.startswith("image_")]
    for name in needed:
        if name not in arrays:
            raise DataError(f"{where}: no array {name!r}, but others of {', '.join(needed)}; expected all or none")
    region = arrays["image_region_frame"]
    if (np.diff(region) < 0).any() or (len(region) and not 0 <= region[0] <= region[-1] < frames):
        raise DataError(f"{where}, array 'image_region_frame': expected frames of the scene, sorted")
    width, height = arrays["image_size"].tolist()
    if min(width, height) < 1:
        raise DataError(f"{where}, array 'image_size': {width} x {height} pixels, expected at least one each way")
    return ImageField(
        projection=arrays["image_projection"],
        height=arrays["image_height"],
        heading=arrays["image_heading"],
        size=(width, height),
        region=arrays["image_region"],
        region_start=starts_of_sorted(region, frames),
        box_size=arrays["image_box_size"],
    )


def lane_arrays(lanes: Sequence[Lane]) -> Arrays:
    """The road map; nothing without lanes."""
    if not lanes:
        return {}
    points = [np.stack([lane.center, lane.left, lane.right], axis=1) for lane in lanes]
    following = [(at, after) for at, lane in enumerate(lanes) for after in lane.following]
    junction = np.array([lane.junction for lane in lanes], dtype=bool)
    return {
        **({"lane_junction": junction} if junction.any() else {}),  # a map without them is as earlier versions wrote it
        "lane_of": np.repeat(np.arange(len(lanes)), [len(own) for own in points]),
        "lane_points": np.concatenate(points),
        "lane_following": np.array(following, dtype=np.int64).reshape(-1, 2),
    }


def lanes_of(arrays: Arrays, where: str) -> tuple[Lane, ...]:
    """The road map. Raises DataError, naming the file ``where``, for arrays that do not fit."""
    of = arrays["lane_of"]
    points, following = arrays.get("lane_points"), arrays.get("lane_following", np.zeros((0, 2), dtype=np.int64))
    count = int(of[-1]) + 1 if len(of) else 0
    steps = np.diff(of, prepend=-1)
    if points is None or not ((steps == 0) | (steps == 1)).all() or (len(of) and of[0] != 0):
        raise DataError(f"{where}, array 'lane_of': expected the lanes 0, 1, 2, ... of 'lane_points', sorted")
    if len(following) and (following.min() < 0 or following.max() >= count):
        raise DataError(f"{where}, array 'lane_following': expected lanes from 0 to {count - 1}")
    junction = arrays.get("lane_junction", np.zeros(count, dtype=bool))
    if len(junction) != count:
        raise DataError(f"{where}, array 'lane_junction': {len(junction)} lanes, expected the {count} of 'lane_of'")
    start = starts_of_sorted(of, count)
    lanes = []
    for at in range(count):
        center, left, right = (points[start[at] : start[at + 1], side] for side in range(3))
        after = tuple(following[following[:, 0] == at, 1].tolist())
        lanes.append(Lane(center, left, right, after, bool(junction[at])))
    return tuple(lanes)

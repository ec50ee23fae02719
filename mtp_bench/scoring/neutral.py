"""Neutral objects, which no label could confirm or refute (docs/definitions, "Targets").

KITTI is labelled in images. An object is placed into the image from its x and y alone, since an agent could choose
the other numbers of a forecast freely.
"""

from dataclasses import replace

import numpy as np

from ..core import Bools, Floats, ImageField, Ints, Scene
from .definitions import CAMERA_HEIGHT, LEAST_IMAGE_HEIGHT, MOST_IN_REGION

_NEAR = 0.1  # m before the camera: what is nearer or behind is cut off
_CORNER = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)]) - [
    0.5,
    0.5,
    0.0,
]  # along, across, up
_EDGE = np.array(
    [(i, j) for i in range(8) for j in range(i) if (i ^ j).bit_count() == 1]
).T  # [2, 12] corners
_ENDS = np.concatenate(
    [_EDGE, _EDGE[::-1]], axis=1
)  # [2, 24] every edge from both ends


def evaluated(scene: Scene) -> Scene:
    """``scene`` as it is evaluated: true boxes that no label of its image could confirm are neutral, never targets."""
    truth, image = scene.truth, scene.image
    if image is None:
        return scene
    hidden = unconfirmable(image, truth.frame_of_rows, truth.box[:, :2], truth.class_id)
    return replace(
        scene,
        truth=replace(
            truth, eligible=truth.eligible & ~hidden, neutral=truth.neutral | hidden
        ),
    )


def neutral_places(scene: Scene, frame: Ints, xy: Floats, class_id: Ints) -> Bools:
    """True for objects at ``xy`` [n, 2] m that no label of the scene could confirm [n]; False without an image."""
    if scene.image is None:
        return np.zeros(len(xy), dtype=bool)
    return unconfirmable(scene.image, frame, xy, class_id)


def unconfirmable(image: ImageField, frame: Ints, xy: Floats, class_id: Ints) -> Bools:
    """True for objects at ``xy`` [n, 2] m, scene's frame of reference, that no label of the image could confirm [n].

    An object of ``class_id`` [n] in ``frame`` [n] is seen as an upright box of the size that stands for its class, with
    the heading of the platform and its bottom 1.65 m below the camera. In the image it is the least rectangle around
    that box as far as it lies before the camera, cut to the image. No label confirms it if nothing of it is left, if it
    is at most 25 pixels high, or if more than half of it lies in one region where labels do not care.
    """
    box = _image_boxes(image, frame, np.asarray(xy, dtype=np.float64), class_id)
    low = ~((box[:, 3] - box[:, 1] > LEAST_IMAGE_HEIGHT) & (box[:, 2] > box[:, 0]))
    return np.asarray(low | (_share_in_region(image, frame, box) > MOST_IN_REGION))


def _image_boxes(image: ImageField, frame: Ints, xy: Floats, class_id: Ints) -> Floats:
    """Left, top, right, bottom [n, 4] of objects in the image, pixels; right is left of left where nothing is seen."""
    offset = _CORNER * image.box_size[class_id][:, None]  # [n, 8, 3]
    cos, sin = (
        np.cos(image.heading[frame])[:, None],
        np.sin(image.heading[frame])[:, None],
    )
    corner = np.ones((len(xy), 8, 4))
    corner[..., 0] = xy[:, :1] + cos * offset[..., 0] - sin * offset[..., 1]
    corner[..., 1] = xy[:, 1:] + sin * offset[..., 0] + cos * offset[..., 1]
    corner[..., 2] = (image.height[frame] - CAMERA_HEIGHT)[:, None] + offset[..., 2]
    point = corner @ image.projection[frame].swapaxes(1, 2)  # u w, v w, w
    start, end = point[:, _ENDS[0]], point[:, _ENDS[1]]  # [n, 24, 3]
    depth, other = start[..., 2], end[..., 2]
    seen = np.maximum(depth, other) >= _NEAR
    cut = seen & (
        depth < _NEAR
    )  # the edge comes out in front of the camera: it starts there
    along = np.where(cut, (_NEAR - depth) / np.where(cut, other - depth, 1.0), 0.0)
    start = start + along[..., None] * (end - start)
    pixel = start[..., :2] / np.where(seen, start[..., 2], 1.0)[..., None]
    least = np.where(seen[..., None], pixel, np.inf).min(axis=1)
    most = np.where(seen[..., None], pixel, -np.inf).max(axis=1)
    return np.concatenate(
        [np.maximum(least, 0.0), np.minimum(most, image.size)], axis=1
    )


def _share_in_region(image: ImageField, frame: Ints, box: Floats) -> Floats:
    """Largest share [n] of each image box [n, 4] that lies in one region of its frame."""
    first = image.region_start[frame]
    count = image.region_start[frame + 1] - first
    row = np.repeat(np.arange(len(box)), count)
    place = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    region, own = image.region[first[row] + place], box[row]
    side = np.minimum(own[:, 2:], region[:, 2:]) - np.maximum(own[:, :2], region[:, :2])
    area = np.maximum(own[:, 2:] - own[:, :2], 0.0).prod(axis=1)
    common = np.maximum(side, 0.0).prod(axis=1)
    share = np.zeros(len(box))
    np.maximum.at(
        share, row, np.divide(common, area, out=np.zeros(len(row)), where=area > 0)
    )
    return share

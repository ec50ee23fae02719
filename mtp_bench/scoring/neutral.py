"""Neutral objects, which no label could confirm or refute.

KITTI is labelled in images. An object is placed into the image from its x and y alone,
since an agent could choose the other numbers of a forecast freely (docs/definitions,
"Targets").
"""

from dataclasses import replace

import numpy as np

from ..core import Bools, Floats, ImageField, Ints, Scene
from .definitions import CAMERA_HEIGHT, LEAST_IMAGE_HEIGHT, MOST_IN_REGION

_MIN_DEPTH_M = 0.1  # before the camera: what is nearer or behind is cut off
# [8, 3] along, across, up, of a box of size 1
_CORNER = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)])
_CORNER = _CORNER - [0.5, 0.5, 0.0]
# [2, 24] corners: every edge from both ends
_ENDS = np.array(
    [(i, j) for i in range(8) for j in range(8) if (i ^ j).bit_count() == 1]
).T


def evaluated(scene: Scene) -> Scene:
    """Return a scene as it is evaluated.

    True boxes that no label of its image could confirm are neutral, never targets.
    """
    if scene.image is None:
        return scene
    truth = scene.truth
    hidden = neutral_places(
        scene, truth.frame_of_rows, truth.box[:, :2], truth.class_id
    )
    truth = replace(
        truth, eligible=truth.eligible & ~hidden, neutral=truth.neutral | hidden
    )
    return replace(scene, truth=truth)


def neutral_places(scene: Scene, frame: Ints, xy: Floats, class_id: Ints) -> Bools:
    """Return True [n] for objects that no label of the scene could confirm.

    At ``xy`` [n, 2] m, scene's frame of reference; False without an image. An object of
    ``class_id`` [n] in ``frame`` [n] is seen as an upright box of the size that stands
    for its class, with the heading of the platform and its bottom 1.65 m below the
    camera. In the image it is the least rectangle around that box as far as it lies
    before the camera, cut to the image. No label confirms it if nothing of it is left,
    if it is at most 25 pixels high, or if more than half of it lies in one region where
    labels do not care.
    """
    image = scene.image
    if image is None:
        return np.zeros(len(xy), dtype=bool)
    box = _image_boxes(image, frame, np.asarray(xy, dtype=np.float64), class_id)
    is_wide = box[:, 2] > box[:, 0]
    is_high = box[:, 3] - box[:, 1] > LEAST_IMAGE_HEIGHT
    in_region = _share_in_region(image, frame, box) > MOST_IN_REGION
    return np.asarray(~(is_high & is_wide) | in_region)


def _image_boxes(image: ImageField, frame: Ints, xy: Floats, class_id: Ints) -> Floats:
    """Return left, top, right, bottom [n, 4] of objects in the image, pixels.

    Right is left of left where nothing is seen.
    """
    offset = _CORNER * image.box_size[class_id][:, None]  # [n, 8, 3]
    cos = np.cos(image.heading[frame])[:, None]
    sin = np.sin(image.heading[frame])[:, None]
    corner = np.ones((len(xy), 8, 4))
    corner[..., 0] = xy[:, :1] + cos * offset[..., 0] - sin * offset[..., 1]
    corner[..., 1] = xy[:, 1:] + sin * offset[..., 0] + cos * offset[..., 1]
    corner[..., 2] = (image.height[frame] - CAMERA_HEIGHT)[:, None] + offset[..., 2]
    point = corner @ image.projection[frame].swapaxes(1, 2)  # u w, v w, w
    start = point[:, _ENDS[0]]  # [n, 24, 3]
    end = point[:, _ENDS[1]]
    start_depth = start[..., 2]
    end_depth = end[..., 2]
    visible = np.maximum(start_depth, end_depth) >= _MIN_DEPTH_M
    # the edge comes out in front of the camera: it starts there
    cut = visible & (start_depth < _MIN_DEPTH_M)
    depth_change = np.where(cut, end_depth - start_depth, 1.0)
    share = np.where(cut, (_MIN_DEPTH_M - start_depth) / depth_change, 0.0)
    start = start + share[..., None] * (end - start)
    pixel = start[..., :2] / np.where(visible, start[..., 2], 1.0)[..., None]
    top_left = np.where(visible[..., None], pixel, np.inf).min(axis=1)
    bottom_right = np.where(visible[..., None], pixel, -np.inf).max(axis=1)
    return np.concatenate(
        [np.maximum(top_left, 0.0), np.minimum(bottom_right, image.size)], axis=1
    )


def _share_in_region(image: ImageField, frame: Ints, box: Floats) -> Floats:
    """Return the largest share [n] of image boxes [n, 4] in one region of a frame."""
    first = image.region_start[frame]
    count = image.region_start[frame + 1] - first
    row = np.repeat(np.arange(len(box)), count)
    place = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    region = image.region[first[row] + place]
    row_box = box[row]
    top_left = np.maximum(row_box[:, :2], region[:, :2])
    bottom_right = np.minimum(row_box[:, 2:], region[:, 2:])
    common_area = np.maximum(bottom_right - top_left, 0.0).prod(axis=1)
    box_area = np.maximum(row_box[:, 2:] - row_box[:, :2], 0.0).prod(axis=1)
    row_share = np.zeros(len(row))
    np.divide(common_area, box_area, out=row_share, where=box_area > 0)
    share = np.zeros(len(box))
    np.maximum.at(share, row, row_share)
    return share

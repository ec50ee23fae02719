"""The image of the camera that sees the object of an event best, and where the boxes of the event are in it.

Nothing is drawn here. Edges of boxes are in pixels of the image, cut off where they come close to the camera.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from PIL import Image

from ..geometry import bev_corners
from ..sources.base import CameraImage
from ..types import Floats
from .focus import Focus

CLOSE = 0.5  # m before the camera: nearer parts of a box are cut off
_EDGES = np.array([[i, (i + 1) % 4] for i in range(4)])  # of the bottom, by corner
EDGES = np.concatenate([_EDGES, _EDGES + 4, np.column_stack([np.arange(4), np.arange(4) + 4])])  # [12, 2] of a box


@dataclass(frozen=True, eq=False)
class Photo:
    """An image with the boxes of an event."""

    image: CameraImage
    edges: tuple[tuple[str, Floats], ...]  # role, and edges [n, 2, 2] of a box, pixels
    middle: Floats  # [2] pixels, of the object
    extent: float  # pixels, the larger side of what is seen of the object

    @cached_property
    def picture(self) -> Image.Image | None:
        """The image, of the size that its projection is for; None where its file cannot be read."""
        try:
            with Image.open(self.image.path) as file:
                picture = file.convert("RGB")
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):  # SyntaxError: a broken PNG
            return None
        return picture if picture.size == self.image.size else picture.resize(self.image.size)


def photo_of(focus: Focus, t: int) -> Photo | None:
    """The image of frame ``t`` in which most of the object is seen; None where no camera sees it."""
    boxes = _boxes(focus, t)
    best: tuple[float, Photo] | None = None
    for image in (image for image in focus.replay.images if image.frame == t) if boxes else ():
        edges = projected(image.projection, boxes[0][1])
        area, low, high = _seen(edges, image.size)
        if area > 0 and (best is None or area > best[0]):
            rest = [(role, projected(image.projection, box)) for role, box in boxes[1:]]
            photo = Photo(image, ((boxes[0][0], edges), *rest), (low + high) / 2, float((high - low).max()))
            best = area, photo
    return None if best is None else best[1]


def photos_around(focus: Focus) -> dict[int, Photo | None]:
    """Photos of the frames t - 1, t and t + 1 that there are; empty where none is of the event's own frame."""
    now = photo_of(focus, focus.at.frame)
    if now is None:
        return {}
    frames = [t for t in (focus.at.frame - 1, focus.at.frame, focus.at.frame + 1) if 0 <= t < focus.replay.frames]
    return {t: now if t == focus.at.frame else photo_of(focus, t) for t in frames}


def projected(projection: Floats, box: Floats) -> Floats:
    """Edges [n, 2, 2] of a box [7] in an image, pixels; the parts of them that are close to the camera are left out."""
    corner = np.column_stack([bev_corners(box), np.full(4, box[2] - box[6] / 2)])
    corner = np.concatenate([corner, corner + np.array([0.0, 0.0, box[6]])])
    ends = (np.column_stack([corner, np.ones(8)]) @ projection.T)[EDGES]  # [12, 2, 3] pixels times metres, metres
    return np.array(list(_cut(ends))).reshape(-1, 2, 2)


def _cut(ends: Floats) -> Iterator[Floats]:
    """The edges [12, 2, 3] as far as they lie before the camera, each as [2, 2] pixels."""
    for a, b in ends:
        if max(a[2], b[2]) <= CLOSE:
            continue
        share = (CLOSE - a[2]) / (b[2] - a[2]) if min(a[2], b[2]) < CLOSE else 0.0
        at = a + share * (b - a)
        near = np.stack([at if a[2] < CLOSE else a, at if b[2] < CLOSE else b])
        yield near[:, :2] / near[:, 2:]


def _boxes(focus: Focus, t: int) -> list[tuple[str, Floats]]:
    """The boxes to draw, each with its role, first the one that has to be seen; none where nothing is there."""
    shown, at = focus.frame(t), focus.at
    boxes = [("truth", box) for box in shown.object_box] + [(track.role, track.box) for track in shown.tracks]
    if not boxes and at.kind == "spurious" and t == at.frame:  # a forecast without a track
        boxes = [("now", focus.replay.rollout.object_box[at.row].astype(np.float64))]
    return boxes


def _seen(edges: Floats, size: tuple[int, int]) -> tuple[float, Floats, Floats]:
    """Area (pixels) of the part of a box in the image, and that part's corners [2] with the least and largest x, y."""
    if not len(edges):
        return 0.0, np.zeros(2), np.zeros(2)
    point = edges.reshape(-1, 2)
    low, high = np.clip(point.min(axis=0), 0, size), np.clip(point.max(axis=0), 0, size)
    return float(np.prod(high - low)), low, high

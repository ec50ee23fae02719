"""Camera images of an event: the camera that sees the object best, with its boxes.

Edges of boxes are in pixels of the image, cut off close to the camera.
"""

import warnings
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw

from ..core import Floats, bev_corners
from ..sources import CameraImage
from .drawing.canvas import FINER, PAPER, font
from .focus import Focus
from .framing import frame_of
from .palette import BLACK, ROLES

CLOSE_M = 0.5  # before the camera: nearer parts of a box are cut off
HEIGHT = 300  # pixels of the row
CAPTION, TEXT, GAP = 26, 15, 12
AROUND = 2.5  # times the object that a small image shows
MIN_PX = 90.0  # of the image that it shows at least
_BOTTOM = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])  # by corner
_UPRIGHT = np.column_stack([np.arange(4), np.arange(4) + 4])
EDGES = np.concatenate([_BOTTOM, _BOTTOM + 4, _UPRIGHT])  # [12, 2] of a box


@dataclass(frozen=True, eq=False)
class Photo:
    """An image with the boxes of an event."""

    image: CameraImage
    edges: tuple[tuple[str, Floats], ...]  # role, and edges [n, 2, 2] of a box, pixels
    middle: Floats  # [2] pixels, of the object
    extent: float  # pixels, the larger side of what is seen of the object


def photo_of(focus: Focus) -> Photo | None:
    """Return the image that shows most of the object then.

    None if no camera sees it.
    """
    boxes = _event_boxes(focus)
    if not boxes:
        return None
    best = None
    best_area = 0.0
    for image in focus.replay.images:
        if image.frame != focus.at.frame:
            continue
        edges = [(role, projected(image.projection, box)) for role, box in boxes]
        _, object_edges = edges[0]
        points = np.clip(object_edges.reshape(-1, 2), 0, image.size)
        if not len(points):
            continue
        low = points.min(axis=0)
        high = points.max(axis=0)
        area = float(np.prod(high - low))  # of the part in the image
        if area > best_area:
            extent = float((high - low).max())
            best = Photo(image, tuple(edges), (low + high) / 2, extent)
            best_area = area
    return best


def _event_boxes(focus: Focus) -> list[tuple[str, Floats]]:
    """Return role and box of all marks, the object first."""
    shown = frame_of(focus, focus.at.frame)
    # the event is where the object is, or a track; detections alone do not show it
    boxes = [("truth", box) for box in shown.object_box]
    boxes += [(track.role, track.box) for track in shown.tracks]
    if not boxes and focus.at.kind == "spurious":  # a forecast without a track
        box = focus.replay.rollout.object_box[focus.at.row]
        boxes = [("now", box.astype(np.float64))]
    if boxes:
        boxes += [("detection", box) for box in shown.detection_box]
    return boxes


def projected(projection: Floats, box: Floats) -> Floats:
    """Project the edges of a box [7] to pixels [n, 2, 2].

    Parts that are close to the camera or behind it are cut off.
    """
    bottom = np.column_stack([bev_corners(box), np.full(4, box[2] - box[6] / 2)])
    corners = np.concatenate([bottom, bottom + np.array([0.0, 0.0, box[6]])])
    # [12, 2, 3] pixels times metres, metres
    ends = (np.column_stack([corners, np.ones(8)]) @ projection.T)[EDGES]
    ends = ends[ends[..., 2].max(axis=1) > CLOSE_M]
    # ends that are too close move along their edges to the depth CLOSE_M
    missing_m = np.maximum(CLOSE_M - ends[..., 2:], 0.0)  # [n, 2, 1]
    way = ends[:, ::-1] - ends
    depth_m = np.where(missing_m > 0, way[..., 2:], 1.0)  # 1: of ends that stay
    ends = ends + missing_m / depth_m * way
    return np.asarray(ends[..., :2] / ends[..., 2:])


def photo_row(photo: Photo, width_px: int) -> Image.Image:
    """Draw the image, and the object from near.

    The row has ``width_px`` x `HEIGHT` pixels. An image that cannot be read is named
    instead.
    """
    row = Image.new("RGB", (width_px, HEIGHT), PAPER)
    ink = ImageDraw.Draw(row)
    height_px = HEIGHT - CAPTION
    size_px = photo.image.size  # that its projection is for
    whole_width = min(round(height_px * size_px[0] / size_px[1]), (width_px - GAP) // 2)
    try:
        with (
            warnings.catch_warnings(action="ignore"),
            Image.open(photo.image.path) as file,
        ):
            picture = file.convert("RGB").resize(size_px)
    # SyntaxError: a broken PNG
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        text = f"{photo.image.path.name} cannot be read"
        ink.text((10, CAPTION + 6), text, BLACK, font(TEXT))
        return row
    near_px = max(MIN_PX, AROUND * photo.extent) / 2
    for left_px, right_px, radius_px, view in (
        (0, whole_width, np.inf, "whole"),
        (whole_width + GAP, width_px, near_px, "near the object"),
    ):
        part = _draw_part(photo, picture, (right_px - left_px, height_px), radius_px)
        row.paste(part, (left_px, CAPTION))
        ink.text((left_px + 10, 4), f"{photo.image.camera}, {view}", BLACK, font(TEXT))
    return row


def _draw_part(
    photo: Photo, picture: Image.Image, size_px: tuple[int, int], radius_px: float
) -> Image.Image:
    """Draw the ``picture`` of a photo with its boxes, in ``size_px`` pixels.

    It shows at most ``radius_px`` pixels of the picture on each side of the object,
    more along the longer side.
    """
    image_size = np.array(picture.size, dtype=np.float64)
    half = np.minimum(radius_px * np.array(size_px) / min(size_px), image_size / 2)
    # beside an edge of the picture the part is moved inside
    low = np.clip(photo.middle, half, image_size - half) - half
    scale = float(min(np.array(size_px) / (2 * half)))
    inner = np.maximum(1, np.rint(2 * half * scale)).astype(int)
    box = (*low.tolist(), *(low + 2 * half).tolist())
    part = picture.resize(tuple(inner * FINER), Image.Resampling.BILINEAR, box=box)
    ink = ImageDraw.Draw(part)
    for role, edges in photo.edges[::-1]:  # the object lies above its tracks
        for line in (edges - low) * scale * FINER:
            ink.line([tuple(point) for point in line.tolist()], ROLES[role], 2 * FINER)
    part_image = Image.new("RGB", size_px, PAPER)
    part_image.paste(
        part.reduce(FINER), tuple(((np.array(size_px) - inner) // 2).tolist())
    )
    return part_image

"""Camera images of an event: the camera that sees the object best, the boxes of the event in it, and a row of images.

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
from .framing import ROLES, frame_of
from .palette import BLACK

CLOSE = 0.5  # m before the camera: nearer parts of a box are cut off
HEIGHT = 300  # pixels of the row
CAPTION, TEXT, GAP = 26, 15, 12
AROUND = 2.5  # times the object that a small image shows
LEAST = 90.0  # pixels of the image that it shows at least
_BOTTOM = np.array([[i, (i + 1) % 4] for i in range(4)])  # by corner
EDGES = np.concatenate(
    [_BOTTOM, _BOTTOM + 4, np.column_stack([np.arange(4), np.arange(4) + 4])]
)  # [12, 2] of a box


@dataclass(frozen=True, eq=False)
class Photo:
    """An image with the boxes of an event."""

    image: CameraImage
    edges: tuple[tuple[str, Floats], ...]  # role, and edges [n, 2, 2] of a box, pixels
    middle: Floats  # [2] pixels, of the object
    extent: float  # pixels, the larger side of what is seen of the object


def photo_of(focus: Focus) -> Photo | None:
    """The image of the event's frame in which most of the object is seen; None if no camera sees it."""
    shown, at = frame_of(focus, focus.at.frame), focus.at
    boxes = [("truth", box) for box in shown.object_box] + [
        (track.role, track.box) for track in shown.tracks
    ]
    if not boxes and at.kind == "spurious":  # a forecast without a track
        boxes = [("now", focus.replay.rollout.object_box[at.row].astype(np.float64))]
    boxes += [("detection", box) for box in shown.detection_box if boxes]
    best, most = None, 0.0
    for image in focus.replay.images if boxes else ():
        if image.frame == at.frame:
            edges = [(role, projected(image.projection, box)) for role, box in boxes]
            points = np.clip(edges[0][1].reshape(-1, 2), 0, image.size)
            low, high = (
                (points.min(axis=0), points.max(axis=0))
                if len(points)
                else (np.zeros(2), np.zeros(2))
            )
            area = float(np.prod(high - low))  # of the part in the image
            if area > most:
                best, most = (
                    Photo(
                        image, tuple(edges), (low + high) / 2, float((high - low).max())
                    ),
                    area,
                )
    return best


def projected(projection: Floats, box: Floats) -> Floats:
    """Edges [n, 2, 2] of a box [7] in an image, pixels, without the parts that are close to the camera or behind."""
    corner = np.column_stack([bev_corners(box), np.full(4, box[2] - box[6] / 2)])
    corner = np.concatenate([corner, corner + np.array([0.0, 0.0, box[6]])])
    # [12, 2, 3] pixels times metres, metres
    ends = (np.column_stack([corner, np.ones(8)]) @ projection.T)[EDGES]
    ends = ends[ends[..., 2].max(axis=1) > CLOSE]
    behind = np.maximum(CLOSE - ends[..., 2:], 0.0)  # [n, 2, 1] m
    other = ends[:, ::-1]
    reach = np.where(behind > 0, other[..., 2:] - ends[..., 2:], 1.0)
    ends = ends + behind / reach * (other - ends)
    return np.asarray(ends[..., :2] / ends[..., 2:])


def photo_row(photo: Photo, wide: int) -> Image.Image:
    """A row of ``wide`` x HEIGHT pixels: the whole image, and the object from near."""
    row, high = Image.new("RGB", (wide, HEIGHT), PAPER), HEIGHT - CAPTION
    ink, whole = (
        ImageDraw.Draw(row),
        min(round(high * photo.image.size[0] / photo.image.size[1]), (wide - GAP) // 2),
    )
    try:
        with (
            warnings.catch_warnings(action="ignore"),
            Image.open(photo.image.path) as file,
        ):
            picture = file.convert("RGB").resize(
                photo.image.size
            )  # that its projection is for
    except (
        OSError,
        ValueError,
        SyntaxError,
        Image.DecompressionBombError,
    ):  # SyntaxError: a broken PNG
        ink.text(
            (10, CAPTION + 6),
            f"{photo.image.path.name} cannot be read",
            fill=BLACK,
            font=font(TEXT),
        )
        return row
    near = max(LEAST, AROUND * photo.extent) / 2
    for left, right, reach, view in (
        (0, whole, np.inf, "whole"),
        (whole + GAP, wide, near, "near the object"),
    ):
        row.paste(_drawn(photo, picture, (right - left, high), reach), (left, CAPTION))
        ink.text(
            (left + 10, 4), f"{photo.image.camera}, {view}", fill=BLACK, font=font(TEXT)
        )
    return row


def _drawn(
    photo: Photo, picture: Image.Image, size: tuple[int, int], reach: float
) -> Image.Image:
    """The ``picture`` of a photo with its boxes in ``size`` pixels, at most ``reach`` pixels of it around the event."""
    whole = np.array(picture.size, dtype=np.float64)
    half = np.minimum(reach * np.array(size) / min(size), whole / 2)
    low = np.clip(photo.middle, half, whole - half) - half
    scale = float(min(np.array(size) / (2 * half)))
    inner = np.maximum(1, np.rint(2 * half * scale)).astype(int)
    box = (*low.tolist(), *(low + 2 * half).tolist())
    part = picture.resize(tuple(inner * FINER), Image.Resampling.BILINEAR, box=box)
    ink = ImageDraw.Draw(part)
    for role, edges in photo.edges[::-1]:  # the object lies above its tracks
        for line in (edges - low) * scale * FINER:
            ink.line(
                [tuple(point) for point in line.tolist()],
                fill=ROLES[role],
                width=2 * FINER,
            )
    drawn = Image.new("RGB", size, PAPER)
    drawn.paste(part.reduce(FINER), tuple(((np.array(size) - inner) // 2).tolist()))
    return drawn

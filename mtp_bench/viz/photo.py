"""Camera images of an event: the camera that sees the object best, the boxes of the event in it, and a row of images.

Edges of boxes are in pixels of the image, cut off close to the camera.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from PIL import Image, ImageDraw

from ..geometry import bev_corners
from ..sources.base import CameraImage
from ..types import Floats
from .drawing.canvas import EDGE, FINER, PAPER, font
from .focus import ROLES, Focus
from .palette import BLACK

CLOSE = 0.5  # m before the camera: nearer parts of a box are cut off
HEIGHT = 300  # pixels of the row
CAPTION, TEXT = 26, 15
AROUND = 2.5  # times the object that a small image shows
LEAST = 90.0  # pixels of the image that it shows at least
_BOTTOM = np.array([[i, (i + 1) % 4] for i in range(4)])  # by corner
EDGES = np.concatenate([_BOTTOM, _BOTTOM + 4, np.column_stack([np.arange(4), np.arange(4) + 4])])  # [12, 2] of a box


@dataclass(frozen=True, eq=False)
class Photo:
    """An image with the boxes of an event."""

    image: CameraImage
    edges: tuple[tuple[str, Floats], ...]  # role, and edges [n, 2, 2] of a box, pixels
    middle: Floats  # [2] pixels, of the object
    extent: float  # pixels, the larger side of what is seen of the object

    @cached_property
    def picture(self) -> Image.Image | None:
        """The image, of the size that its projection is for; None if its file cannot be read."""
        try:
            with Image.open(self.image.path) as file:
                picture = file.convert("RGB")
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):  # SyntaxError: a broken PNG
            return None
        return picture if picture.size == self.image.size else picture.resize(self.image.size)


def photo_of(focus: Focus, t: int) -> Photo | None:
    """The image of frame ``t`` in which most of the object is seen; None if no camera sees it."""
    shown, at = focus.frame(t), focus.at
    boxes = [("truth", box) for box in shown.object_box] + [(track.role, track.box) for track in shown.tracks]
    if not boxes and at.kind == "spurious" and t == at.frame:  # a forecast without a track
        boxes = [("now", focus.replay.rollout.object_box[at.row].astype(np.float64))]
    best, most = None, 0.0
    for image in focus.replay.images if boxes else ():
        if image.frame != t:
            continue
        edges = [(role, projected(image.projection, box)) for role, box in boxes]
        points = np.clip(edges[0][1].reshape(-1, 2), 0, image.size)
        low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
        area = float(np.prod(high - low))  # of the part in the image
        if area > most:
            best, most = Photo(image, tuple(edges), (low + high) / 2, float((high - low).max())), area
    return best


def photos_around(focus: Focus) -> dict[int, Photo | None]:
    """Photos of the frames t - 1, t and t + 1 of the scene; empty if none shows the event's own frame."""
    at = focus.at.frame
    now = photo_of(focus, at)
    if now is None:
        return {}
    frames = [t for t in (at - 1, at, at + 1) if 0 <= t < focus.replay.frames]
    return {t: now if t == at else photo_of(focus, t) for t in frames}


def projected(projection: Floats, box: Floats) -> Floats:
    """Edges [n, 2, 2] of a box [7] in an image, pixels, without the parts that are close to the camera or behind."""
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


def photo_row(focus: Focus, photos: dict[int, Photo | None], wide: int) -> Image.Image:
    """A row of ``wide`` x HEIGHT pixels: the image of the event's frame, and t - 1, t and t + 1 from near."""
    t, row = focus.at.frame, Image.new("RGB", (wide, HEIGHT), PAPER)
    now = photos[t]
    assert now is not None, "a row is drawn if the event is seen"
    ink = ImageDraw.Draw(row)
    width = min(round((HEIGHT - CAPTION) * now.image.size[0] / now.image.size[1]), wide // 2)
    _paste(row, ink, now, f"{now.image.camera}, {focus.case.seconds(t):.1f} s", (0, width), None)
    own = {s: photo for s, photo in photos.items() if photo is not None}
    reach = max([LEAST, *(AROUND * photo.extent for photo in own.values())]) / 2
    for i, (s, name) in enumerate(((t - 1, "t - 1"), (t, "t"), (t + 1, "t + 1"))):
        left, right = (width + (wide - width) * j // 3 for j in (i, i + 1))
        if s in own:
            other = "" if own[s].image.camera == now.image.camera else f", {own[s].image.camera}"
            _paste(row, ink, own[s], name + other, (left, right), reach)
        elif s in photos:
            ink.text((left + 10, 4), f"{name}: no image shows it", fill=BLACK, font=font(TEXT))
        ink.rectangle([left, 0, right - 1, HEIGHT - 1], outline=EDGE)
    ink.rectangle([0, 0, width - 1, HEIGHT - 1], outline=EDGE)
    return row


def _paste(
    row: Image.Image, ink: ImageDraw.ImageDraw, photo: Photo, title: str, place: tuple[int, int], reach: float | None
) -> None:
    """An image with its title between two columns of the row."""
    ink.text((place[0] + 10, 4), title, fill=BLACK, font=font(TEXT))
    drawn = draw_photo(photo, (place[1] - place[0], HEIGHT - CAPTION), reach)
    if drawn is None:
        ink.text((place[0] + 10, CAPTION + 6), f"{photo.image.path.name[:24]}", fill=BLACK, font=font(TEXT))
        ink.text((place[0] + 10, CAPTION + 26), "cannot be read", fill=BLACK, font=font(TEXT))
    else:
        row.paste(drawn, (place[0], CAPTION))


def draw_photo(photo: Photo, size: tuple[int, int], reach: float | None = None) -> Image.Image | None:
    """The image with the boxes in ``size`` pixels; None if its file cannot be read.

    ``reach``: only so many pixels of it around the object, as far as it has them; None: all of it.
    """
    picture = photo.picture
    if picture is None:
        return None
    low: Floats = np.zeros(2)
    high: Floats = np.array(picture.size, dtype=np.float64)
    if reach is not None:
        half = np.minimum(reach * np.array(size) / min(size), high / 2)
        center = np.clip(photo.middle, half, high - half)
        low, high = center - half, center + half
    scale = float(min(np.array(size) / (high - low)))
    inner = np.maximum(1, np.rint((high - low) * scale)).astype(int)
    part = picture.resize(tuple(inner * FINER), Image.Resampling.BILINEAR, box=(*low.tolist(), *high.tolist()))
    ink = ImageDraw.Draw(part)
    for role, edges in photo.edges[::-1]:  # the object lies above its tracks
        for line in (edges - low) * scale * FINER:
            ink.line([tuple(point) for point in line.tolist()], fill=ROLES[role], width=2 * FINER)
    drawn = Image.new("RGB", size, PAPER)
    drawn.paste(part.reduce(FINER), tuple(((np.array(size) - inner) // 2).tolist()))
    return drawn

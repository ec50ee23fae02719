"""Images of a camera with the boxes of an event: the whole one, and small ones of the frames around it from near."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw

from ...types import Floats
from ..focus import ROLES, Focus
from ..palette import BLACK
from ..photo import Photo
from .canvas import EDGE, FINER, PAPER, font

HEIGHT = 300  # pixels of the row
CAPTION, TEXT = 26, 15
AROUND = 2.5  # times the object that a small image shows
LEAST = 90.0  # pixels of the image that it shows at least


def photo_row(focus: Focus, photos: dict[int, Photo | None], wide: int) -> Image.Image:
    """A row of ``wide`` x HEIGHT pixels: the image of the event's frame, and t - 1, t and t + 1 from near."""
    t, row = focus.at.frame, Image.new("RGB", (wide, HEIGHT), PAPER)
    now = photos[t]
    assert now is not None, "a row is drawn where the event is seen"
    ink = ImageDraw.Draw(row)
    width = min(round((HEIGHT - CAPTION) * now.image.size[0] / now.image.size[1]), wide // 2)
    _paste(row, ink, now, f"{now.image.camera}, {focus.case.seconds(t):.1f} s", (0, width), None)
    own = {s: photo for s, photo in photos.items() if photo is not None}
    reach = max([LEAST, *(AROUND * photo.extent for photo in own.values())]) / 2
    for i, s in enumerate((t - 1, t, t + 1)):
        left, right = (width + (wide - width) * j // 3 for j in (i, i + 1))
        name = {-1: "t - 1", 0: "t", 1: "t + 1"}[s - t]
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
    size = place[1] - place[0], HEIGHT - CAPTION
    ink.text((place[0] + 10, 4), title, fill=BLACK, font=font(TEXT))
    drawn = draw_photo(photo, size, reach)
    if drawn is None:
        ink.text((place[0] + 10, CAPTION + 6), f"{photo.image.path.name[:24]}", fill=BLACK, font=font(TEXT))
        ink.text((place[0] + 10, CAPTION + 26), "cannot be read", fill=BLACK, font=font(TEXT))
    else:
        row.paste(drawn, (place[0], CAPTION))


def draw_photo(photo: Photo, size: tuple[int, int], reach: float | None = None) -> Image.Image | None:
    """The image with the boxes in ``size`` pixels; None where its file cannot be read.

    ``reach``: only so many pixels of it around the object, or what is there of them; None: all of it.
    """
    picture = photo.picture
    if picture is None:
        return None
    whole = np.array([[0.0, 0.0], picture.size])
    low, high = whole if reach is None else _window(photo.middle, reach, size, whole[1])
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


def _window(middle: Floats, reach: float, size: tuple[int, int], most: Floats) -> tuple[Floats, Floats]:
    """The part of an image around ``middle``, of the shape of ``size`` and within the image of ``most`` pixels."""
    half = np.minimum(reach * np.array(size) / min(size), most / 2)
    center = np.clip(middle, half, most - half)
    return center - half, center + half

"""Camera images of an event in a recording, with the boxes of the event in them."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO

import numpy as np

from ...types import Floats
from ..focus import Focus
from ..photo import Photo, photo_of
from .colors import Colors, packed
from .entities import Log, frame_times
from .focus import COLORS, frames_around, shown_in
from .sdk import rr

PATH = "focus/camera"
QUALITY = 85  # of a JPEG
WIDTH = -1.2  # half the width of lines: negative numbers are points of the screen


def log_camera(recording: rr.RecordingStream, focus: Focus) -> None:
    """Log the image of the camera that sees the object best in each frame around the event; nothing without images."""
    if photo_of(focus, focus.at.frame) is None:  # then there is no view of them either
        return
    frames = frames_around(focus)
    photos = [photo_of(focus, t) if shown_in(focus, t) else None for t in frames.tolist()]
    blobs = [_jpeg(photo) for photo in photos]
    found = [blob for blob in blobs if blob is not None]
    if not found:
        return
    there = np.array([blob is not None for blob in blobs], dtype=int)
    log = Log(recording, frame_times(focus.replay.scene, frames))
    images = rr.EncodedImage.columns(blob=found, media_type=["image/jpeg"] * len(found)).partition(there)
    log.columns(PATH, rr.EncodedImage.from_fields(draw_order=-1.0), images)
    lines, colors, count = _edges(photos)
    strips = rr.LineStrips2D.columns(strips=lines, colors=packed(colors)).partition(count)
    log.columns(f"{PATH}/box", rr.LineStrips2D.from_fields(radii=WIDTH), strips)


def _edges(photos: Sequence[Photo | None]) -> tuple[list[Floats], Colors, list[int]]:
    """Edges of the boxes over the frames, their colours, and how many there are in each frame."""
    rows = [
        [(role, line) for role, edges in ([] if photo is None else photo.edges) for line in edges] for photo in photos
    ]
    colors = np.array([COLORS[role] for row in rows for role, _ in row], dtype=np.uint8).reshape(-1, 3)
    return [line for row in rows for _, line in row], colors, [len(row) for row in rows]


def _jpeg(photo: Photo | None) -> bytes | None:
    """The image as JPEG, which a recording has room for; None where there is none, or its file cannot be read."""
    picture = None if photo is None else photo.picture
    if picture is None:
        return None
    content = BytesIO()
    picture.save(content, "JPEG", quality=QUALITY)
    return content.getvalue()

"""Images of the cameras of a recording, which pictures of events show; nothing else depends on them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..types import Floats


@dataclass(frozen=True, eq=False)
class CameraImage:
    """One image, found but not read."""

    frame: int
    camera: str  # such as "CAM_FRONT"
    path: Path
    size: tuple[int, int]  # pixels, width and height, that ``projection`` is for
    projection: Floats  # [3, 4] from the scene's frame of reference, homogeneous, to pixels; its third row gives metres

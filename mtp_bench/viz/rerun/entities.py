"""Entities of a recording: boxes and polylines over frames, the map, the sensor platform."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...types import Floats, Ints, Scene
from . import arrays as arrays
from .arrays import BoxRows, Strips
from .colors import BORDER, CENTER, packed
from .sdk import rr

TRAIL, FUTURE, FORECAST, EDGE = 0.14, 0.09, 0.035, 0.05  # m, half the width of lines
TRACK_FILL = "transparentfillmajorwireframe"


def log_map(recording: rr.RecordingStream, scene: Scene, root: str = "") -> None:
    """What does not move."""
    recording.log(f"{root}world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for name, color in (("center", CENTER), ("border", BORDER)):
        lines = arrays.map_lines(scene, border=name == "border")
        if lines:
            recording.log(f"{root}world/map/{name}", rr.LineStrips3D(lines, colors=color, radii=EDGE), static=True)


def frame_times(scene: Scene, frames: Ints | None = None) -> list[rr.TimeColumn]:
    """Both timelines at ``frames``, by default all: numbers of frames, and seconds since the first."""
    frames = np.arange(scene.frames) if frames is None else frames
    seconds = (scene.time - scene.time[0])[frames]
    return [
        rr.TimeColumn("frame", sequence=frames),
        rr.TimeColumn("time", duration=np.rint(seconds * 1e9).astype("timedelta64[ns]")),
    ]


def log_ego(recording: rr.RecordingStream, root: str, times: list[rr.TimeColumn], ego: Floats) -> None:
    """The sensor platform at poses [F, 4]; and a frame that moves along with it, without turning, for views."""
    log_boxes(recording, f"{root}world/ego", times, arrays.ego_boxes(ego), "solid")
    place = rr.Transform3D.columns(translation=ego[:, :3].astype(np.float32))
    recording.send_columns(f"{root}world/follow", times, place)


def log_boxes(
    recording: rr.RecordingStream,
    path: str,
    times: list[rr.TimeColumn],
    rows: BoxRows,
    fill: Any,
    radius: float = EDGE,
) -> None:
    """Boxes of the frames of ``times``; a frame without any shows none."""
    style = rr.Boxes3D.from_fields(fill_mode=fill, radii=radius, show_labels=False)
    recording.log(path, style, static=True)
    columns = rr.Boxes3D.columns(
        centers=rows.box[:, :3],
        half_sizes=rows.box[:, 4:7] / 2,
        quaternions=arrays.quaternions(rows.box[:, 3]),
        colors=packed(rows.color),
        labels=rows.label or None,
    )
    recording.send_columns(path, times, columns.partition(rows.count))


def log_strips(
    recording: rr.RecordingStream, path: str, times: list[rr.TimeColumn], lines: Strips, radius: float
) -> None:
    """Polylines of the frames of ``times``; a frame without any shows none."""
    recording.log(path, rr.LineStrips3D.from_fields(radii=radius), static=True)
    columns = rr.LineStrips3D.columns(strips=lines.point, colors=packed(lines.color))
    recording.send_columns(path, times, columns.partition(lines.count))

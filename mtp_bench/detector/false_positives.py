"""Common parts of both kinds of false positives: places, classes, sizes, rows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core import (
    Detections,
    Floats,
    Ints,
    Truth,
    joined,
    select,
    starts_of,
    unit_vectors,
)
from .draws import Memory
from .errors import BoxErrors, detected_boxes
from .profile import DISTANCE_RANKS, ClassNoise
from .visibility import Sensor, polar

_SIZE_DEVIATION = 0.1  # of each side, share of its mean
_MIN_SIZE = 0.3  # of each side, share of its mean
# drawn until a place is inside the area, first of the bearing alone and then as often
# of bearing and distance
_MAX_BEARINGS = 100
# random part of the quality that decides the errors of false positives
_FALSE_QUALITY = -1.0


@dataclass(frozen=True, eq=False)
class SensedScene:
    """True boxes of a scene and the sensor that observes them."""

    truth: Truth
    ego: Floats  # [F, 4] x y z yaw of the sensor
    sensor: Sensor
    steps: float  # frame periods of the profile per frame of the scene
    field_ratio: float  # field of view of the sensor over that of the profile
    level: float | None = None  # m, of a flat ground; None: as the true boxes stand
    memory: Memory | None = None  # if its last frame alone is asked for


@dataclass(frozen=True, eq=False)
class DetectedRows:
    """Detected boxes of a scene in any order."""

    frame: Ints  # [R]
    box: Floats  # [R, 7]
    velocity: Floats  # [R, 2] m/s, NaN where not measured
    class_id: Ints  # [R]
    score: Floats  # [R]


def sorted_detections(parts: Sequence[DetectedRows], frames: int) -> Detections:
    """Return detections sorted by frame, descending score and x.

    This order does not show which detections are false.
    """
    rows = joined(parts)
    row_order = np.lexsort((rows.box[:, 0], -rows.score, rows.frame))
    frame_starts = starts_of(np.bincount(rows.frame, minlength=frames))
    return Detections(
        frame_starts,
        rows.box[row_order],
        rows.velocity[row_order],
        rows.class_id[row_order],
        rows.score[row_order],
    )


def detect_false_positives(
    parts: Sequence[tuple[BoxErrors, DetectedRows]], scene: SensedScene
) -> DetectedRows:
    """Return detections of the visible false positives that the sensor covers.

    Their errors are those of true objects of poor quality.
    """
    errors = joined([part for part, _ in parts])
    visible = joined([rows for _, rows in parts])
    distance_m, bearing_rad = polar(visible.box[:, :2], scene.ego[visible.frame])
    covered = np.flatnonzero(scene.sensor.covers(distance_m, bearing_rad))
    visible = select(visible, covered)
    box, velocity = detected_boxes(
        visible.box,
        visible.velocity,
        select(errors, covered),
        distance_m[covered],
        bearing_rad[covered] + scene.ego[visible.frame, 3],
        np.full(len(covered), _FALSE_QUALITY),
    )
    return replace(visible, box=box, velocity=velocity)


def draw_places(
    quantiles: Sequence[float],
    sensor: Sensor,
    ego: Floats,
    numbers: Callable[[], Floats],
) -> Floats:
    """Draw places [B, 2] around sensor poses [B, 4].

    Their distances from the sensor have the given quantiles. ``numbers`` returns new
    uniform numbers [B, 2]. A place outside the sensor's area gets a new bearing; if no
    bearing fits, also a new distance.
    """
    area = sensor.area
    if area is None:
        area = -np.inf, -np.inf, np.inf, np.inf
    view_rad = min(sensor.field_of_view, 2 * np.pi)
    uniform = numbers()
    for attempt in range(2 * _MAX_BEARINGS + 1):
        distance_m = np.interp(uniform[:, 0], DISTANCE_RANKS, quantiles)
        direction_rad = ego[:, 3] + view_rad * (uniform[:, 1] - 0.5)
        place_xy = ego[:, :2] + distance_m[:, None] * unit_vectors(direction_rad)
        outside_area = ((place_xy < area[:2]) | (place_xy > area[2:])).any(axis=1)
        if not outside_area.any():
            break
        redrawn_numbers = numbers()
        uniform[outside_area, 1] = redrawn_numbers[outside_area, 1]
        if attempt >= _MAX_BEARINGS:
            uniform[outside_area, 0] = redrawn_numbers[outside_area, 0]
    # the loop runs at least once
    return place_xy  # pyright: ignore[reportPossiblyUnboundVariable]


def ground_height(place_xy: Floats, frame: Ints, scene: SensedScene) -> Floats:
    """Return the height of the ground at places [B, 2].

    The ground is where the nearest true box of the frame stands. In a frame without
    true boxes it is as far above or below the ego as the median underside of boxes in
    the scene.
    """
    if scene.level is not None:
        return np.full(len(place_xy), scene.level)
    truth = scene.truth
    ego_z = scene.ego[:, 2]
    underside = truth.box[:, 2] - truth.box[:, 6] / 2
    above_sensor_m = underside - ego_z[truth.frame_of_rows]
    ground_z = ego_z[frame] + (
        np.median(above_sensor_m) if len(above_sensor_m) else 0.0
    )
    row_order = np.argsort(frame, kind="stable")
    frame_starts = np.searchsorted(frame[row_order], np.arange(truth.frames + 1))
    for used_frame in np.flatnonzero(np.diff(frame_starts)):
        rows = truth.rows(int(used_frame))
        place_index = row_order[frame_starts[used_frame] : frame_starts[used_frame + 1]]
        if rows.stop > rows.start:
            squared_offset = place_xy[place_index, :, None] - truth.box[rows, :2].T
            squared_offset *= squared_offset
            nearest_rows = (squared_offset[:, 0] + squared_offset[:, 1]).argmin(axis=1)
            ground_z[place_index] = underside[rows][nearest_rows]
    return np.asarray(ground_z)


@dataclass(frozen=True, eq=False)
class ReportedClasses:
    """Classes under which the detector reports false positives of one noise."""

    class_id: Ints  # [K]
    share: Floats  # [K] sum 1
    size: Floats  # [K, 3] m, mean length, width, height


def reported_classes(
    truth: Truth,
    classes: Sequence[str],
    noise_names: Sequence[str],
    noise_name: str,
    noise: ClassNoise,
) -> ReportedClasses | None:
    """Return the classes that have the noise ``noise_name``.

    ``noise_names``: name of the noise of each of the ``classes``. The share of a class
    is proportional to its number of true boxes in the scene. Without such boxes: the
    class of that name, or the first one with this noise, with the size of
    ``noise.free``. None if no class has the noise, or it has no free false positives.
    """
    free = noise.free
    candidates = np.flatnonzero(np.array(noise_names) == noise_name)
    if not len(candidates) or free is None or not free.rate:
        return None
    box_counts = np.bincount(truth.class_id, minlength=len(classes))
    present_classes = candidates[box_counts[candidates] > 0]
    if not len(present_classes):
        same_name = candidates[np.array(classes)[candidates] == noise_name]
        single_class = same_name[:1] if len(same_name) else candidates[:1]
        return ReportedClasses(single_class, np.ones(1), np.array([free.size]))
    mean_sizes = [
        truth.box[truth.class_id == k, 4:].mean(axis=0) for k in present_classes
    ]
    class_share = box_counts[present_classes] / box_counts[present_classes].sum()
    return ReportedClasses(present_classes, class_share, np.array(mean_sizes))


def spread_sizes(size: Floats, normal: Floats) -> Floats:
    """Return sizes [B, 3] of false positives around mean sizes.

    ``normal``: standard normal numbers.
    """
    return np.asarray(size * np.maximum(1.0 + _SIZE_DEVIATION * normal, _MIN_SIZE))

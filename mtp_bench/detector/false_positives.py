"""Common parts of both kinds of false positives: places, classes, sizes and their detections."""

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
from .errors import BoxErrors, detected_boxes
from .grid import Memory
from .profile import EVEN_RANKS, ClassNoise
from .visibility import Sensor, polar

_SPREAD = 0.1  # deviation of each side, share of its mean
_SMALLEST = 0.3  # least side, share of its mean
_TRIES = 100  # bearings drawn until a place is inside the area
_POOR = -1.0  # random part of the quality that decides the errors of false positives


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
    """Detections sorted by frame, descending score and x, so that their order does not show which are false."""
    rows = joined(parts)
    order = np.lexsort((rows.box[:, 0], -rows.score, rows.frame))
    start = starts_of(np.bincount(rows.frame, minlength=frames))
    return Detections(
        start,
        rows.box[order],
        rows.velocity[order],
        rows.class_id[order],
        rows.score[order],
    )


def detect_false_positives(
    parts: Sequence[tuple[BoxErrors, DetectedRows]], scene: SensedScene
) -> DetectedRows:
    """Detections of the visible false positives that the sensor covers, with their errors, those of poor quality."""
    errors, visible = (
        joined([each for each, _ in parts]),
        joined([each for _, each in parts]),
    )
    distance, bearing = polar(visible.box[:, :2], scene.ego[visible.frame])
    covered = np.flatnonzero(scene.sensor.covers(distance, bearing))
    visible, errors, distance = (
        select(visible, covered),
        select(errors, covered),
        distance[covered],
    )
    direction, quality = (
        bearing[covered] + scene.ego[visible.frame, 3],
        np.full(len(distance), _POOR),
    )
    box, velocity = detected_boxes(
        visible.box, visible.velocity, errors, distance, direction, quality
    )
    return replace(visible, box=box, velocity=velocity)


def draw_places(
    quantiles: Sequence[float],
    sensor: Sensor,
    ego: Floats,
    numbers: Callable[[], Floats],
) -> Floats:
    """Draw places ``[B, 2]`` around sensor poses ``[B, 4]``, at distances with these quantiles.

    ``numbers``: new uniform ones ``[B, 2]``. A place outside the sensor's area gets a new bearing; if no bearing fits,
    also a new distance.
    """
    low, high = (
        (-np.inf, np.inf) if sensor.area is None else (sensor.area[:2], sensor.area[2:])
    )
    uniform = numbers()
    for attempt in range(2 * _TRIES + 1):
        distance = np.interp(uniform[:, 0], EVEN_RANKS, quantiles)
        direction = ego[:, 3] + min(sensor.field_of_view, 2 * np.pi) * (
            uniform[:, 1] - 0.5
        )
        place = ego[:, :2] + distance[:, None] * unit_vectors(direction)
        outside = ((place < low) | (place > high)).any(axis=1)
        if not outside.any():
            break
        redrawn = numbers()
        uniform[outside, 1] = redrawn[outside, 1]
        if attempt >= _TRIES:
            uniform[outside, 0] = redrawn[outside, 0]
    return place  # pyright: ignore[reportPossiblyUnboundVariable]  # the loop runs at least once


def ground_height(place: Floats, frame: Ints, scene: SensedScene) -> Floats:
    """Height of the ground at places ``[B, 2]``: the underside of the nearest true box of the frame.

    In a frame without true boxes: as high above the ego as the median underside in the scene.
    """
    truth, ego = scene.truth, scene.ego
    if scene.level is not None:
        return np.full(len(place), scene.level)
    underside = truth.box[:, 2] - truth.box[:, 6] / 2
    above = underside - ego[truth.frame_of_rows, 2]
    ground = ego[frame, 2] + (np.median(above) if len(above) else 0.0)
    order = np.argsort(frame, kind="stable")
    start = np.searchsorted(frame[order], np.arange(truth.frames + 1))
    for t in np.flatnonzero(np.diff(start)):
        rows, index = truth.rows(int(t)), order[start[t] : start[t + 1]]
        if rows.stop > rows.start:
            offset = place[index, :, None] - truth.box[rows, :2].T
            offset *= offset
            ground[index] = underside[rows][
                (offset[:, 0] + offset[:, 1]).argmin(axis=1)
            ]
    return np.asarray(ground)


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
    """The ``classes`` that have the noise ``noise_name``, in proportion to their true boxes in the scene.

    ``noise_names``: of each class. Without such boxes: the class of that name, or the first one with this noise, with
    the size of ``noise.free``. None if no class has the noise, and without free false positives.
    """
    free, candidates = (
        noise.free,
        [class_id for class_id, name in enumerate(noise_names) if name == noise_name],
    )
    if not candidates or free is None or not free.rate:
        return None
    boxes = np.bincount(truth.class_id, minlength=len(classes))
    present = [class_id for class_id in candidates if boxes[class_id]]
    if present:
        means = [
            truth.box[truth.class_id == class_id, 4:].mean(axis=0)
            for class_id in present
        ]
        return ReportedClasses(
            np.array(present), boxes[present] / boxes[present].sum(), np.array(means)
        )
    single = next(
        (class_id for class_id in candidates if classes[class_id] == noise_name),
        candidates[0],
    )
    return ReportedClasses(np.array([single]), np.ones(1), np.array([free.size]))


def spread_sizes(size: Floats, normal: Floats) -> Floats:
    """Sizes ``[B, 3]`` of false positives around mean sizes, from standard normal numbers."""
    return np.asarray(size * np.maximum(1.0 + _SPREAD * normal, _SMALLEST))

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
from .errors import BoxErrors, detected_boxes
from .memory import Memory
from .profile import EVEN_RANKS, ClassNoise
from .visibility import Sensor, polar

_SIZE_DEVIATION = 0.1  # of each side, share of its mean
_MIN_SIZE = 0.3  # of each side, share of its mean
_MAX_BEARINGS = 100  # drawn until a place is inside the area
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

    So their order does not show which are false.
    """
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
    """Return detections of the visible false positives that the sensor covers.

    They have the errors of objects of poor quality.
    """
    errors = joined([part for part, _ in parts])
    visible = joined([rows for _, rows in parts])
    distance, bearing = polar(visible.box[:, :2], scene.ego[visible.frame])
    covered = np.flatnonzero(scene.sensor.covers(distance, bearing))
    visible = select(visible, covered)
    box, velocity = detected_boxes(
        visible.box,
        visible.velocity,
        select(errors, covered),
        distance[covered],
        bearing[covered] + scene.ego[visible.frame, 3],
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

    Their distances have these quantiles. ``numbers``: new uniform ones [B, 2]. A place
    outside the sensor's area gets a new bearing; if no bearing fits, also a new
    distance.
    """
    area = (-np.inf,) * 2 + (np.inf,) * 2 if sensor.area is None else sensor.area
    view = min(sensor.field_of_view, 2 * np.pi)
    uniform = numbers()
    for attempt in range(2 * _MAX_BEARINGS + 1):
        distance = np.interp(uniform[:, 0], EVEN_RANKS, quantiles)
        direction = ego[:, 3] + view * (uniform[:, 1] - 0.5)
        place = ego[:, :2] + distance[:, None] * unit_vectors(direction)
        outside = ((place < area[:2]) | (place > area[2:])).any(axis=1)
        if not outside.any():
            break
        redrawn = numbers()
        uniform[outside, 1] = redrawn[outside, 1]
        if attempt >= _MAX_BEARINGS:
            uniform[outside, 0] = redrawn[outside, 0]
    # the loop runs at least once
    return place  # pyright: ignore[reportPossiblyUnboundVariable]


def ground_height(place: Floats, frame: Ints, scene: SensedScene) -> Floats:
    """Return the height of the ground at places [B, 2].

    It is the underside of the nearest true box of the frame; in a frame without true
    boxes, as high above the ego as the median underside in the scene.
    """
    if scene.level is not None:
        return np.full(len(place), scene.level)
    truth = scene.truth
    ego_z = scene.ego[:, 2]
    underside = truth.box[:, 2] - truth.box[:, 6] / 2
    above = underside - ego_z[truth.frame_of_rows]
    ground = ego_z[frame] + (np.median(above) if len(above) else 0.0)
    order = np.argsort(frame, kind="stable")
    start = np.searchsorted(frame[order], np.arange(truth.frames + 1))
    for t in np.flatnonzero(np.diff(start)):
        rows = truth.rows(int(t))
        index = order[start[t] : start[t + 1]]
        if rows.stop > rows.start:
            offset = place[index, :, None] - truth.box[rows, :2].T
            offset *= offset
            nearest = (offset[:, 0] + offset[:, 1]).argmin(axis=1)
            ground[index] = underside[rows][nearest]
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
    """Return the ``classes`` that have the noise ``noise_name``.

    They have shares in proportion to their true boxes in the scene. ``noise_names``: of
    each class. Without such boxes: the class of that name, or the first one with this
    noise, with the size of ``noise.free``. None if no class has the noise, and without
    free false positives.
    """
    free = noise.free
    candidates = np.flatnonzero(np.array(noise_names) == noise_name)
    if not len(candidates) or free is None or not free.rate:
        return None
    boxes = np.bincount(truth.class_id, minlength=len(classes))
    present = candidates[boxes[candidates] > 0]
    if not len(present):
        same_name = candidates[np.array(classes)[candidates] == noise_name]
        single = [*same_name, *candidates][:1]
        return ReportedClasses(np.array(single), np.ones(1), np.array([free.size]))
    sizes = [truth.box[truth.class_id == k, 4:].mean(axis=0) for k in present]
    share = boxes[present] / boxes[present].sum()
    return ReportedClasses(present, share, np.array(sizes))


def spread_sizes(size: Floats, normal: Floats) -> Floats:
    """Return sizes [B, 3] of false positives around mean sizes.

    ``normal``: standard normal numbers.
    """
    return np.asarray(size * np.maximum(1.0 + _SIZE_DEVIATION * normal, _MIN_SIZE))

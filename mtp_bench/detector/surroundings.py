"""Where false positives appear in a scene, and what they look like there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..types import Floats, Ints, Truth
from .sight import Sensor

_SPREAD = 0.1  # deviation of each side, share of its mean
_SMALLEST = 0.3  # share of its mean that every side keeps
_TRIES = 100  # bearings drawn for a place until it is inside of the area


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Where false positives appear."""

    truth: Truth
    ego: Floats  # [F, 4] x y z yaw of the sensor
    sensor: Sensor
    steps: float  # frame periods of the profile per frame of the scene
    wider: float  # the sensor's field of view over that of the profile


def places(law: Sequence[float], sensor: Sensor, ego: Floats, rng: np.random.Generator) -> Floats:
    """Places ``[B, 2]`` seen from poses ``[B, 4]``, at distances by the quantiles ``law``.

    The bearing is drawn anew while the place is off the sensor's area, and the distance too where no bearing will do.
    """
    uniform = rng.random((len(ego), 2))
    place = _placed(law, sensor, ego, uniform)
    if sensor.area is None:
        return place
    low, high = sensor.area[:2], sensor.area[2:]
    for attempt in range(2 * _TRIES):
        off = ((place < low) | (place > high)).any(axis=1)
        if not off.any():
            break
        anew = rng.random((len(ego), 2))
        uniform[off, 1] = anew[off, 1]
        if attempt >= _TRIES:
            uniform[off, 0] = anew[off, 0]
        place = _placed(law, sensor, ego, uniform)
    return place


def _placed(law: Sequence[float], sensor: Sensor, ego: Floats, uniform: Floats) -> Floats:
    """Places ``[B, 2]`` at distances and bearings by uniform numbers ``[B, 2]``."""
    distance = np.interp(uniform[:, 0], np.linspace(0.0, 1.0, len(law)), law)
    toward = ego[:, 3] + min(sensor.field_of_view, 2 * np.pi) * (uniform[:, 1] - 0.5)
    return np.asarray(ego[:, :2] + distance[:, None] * np.stack([np.cos(toward), np.sin(toward)], axis=-1))


def ground_at(place: Floats, frame: Ints, around: Surroundings) -> Floats:
    """Height of the ground at places ``[B, 2]``: where the nearest true box of the frame stands.

    In a frame without any: as high above the ego as true boxes stand in the middle of the scene's.
    """
    truth, ego = around.truth, around.ego
    underside = truth.box[:, 2] - truth.box[:, 6] / 2
    above = underside - ego[truth.frame_of_rows, 2]
    ground = ego[frame, 2] + (np.median(above) if len(above) else 0.0)
    order = np.argsort(frame, kind="stable")
    start = np.searchsorted(frame[order], np.arange(truth.frames + 1))
    for t in np.flatnonzero(np.diff(start)):
        rows, here = truth.rows(int(t)), order[start[t] : start[t + 1]]
        if rows.stop > rows.start:
            off = place[here, :, None] - truth.box[rows, :2].T
            off *= off
            ground[here] = underside[rows][(off[:, 0] + off[:, 1]).argmin(axis=1)]
    return np.asarray(ground)


@dataclass(frozen=True, eq=False)
class Labels:
    """What the false positives of one noise are reported as in a scene."""

    class_id: Ints  # [K]
    share: Floats  # [K] sum 1
    size: Floats  # [K, 3] m, mean length, width, height


def labels_of(
    truth: Truth, classes: Sequence[str], noise_names: Sequence[str], own: str, size: Sequence[float]
) -> Labels | None:
    """The ``classes`` with the noise of ``own``, by their number of true boxes in the scene; names of noise per class.

    Where it has none: the class ``own``, or the first with its noise, with ``size``; None where no class has the noise.
    """
    having = [class_id for class_id, name in enumerate(noise_names) if name == own]
    if not having:
        return None
    boxes = np.bincount(truth.class_id, minlength=len(classes))
    there = [class_id for class_id in having if boxes[class_id]]
    if there:
        means = [truth.box[truth.class_id == class_id, 4:].mean(axis=0) for class_id in there]
        return Labels(np.array(there), boxes[there] / boxes[there].sum(), np.array(means))
    alone = next((class_id for class_id in having if classes[class_id] == own), having[0])
    return Labels(np.array([alone]), np.ones(1), np.array([size]))


def spread_sides(size: Floats, normal: Floats) -> Floats:
    """Sides ``[B, 3]`` of false positives whose classes have those of ``size``, by standard normal numbers."""
    return np.asarray(size * np.maximum(1.0 + _SPREAD * normal, _SMALLEST))

"""False positives: boxes that stand still in the world for a few frames where there is nothing."""

from __future__ import annotations

import numpy as np

from ..geometry import wrap_angle
from ..types import Floats, Ints
from .box_errors import turned
from .chains import decayed
from .profile import ClassNoise, FalsePositives
from .rows import Rows
from .sight import Sensor, polar, within
from .streams import Kind, stream

_SIZE_SPREAD = 0.1  # deviation of each side, share of its mean
_SMALLEST = 0.3  # share of its mean that every side keeps


def more_clutter(law: FalsePositives, factor: float) -> FalsePositives:
    """``factor`` times as many false positives; how much scenes differ, relatively, stays."""
    dispersion = 1.0 + factor * (law.dispersion - 1.0)
    return law.model_copy(update={"rate": factor * law.rate, "dispersion": dispersion})


def clutter(
    noise: ClassNoise, ego: Floats, sensor: Sensor, ground: float, class_id: int, seed: int, steps: float, factor: float
) -> Rows:
    """False positives of one class over a scene.

    ``ego`` is ``[F, 4]`` x y z yaw; ``ground`` (m) is the height of the boxes' undersides above the ego's z; ``steps``
    are the frame periods of the profile per frame of the scene; ``factor`` is the sensor's field of view over that of
    the profile. A box that the moving sensor loses is gone.
    """
    if noise.false_positives is None or noise.false_positives.rate == 0:
        return Rows.none()
    law = more_clutter(noise.false_positives, factor)
    survive = float(decayed(np.asarray(law.survive), steps))
    birth = _births(law, survive, len(ego), class_id, seed)
    life = stream(seed, Kind.CLUTTER_LIFE, class_id).geometric(1.0 - survive, len(birth))
    box = _boxes(law, ego[birth], sensor, ground, class_id, seed)
    alive = np.minimum(life, len(ego) - birth)
    which = np.repeat(np.arange(len(birth)), alive)
    age = np.arange(len(which)) - np.repeat(np.cumsum(alive) - alive, alive)
    frame = birth[which] + age
    kept = _seen(box[which], ego[frame], sensor)
    return _rows(noise, law, frame[kept], box[which[kept]], ego[frame[kept], 3], class_id, seed)


def _births(law: FalsePositives, survive: float, frames: int, class_id: int, seed: int) -> Ints:
    """Frame of every birth, ascending: Poisson with a rate that differs between scenes by a Gamma factor.

    Counts per frame then have variance / mean = 1 + rate x variance of the factor. The first frame is in equilibrium.
    """
    factor = 1.0
    if law.dispersion > 1.0:
        shape = law.rate / (law.dispersion - 1.0)
        factor = stream(seed, Kind.CLUTTER_SCENE, class_id).gamma(shape) / shape
    mean = np.full(frames, law.rate * factor * (1.0 - survive))
    mean[:1] = law.rate * factor
    return np.repeat(np.arange(frames), stream(seed, Kind.CLUTTER_BIRTH, class_id).poisson(mean))


def _boxes(law: FalsePositives, ego: Floats, sensor: Sensor, ground: float, class_id: int, seed: int) -> Floats:
    """Boxes ``[B, 7]`` born in view of the ego poses ``[B, 4]``, evenly over distance, bearing and heading."""
    count = len(ego)
    uniform = stream(seed, Kind.CLUTTER_PLACE, class_id).random((count, 2))
    distance = sensor.reach * uniform[:, 0]
    toward = ego[:, 3] + min(sensor.field_of_view, 2 * np.pi) * (uniform[:, 1] - 0.5)
    spread = stream(seed, Kind.CLUTTER_SIZE, class_id).standard_normal((count, 3))
    size = np.array(law.size) * np.maximum(1.0 + _SIZE_SPREAD * spread, _SMALLEST)
    box = np.empty((count, 7))
    box[:, 0] = ego[:, 0] + distance * np.cos(toward)
    box[:, 1] = ego[:, 1] + distance * np.sin(toward)
    box[:, 2] = ego[:, 2] + ground + size[:, 2] / 2
    turn = stream(seed, Kind.CLUTTER_HEADING, class_id).random(count)
    box[:, 3] = wrap_angle(ego[:, 3] + 2 * np.pi * turn)
    box[:, 4:] = size
    return box


def _seen(box: Floats, ego: Floats, sensor: Sensor) -> Ints:
    """Indices of the rows whose box is covered from the ego pose of its frame."""
    return np.flatnonzero(within(*polar(box[:, :2], ego), sensor))


def _rows(
    noise: ClassNoise, law: FalsePositives, frame: Ints, box: Floats, heading: Floats, class_id: int, seed: int
) -> Rows:
    """The rows of standing boxes; scores and velocities are new in every frame. ``heading`` ``[R]`` is the sensor's."""
    count = len(frame)
    score = law.score + law.score_deviation * stream(seed, Kind.CLUTTER_SCORE, class_id).standard_normal(count)
    ceiling = np.inf if noise.score.ceiling is None else noise.score.ceiling
    deviation = np.nan if noise.velocity is None else noise.velocity
    velocity = deviation * stream(seed, Kind.CLUTTER_VELOCITY, class_id).standard_normal((count, 2))
    score = np.clip(score, noise.score.floor, ceiling)
    return Rows(frame, box, turned(velocity, heading), np.full(count, class_id), score)

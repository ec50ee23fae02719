"""False positives: phantom objects that stand still where there is nothing, detected as true objects are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry import wrap_angle
from ..types import Floats, Ints, Truth
from .box_errors import box_errors, latent_scores, scores_within, velocities
from .chains import decayed
from .grid import Grid
from .labels import Labels
from .profile import ClassNoise, FalsePositives
from .rows import Rows
from .sight import Sensor, polar, within
from .streams import Kind, Streams, Whose, stream

_SIZE_SPREAD = 0.1  # deviation of each side, share of its mean
_SMALLEST = 0.3  # share of its mean that every side keeps
_TRIES = 100  # bearings drawn for a phantom until it is inside of the area


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Where clutter appears."""

    truth: Truth
    ego: Floats  # [F, 4] x y z yaw of the sensor
    sensor: Sensor
    steps: float  # frame periods of the profile per frame of the scene
    wider: float  # the sensor's field of view over that of the profile


@dataclass(frozen=True, eq=False)
class _Phantoms:
    birth: Ints  # [B] frame, ascending
    life: Ints  # [B] frames, at least 1, to the end of the scene at most
    box: Floats  # [B, 7]
    class_id: Ints  # [B]


def more_clutter(law: FalsePositives, factor: float) -> FalsePositives:
    """``factor`` times as many false positives; how much scenes differ, relatively, stays."""
    dispersion = 1.0 + factor * (law.dispersion - 1.0)
    return law.model_copy(update={"rate": factor * law.rate, "dispersion": dispersion})


def clutter(noise: ClassNoise, labels: Labels, around: Surroundings, number: int, seed: int) -> Rows:
    """False positives of one noise over a scene; ``number`` tells the random streams of several noises apart.

    What appears beyond the sensor's reach is dropped, and a phantom that the moving sensor does not cover is not seen.
    """
    if noise.false_positives is None or noise.false_positives.rate == 0:
        return Rows.none()
    law = more_clutter(noise.false_positives, around.wider)
    phantoms = _phantoms(law, labels, around, number, seed)
    which = np.repeat(np.arange(len(phantoms.life)), phantoms.life)
    age = np.arange(len(which)) - np.repeat(np.cumsum(phantoms.life) - phantoms.life, phantoms.life)
    frame = phantoms.birth[which] + age
    distance, bearing = polar(phantoms.box[which, :2], around.ego[frame])
    near = distance[age == 0] <= around.sensor.reach
    seen = np.flatnonzero(near[which] & within(distance, bearing, around.sensor))
    frame, which = frame[seen], which[seen]
    grid = _grid(noise, phantoms, age[seen], which, around.steps)
    toward = bearing[seen] + around.ego[frame, 3]
    streams = Streams(seed, Whose.CLUTTER, number)
    box = box_errors(phantoms.box[which], grid, distance[seen], toward, streams)
    velocity = velocities(np.zeros((len(which), 2)), grid, toward, streams)
    location, deviation = np.full(len(which), law.score), np.full(len(which), law.score_deviation)
    score = scores_within(latent_scores(grid, streams), location, deviation, grid)
    return Rows(frame, box, velocity, phantoms.class_id[which], score)


def _grid(noise: ClassNoise, phantoms: _Phantoms, age: Ints, which: Ints, steps: float) -> Grid:
    """Phantoms by age: no larger than the longest life."""
    count = len(phantoms.life)
    return Grid(int(phantoms.life.max(initial=0)), count, age, which, (noise,), np.zeros(count, dtype=np.int64), steps)


def _phantoms(law: FalsePositives, labels: Labels, around: Surroundings, number: int, seed: int) -> _Phantoms:
    """All phantoms of a scene, those beyond the sensor's reach included."""
    survive = float(decayed(np.asarray(law.survive), around.steps))
    birth = _births(law, survive, len(around.ego), number, seed)
    life = stream(seed, Kind.CLUTTER_LIFE, number).geometric(1.0 - survive, len(birth))
    label = stream(seed, Kind.CLUTTER_CLASS, number).choice(len(labels.share), len(birth), p=labels.share)
    spread = stream(seed, Kind.CLUTTER_SIZE, number).standard_normal((len(birth), 3))
    size = labels.size[label] * np.maximum(1.0 + _SIZE_SPREAD * spread, _SMALLEST)
    box = _boxes(law, around, birth, size, number, seed)
    return _Phantoms(birth, np.minimum(life, len(around.ego) - birth), box, labels.class_id[label])


def _births(law: FalsePositives, survive: float, frames: int, number: int, seed: int) -> Ints:
    """Frame of every birth, ascending: Poisson with a rate that differs between scenes by a Gamma factor.

    Counts per frame then have variance / mean = 1 + rate x variance of the factor. The first frame is in equilibrium.
    """
    factor = 1.0
    if law.dispersion > 1.0:
        shape = law.rate / (law.dispersion - 1.0)
        factor = stream(seed, Kind.CLUTTER_SCENE, number).gamma(shape) / shape
    mean = np.full(frames, law.rate * factor * (1.0 - survive))
    mean[:1] = law.rate * factor
    return np.repeat(np.arange(frames), stream(seed, Kind.CLUTTER_BIRTH, number).poisson(mean))


def _boxes(law: FalsePositives, around: Surroundings, birth: Ints, size: Floats, number: int, seed: int) -> Floats:
    """Boxes ``[B, 7]`` on the ground: distances by the law, evenly over the field of view and all headings."""
    ego = around.ego[birth]
    box = np.empty((len(birth), 7))
    box[:, :2] = _places(law, around.sensor, ego, stream(seed, Kind.CLUTTER_PLACE, number))
    box[:, 3] = wrap_angle(ego[:, 3] + 2 * np.pi * stream(seed, Kind.CLUTTER_HEADING, number).random(len(birth)))
    box[:, 4:] = size
    box[:, 2] = _ground(box[:, :2], birth, around) + size[:, 2] / 2
    return box


def _places(law: FalsePositives, sensor: Sensor, ego: Floats, rng: np.random.Generator) -> Floats:
    """Places ``[B, 2]`` seen from poses ``[B, 4]``.

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


def _placed(law: FalsePositives, sensor: Sensor, ego: Floats, uniform: Floats) -> Floats:
    """Places ``[B, 2]`` at distances and bearings by uniform numbers ``[B, 2]``."""
    distance = np.interp(uniform[:, 0], np.linspace(0.0, 1.0, len(law.distance)), law.distance)
    toward = ego[:, 3] + min(sensor.field_of_view, 2 * np.pi) * (uniform[:, 1] - 0.5)
    return np.asarray(ego[:, :2] + distance[:, None] * np.stack([np.cos(toward), np.sin(toward)], axis=-1))


def _ground(place: Floats, frame: Ints, around: Surroundings) -> Floats:
    """Height of the ground at places ``[B, 2]``: where the nearest true box of the frame stands.

    In a frame without any: as high above the ego as true boxes stand in the middle of the scene's.
    """
    truth, ego = around.truth, around.ego
    underside = truth.box[:, 2] - truth.box[:, 6] / 2
    above = underside - np.repeat(ego[:, 2], np.diff(truth.start))
    ground = ego[frame, 2] + (np.median(above) if len(above) else 0.0)
    for i, t in enumerate(frame):
        rows = truth.rows(t)
        if rows.stop > rows.start:
            off = truth.box[rows, :2] - place[i]
            ground[i] = underside[rows][np.argmin((off**2).sum(axis=1))]
    return np.asarray(ground)

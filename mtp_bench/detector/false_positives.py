"""False positives: they stand still where there is nothing, and are detected as true objects are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from ..geometry import wrap_angle
from ..types import Detections, Floats, Ints, Ragged, Truth, starts_of
from .box_errors import box_errors, latent_scores, scores_within, velocities
from .draws import Grid, Kind, Streams, Whose, decayed, stream
from .profile import ClassNoise, FalsePositives, Profile
from .sight import Sensor, polar, within

SIZE_SPREAD = 0.1  # deviation of each side, share of its mean
SMALLEST_SHARE = 0.3  # share of its mean that every side keeps
_TRIES = 100  # bearings drawn for a run until it is inside of the area


@dataclass(frozen=True, eq=False)
class Rows:
    """Detected boxes of a scene, in any order."""

    frame: Ints  # [R]
    box: Floats  # [R, 7]
    velocity: Floats  # [R, 2] m/s, NaN where not measured
    class_id: Ints  # [R]
    score: Floats  # [R]

    @classmethod
    def none(cls) -> Rows:
        """No rows."""
        no_ints = np.zeros(0, dtype=np.int64)
        return cls(no_ints, np.zeros((0, 7)), np.zeros((0, 2)), no_ints, np.zeros(0))


def in_order(parts: Sequence[Rows], frames: int) -> Detections:
    """All parts by frame; within a frame by descending score, then by x: the order does not tell what a row is."""
    columns = [np.concatenate([getattr(part, column.name) for part in parts]) for column in fields(Rows)]
    frame, box, velocity, class_id, score = columns
    order = np.lexsort((box[:, 0], -score, frame))
    start = starts_of(np.bincount(frame, minlength=frames))
    return Detections(start, box[order], velocity[order], class_id[order], score[order])


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Where false positives appear."""

    truth: Truth
    ego: Floats  # [F, 4] x y z yaw of the sensor
    sensor: Sensor
    steps: float  # frame periods of the profile per frame of the scene
    wider: float  # the sensor's field of view over that of the profile


@dataclass(frozen=True, eq=False)
class _Runs:
    """Runs of false positives: something that is not there is detected at one place for some frames."""

    birth: Ints  # [B] frame, ascending
    life: Ints  # [B] frames, at least 1, to the end of the scene at most
    box: Floats  # [B, 7]
    class_id: Ints  # [B]


def more_false_positives(law: FalsePositives, factor: float) -> FalsePositives:
    """``factor`` times as many false positives; how much scenes differ, relatively, stays."""
    dispersion = 1.0 + factor * (law.dispersion - 1.0)
    return law.model_copy(update={"rate": factor * law.rate, "dispersion": dispersion})


def false_positives(noise: ClassNoise, labels: Labels, around: Surroundings, number: int, seed: int) -> Rows:
    """False positives of one noise over a scene; ``number`` tells the random streams of several noises apart.

    ``labels``: classes and sizes that they may have; ``around``: where they may be; ``seed``: of the detector's noise.
    What appears beyond the sensor's reach is dropped, and one that the moving sensor does not cover is not seen.
    """
    if noise.false_positives is None or noise.false_positives.rate == 0:
        return Rows.none()
    law = more_false_positives(noise.false_positives, around.wider)
    runs = _runs(law, labels, around, number, seed)
    rows = Ragged.of_counts(runs.life)
    which = rows.frame_of_rows
    age = np.arange(len(which)) - rows.start[which]
    frame = runs.birth[which] + age
    distance, bearing = polar(runs.box[which, :2], around.ego[frame])
    near = distance[age == 0] <= around.sensor.reach
    seen = np.flatnonzero(near[which] & within(distance, bearing, around.sensor))
    frame, which = frame[seen], which[seen]
    grid = _grid(noise, runs, age[seen], which, around.steps)
    toward = bearing[seen] + around.ego[frame, 3]
    streams = Streams(seed, Whose.FALSE_POSITIVES, number)
    box = box_errors(runs.box[which], grid, distance[seen], toward, streams)
    velocity = velocities(np.zeros((len(which), 2)), grid, toward, streams)
    location, deviation = np.full(len(which), law.score), np.full(len(which), law.score_deviation)
    score = scores_within(latent_scores(grid, streams), location, deviation, grid)
    return Rows(frame, box, velocity, runs.class_id[which], score)


def _grid(noise: ClassNoise, runs: _Runs, age: Ints, which: Ints, steps: float) -> Grid:
    """A grid of the runs by age: no larger than the longest life."""
    count = len(runs.life)
    return Grid(int(runs.life.max(initial=0)), count, age, which, (noise,), np.zeros(count, dtype=np.int64), steps)


def _runs(law: FalsePositives, labels: Labels, around: Surroundings, number: int, seed: int) -> _Runs:
    """All runs of a scene, those beyond the sensor's reach included."""
    survive = float(decayed(np.asarray(law.survive), around.steps))
    birth = _births(law, survive, len(around.ego), number, seed)
    life = stream(seed, Kind.FALSE_LIFE, number).geometric(1.0 - survive, len(birth))
    label = stream(seed, Kind.FALSE_CLASS, number).choice(len(labels.share), len(birth), p=labels.share)
    spread = stream(seed, Kind.FALSE_SIZE, number).standard_normal((len(birth), 3))
    size = labels.size[label] * np.maximum(1.0 + SIZE_SPREAD * spread, SMALLEST_SHARE)
    box = _boxes(law, around, birth, size, number, seed)
    return _Runs(birth, np.minimum(life, len(around.ego) - birth), box, labels.class_id[label])


def _births(law: FalsePositives, survive: float, frames: int, number: int, seed: int) -> Ints:
    """Frame of every birth, ascending: Poisson with a rate that differs between scenes by a Gamma factor.

    Counts per frame then have variance / mean = 1 + rate x variance of the factor. The first frame is in equilibrium.
    """
    factor = 1.0
    if law.dispersion > 1.0:
        shape = law.rate / (law.dispersion - 1.0)
        factor = stream(seed, Kind.FALSE_SCENE, number).gamma(shape) / shape
    mean = np.full(frames, law.rate * factor * (1.0 - survive))
    mean[:1] = law.rate * factor
    return np.repeat(np.arange(frames), stream(seed, Kind.FALSE_BIRTH, number).poisson(mean))


def _boxes(law: FalsePositives, around: Surroundings, birth: Ints, size: Floats, number: int, seed: int) -> Floats:
    """Boxes ``[B, 7]`` on the ground: distances by the law, evenly over the field of view and all headings."""
    ego = around.ego[birth]
    box = np.empty((len(birth), 7))
    box[:, :2] = places(law.distance, around.sensor, ego, stream(seed, Kind.FALSE_PLACE, number))
    box[:, 3] = wrap_angle(ego[:, 3] + 2 * np.pi * stream(seed, Kind.FALSE_HEADING, number).random(len(birth)))
    box[:, 4:] = size
    box[:, 2] = ground_at(box[:, :2], birth, around) + size[:, 2] / 2
    return box


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
    for t in np.unique(frame):
        rows, here = truth.rows(int(t)), np.flatnonzero(frame == t)
        if rows.stop > rows.start:
            off = truth.box[None, rows, :2] - place[here, None]
            ground[here] = underside[rows][np.argmin((off**2).sum(axis=-1), axis=1)]
    return np.asarray(ground)


@dataclass(frozen=True, eq=False)
class Labels:
    """What the false positives of one noise are reported as in a scene."""

    class_id: Ints  # [K]
    share: Floats  # [K] sum 1
    size: Floats  # [K, 3] m, mean length, width, height


def labels_of(truth: Truth, classes: Sequence[str], profile: Profile, own: str) -> Labels | None:
    """The classes of the task that have the noise of ``own``, by their number of true boxes in the scene.

    Where it has none: the class ``own``, or the first with its noise; None where no class of the task has it.
    """
    having = [class_id for class_id, name in enumerate(classes) if profile.alike.get(name, name) == own]
    boxes = np.bincount(truth.class_id, minlength=len(classes))
    there = [class_id for class_id in having if boxes[class_id]]
    if there:
        size = [truth.box[truth.class_id == class_id, 4:].mean(axis=0) for class_id in there]
        return Labels(np.array(there), boxes[there] / boxes[there].sum(), np.array(size))
    false = profile.classes[own].false_positives
    if not having or false is None:
        return None
    alone = classes.index(own) if own in classes and classes.index(own) in having else having[0]
    return Labels(np.array([alone]), np.ones(1), np.array([false.size]))

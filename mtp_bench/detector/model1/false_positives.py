"""False positives: they stand still where there is nothing, and are detected as true objects are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...geometry import wrap_angle
from ...types import Floats, Ints, Ragged
from ..chains import decayed
from ..rows import Rows
from ..sections import more
from ..sight import polar, within
from ..surroundings import Labels, Surroundings, ground_at, places, spread_sides
from .draws import Grid, Kind, Streams, Whose
from .errors import box_errors, latent_scores, scores_within, velocities
from .profile import ClassNoise, FalsePositives


@dataclass(frozen=True, eq=False)
class _Runs:
    """Runs of false positives: something that is not there is detected at one place for some frames."""

    birth: Ints  # [B] frame, ascending
    life: Ints  # [B] frames, at least 1, to the end of the scene at most
    box: Floats  # [B, 7]
    class_id: Ints  # [B]


def false_positives(noise: ClassNoise, labels: Labels, around: Surroundings, number: int, seed: int) -> Rows:
    """False positives of one noise over a scene; ``number`` tells the random streams of several noises apart.

    ``labels``: classes and sizes that they may have; ``around``: where they may be; ``seed``: of the detector's noise.
    What appears beyond the sensor's reach is dropped, and one that the moving sensor does not cover is not seen.
    """
    if noise.false_positives is None or noise.false_positives.rate == 0:
        return Rows.none()
    law = noise.false_positives
    law = law.model_copy(update=more(law.rate, law.dispersion, around.wider))
    runs = _runs(law, labels, around, Streams(seed, number=number))
    rows = Ragged.of_counts(runs.life)
    which = rows.frame_of_rows
    age = np.arange(len(which)) - rows.start[which]
    frame = runs.birth[which] + age
    distance, bearing = polar(runs.box[which, :2], around.ego[frame])
    near = distance[age == 0] <= around.sensor.reach
    seen = np.flatnonzero(near[which] & within(distance, bearing, around.sensor))
    frame, which = frame[seen], which[seen]
    count, longest = len(runs.life), int(runs.life.max(initial=0))  # the grid is by age
    grid = Grid(longest, count, age[seen], which, (noise,), np.zeros(count, dtype=np.int64), around.steps)
    toward = bearing[seen] + around.ego[frame, 3]
    streams = Streams(seed, Whose.FALSE_POSITIVES, number)
    box = box_errors(runs.box[which], grid, distance[seen], toward, streams)
    velocity = velocities(np.zeros((len(which), 2)), grid, toward, streams)
    location, deviation = np.full(len(which), law.score), np.full(len(which), law.score_deviation)
    score = scores_within(latent_scores(grid, streams), location, deviation, grid)
    return Rows(frame, box, velocity, runs.class_id[which], score)


def _runs(law: FalsePositives, labels: Labels, around: Surroundings, streams: Streams) -> _Runs:
    """All runs of a scene, those beyond the sensor's reach included."""
    survive = float(decayed(np.asarray(law.survive), around.steps))
    birth = _births(law, survive, len(around.ego), streams)
    life = streams.of(Kind.FALSE_LIFE).geometric(1.0 - survive, len(birth))
    label = streams.of(Kind.FALSE_CLASS).choice(len(labels.share), len(birth), p=labels.share)
    spread = streams.of(Kind.FALSE_SIZE).standard_normal((len(birth), 3))
    size = spread_sides(labels.size[label], spread)
    box = _boxes(law, around, birth, size, streams)
    return _Runs(birth, np.minimum(life, len(around.ego) - birth), box, labels.class_id[label])


def _births(law: FalsePositives, survive: float, frames: int, streams: Streams) -> Ints:
    """Frame of every birth, ascending: Poisson with a rate that differs between scenes by a Gamma factor.

    Counts per frame then have variance / mean = 1 + rate x variance of the factor. The first frame is in equilibrium.
    """
    factor = 1.0
    if law.dispersion > 1.0:
        shape = law.rate / (law.dispersion - 1.0)
        factor = streams.of(Kind.FALSE_SCENE).gamma(shape) / shape
    mean = np.full(frames, law.rate * factor * (1.0 - survive))
    mean[:1] = law.rate * factor
    return np.repeat(np.arange(frames), streams.of(Kind.FALSE_BIRTH).poisson(mean))


def _boxes(law: FalsePositives, around: Surroundings, birth: Ints, size: Floats, streams: Streams) -> Floats:
    """Boxes ``[B, 7]`` on the ground: distances by the law, evenly over the field of view and all headings."""
    ego = around.ego[birth]
    box = np.empty((len(birth), 7))
    box[:, :2] = places(law.distance, around.sensor, ego, streams.of(Kind.FALSE_PLACE))
    box[:, 3] = wrap_angle(ego[:, 3] + 2 * np.pi * streams.of(Kind.FALSE_HEADING).random(len(birth)))
    box[:, 4:] = size
    box[:, 2] = ground_at(box[:, :2], birth, around) + size[:, 2] / 2
    return box

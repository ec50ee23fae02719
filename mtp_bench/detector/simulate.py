"""Detections that a simulated detector makes of true boxes; ``README.md`` beside this file describes the model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..shapes import require_shape
from ..types import Bools, Detections, Floats, Truth
from .box_errors import box_errors, duplicates, scores, velocities
from .clutter import clutter
from .grid import Grid, grid_of
from .misses import missed
from .profile import Profile
from .rows import Rows, in_order
from .sight import Sensor, Sight, within
from .sight import sight as sight_of


def simulate(
    truth: Truth,
    ego: Floats,
    classes: Sequence[str],
    profile: Profile,
    sensor: Sensor,
    seed: int,
    dt: float,
    sight: Sight | None = None,
) -> Detections:
    """What a detector with the noise of ``profile`` reports of a scene, the same for the same arguments.

    Args:
        truth: true boxes, the neutral ones included; ``class_id`` is an index into ``classes``.
        ego: ``[F, 4]`` x y z yaw of the sensor, in the truth's frame of reference.
        classes: names that the profile must know, else UnknownNameError.
        profile: the noise.
        sensor: what is covered; nothing else is ever detected.
        seed: not negative. Every kind of noise has its own stream: a changed level leaves all other draws alone.
        dt: s between frames. Where it differs from the profile's, memory decays accordingly.
        sight: `sight(truth, ego, sensor)` if known already.

    Rows within a frame are by descending score, ties by x.
    """
    require_shape("ego", ego, (len(truth.start) - 1, 4))
    steps = dt / profile.dt
    grid = grid_of(truth, [profile.noise(name) for name in classes], steps)
    sight = sight_of(truth, ego, sensor) if sight is None else sight
    covered = within(sight.distance, sight.bearing, sensor)
    hit = ~missed(grid, sight, covered, seed)
    ground = _ground(truth, ego, grid)
    own = [(class_id, name) for class_id, name in enumerate(classes) if name in profile.classes]
    wider = min(sensor.field_of_view, 2 * np.pi) / np.deg2rad(profile.field_of_view)
    false = [clutter(profile.noise(name), ego, sensor, ground, class_id, seed, steps, wider) for class_id, name in own]
    return in_order([*_of_objects(truth, ego, grid, sight, hit, seed), *false], len(ego))


def _of_objects(truth: Truth, ego: Floats, grid: Grid, sight: Sight, hit: Bools, seed: int) -> tuple[Rows, Rows]:
    """Detections of true objects, and their duplicates."""
    toward = sight.bearing + ego[grid.frame, 3]
    box = box_errors(truth.box, grid, sight, toward, seed)
    score = scores(grid, sight, seed)
    velocity = velocities(truth.velocity, grid, toward, seed)
    twice, second, weaker = duplicates(box, score, grid, toward, seed)
    twice &= hit
    found = Rows(grid.frame[hit], box[hit], velocity[hit], truth.class_id[hit], score[hit])
    again = Rows(grid.frame[twice], second[twice], velocity[twice], truth.class_id[twice], weaker[twice])
    return found, again


def _ground(truth: Truth, ego: Floats, grid: Grid) -> float:
    """Height of the ground above the ego's z, metres: where the true boxes stand."""
    underside = truth.box[:, 2] - truth.box[:, 6] / 2 - ego[grid.frame, 2]
    return float(np.median(underside)) if len(underside) else 0.0

"""Detections by model 2 of true boxes; ``mtp_bench/detector/README.md`` describes the model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...types import Detections, Truth
from ..rows import Rows, in_order
from ..sight import Sight, within
from ..surroundings import Surroundings, labels_of
from .draws import Draws, grid_of, neighbours_in
from .errors import estimated, position_errors, velocities
from .free import free_ghosts
from .near import classes_alike, near_ghosts
from .profile import Profile
from .quality import qualities


def simulate2(
    truth: Truth, classes: Sequence[str], profile: Profile, around: Surroundings, sight: Sight, seed: int
) -> Detections:
    """What a detector with the noise of ``profile`` reports of a scene; see `mtp_bench.detector.simulate.simulate`.

    ``around``: ego poses, sensor and frame period; ``sight``: how the sensor sees the truth.
    """
    draws = Draws(seed)
    grid = grid_of(truth, [profile.noise(name) for name in classes], around.steps)
    neighbours = neighbours_in(grid, truth.box[:, :2], profile.neighbours)
    found = qualities(grid, sight, neighbours, draws)
    toward = sight.bearing + around.ego[grid.frame, 3]
    off = position_errors(grid, sight.distance, toward, found.random, neighbours, draws)
    hit = np.flatnonzero(found.reported & within(sight.distance, sight.bearing, around.sensor))
    seen = grid.of_these(hit)
    box = estimated(truth.box[hit], off[hit], seen, draws)
    velocity = velocities(truth.velocity[hit], seen, toward[hit], draws)
    objects = Rows(seen.frame, box, velocity, truth.class_id[hit], found.score[hit])
    names = [profile.noise_name(name) for name in classes]
    rows = [objects, near_ghosts(grid, around, found, classes_alike(truth, names), seed)]
    for number, (own, noise) in enumerate(profile.classes.items()):
        labels = None if noise.free is None else labels_of(truth, classes, names, own, noise.free.size)
        if labels is not None:
            rows.append(free_ghosts(noise, labels, around, number, seed))
    return in_order(rows, len(around.ego))

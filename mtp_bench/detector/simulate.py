"""Detections that a simulated detector makes of true boxes; ``README.md`` beside this file describes the model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..shapes import require_shape
from ..types import Bools, Detections, Floats, Truth
from .box_errors import box_errors, duplicates, latent_scores, reshaped, scores, velocities
from .draws import Grid, Streams, Whose, grid_of
from .false_positives import Rows, Surroundings, false_positives, in_order, labels_of
from .model2.profile import Profile2
from .model2.simulate import simulate2
from .profile import Profile
from .sight import Sensor, Sight, within
from .sight import sight as sight_of
from .undetected import undetected


def simulate(
    truth: Truth,
    ego: Floats,
    classes: Sequence[str],
    profile: Profile | Profile2,
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
    require_shape("ego", ego, (truth.frames, 4))
    steps = dt / profile.dt
    sight = sight_of(truth, ego, sensor) if sight is None else sight
    wider = min(sensor.field_of_view, 2 * np.pi) / np.deg2rad(profile.field_of_view)
    around = Surroundings(truth, ego, sensor, steps, float(wider))
    if isinstance(profile, Profile2):
        return simulate2(truth, classes, profile, around, sight, seed)
    grid = grid_of(truth, [profile.noise(name) for name in classes], steps)
    hit = ~undetected(grid, sight, within(sight.distance, sight.bearing, sensor), seed)
    found = _of_objects(truth, ego, grid, sight, hit, seed)
    return in_order([*found, *_false_positives(profile, classes, around, seed)], len(ego))


def _of_objects(truth: Truth, ego: Floats, grid: Grid, sight: Sight, hit: Bools, seed: int) -> tuple[Rows, Rows]:
    """Detections of true objects, and their duplicates."""
    toward = sight.bearing + ego[grid.frame, 3]
    streams = Streams(seed)
    box = box_errors(truth.box, grid, sight.distance, toward, streams)
    latent = latent_scores(grid, streams)
    score = scores(latent, grid, sight.distance)
    velocity = velocities(truth.velocity, grid, toward, streams)
    found = Rows(grid.frame[hit], box[hit], velocity[hit], truth.class_id[hit], score[hit])
    twice, beside, weaker = duplicates(grid, toward, seed)
    twice &= hit
    if not twice.any():
        return found, Rows.none()
    streams = Streams(seed, Whose.DUPLICATES)
    second = reshaped(truth.box, grid, streams)
    second[:, :2] = box[:, :2] + beside
    velocity = velocities(truth.velocity, grid, toward, streams)
    score = scores(latent - weaker, grid, sight.distance)
    again = Rows(grid.frame[twice], second[twice], velocity[twice], truth.class_id[twice], score[twice])
    return found, again


def _false_positives(profile: Profile, classes: Sequence[str], around: Surroundings, seed: int) -> list[Rows]:
    """False positives, by noise of the profile."""
    rows = []
    for number, (own, noise) in enumerate(profile.classes.items()):
        labels = labels_of(around.truth, classes, profile, own)
        if labels is not None:
            rows.append(false_positives(noise, labels, around, number, seed))
    return rows

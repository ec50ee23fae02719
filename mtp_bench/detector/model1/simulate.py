"""Detections by model 1 of true boxes; ``mtp_bench/detector/README.md`` describes the model."""

from __future__ import annotations

from collections.abc import Sequence

from ...types import Bools, Detections, Floats, Truth
from ..rows import Rows, in_order
from ..sight import Sight, within
from ..surroundings import Surroundings, labels_of
from .draws import Grid, Streams, Whose, grid_of
from .errors import box_errors, duplicates, latent_scores, reshaped, scores, velocities
from .false_positives import false_positives
from .profile import Profile1
from .undetected import undetected


def simulate1(
    truth: Truth, classes: Sequence[str], profile: Profile1, around: Surroundings, sight: Sight, seed: int
) -> Detections:
    """What a detector with the noise of ``profile`` reports of a scene; see `mtp_bench.detector.simulate.simulate`.

    ``around``: ego poses, sensor and frame period; ``sight``: how the sensor sees the truth.
    """
    grid = grid_of(truth, [profile.noise(name) for name in classes], around.steps)
    hit = ~undetected(grid, sight, within(sight.distance, sight.bearing, around.sensor), seed)
    found = _of_objects(truth, around.ego, grid, sight, hit, seed)
    return in_order([*found, *_false_positives(profile, classes, around, seed)], len(around.ego))


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


def _false_positives(profile: Profile1, classes: Sequence[str], around: Surroundings, seed: int) -> list[Rows]:
    """False positives, by noise of the profile."""
    rows, names = [], [profile.noise_name(name) for name in classes]
    for number, (own, noise) in enumerate(profile.classes.items()):
        law = noise.false_positives
        labels = None if law is None else labels_of(around.truth, classes, names, own, law.size)
        if labels is not None:
            rows.append(false_positives(noise, labels, around, number, seed))
    return rows

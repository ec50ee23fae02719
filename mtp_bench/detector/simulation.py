"""Simulation of a detector; ``README.md`` beside this file describes the model."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core import Detections, Floats, Truth, require_shape, select
from .draws import Draws
from .errors import detected_boxes, draw_errors
from .false_positives import (
    DetectedRows,
    SensedScene,
    detect_false_positives,
    reported_classes,
    sorted_detections,
)
from .free import free_false_positives
from .grid import Memory, kept, truth_grid, truth_neighbours
from .near import classes_of_same_noise, near_false_positives
from .profile import Profile
from .quality import draw_qualities
from .visibility import Sensor, Visibility, visibility_of


@dataclass(frozen=True, eq=False)
class OpenScene:
    """A scene that goes on: detections of a frame do not depend on later frames."""

    frames: int  # at most
    known: Truth  # true boxes whose classes and sizes false positives have
    level: float = 0.0  # m, of the ground
    memory: Memory | None = (
        None  # of the frames before, if only the last frame has boxes
    )


def simulate(
    truth: Truth,
    ego: Floats,
    classes: Sequence[str],
    profile: Profile,
    sensor: Sensor,
    seed: int,
    dt: float,
    visibility: Visibility | None = None,
    going_on: OpenScene | None = None,
) -> Detections:
    """Simulate the detections of a scene; equal arguments give equal detections.

    ``truth``: true boxes with the neutral ones, ``class_id`` an index into ``classes``; ``ego`` ``[F, 4]``: x y z (m)
    and yaw (rad) of the sensor, in the frame of the truth; ``seed``: not negative; ``dt``: s between frames, by which
    the memory of the profile decays; ``visibility``: `visibility_of` the truth, if known; ``going_on``: of a closed
    loop. Rows of a frame are sorted by descending score, then by x. Raises ShapeError for another shape of ``ego``, and
    UnknownNameError for a class that the profile does not have.
    """
    require_shape("ego", ego, (truth.frames, 4))
    visibility = visibility_of(truth, ego, sensor) if visibility is None else visibility
    frames, known, memory, level = len(ego), truth, None, None
    if going_on is not None:
        known, memory, level = going_on.known, going_on.memory, going_on.level
        ego = np.concatenate(
            [ego, np.repeat(ego[-1:], max(going_on.frames - frames, 0), axis=0)]
        )
    if memory is not None:
        memory.frame = (
            frames - 1
        )  # numbers of earlier frames are in the memory, so this one alone is detected
    field_ratio = float(
        min(sensor.field_of_view, 2 * np.pi) / np.deg2rad(profile.field_of_view)
    )
    scene = SensedScene(truth, ego, sensor, dt / profile.dt, field_ratio, level, memory)
    draws = Draws(seed)
    steps, noise_names = scene.steps, [profile.noise_name(name) for name in classes]
    grid = truth_grid(
        truth, [profile.classes[name] for name in noise_names], steps, memory
    )
    neighbours = truth_neighbours(grid, truth.box[:, :2], profile.neighbours)
    qualities = draw_qualities(grid, visibility, neighbours, draws)
    direction = visibility.bearing + ego[grid.frame, 3]
    hit = np.flatnonzero(
        qualities.reported & sensor.covers(visibility.distance, visibility.bearing)
    )
    errors = draw_errors(grid, neighbours, draws, hit)
    seen = visibility.distance[hit], direction[hit], qualities.random[hit]
    box, velocity = detected_boxes(truth.box[hit], truth.velocity[hit], errors, *seen)
    objects = DetectedRows(
        grid.frame[hit], box, velocity, truth.class_id[hit], qualities.score[hit]
    )
    similar = kept(memory, "similar", lambda: classes_of_same_noise(known, noise_names))
    false = [near_false_positives(grid, scene, qualities, similar, seed)]
    every = kept(
        memory,
        "reported",
        lambda: [
            reported_classes(known, classes, noise_names, *each)
            for each in profile.classes.items()
        ],
    )
    for number, (noise, reported) in enumerate(
        zip(profile.classes.values(), every, strict=True)
    ):
        if reported is not None:
            false.append(free_false_positives(noise, reported, scene, number, seed))
    rows = [objects, detect_false_positives(false, scene)]
    if going_on is not None and memory is None:
        rows = [select(part, part.frame < frames) for part in rows]
    return sorted_detections(rows, frames)

"""Simulation of a detector; ``README.md`` beside this file describes the model."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core import Detections, Floats, Truth, require_shape, select
from .draws import Draws, Memory, remembered
from .errors import detected_boxes, draw_errors
from .false_positives import (
    DetectedRows,
    ReportedClasses,
    SensedScene,
    detect_false_positives,
    reported_classes,
    sorted_detections,
)
from .free import free_false_positives
from .grid import truth_grid, truth_neighbours
from .near import classes_of_same_noise, near_false_positives
from .profile import Profile
from .quality import draw_qualities
from .visibility import Sensor, Visibility, visibility_of


@dataclass(frozen=True, eq=False)
class OpenScene:
    """A scene that goes on.

    Detections of a frame do not depend on later frames.
    """

    frames: int  # of the finished scene, at most
    known_truth: Truth  # true boxes whose classes and sizes false positives have
    level: float = 0.0  # m, of the ground
    # state after the frames before, if only the last frame has boxes
    memory: Memory | None = None


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
    """Simulate the detections of a scene.

    Equal arguments give equal detections. ``truth``: true boxes with the neutral ones,
    ``class_id`` an index into ``classes``; ``ego`` [F, 4]: x y z (m) and yaw (rad) of
    the sensor, in the frame of the truth; ``seed``: not negative; ``dt``: s between
    frames, by which the memory of the profile decays; ``visibility``: `visibility_of`
    the truth, if known; ``going_on``: state of a closed loop. Rows of a frame are
    sorted by descending score, then by x. Raises ShapeError for another shape of
    ``ego``, and UnknownNameError for a class that the profile does not have.
    """
    require_shape("ego", ego, (truth.frames, 4))
    if visibility is None:
        visibility = visibility_of(truth, ego, sensor)
    frames = len(ego)
    scene = _sensed_scene(truth, ego, profile, sensor, dt, going_on)
    memory = scene.memory
    noise_names = [profile.noise_name(name) for name in classes]
    noises = [profile.classes[name] for name in noise_names]
    grid = truth_grid(truth, noises, scene.steps, memory)
    draws = Draws(seed)
    neighbours = truth_neighbours(grid, truth.box[:, :2], profile.neighbours)
    qualities = draw_qualities(grid, visibility, neighbours, draws)

    in_coverage = sensor.covers(visibility.distance, visibility.bearing)
    hit_rows = np.flatnonzero(qualities.reported & in_coverage)
    box, velocity = detected_boxes(
        truth.box[hit_rows],
        truth.velocity[hit_rows],
        draw_errors(grid, neighbours, draws, hit_rows),
        visibility.distance[hit_rows],
        (visibility.bearing + scene.ego[grid.frame, 3])[hit_rows],
        qualities.random[hit_rows],
    )
    objects = DetectedRows(
        grid.frame[hit_rows],
        box,
        velocity,
        truth.class_id[hit_rows],
        qualities.score[hit_rows],
    )

    known_truth = truth if going_on is None else going_on.known_truth
    similar, reported = remembered(
        memory,
        "classes",
        lambda: (
            classes_of_same_noise(known_truth, noise_names),
            _reported_classes(known_truth, classes, noise_names, profile),
        ),
    )
    false_positives = [near_false_positives(grid, scene, qualities, similar, seed)]
    for noise_number, noise in enumerate(profile.classes.values()):
        noise_classes = reported[noise_number]
        if noise_classes is not None:
            false_positives.append(
                free_false_positives(noise, noise_classes, scene, noise_number, seed)
            )
    rows = [objects, detect_false_positives(false_positives, scene)]
    # free false positives are drawn up to the end of an open scene
    if going_on is not None and memory is None:
        rows = [select(part, part.frame < frames) for part in rows]
    return sorted_detections(rows, frames)


def _reported_classes(
    known_truth: Truth, classes: Sequence[str], noise_names: list[str], profile: Profile
) -> list[ReportedClasses | None]:
    """Return the classes of free false positives of each noise."""
    return [
        reported_classes(known_truth, classes, noise_names, name, noise)
        for name, noise in profile.classes.items()
    ]


def _sensed_scene(
    truth: Truth,
    ego: Floats,
    profile: Profile,
    sensor: Sensor,
    dt: float,
    going_on: OpenScene | None,
) -> SensedScene:
    """Return the scene as the detector needs it.

    The sensor of an open scene stands still at its end.
    """
    view = min(sensor.field_of_view, 2 * np.pi)
    field_ratio = float(view / np.deg2rad(profile.field_of_view))
    steps = dt / profile.dt
    if going_on is None:
        return SensedScene(truth, ego, sensor, steps, field_ratio)
    memory = going_on.memory
    if memory is not None:
        # numbers of earlier frames are in the memory, so the last one alone is detected
        memory.frame = len(ego) - 1
    missing = max(going_on.frames - len(ego), 0)
    ego = np.concatenate([ego, np.repeat(ego[-1:], missing, axis=0)])
    level = going_on.level
    return SensedScene(truth, ego, sensor, steps, field_ratio, level, memory)

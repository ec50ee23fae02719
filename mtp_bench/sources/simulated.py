"""Simulated detections in place of stored ones, for any source.

Scenes whose frames have separate axes are detected in the world.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from ..cards import Card, DetectorSection
from ..core import (
    DataError,
    Detections,
    Floats,
    Scene,
    Truth,
    pieces_of,
    rotate,
    transform_boxes,
)
from .motion import as_places, extent, looking_back

if TYPE_CHECKING:
    from ..detector import OpenScene, Sensor

MAX_SIMULATED_BYTES = 2**25  # of detected boxes that a process keeps
_SIMULATED: dict[bytes, Detections] = {}
_LOCK = Lock()
RowsT = TypeVar("RowsT", Truth, Detections)


def detected(
    scene: Scene, card: Card, seed: int | None = None, going_on: OpenScene | None = None
) -> Scene:
    """Return the scene with the detections of the card's simulated detector.

    Unchanged if it has stored ones. The noise depends on the scene's name and the
    detector's seed, or on ``seed`` if it is given. Measured velocities do not contain
    the next frame: true velocities that do are replaced by backward ones. An unknown
    velocity is measured as 0, as that of a false positive, since a missing one would
    show that a box is true and new. If every frame has its own frame of reference,
    velocities are those in the world, turned into the frames. ``going_on``: state of a
    closed loop. Raises DataError for a partly annotated scene.
    """
    if card.detector is None or (scene.detector and not scene.simulated):
        return scene
    if len(scene.annotated_frames) < scene.frames:
        raise DataError(
            f"scene {scene.name!r}: only some of its frames are annotated, so a "
            "simulated detector would see nothing in the others; use the detections "
            "of the files"
        )
    from ..detector import simulate, visibility_of, visible_fractions

    profile = card.detector.resolved
    traits = card.source.traits
    sensor = sensor_of(card.detector, scene, traits.bounded_by_truth)
    visible = scene.visible
    if visible is None:
        visible = visible_fractions(scene.truth, scene.ego)
    period_s = 1.0 / card.task.rate
    truth, world_scene = _measured_world(scene, card, period_s)
    scene_seed = _scene_seed(card.detector.seed, scene.name) if seed is None else seed
    detector_settings = card.task.classes, profile, sensor, scene_seed, period_s

    def simulate_scene() -> Detections:
        fractions = visibility_of(world_scene.truth, world_scene.ego, sensor, visible)
        return simulate(
            world_scene.truth, world_scene.ego, *detector_settings, fractions, going_on
        )

    if seed is None and going_on is None:
        arrays = [visible, world_scene.ego, *vars(world_scene.truth).values()]
        detections = _simulated_once(detector_settings, arrays, simulate_scene)
    else:
        detections = simulate_scene()
    if scene.world is not None:
        detections = in_frames(detections, scene.world, scene.time, period_s)
    if traits.places_only:
        detections = as_places(detections)
    return replace(
        scene,
        truth=truth,
        detections=detections,
        detector=f"{profile.name}, simulated detections",
        simulated=True,
        skipped={},
        visible=visible,
    )


def _measured_world(scene: Scene, card: Card, period_s: float) -> tuple[Truth, Scene]:
    """Return the truth, and the scene in the world, with velocities as measured."""
    truth = scene.truth
    if card.velocity and card.source.traits.velocity_ahead:
        truth = looking_back(truth, scene.time, period_s)
    world_scene = in_world(replace(scene, truth=truth))
    if not card.velocity:
        return truth, world_scene
    measured = world_scene.truth
    if scene.world is not None:  # velocities in other frames of reference
        measured = looking_back(measured, scene.time, period_s)
    velocity = np.nan_to_num(measured.velocity)
    return truth, replace(world_scene, truth=replace(measured, velocity=velocity))


def sensor_of(section: DetectorSection, scene: Scene, bounded_by_truth: bool) -> Sensor:
    """Return the sensor of a card's detector.

    ``bounded_by_truth``: without an area in the card, it is that of the true boxes.
    """
    from ..detector import Sensor

    area = section.area
    if area is None and bounded_by_truth:
        area = extent(scene.truth.box)
    return Sensor(section.reach, float(np.deg2rad(section.field_of_view)), area)


def _scene_seed(seed: int, name: str) -> int:
    """Return a seed that is equal in every process and on every machine."""
    digest = hashlib.sha256(f"{seed}|detector|{name}".encode()).digest()
    return int.from_bytes(digest[:8], "big")


def _simulated_once(
    detector_settings: object, arrays: Sequence[Any], simulate: Callable[[], Detections]
) -> Detections:
    """Simulate detections once per ``detector_settings`` and ``arrays``.

    All settings of a comparison play the same scenes.
    """
    sha256 = hashlib.sha256(repr(detector_settings).encode())
    for array in arrays:
        sha256.update(f"{array.dtype.str}{array.shape}".encode() + array.tobytes())
    key = sha256.digest()
    with _LOCK:
        detections = _SIMULATED.pop(key, None)
    if detections is None:
        detections = simulate()
    with _LOCK:
        _SIMULATED[key] = detections
        while (
            sum(entry.box.nbytes for entry in _SIMULATED.values()) > MAX_SIMULATED_BYTES
        ):
            del _SIMULATED[next(iter(_SIMULATED))]  # the least recently used
    # a copy, since a caller may write into it
    columns = {name: np.array(values) for name, values in vars(detections).items()}
    return replace(detections, **columns)


def in_world(scene: Scene) -> Scene:
    """Return truth, detections and ego of a scene in one frame of reference.

    The scene as it is if it does not know where its frames are. Boxes turn about z
    alone and stay upright; velocities are turned, not made anew.
    """
    if scene.world is None:
        return scene
    return replace(
        scene,
        ego=scene.world,
        world=None,
        truth=_to_world(scene.truth, scene.world),
        detections=_to_world(scene.detections, scene.world),
    )


def in_frames(
    detections: Detections, world: Floats, time: Floats, period: float
) -> Detections:
    """Return detections of the world in the frames ``world`` [F, 4] x y z yaw.

    ``time`` [F] s of the frames. Velocities are those in the frames: an object that
    stands in the world moves against a frame that drives. In the first frame, and after
    a hole in time by the nominal ``period``, s, they are those in the world.
    """
    frame = detections.frame_of_rows
    is_first = np.diff(pieces_of(time, period), prepend=-1)[frame] > 0
    previous_frame = np.where(is_first, frame, frame - 1)
    step_s = np.where(is_first, 1.0, time[frame] - time[previous_frame])[:, None]
    box = _to_frame(detections.box, world[frame])
    # without a frame before: moved for 1 s in its own frame, which turns the velocity
    earlier_box = detections.box.copy()
    earlier_box[:, :2] -= step_s * detections.velocity
    moved_m = box[:, :2] - _to_frame(earlier_box, world[previous_frame])[:, :2]
    return replace(detections, box=box, velocity=moved_m / step_s)


def _to_world(rows: RowsT, world: Floats) -> RowsT:
    """Bring rows in the frames ``world`` [F, 4] to the world."""
    pose = world[rows.frame_of_rows]
    box = transform_boxes(rows.box, pose[:, 3], pose[:, :3])
    return replace(rows, box=box, velocity=rotate(rows.velocity, pose[:, 3]))


def _to_frame(box: Floats, pose: Floats) -> Floats:
    """Return boxes [R, 7] of the world as seen from ``pose`` [R, 4]."""
    yaw = -pose[:, 3]
    return transform_boxes(box, yaw, -rotate(pose[:, :3], yaw))

"""Simulated detections in place of stored ones, for any source and for scenes whose frames have separate axes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from ..cards import Card
from ..core import Detections, Floats, Scene, Truth, pieces_of, rotate, transform_boxes
from .motion import as_places, extent, looking_back

if TYPE_CHECKING:
    from ..detector import OpenScene

KEPT_BYTES = 2**25  # of detected boxes that a process keeps
_KEPT: dict[bytes, Detections] = {}
_LOCK = Lock()
RowsT = TypeVar("RowsT", Truth, Detections)


def detected(
    scene: Scene, card: Card, seed: int | None = None, going_on: OpenScene | None = None
) -> Scene:
    """``scene`` with the detections of the card's simulated detector; unchanged if it has stored ones.

    The noise depends on the scene's name and the detector's seed, or on ``seed`` alone if it is given. Measured
    velocities do not contain the next frame: true velocities that do are replaced by backward ones. An unknown velocity
    is measured as 0, as that of a false positive, since a missing one would show that a box is true and new. If every
    frame has its own frame of reference, velocities are those in the world, turned into the frames.
    """
    if card.detector is None or (scene.detector and not scene.simulated):
        return scene
    from ..detector import Sensor, simulate, visibility_of, visible_fractions

    section, profile = card.detector, card.detector.resolved
    area = section.area
    if area is None and card.source.traits.bounded_by_truth:
        area = extent(scene.truth.box)
    sensor = Sensor(section.reach, float(np.deg2rad(section.field_of_view)), area)
    visible = (
        scene.visible
        if scene.visible is not None
        else visible_fractions(scene.truth, scene.ego)
    )
    truth, period = scene.truth, 1.0 / card.task.rate
    if card.velocity and card.source.traits.velocity_ahead:
        truth = looking_back(truth, scene.time, period)
    once = seed is not None or going_on is not None
    if seed is None:  # equal in every process and on every machine
        digest = hashlib.sha256(
            f"{section.seed}|detector|{scene.name}".encode()
        ).digest()
        seed = int.from_bytes(digest[:8], "big")
    world = in_world(replace(scene, truth=truth))
    if card.velocity:
        moving = (
            world.truth
            if scene.world is None
            else looking_back(world.truth, scene.time, period)
        )
        world = replace(
            world, truth=replace(moving, velocity=np.nan_to_num(moving.velocity))
        )
    noise = card.task.classes, profile, sensor, seed, period

    def simulated() -> Detections:
        seen = visibility_of(world.truth, world.ego, sensor, visible)
        return simulate(world.truth, world.ego, *noise, seen, going_on)

    found = (
        simulated()
        if once
        else _remembered(
            noise, [visible, world.ego, *vars(world.truth).values()], simulated
        )
    )
    if scene.world is not None:
        found = in_frames(found, scene.world, scene.time, period)
    if card.source.traits.places_only:
        found = as_places(found)
    label = f"{profile.name}, simulated detections"
    return replace(
        scene,
        truth=truth,
        detections=found,
        detector=label,
        simulated=True,
        skipped={},
        visible=visible,
    )


def _remembered(
    noise: object, arrays: Sequence[Any], simulate: Callable[[], Detections]
) -> Detections:
    """Detections of ``noise`` and ``arrays``, simulated once: all settings of a comparison play the same scenes."""
    digest = hashlib.sha256(repr(noise).encode())
    for array in arrays:
        digest.update(f"{array.dtype.str}{array.shape}".encode() + array.tobytes())
    with _LOCK:
        found = _KEPT.pop(digest.digest(), None)
    found = simulate() if found is None else found
    with _LOCK:
        _KEPT[digest.digest()] = found
        while sum(each.box.nbytes for each in _KEPT.values()) > KEPT_BYTES:
            del _KEPT[next(iter(_KEPT))]  # not asked for for longest
    return replace(
        found, **{name: np.array(column) for name, column in vars(found).items()}
    )


def in_world(scene: Scene) -> Scene:
    """Truth, detections and ego of a scene in one frame of reference, if the scene knows where its frames are.

    Else the scene as it is. Boxes turn about z alone and stay upright; velocities are turned, not made anew.
    """
    if scene.world is None:
        return scene
    truth, detections = (
        _moved(scene.truth, scene.world),
        _moved(scene.detections, scene.world),
    )
    return replace(
        scene, ego=scene.world, world=None, truth=truth, detections=detections
    )


def in_frames(
    seen: Detections, world: Floats, time: Floats, period: float
) -> Detections:
    """Detections of the world in the frames ``world`` ``[F, 4]`` x y z yaw, which are at the times ``time`` ``[F]`` s.

    Velocities are those in the frames: an object that stands in the world moves against a frame that drives. In the
    first frame, and after a hole in time by the nominal ``period``, s, they are those in the world.
    """
    frame = seen.frame_of_rows
    first = np.diff(pieces_of(time, period), prepend=-1)[frame] > 0
    before = np.where(first, frame, frame - 1)
    passed = np.where(first, 1.0, time[frame] - time[before])[:, None]
    box = _placed(seen.box, world[frame])
    back = np.concatenate(
        [seen.box[:, :2] - passed * seen.velocity, seen.box[:, 2:]], axis=1
    )
    return replace(
        seen,
        box=box,
        velocity=(box[:, :2] - _placed(back, world[before])[:, :2]) / passed,
    )


def _moved(rows: RowsT, world: Floats) -> RowsT:
    """Rows in the frames ``world`` ``[F, 4]``, brought to the world."""
    pose = world[rows.frame_of_rows]
    box = transform_boxes(rows.box, pose[:, 3], pose[:, :3])
    return replace(rows, box=box, velocity=rotate(rows.velocity, pose[:, 3]))


def _placed(box: Floats, pose: Floats) -> Floats:
    """Boxes ``[R, 7]`` of the world as seen from ``pose`` ``[R, 4]``."""
    turn = -pose[:, 3]
    return transform_boxes(box, turn, -rotate(pose[:, :3], turn))

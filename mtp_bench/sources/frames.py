"""Scenes in which every frame has its own frame of reference, brought to that of the world and back."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from ..geometry import rotate, transform_boxes
from ..types import Detections, Floats, Scene, Truth

RowsT = TypeVar("RowsT", Truth, Detections)


def in_world(scene: Scene) -> Scene:
    """Truth, detections and ego of a scene in one frame of reference, if the scene knows where its frames are.

    Else the scene as it is. Boxes turn about z alone and stay upright; velocities are turned, not made anew.
    """
    if scene.world is None:
        return scene
    truth, detections = _moved(scene.truth, scene.world), _moved(scene.detections, scene.world)
    return replace(scene, ego=scene.world, world=None, truth=truth, detections=detections)


def in_frames(seen: Detections, world: Floats, time: Floats) -> Detections:
    """Detections of the world in the frames ``world`` ``[F, 4]`` x y z yaw, which are at the times ``time`` ``[F]`` s.

    Velocities are those in the frames: an object that stands in the world moves against a frame that drives. The motion
    of the frames before the first is unknown.
    """
    frame = seen.frame_of_rows
    before = np.maximum(frame - 1, 0)
    passed = np.where(frame > 0, time[frame] - time[before], 1.0)[:, None]
    box = _placed(seen.box, world[frame])
    back = np.concatenate([seen.box[:, :2] - passed * seen.velocity, seen.box[:, 2:]], axis=1)
    velocity = (box[:, :2] - _placed(back, world[before])[:, :2]) / passed
    return replace(seen, box=box, velocity=velocity)


def _moved(rows: RowsT, world: Floats) -> RowsT:
    """Rows in the frames ``world`` ``[F, 4]``, brought to the world."""
    pose = world[rows.frame_of_rows]
    box = transform_boxes(rows.box, pose[:, 3], pose[:, :3])
    return replace(rows, box=box, velocity=rotate(rows.velocity, pose[:, 3]))


def _placed(box: Floats, pose: Floats) -> Floats:
    """Boxes ``[R, 7]`` of the world as seen from ``pose`` ``[R, 4]``."""
    turn = -pose[:, 3]
    return transform_boxes(box, turn, -rotate(pose[:, :3], turn))

"""Scenes whose every frame has its own frame of reference, in that of the world and back."""

from __future__ import annotations

from dataclasses import replace

from ..geometry import rotate, transform_boxes
from ..types import Detections, Floats, Scene


def in_world(scene: Scene) -> Scene:
    """Truth, detections and ego of a scene in one frame of reference, where the scene says where its frames are.

    Else the scene as it is. Boxes turn about z alone and stay upright; velocities are turned, not made anew.
    """
    world, truth, seen = scene.world, scene.truth, scene.detections
    if world is None:
        return scene
    pose, place = world[truth.frame_of_rows], world[seen.frame_of_rows]
    return replace(
        scene,
        ego=world,
        world=None,
        truth=replace(
            truth,
            box=transform_boxes(truth.box, pose[:, 3], pose[:, :3]),
            velocity=rotate(truth.velocity, pose[:, 3]),
        ),
        detections=replace(
            seen,
            box=transform_boxes(seen.box, place[:, 3], place[:, :3]),
            velocity=rotate(seen.velocity, place[:, 3]),
        ),
    )


def in_frames(seen: Detections, world: Floats) -> Detections:
    """Detections of the world in the frames ``world`` ``[F, 4]`` x y z yaw: the inverse of `in_world`."""
    pose = world[seen.frame_of_rows]
    back = -pose[:, 3]
    box = transform_boxes(seen.box, back, -rotate(pose[:, :3], back))
    return replace(seen, box=box, velocity=rotate(seen.velocity, back))

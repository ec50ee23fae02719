"""Targets, live frames, and neutral objects."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mtp_bench.cards import Card
from mtp_bench.core import Bools, Floats, ImageField, Scene

NEAR = 1e-6  # m


@dataclass(frozen=True, eq=False)
class Target:
    """An object of a scene at a frame, whose future is asked for."""

    scene: int
    object: int
    t: int
    row: int  # of the truth
    kind: int  # class
    future: Floats  # [T, 2]
    ego: Floats  # [T, 2] where the ego is then
    owner: tuple[str, int]  # identity of the object in the recording


def after_hole(scene: Scene, card: Card, t: int) -> bool:
    """True if the step from frame t - 1 to t is longer than 1.5 times that of the card."""
    return t > 0 and bool(scene.time[t] - scene.time[t - 1] > 1.5 / card.task.rate)


def can_exist(scene: Scene, card: Card, t: int) -> bool:
    """True if a target of frame t would have all its frames within the scene, and no hole among them."""
    first = t if scene.listed_targets else t - card.task.past + 1
    last = t + card.task.future
    if first < 0 or last >= scene.frames:
        return False
    return not any(after_hole(scene, card, u) for u in range(first + 1, last + 1))


def live_frames(scene: Scene, card: Card) -> list[int]:
    """Reading: a frame from which a hole lies less than P - 1 frames back, or T ahead, can have no target either."""
    return [t for t in range(scene.frames) if can_exist(scene, card, t)]


def find_targets(scenes: Sequence[Scene], card: Card) -> list[Target]:
    """All targets, sorted by scene, frame and row of the truth.

    Reading: ``eligible`` is asked of the row at t only; neutral rows are no true frames, of the past and future too,
    but a box that the image cannot confirm is.
    """
    found = []
    for s, scene in enumerate(scenes):
        truth, neutral = scene.truth, neutral_rows(scene)
        frame = truth.frame_of_rows
        row_of = {(int(truth.object_id[r]), int(frame[r])): r for r in range(len(frame)) if not truth.neutral[r]}
        past = 1 if scene.listed_targets else card.task.past
        for r in range(len(frame)):
            g, t = int(truth.object_id[r]), int(frame[r])
            needed = [(g, u) for u in range(t - past + 1, t + card.task.future + 1)]
            if neutral[r] or not truth.eligible[r] or any(key not in row_of for key in needed):
                continue
            if not can_exist(scene, card, t):
                continue
            future = np.array([truth.box[row_of[g, t + tau], :2] for tau in range(1, card.task.future + 1)], float)
            ego = np.array(scene.ego[t + 1 : t + 1 + card.task.future, :2], float)
            owner = (scene.recording or scene.name, g)
            found.append(Target(s, g, t, r, int(truth.class_id[r]), future, ego, owner))
    return found


def neutral_rows(scene: Scene) -> Bools:
    """Which true boxes are neither targets nor wrong to forecast [R]."""
    truth, neutral = scene.truth, np.array(scene.truth.neutral, dtype=bool)
    if scene.image is not None:
        for r, t in enumerate(truth.frame_of_rows):
            neutral[r] |= unconfirmed(scene.image, int(t), truth.box[r, :2], int(truth.class_id[r]))
    return neutral


def unconfirmed(image: ImageField, t: int, xy: Floats, kind: int) -> bool:
    """True if no label of the image could confirm an object of class ``kind`` at ``xy``.

    Reading: the 2D box is the hull of what lies ahead of the camera, clipped to the image. Height and area are those of
    the clipped box; a region is compared on its own, not their union.
    """
    l, w, h = image.box_size[kind]
    bottom, yaw = image.height[t] - 1.65, image.heading[t]
    corners, u, v = [], [], []
    for along, across, up in itertools.product((-l / 2, l / 2), (-w / 2, w / 2), (0.0, h)):
        x = xy[0] + math.cos(yaw) * along - math.sin(yaw) * across
        y = xy[1] + math.sin(yaw) * along + math.cos(yaw) * across
        corners.append(image.projection[t] @ np.array([x, y, bottom + up, 1.0]))
    for i, corner in enumerate(corners):
        for end in (corners[i ^ 1], corners[i ^ 2], corners[i ^ 4]):
            if corner[2] >= NEAR:
                ahead = corner
            elif end[2] >= NEAR:  # the edge crosses the plane of the camera
                ahead = corner + (NEAR - corner[2]) / (end[2] - corner[2]) * (end - corner)
            else:
                continue
            u.append(ahead[0] / ahead[2])
            v.append(ahead[1] / ahead[2])
    if not u:
        return True
    left, right = max(min(u), 0.0), min(max(u), float(image.size[0]))
    top, bottom_edge = max(min(v), 0.0), min(max(v), float(image.size[1]))
    if right <= left or bottom_edge - top <= 25:
        return True
    area = (right - left) * (bottom_edge - top)
    for a, b, c, d in image.region[image.region_start[t] : image.region_start[t + 1]]:
        common = max(0.0, min(right, c) - max(left, a)) * max(0.0, min(bottom_edge, d) - max(top, b))
        if common > area / 2:
            return True
    return False

"""Which part of the world the pictures of a scene show: one size for all its frames, so that nothing jumps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...cards import Card
from ...types import Floats, Scene
from .canvas import Viewport

SMALLEST, LARGEST = 16.0, 50.0  # m, half of what is shown around a vehicle
MARGIN = 3.0  # m around the objects of a fixed place


@dataclass(frozen=True)
class Camera:
    """A view from above that goes along with the ego, or stays; it never turns."""

    follows: bool  # the ego
    view: Viewport  # its x: metres ahead of the ego, where it follows

    def at(self, ego: Floats) -> Viewport:
        """What is shown where the ego's pose is ``ego`` [4]."""
        if not self.follows:
            return self.view
        x, y, yaw = float(ego[0]), float(ego[1]), float(ego[3])
        return replace(self.view, x=x + self.view.x * np.cos(yaw), y=y + self.view.x * np.sin(yaw))


def camera(scene: Scene, card: Card) -> Camera:
    """The camera of a scene, by its detections; by its true boxes where an agent is given those instead."""
    seen = scene.detections if len(scene.detections.box) else scene.truth
    xy = seen.box[:, :2]
    if not card.has_ego:
        return _fixed(xy if len(xy) else scene.ego[:, :2])
    if len(xy) == 0:
        return Camera(True, Viewport(0.0, 0.0, 2 * SMALLEST, 2 * SMALLEST))
    return _following(xy, scene.ego[seen.frame_of_rows])


def _following(xy: Floats, pose: Floats) -> Camera:
    """A camera that sees most of the places ``xy`` [R, 2] from the ego's poses [R, 4] at that time."""
    gap = xy - pose[:, :2]
    cos, sin = np.cos(pose[:, 3]), np.sin(pose[:, 3])
    ahead, aside = cos * gap[:, 0] + sin * gap[:, 1], cos * gap[:, 1] - sin * gap[:, 0]
    rear, front = (float(value) for value in np.quantile(ahead, [0.05, 0.95]))
    rear, front = min(rear, -5.0), max(front, 5.0)
    half = max((front - rear) / 2, float(np.quantile(np.abs(aside), 0.9)), SMALLEST)
    # where the detections reach too far for one picture, what is near the ego is what matters
    center = (front + rear) / 2 if half <= LARGEST else np.clip((front + rear) / 2, -LARGEST / 2, LARGEST / 2)
    half = min(half, LARGEST)
    return Camera(True, Viewport(float(center), 0.0, 2 * half, 2 * half))


def _fixed(xy: Floats) -> Camera:
    low, high = np.quantile(xy, 0.01, axis=0) - MARGIN, np.quantile(xy, 0.99, axis=0) + MARGIN
    (x, y), (wide, tall) = (low + high) / 2, np.maximum(high - low, 2 * MARGIN)
    return Camera(False, Viewport(float(x), float(y), float(wide), float(tall)))

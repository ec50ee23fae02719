"""The frame of reference of the observations and answers of an episode."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry import rotate, transform_boxes
from ..types import Floats, Scene


@dataclass(frozen=True, eq=False)
class LocalFrame:
    """Planar rigid motion that takes the scene's frame of reference to the frame of the observations."""

    yaw: float
    translation: Floats  # [3] m, applied after the rotation

    @classmethod
    def of(cls, scene: Scene, rng: np.random.Generator | None = None) -> LocalFrame:
        """The frame in which the first ego pose is the origin, moved at random if ``rng`` is given."""
        x, y, z, ego_yaw = (float(value) for value in scene.ego[0])
        turn, shift = 0.0, np.zeros(3)
        if rng is not None:
            turn = float(rng.uniform(-np.pi, np.pi))
            shift = rng.uniform(-1.0, 1.0, 3) * np.array([100.0, 100.0, 1.0])
        yaw = turn - ego_yaw
        return cls(yaw, shift - rotate(np.array([x, y, z]), yaw))

    def to_local(self, box: Floats) -> Floats:
        """Boxes [R, 7] of the scene in the local frame."""
        return transform_boxes(box, self.yaw, self.translation)

    def to_scene(self, box: Floats) -> Floats:
        """Boxes [R, 7] of the local frame in the scene's."""
        return transform_boxes(box, -self.yaw, -rotate(self.translation, -self.yaw))

"""Detections that a simulated detector makes of true boxes; ``README.md`` beside this file describes the models."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..shapes import require_shape
from ..types import Detections, Floats, Truth
from .model1.profile import Profile1
from .model1.simulate import simulate1
from .model2.profile import Profile
from .model2.simulate import simulate2
from .sight import Sensor, Sight
from .sight import sight as sight_of
from .surroundings import Surroundings


def simulate(
    truth: Truth,
    ego: Floats,
    classes: Sequence[str],
    profile: Profile | Profile1,
    sensor: Sensor,
    seed: int,
    dt: float,
    sight: Sight | None = None,
) -> Detections:
    """What a detector with the noise of ``profile`` reports of a scene, the same for the same arguments.

    Args:
        truth: true boxes, the neutral ones included; ``class_id`` is an index into ``classes``.
        ego: ``[F, 4]`` x y z yaw of the sensor, in the truth's frame of reference.
        classes: names that the profile must know, else UnknownNameError.
        profile: the noise.
        sensor: what is covered; nothing else is ever detected.
        seed: not negative. Every kind of noise has its own stream: a changed level leaves all other draws alone.
        dt: s between frames. Where it differs from the profile's, memory decays accordingly.
        sight: `sight(truth, ego, sensor)` if known already.

    Rows within a frame are by descending score, ties by x.
    """
    require_shape("ego", ego, (truth.frames, 4))
    steps = dt / profile.dt
    sight = sight_of(truth, ego, sensor) if sight is None else sight
    wider = min(sensor.field_of_view, 2 * np.pi) / np.deg2rad(profile.field_of_view)
    around = Surroundings(truth, ego, sensor, steps, float(wider))
    if isinstance(profile, Profile1):
        return simulate1(truth, classes, profile, around, sight, seed)
    return simulate2(truth, classes, profile, around, sight, seed)

"""Truths and profiles of model 2 with one property at a time."""

from __future__ import annotations

from typing import Any

import numpy as np

from mtp_bench.detector import Profile
from mtp_bench.detector.sight import Sensor, Sight
from mtp_bench.detector.simulate import simulate
from mtp_bench.types import Detections, Floats, Truth
from tests.support.detector_scenes import EVERYWHERE, SPACING, crowd, seen_at

DT = 0.5
CLASSES = ("car",)
NEW = {"bias": 0.0, "ar": 0.0, "phi": 0.0, "white": 1.0}
LASTING = {"bias": 0.3, "ar": 0.5, "phi": 0.8, "white": 0.2}
ALONE = {"share": 0.0, "bias": 0.0, "phi": 0.0, "shared": 0.0}
SCORES = {"latent": (0.0, 1.0, 2.0, 3.0, 6.0), "score": (0.1, 0.3, 0.6, 0.9, 1.0)}
FREE: dict[str, Any] = {
    **LASTING, "rate": 3.0, "dispersion": 1.0, "chance": 0.3, "survive": 0.9, "siblings": 0.0, "spread": 0.5,
    "family": 0.0, "size": (4.0, 1.8, 1.5), "distance": tuple(np.linspace(3.0, 58.0, 11)),
    "score": tuple(np.linspace(0.1, 0.9, 11)),
}  # fmt: skip
NEAR: dict[str, Any] = {
    **LASTING, "chance": 0.2, "score": tuple(np.linspace(0.1, 0.9, 11)), "offset": tuple(np.linspace(0.0, 3.0, 11)),
    "same": (1.0, 1.0, 1.0),
}  # fmt: skip


def profile_of(**sections: Any) -> Profile:
    """A detector of cars without errors that misses a tenth; sections change it."""
    still = {**NEW, "s0": 0.0, "s1": 0.0}
    quality = {**NEW, "location": (1.2816, 0, 0, 0, 0, 0, 0), "lapses": ALONE, **SCORES, "floor": 0.1}
    car: dict[str, Any] = {
        "quality": quality, "radial": still, "tangential": still, "nu": 5.0,
        "heading": {"scale": 0.0, "flip": 0.0, "flip_again": 0.0},
        "size": {"mean": (0, 0, 0), "deviation": (0, 0, 0)}, "velocity": 0.0,
    }  # fmt: skip
    for name, change in sections.items():
        car[name] = {**(car.get(name) or {}), **change} if isinstance(change, dict) else change
    content = {"model": 2, "name": "synthetic", "summary": "", "source": "", "dt": DT, "classes": {"car": car}}
    return Profile.model_validate(content)


def detect(
    truth: Truth, profile: Profile, seed: int = 0, sight: Sight | None = None, sensor: Sensor = EVERYWHERE
) -> Detections:
    """Detections by a sensor at the origin; without ``sight`` all objects are seen alike, at 20 m."""
    ego = np.zeros((truth.frames, 4))
    return simulate(truth, ego, CLASSES, profile, sensor, seed, DT, seen_at(truth, 20.0) if sight is None else sight)


def cars(frames: int, objects: int, gap: float = SPACING) -> Truth:
    """Standing cars in a row along x, ``gap`` m apart."""
    truth = crowd(frames, objects)
    box: Floats = truth.box.copy()
    box[:, 0] *= gap / SPACING
    return Truth(truth.start, box, truth.velocity * 0.0, *_rest(truth))


def _rest(truth: Truth) -> tuple[Any, ...]:
    return truth.class_id, truth.object_id, truth.eligible, truth.neutral

"""Truths of many objects, profiles with one property at a time, and the detections they give."""

from typing import Any

import numpy as np

from mtp_bench.core import Bools, Detections, Floats, Ints, Truth, starts_of_sorted
from mtp_bench.detector import Profile
from mtp_bench.detector.simulation import simulate
from mtp_bench.detector.visibility import Sensor, Visibility

SIZE = (4.0, 2.0, 1.6)
SPACING = 20.0  # m between the objects of a crowd
DT = 0.5
CLASSES = ("car",)
EVERYWHERE = Sensor(reach=1e9, field_of_view=2 * np.pi)
AHEAD = Sensor(reach=60.0, field_of_view=np.pi / 2)
NEW = {"bias": 0.0, "ar": 0.0, "phi": 0.0, "white": 1.0}
LASTING = {"bias": 0.3, "ar": 0.5, "phi": 0.8, "white": 0.2}
NO_LAPSES = {"share": 0.0, "bias": 0.0, "phi": 0.0, "shared": 0.0}
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
    quality = {**NEW, "location": (1.2816, 0, 0, 0, 0, 0, 0), "lapses": NO_LAPSES, **SCORES, "floor": 0.1}
    car: dict[str, Any] = {
        "quality": quality, "radial": still, "tangential": still, "nu": 5.0,
        "heading": {"scale": 0.0, "flip": 0.0, "flip_again": 0.0},
        "size": {"mean": (0, 0, 0), "deviation": (0, 0, 0)}, "velocity": 0.0,
    }  # fmt: skip
    for name, change in sections.items():
        car[name] = {**(car.get(name) or {}), **change} if isinstance(change, dict) else change
    return Profile.model_validate({"name": "synthetic", "summary": "", "source": "", "dt": DT, "classes": {"car": car}})


def detect(
    truth: Truth, profile: Profile, seed: int = 0, visibility: Visibility | None = None, sensor: Sensor = EVERYWHERE,
    dt: float = DT,
) -> Detections:  # fmt: skip
    """Detections by a sensor at the origin; without ``visibility`` all objects are equally visible, at 20 m."""
    ego = np.zeros((truth.frames, 4))
    seen = seen_at(truth, 20.0) if visibility is None else visibility
    return simulate(truth, ego, CLASSES, profile, sensor, seed, dt, seen)


def truth_of(frame: Ints, object_id: Ints, box: Floats, frames: int) -> Truth:
    """A truth of cars that move at 1, 2 m/s, from rows in the order of frames."""
    rows = len(frame)
    start = starts_of_sorted(frame, frames)
    velocity = np.tile([1.0, 2.0], (rows, 1))
    return Truth(start, box, velocity, np.zeros(rows, int), object_id, np.ones(rows, bool), np.zeros(rows, bool))


def grid_truth(box: Floats, velocity: Floats, kind: Ints, object_id: Ints | None = None) -> Truth:
    """Objects that are there in every frame: boxes ``[F, J, 7]``; velocities ``[J, 2]``, classes and ids ``[J]``."""
    frames, objects = box.shape[:2]
    rows = frames * objects
    return Truth(
        start=objects * np.arange(frames + 1), box=box.reshape(-1, 7), velocity=np.tile(velocity, (frames, 1)),
        class_id=np.tile(kind, frames),
        object_id=np.tile(np.arange(objects) if object_id is None else object_id, frames),
        eligible=np.ones(rows, dtype=bool), neutral=np.zeros(rows, dtype=bool),
    )  # fmt: skip


def cars(frames: int, objects: int, gap: float = SPACING) -> Truth:
    """Standing cars in a row along x, ``gap`` m apart."""
    box = np.tile([0.0, 5.0, 0.8, 0.3, *SIZE], (frames, objects, 1))
    box[..., 0] = gap * np.arange(objects)
    return grid_truth(box, np.zeros((objects, 2)), np.zeros(objects, int))


def seen_at(truth: Truth, distance: float, occlusion: int = 0, bearing: float = 0.0) -> Visibility:
    """A visibility with the same distance, bearing and occlusion for every object."""
    rows = len(truth.box)
    visible = np.full(rows, distance), np.full(rows, bearing), np.full(rows, occlusion)
    return Visibility(*visible, truncated=np.zeros(rows, dtype=bool))


def on_grid(detections: Detections, gap: float, objects: int) -> tuple[Bools, Floats, Floats]:
    """Of cars in a row: hit ``[F, J]``; scores ``[F, J]`` and boxes ``[F, J, 7]``, NaN where undetected."""
    frame, column = detections.frame_of_rows, np.rint(detections.box[:, 0] / gap).astype(int)
    hit = np.zeros((detections.frames, objects), dtype=bool)
    score, box = np.full(hit.shape, np.nan), np.full((*hit.shape, 7), np.nan)
    hit[frame, column], score[frame, column], box[frame, column] = True, detections.score, detections.box
    return hit, score, box


def correlation(one: Floats, other: Floats) -> float:
    finite = np.isfinite(one) & np.isfinite(other)
    return float(np.corrcoef(one[finite], other[finite])[0, 1])


def traffic(frames: int = 30, objects: int = 20) -> tuple[Truth, Floats]:
    """Objects of three classes on straight ways at 10 Hz, and the poses of a sensor that drives through them."""
    rng = np.random.default_rng(5)
    place, velocity = rng.uniform(-60, 60, (objects, 2)), rng.normal(0, 4, (objects, 2))
    box = np.zeros((frames, objects, 7))
    box[..., :2] = place + np.arange(frames)[:, None, None] * 0.1 * velocity
    box[..., 2] = 0.8
    box[..., 3] = np.arctan2(velocity[:, 1], velocity[:, 0])
    box[..., 4:] = np.array([[4.5, 1.9, 1.6], [9.0, 2.5, 3.0], [0.8, 0.7, 1.7]])[np.arange(objects) % 3]
    truth = grid_truth(box, velocity, np.arange(objects) % 3, rng.permutation(objects) * 7 + 100)
    ego = np.zeros((frames, 4))
    ego[:, 0], ego[:, 3] = np.arange(frames) * 0.8, np.linspace(0, 0.6, frames)
    return truth, ego

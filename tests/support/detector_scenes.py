"""Truths of many objects at one distance, and noise profiles with one kind of noise at a time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mtp_bench.detector import Profile, Profile2, load_profile
from mtp_bench.detector.sight import Sensor, Sight
from mtp_bench.detector.simulate import simulate
from mtp_bench.types import Bools, Detections, Floats, Ints, Truth, starts_of_sorted
from tests.support.detector_statistics import ClassStatistics

SIZE = (4.0, 2.0, 1.6)
SPACING = 20.0  # m between the objects of a crowd: a detection belongs to the nearest one
DT = 0.1
EVERYWHERE = Sensor(reach=1e9, field_of_view=2 * np.pi)
WHITE = {"bias": 0.0, "ar": 0.0, "phi": 0.0, "white": 1.0}
MEMORY = {"bias": 0.2, "ar": 0.5, "phi": 0.8, "white": 0.3}
CLASSES = ("car",)
AHEAD = Sensor(reach=60.0, field_of_view=np.pi / 2)
FALSE_POSITIVES: dict[str, Any] = {
    "rate": 2.0,
    "dispersion": 1.0,
    "survive": 0.4,
    "score": 3.0,
    "score_deviation": 0.5,
    "size": (4.0, 1.8, 1.5),
}


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
        start=objects * np.arange(frames + 1),
        box=box.reshape(-1, 7),
        velocity=np.tile(velocity, (frames, 1)),
        class_id=np.tile(kind, frames),
        object_id=np.tile(np.arange(objects) if object_id is None else object_id, frames),
        eligible=np.ones(rows, dtype=bool),
        neutral=np.zeros(rows, dtype=bool),
    )


def crowd(frames: int, objects: int) -> Truth:
    """Standing objects in a row along x, object j at x = 20 j."""
    box = np.tile([0.0, 5.0, 0.8, 0.3, *SIZE], (frames, objects, 1))
    box[..., 0] = SPACING * np.arange(objects)
    return grid_truth(box, np.tile([1.0, 2.0], (objects, 1)), np.zeros(objects, int))


def seen_at(truth: Truth, distance: float, occlusion: int = 0, bearing: float = 0.0, truncated: bool = False) -> Sight:
    """A sight in which every object has the same distance and bearing, and nothing stands before it by chance."""
    rows = len(truth.box)
    return Sight(
        truth.frame_of_rows,
        np.full(rows, distance),
        np.full(rows, bearing),
        np.full(rows, occlusion),
        np.full(rows, truncated),
    )


def assert_alike(after: ClassStatistics, before: ClassStatistics, odds: float = 0.15, gap: float = 0.2) -> None:
    """Recall, gaps and correlations of two detectors agree; ``odds`` and ``gap``: relative tolerances."""
    assert after.recall == pytest.approx(before.recall, abs=0.02)
    assert after.undetected_odds_ratio == pytest.approx(before.undetected_odds_ratio, rel=odds)
    assert after.gap_length == pytest.approx(before.gap_length, rel=gap)
    assert after.radial_autocorrelation == pytest.approx(before.radial_autocorrelation, rel=0.15)
    assert after.tangential_autocorrelation == pytest.approx(before.tangential_autocorrelation, rel=0.15)


def profile1(name: str) -> Profile:
    """A shipped profile of model 1."""
    profile = load_profile(f"v1/{name}")
    assert isinstance(profile, Profile)
    return profile


def noisy(**sections: Any) -> Profile:
    """The clean profile with other noise for cars: entries of a section by name, or a value instead of one."""
    clean = profile1("clean").model_dump()
    car = clean["classes"]["car"]
    for name, change in sections.items():
        car[name] = {**(car[name] or {}), **change} if isinstance(change, dict) else change
    return Profile.model_validate({**clean, "name": "noisy", "dt": DT, "classes": {"car": car}})


def missing(base: float, lag: float = 0.0, first: float | None = None) -> dict[str, tuple[float, ...]]:
    """The section `miss` without any influence but that of the frame before."""
    begin = base if first is None else first
    return {"first": (begin, 0.0, 0.0, 0.0, 0.0, 0.0), "later": (base, 0.0, 0.0, 0.0, 0.0, 0.0, lag)}


def detect(truth: Truth, profile: Profile | Profile2, sight: Sight, seed: int = 0, dt: float = DT) -> Detections:
    """Detections of a truth by a sensor at the origin that covers everything."""
    ego = np.zeros((truth.frames, 4))
    return simulate(truth, ego, CLASSES, profile, EVERYWHERE, seed, dt, sight)


def on_grid(detections: Detections, objects: int) -> tuple[Bools, Floats, Floats, Floats]:
    """Of a crowd: hit ``[F, J]``; boxes ``[F, J, 7]``, velocities ``[F, J, 2]``, scores ``[F, J]``, NaN if not hit."""
    frame = detections.frame_of_rows
    column = np.rint(detections.box[:, 0] / SPACING).astype(int)
    shape = detections.frames, objects
    hit = np.zeros(shape, dtype=bool)
    hit[frame, column] = True
    box, velocity, score = np.full((*shape, 7), np.nan), np.full((*shape, 2), np.nan), np.full(shape, np.nan)
    box[frame, column], velocity[frame, column], score[frame, column] = (
        detections.box,
        detections.velocity,
        detections.score,
    )
    return hit, box, velocity, score


def inner_gaps(hit: Bools) -> Ints:
    """Lengths of the runs of undetected frames between two hits of an object: ``hit`` ``[F, J]``."""
    lengths = []
    for column in hit.T:
        steps = np.diff(np.flatnonzero(column))
        lengths.append(steps[steps > 1] - 1)
    return np.concatenate(lengths)


def perfect_with(**changes: Any) -> Profile:
    """Perfect detections of cars, and false positives."""
    profile = noisy(
        false_positives={**FALSE_POSITIVES, **changes},
        velocity=0.2,
        score={"quadratic": (5.0, 0.0, 0.0), "ceiling": None},
    )
    return profile.model_copy(update={"field_of_view": 90.0})  # that of AHEAD


def nothing(frames: int) -> Truth:
    """A truth without objects."""
    empty = np.zeros(0, dtype=int)
    return truth_of(empty, empty, np.zeros((0, 7)), frames)


def in_empty_scene(
    profile: Profile, frames: int = 4000, seed: int = 0, ego: Floats | None = None, dt: float = DT
) -> Detections:
    """False positives of an empty scene."""
    pose = np.zeros((frames, 4)) if ego is None else ego
    return simulate(nothing(len(pose)), pose, ("car",), profile, AHEAD, seed, dt)

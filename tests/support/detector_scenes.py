"""Truths of many objects at one distance, and what a detector makes of them."""

from __future__ import annotations

import numpy as np
import pytest

from mtp_bench.detector import Profile, Profile1
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


def assert_alike(
    after: ClassStatistics, before: ClassStatistics, recall: float = 0.02, odds: float = 0.15, gap: float = 0.2
) -> None:
    """Recall, gaps and correlations agree; ``recall``: tolerance; ``odds`` and ``gap``: relative ones."""
    assert after.recall == pytest.approx(before.recall, abs=recall)
    assert after.undetected_odds_ratio == pytest.approx(before.undetected_odds_ratio, rel=odds)
    assert after.gap_length == pytest.approx(before.gap_length, rel=gap)
    assert after.radial_autocorrelation == pytest.approx(before.radial_autocorrelation, rel=0.15)
    assert after.tangential_autocorrelation == pytest.approx(before.tangential_autocorrelation, rel=0.15)


def detect(truth: Truth, profile: Profile | Profile1, sight: Sight, seed: int = 0, dt: float = DT) -> Detections:
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


def nothing(frames: int) -> Truth:
    """A truth without objects."""
    empty = np.zeros(0, dtype=int)
    return truth_of(empty, empty, np.zeros((0, 7)), frames)


def traffic(frames: int = 30, objects: int = 20) -> tuple[Truth, Floats]:
    """Objects of three classes on straight ways in the plane, a sensor that drives through them, and its poses."""
    rng = np.random.default_rng(5)
    place, velocity = rng.uniform(-60, 60, (objects, 2)), rng.normal(0, 4, (objects, 2))
    box = np.zeros((frames, objects, 7))
    box[..., :2] = place + np.arange(frames)[:, None, None] * DT * velocity
    box[..., 2] = 0.8
    box[..., 3] = np.arctan2(velocity[:, 1], velocity[:, 0])
    box[..., 4:] = np.array([[4.5, 1.9, 1.6], [9.0, 2.5, 3.0], [0.8, 0.7, 1.7]])[np.arange(objects) % 3]
    truth = grid_truth(box, velocity, np.arange(objects) % 3, rng.permutation(objects) * 7 + 100)
    ego = np.zeros((frames, 4))
    ego[:, 0], ego[:, 3] = np.arange(frames) * 0.8, np.linspace(0, 0.6, frames)
    return truth, ego

"""Trackers that are told a measured velocity, and the settings of simulated detectors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mtp_bench.agent import Observation
from mtp_bench.errors import UnknownNameError
from mtp_bench.tracking import AB3DMOT, HypothesisTracker
from mtp_bench.tracking.parameters import ab3dmot_parameters
from mtp_bench.types import Floats
from tests.support import plain_motion as motion
from tests.support.tracking_scenes import CAR, frame, kitti_task, observation

DT = 0.5
URBAN = kitti_task(classes=("car",), dt=DT, detector="nuscenes_megvii", velocity=True)


def seen(x: float, velocity: float) -> Observation:
    """A car on the x axis."""
    return {**observation(frame((x, 0.0, CAR))), "detection_velocity": np.array([[velocity, 0.0]], dtype=np.float32)}


def test_a_fast_car_at_2_hz_keeps_its_identity_only_by_its_velocity() -> None:
    speed = 25.0  # m/s: 12.5 m between frames, far beyond the gate
    ids: dict[bool, set[int]] = {}
    for known in (True, False):
        tracker = HypothesisTracker()
        tracker.reset(replace(URBAN, velocity=known))
        tracks = [tracker.step(seen(speed * DT * t, speed)) for t in range(4)]
        ids[known] = {int(track_id) for frame_tracks in tracks for track_id in frame_tracks.track_id}
    assert len(ids[True]) == 1
    assert len(ids[False]) == 4


def test_a_velocity_of_a_task_without_velocities_is_not_looked_at() -> None:
    outputs = []
    for velocity in (0.0, 9.0):
        tracker = HypothesisTracker()
        tracker.reset(replace(URBAN, velocity=False))
        outputs.append([tracker.step(seen(0.4 * t, velocity)).box for t in range(3)])
    np.testing.assert_array_equal(outputs[0], outputs[1])


def joint_filter(boxes: Floats, velocities: Floats) -> tuple[Floats, Floats]:
    """The textbook Kalman filter of one axis with position and velocity measured together; mean and covariance."""
    transition, noise = np.array([[1.0, 1.0], [0.0, 1.0]]), np.diag([motion.POSITION_NOISE, motion.VELOCITY_NOISE])
    measured = np.diag([motion.MEASUREMENT_VARIANCE, (motion.VELOCITY_DEVIATION * DT) ** 2])
    mean, covariance = np.zeros(2), np.zeros((2, 2))
    for t, (position, velocity) in enumerate(zip(boxes, velocities, strict=True)):
        if t == 0:
            mean = np.array([position, 0.0])
            covariance = np.diag([motion.POSITION_VARIANCE_AT_BIRTH, motion.VELOCITY_VARIANCE_AT_BIRTH])
            row = np.array([[0.0, 1.0]])  # at birth the position is the box, only the velocity is measured
            gain = covariance @ row.T / (row @ covariance @ row.T + measured[1, 1])
            mean = mean + gain[:, 0] * (velocity - mean[1])
            covariance = covariance - gain @ row @ covariance
            continue
        mean, covariance = transition @ mean, transition @ covariance @ transition.T + noise
        gain = covariance @ np.linalg.inv(covariance + measured)
        mean = mean + gain @ (np.array([position, velocity]) - mean)
        covariance = covariance - gain @ covariance
    return mean, covariance


def test_position_and_velocity_one_after_the_other_are_the_joint_update() -> None:
    rng = np.random.default_rng(0)
    x, v = np.cumsum(rng.normal(2.0, 0.3, 6)), rng.normal(2.0, 0.3, 6)
    box = np.zeros((6, 1, 7))
    box[:, 0, 0], box[:, 0, 4:] = x, (4.0, 2.0, 1.5)
    velocity = np.zeros((6, 1, 2))
    velocity[:, 0, 0] = v
    state = motion.born(box[0], velocity[0] / DT, DT)
    for t in range(1, 6):
        state = motion.updated(motion.predicted(state), box[t], velocity[t] / DT, DT)
    mean, covariance = joint_filter(x, v)
    np.testing.assert_allclose(state.mean[0, [0, 7]], mean, rtol=1e-9)
    np.testing.assert_allclose(state.covariance[0], covariance, rtol=1e-9)


def test_a_velocity_of_exactly_zero_is_not_a_measurement() -> None:
    box = np.zeros((2, 7))
    box[:, 4:] = (4.0, 2.0, 1.5)
    state = motion.born(box, np.array([[0.0, 0.0], [0.0, 1e-3]]), DT)
    unknown = motion.born(box)
    np.testing.assert_array_equal(state.covariance[0], unknown.covariance[0])
    assert state.covariance[1, 1, 1] < 1e-3 * unknown.covariance[1, 1, 1]


def test_a_simulated_detector_is_tracked_like_the_one_it_was_fitted_to() -> None:
    kitti = ab3dmot_parameters("kitti_pointrcnn", ("car", "pedestrian", "cyclist"))
    assert kitti == tuple(AB3DMOT["pointrcnn"].values())
    assert ab3dmot_parameters("kitti_pointrcnn-hard", ("car", "truck")) == (kitti[0], kitti[0])
    for name in ("nuscenes_megvii", "nuscenes_centerpoint", "clean"):
        assert len(ab3dmot_parameters(name, ("car", "truck", "bus", "motorcycle", "pedestrian"))) == 5


def test_an_unknown_detector_is_an_error() -> None:
    with pytest.raises(UnknownNameError, match="unknown detector 'lidar-x'"):
        ab3dmot_parameters("lidar-x", ("car",))
    with pytest.raises(UnknownNameError, match="class for detector 'megvii-iid' 'tram'"):
        ab3dmot_parameters("megvii-iid", ("tram",))

"""Trackers that are told a measured velocity, and the settings of simulated detectors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mtp_bench.agent import Observation
from mtp_bench.errors import UnknownNameError
from mtp_bench.tracking import HypothesisTracker
from mtp_bench.tracking.parameters import detector_parameters
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


def test_a_simulated_detector_is_tracked_like_the_one_it_was_fitted_to() -> None:
    kitti = detector_parameters("kitti_pointrcnn", ("car", "pedestrian", "cyclist"))
    assert kitti == detector_parameters("pointrcnn", ("car", "pedestrian", "cyclist"))
    assert detector_parameters("kitti_pointrcnn-hard", ("car", "truck")) == (kitti[0], kitti[0])
    for name in ("nuscenes_megvii", "nuscenes_centerpoint", "clean"):
        assert len(detector_parameters(name, ("car", "truck", "bus", "motorcycle", "pedestrian"))) == 5


def test_an_unknown_detector_is_an_error() -> None:
    with pytest.raises(UnknownNameError, match="unknown detector 'lidar-x'"):
        detector_parameters("lidar-x", ("car",))
    with pytest.raises(UnknownNameError, match="class for detector 'megvii-iid' 'trialer'"):
        detector_parameters("megvii-iid", ("trialer",))

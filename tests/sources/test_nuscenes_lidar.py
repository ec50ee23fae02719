"""The lidar frame of a sample: a mount that is turned and raised on an ego that is turned, by hand."""

from pathlib import Path

import numpy as np
import pytest

from mtp_bench.sources import NuScenes, lidar_pose, to_global, to_lidar
from tests.support.nuscenes_root import VERSION, edited, nuscenes_card, sample, write_root


def test_the_lidar_frame_of_a_sample(tmp_path: Path) -> None:
    with edited(write_root(tmp_path) / "nuscenes" / VERSION / "calibrated_sensor.json") as sensors:
        sensors[0].update(translation=[1.0, 0.0, 2.0], rotation=[0.0, 0.0, 0.0, 1.0])  # a metre ahead, looks back
    tables = NuScenes(nuscenes_card(), tmp_path).tables
    # the ego of frame 1 heads along y at (0, 2, 0.5)
    pose = lidar_pose(tables, sample("scene-0003", 1))
    np.testing.assert_allclose(pose[1], [0.0, 3.0, 2.5], atol=1e-6)
    # the car is 10 m to its right and 1 m behind the lidar: 1 m along x and 10 m along y of a lidar that looks back
    np.testing.assert_allclose(to_lidar(np.array([10.0, 2.0, 1.0]), pose), [1.0, 10.0, -1.5], atol=1e-6)
    np.testing.assert_allclose(to_global(np.array([1.0, 10.0, 1.0]), pose), [10.0, 2.0, 1.0], atol=1e-6)


@pytest.mark.parametrize("height", [0.0, 1.5])
def test_a_tilted_lidar_loses_nothing_but_the_height(height: float) -> None:
    cos, sin = 0.8, 0.6
    pose = np.array([[1.0, 0, 0], [0, cos, -sin], [0, sin, cos]]), np.array([3.0, 1.0, 2.0])
    places = np.random.default_rng(0).normal(scale=20.0, size=(2, 3, 3))
    places[..., 2] = height
    flat = np.concatenate([to_lidar(places, pose)[..., :2], places[..., 2:]], axis=-1)
    np.testing.assert_allclose(to_global(flat, pose), places, atol=1e-9)

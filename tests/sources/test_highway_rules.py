"""Parts of the simulated traffic against other programs: lanes against highway_env, overlap against shapely."""

import numpy as np
import pytest
from shapely.geometry import Polygon

from mtp_bench.geometry import bev_corners
from mtp_bench.sources.highway.networks import build_map
from mtp_bench.sources.highway.simulate import overlapping
from mtp_bench.sources.highway.world import ScenarioName

SCENARIOS: tuple[ScenarioName, ...] = ("intersection", "roundabout", "merge", "highway")


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_lane_coordinates_are_those_of_highway_env(scenario: ScenarioName) -> None:
    geometry = build_map(scenario, 5.0).geometry
    points = np.random.default_rng(0).uniform(-60.0, 60.0, (20, 2))
    s, d = geometry.coordinates(points)
    for k, lane in enumerate(geometry.lanes):
        expected = np.array([lane.local_coordinates(point) for point in points])
        np.testing.assert_allclose(np.stack([s[k], d[k]], axis=1), expected, atol=1e-9)
        heading = geometry.heading(np.full(20, k), s[k])
        np.testing.assert_allclose(heading, [lane.heading_at(a) for a in s[k]], atol=1e-9)


def test_overlap_against_polygons() -> None:
    rng = np.random.default_rng(1)
    box = np.zeros((40, 7))
    box[:, :2] = rng.uniform(-10.0, 10.0, (40, 2))
    box[:, 3] = rng.uniform(-4.0, 4.0, 40)
    box[:, 4:] = rng.uniform(0.4, 5.0, (40, 3))
    shapes = [Polygon(corners) for corners in bev_corners(box)]
    expected = [(i, j) for i in range(40) for j in range(i + 1, 40) if shapes[i].intersects(shapes[j])]
    assert ([tuple(pair) for pair in overlapping(box).tolist()], len(overlapping(box[:1]))) == (expected, 0)

"""Matching of detections to true boxes on scenes that can be counted by hand."""

import numpy as np
import pytest

from mtp_bench.core import Detections, Floats, Truth
from mtp_bench.training.detector_fit.samples import match_boxes
from tests.support.detector_scenes import truth_of

CLASSES = ("car", "pedestrian")
PLACES = list[tuple[float, float]]  # x, y


def boxes(places: PLACES) -> Floats:
    return np.array([[x, y, 0.8, 0.0, 4.0, 2.0, 1.6] for x, y in places], dtype=np.float64).reshape(-1, 7)


def truth(places: PLACES) -> Truth:
    return truth_of(np.zeros(len(places), int), np.arange(len(places)), boxes(places), 1)


def detections(places: PLACES) -> Detections:
    rows = len(places)
    return Detections(
        np.array([0, rows]), boxes(places), np.full((rows, 2), np.nan), np.zeros(rows, int), np.ones(rows)
    )


@pytest.mark.parametrize(
    ("true", "found", "expected"),
    [
        pytest.param([(10, 0)], [(11.9, 0)], [0], id="inside the gate"),
        pytest.param([(10, 0)], [(12.1, 0)], [-1], id="beyond it"),
        # The nearest pair is 0.5 m apart, but then the second object would be left alone.
        pytest.param([(10, 0), (12, 0)], [(11.5, 0), (13.5, 0)], [0, 1], id="the most pairs first"),
        pytest.param([(10, 0), (11, 0)], [(10.9, 0), (10.1, 0)], [1, 0], id="then the least sum"),
        pytest.param([(10, 0), (11, 0)], [(10.9, 0)], [-1, 0], id="the nearer one"),
        pytest.param([(10, 0)], [], [-1], id="nothing detected"),
    ],
)
def test_match(true: PLACES, found: PLACES, expected: list[int]) -> None:
    assert match_boxes(truth(true), detections(found), CLASSES).detection.tolist() == expected


def test_what_counts_as_false() -> None:
    """A neutral box absorbs its detections; a second detection of an object is a duplicate."""
    true, found = truth([(10, 0), (30, 0)]), detections([(10, 0), (30.1, 0), (31, 0)])
    true.neutral[1], true.eligible[1] = True, False
    assert not match_boxes(true, found, CLASSES).false.any()
    matches = match_boxes(truth([(10, 0)]), detections([(10.1, 0), (10.3, 0), (11.5, 0)]), CLASSES)
    assert (matches.false.tolist(), matches.duplicate.tolist()) == ([False, True, True], [False, True, False])

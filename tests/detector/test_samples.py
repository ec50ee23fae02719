"""Matching of detections to true boxes, and the statistics of a detector, on scenes that can be counted by hand."""

import numpy as np
import pytest

from mtp_bench.core import Detections, Floats, Scene, Truth
from mtp_bench.detector.visibility import Sensor
from mtp_bench.training.detector_fit.samples import match_boxes
from tests.support.detector_statistics import ClassStatistics, detector_statistics

AHEAD = Sensor(reach=50.0, field_of_view=np.pi / 2)
CLASSES = ("car", "pedestrian")
ROW = tuple[float, float]  # x, y


def boxes(*places: ROW) -> Floats:
    box = np.tile([0.0, 0.0, 0.8, 0.0, 4.0, 2.0, 1.6], (len(places), 1))
    if places:
        box[:, :2] = places
    return box


def detections(*frames: list[ROW], class_id: int = 0, score: float = 1.0) -> Detections:
    rows = sum(map(len, frames))
    return Detections(
        start=np.cumsum([0, *map(len, frames)]), box=boxes(*(place for places in frames for place in places)),
        velocity=np.full((rows, 2), np.nan), class_id=np.full(rows, class_id), score=np.full(rows, score),
    )  # fmt: skip


def truth(*frames: list[ROW], class_id: int = 0, neutral: tuple[int, ...] = ()) -> Truth:
    """Object j is the j-th place of every frame; those in ``neutral`` are neutral."""
    same = detections(*frames, class_id=class_id)
    object_id = np.concatenate([np.arange(len(places)) for places in frames])
    beside = np.isin(object_id, neutral)
    return Truth(same.start, same.box, same.velocity, same.class_id, object_id, ~beside, beside)


def of_car(true: Truth, found: Detections) -> ClassStatistics:
    scene = Scene("drawn", 0.1 * np.arange(true.frames), np.zeros((true.frames, 4)), true, found)
    return detector_statistics([scene], CLASSES, AHEAD)["car"]


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
def test_match(true: list[ROW], found: list[ROW], expected: list[int]) -> None:
    assert match_boxes(truth(true), detections(found), CLASSES).detection.tolist() == expected


def test_a_neutral_box_absorbs_its_detections_and_counts_nowhere() -> None:
    true, found = truth([(10, 0), (30, 0)], neutral=(1,)), detections([(10, 0), (30.1, 0), (31, 0)])
    assert match_boxes(true, found, CLASSES).false.tolist() == [False, False, False]
    statistics = of_car(true, found)
    assert (statistics.boxes, statistics.recall, statistics.false_positives) == (1, 1.0, 0.0)


def test_a_second_detection_of_an_object_is_a_duplicate() -> None:
    matches = match_boxes(truth([(10, 0)]), detections([(10.1, 0), (10.3, 0), (11.5, 0)]), CLASSES)
    assert (matches.false.tolist(), matches.duplicate.tolist()) == ([False, True, True], [False, True, False])


def test_only_what_the_sensor_covers_counts() -> None:
    behind, far, seen = (-10.0, 0.0), (60.0, 0.0), (10.0, 0.0)
    figures = of_car(truth([behind, far, seen]), detections([(-20.0, 0.0), (70.0, 0.0), (20.0, 0.0), (10.0, 0.0)]))
    assert (figures.boxes, figures.recall, figures.false_positives) == (1, 1.0, 1.0)

"""Classes that baselines have no settings for."""

from __future__ import annotations

import pytest

from mtp_bench.errors import UnknownNameError
from mtp_bench.prediction.motion_noise import stored_noise
from mtp_bench.similar import class_hint, similar_class
from mtp_bench.tracking.parameters import detector_parameters
from tests.support.tracking_scenes import kitti_task

KITTI = ("car", "pedestrian", "cyclist")


@pytest.mark.parametrize(
    ("name", "like"),
    [
        ("cyclist", "cyclist"),
        ("truck", "car"),
        ("forklift", "car"),
        ("motorcycle", "cyclist"),
        ("worker", "pedestrian"),
        ("robot", "car"),
        ("minibus", "car"),
        ("Worker", "pedestrian"),
        ("tricycle", "cyclist"),
        ("train", "car"),
        ("pedestrain", None),
        ("cars", None),
    ],
)
def test_similar_classes(name: str, like: str | None) -> None:
    assert similar_class(name, KITTI) == like


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("bicycle", "did you mean 'cyclist'?"),
        ("Person", "did you mean 'pedestrian'?"),
        ("pedestrain", "did you mean 'pedestrian'?"),
        ("Car", "did you mean 'car'?"),
        ("truck", "similar is 'car'"),
        ("human.pedestrian.adult", "did you mean 'pedestrian'?"),
        ("animal", ""),
    ],
)
def test_hints_of_classes_that_the_task_does_not_have(name: str, hint: str) -> None:
    assert class_hint(name, KITTI) == hint


def test_nothing_is_like_a_class_where_none_is_known() -> None:
    assert similar_class("car", ()) is None


def test_baselines_track_and_forecast_classes_of_own_cards() -> None:
    car, truck, bus, cyclist, motorcycle = detector_parameters(
        "kitti_pointrcnn-hard", ("car", "truck", "bus", "cyclist", "motorcycle")
    )
    assert (car == truck == bus, cyclist == motorcycle) == (True, True)
    car, forklift = detector_parameters("pointrcnn-ours", ("car", "forklift"))
    assert car == forklift
    noise = stored_noise(kitti_task(detector="pointrcnn-ours", motion_noise="", classes=("forklift", "car")))
    assert noise.measurement[0] == noise.measurement[1]
    with pytest.raises(UnknownNameError, match="class for detector 'pointrcnn-ours' 'pedestrain': did you mean"):
        detector_parameters("pointrcnn-ours", ("pedestrain",))

"""Classes that baselines have no settings for."""

import pytest

from mtp_bench.core.errors import UnknownNameError, class_hint, similar_class
from mtp_bench.prediction.kalman import stored_noise
from mtp_bench.tracking.parameters import detector_parameters
from tests.support.tracking_scenes import kitti_task

KITTI = ("car", "pedestrian", "cyclist")


@pytest.mark.parametrize(("name", "like", "hint"), [
    ("cyclist", "cyclist", "did you mean 'cyclist'?"), ("truck", "car", "similar is 'car'"),
    ("forklift", "car", "similar is 'car'"), ("bicycle", "cyclist", "did you mean 'cyclist'?"),
    ("Worker", "pedestrian", "did you mean 'pedestrian'?"),
    ("human.pedestrian.adult", "car", "did you mean 'pedestrian'?"), ("robot", "car", ""),
    ("minibus", "car", "similar is 'car'"), ("train", "car", ""), ("pedestrain", None, "did you mean 'pedestrian'?"),
    ("cars", None, "did you mean 'car'?"), ("Car", "car", "did you mean 'car'?"),
])  # fmt: skip
def test_similar_classes(name: str, like: str | None, hint: str) -> None:
    assert (similar_class(name, KITTI), class_hint(name, KITTI)) == (like, hint)


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

"""SORT's life cycle on the ground plane."""

from __future__ import annotations

import pytest

from mtp_bench.tracking import ClassParameters, HypothesisTracker, sort_parameters
from tests.support.tracking_scenes import PEDESTRIAN, frame, kitti_task, run

TASK = kitti_task(classes=("car", "pedestrian"), dt=0.5)


def ids(seen: str, x: float = 0.3, **settings: float) -> list[list[int]]:
    """Identities after each frame of a walk of ``x`` m per frame that is detected where ``seen`` has an o."""
    frames = [frame(*[(x * t, 0, PEDESTRIAN)] * (sign == "o")) for t, sign in enumerate(seen)]
    tracker = HypothesisTracker(parameters=sort_parameters(TASK.classes, **settings))  # type: ignore[arg-type]
    return [tracks.track_id.tolist() for tracks in run(tracker, frames, TASK)]


def test_every_class_has_the_same_rules() -> None:
    rule = ClassParameters("hungarian", "center_distance", 1.5, 3, 2)
    assert sort_parameters(("a", "b")) == (rule, rule)
    assert sort_parameters(()) == ()


LIVES: dict[str, tuple[str, list[list[int]]]] = {
    "survives one miss": ("oooo.oo", [[0]] * 7),
    "ends with the second miss, as another it needs three detections": ("oooo..ooo", [[0]] * 5 + [[]] * 3 + [[1]]),
    "is output from three detections on": (".....oooo", [[]] * 7 + [[0]] * 2),
    "a recording does not wait": ("oo", [[0]] * 2),
}


@pytest.mark.parametrize("case", LIVES)
def test_life(case: str) -> None:
    seen, expected = LIVES[case]
    assert ids(seen) == expected


def test_who_leaves_the_gate_is_another() -> None:
    assert ids("oooooo", x=2.0)[-1] == []
    assert ids("oooooo", x=2.0, gate=3.0)[-1] == [0]


def test_longer_life() -> None:
    assert ids("oooo..o", max_age=2)[-1] == [0]
    assert ids("....oo", min_hits=2)[-1] == [0]

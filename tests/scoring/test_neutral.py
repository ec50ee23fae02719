"""What no label of an image could confirm: objects in the picture of one camera, drawn by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mtp_bench.geometry import rotate
from mtp_bench.scoring import evaluated, find_targets, unconfirmable
from mtp_bench.types import Floats, ImageField
from tests.support.scoring_scenes import Thing, make_card, make_scene

CAR, WALKER = 0, 1
# A camera at the origin that looks along x: 200 x 100 pixels, its axis in the middle, 100 pixels to the metre at 1 m.
# A car ahead at x is 2 m long, 2 m wide, 1.65 m high: from x - 1 to x + 1 m, from the horizon (row 50) downwards.
# Seen from the front its near face decides: 200 / (x - 1) wide, 165 / (x - 1) high.
CAMERA = np.array([[100.0, -100.0, 0.0, 0.0], [50.0, 0.0, -100.0, 0.0], [1.0, 0.0, 0.0, 0.0]])
SIZES = np.array([[2.0, 2.0, 1.65], [0.2, 0.2, 1.65]])


def field(*regions: tuple[float, ...], frames: int = 1) -> ImageField:
    """The camera, and these regions in the last frame."""
    return ImageField(
        projection=np.tile(CAMERA, (frames, 1, 1)),
        height=np.zeros(frames),
        heading=np.zeros(frames),
        size=(200, 100),
        region=np.reshape(regions, (-1, 4)),
        region_start=np.array([0] * frames + [len(regions)]),
        box_size=SIZES,
    )


def one(image: ImageField, x: float, y: float = 0.0, class_id: int = CAR, frame: int = 0) -> bool:
    (answer,) = unconfirmable(image, np.array([frame]), np.array([[x, y]]), np.array([class_id]))
    return bool(answer)


SEEN = {
    # x, y, class: whether no label could confirm it
    "ahead": (5.0, 0.0, CAR, False),
    "just high enough": (7.59, 0.0, CAR, False),  # 25.04 px
    "too low": (7.61, 0.0, CAR, True),  # 24.96 px
    "a walker is nearer to its middle": (6.69, 0.0, WALKER, False),  # 165 / 6.59 = 25.04 px
    "a walker too low": (6.71, 0.0, WALKER, True),
    "behind": (-5.0, 0.0, CAR, True),
    "behind and high": (-1.2, 0.0, CAR, True),
    "left of the image": (5.0, 8.0, CAR, True),  # its right rear end at 6, 7 is 116.7 px left of the middle
    "partly in the image": (5.0, 6.9, CAR, False),  # 5.9 / 6: 1.7 px of it
    "around the camera": (0.0, 0.0, CAR, False),
    "beside the camera, its front ahead": (0.5, 1.4, CAR, False),  # 0.4 / 1.5: seen
    "beside the camera, nothing to be seen": (0.5, 3.0, CAR, True),  # 2 / 1.5: left of the image
    "far away": (1e6, 1e6, CAR, True),
}


@pytest.mark.parametrize(("x", "y", "class_id", "want"), SEEN.values(), ids=SEEN.keys())
def test_what_is_seen(x: float, y: float, class_id: int, want: bool) -> None:
    assert one(field(), x, y, class_id) == want


# A car at 5 m: near face at 4 m, from 75 to 125 px across; from 50 to 91.25 px down.
REGIONS = {
    "more than half": ([(75.0, 50.0, 100.1, 95.0)], True),
    "exactly half": ([(75.0, 50.0, 100.0, 95.0)], False),
    "two regions with less than half each": ([(75.0, 50.0, 99.0, 95.0), (99.0, 50.0, 123.0, 95.0)], False),
    "the second of two": ([(0.0, 0.0, 10.0, 10.0), (0.0, 0.0, 200.0, 100.0)], True),
    "beside": ([(0.0, 50.0, 74.0, 95.0)], False),
    "small, inside of it": ([(90.0, 60.0, 110.0, 80.0)], False),
}


@pytest.mark.parametrize(("regions", "want"), REGIONS.values(), ids=REGIONS.keys())
def test_regions_where_labels_do_not_care(regions: list[tuple[float, ...]], want: bool) -> None:
    assert one(field(*regions), 5.0) == want
    assert not one(field(*regions, frames=2), 5.0)  # a region counts in its own frame only
    assert one(field(*regions, frames=2), 5.0, frame=1) == want


def test_the_share_is_one_of_what_the_image_shows() -> None:
    # from 163.3 px (its far left corner) to 245 px, cut at 200: half of what is seen begins at 181.7 px
    assert one(field((181.0, 0.0, 200.0, 100.0)), 5.0, -4.8)
    assert not one(field((182.0, 0.0, 200.0, 100.0)), 5.0, -4.8)


def test_the_heading_is_that_of_the_platform() -> None:
    image = replace(field(), box_size=np.array([[8.0, 0.2, 1.65]]))
    assert not one(image, 9.0)  # its end is 5 m away: 33 px
    assert one(replace(image, heading=np.array([np.pi / 2])), 9.0)  # across, 8.9 m away: 18.5 px


@settings(derandomize=True, deadline=None, max_examples=20)
@given(st.floats(-3.1, 3.1), st.floats(-100, 100), st.floats(-100, 100), st.floats(-9, 9))
def test_the_place_of_the_world_does_not_matter(yaw: float, x: float, y: float, z: float) -> None:
    image, xy = field((50.0, 40.0, 110.0, 90.0)), np.random.default_rng(7).uniform(-3, 9, (60, 2))
    same = np.zeros(60, dtype=np.int64)
    back = np.eye(4)  # from the moved world to the camera's
    back[:2, :2] = [[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]]
    back[:3, 3] = -back[:3, :3] @ [x, y, z]
    other = replace(image, projection=image.projection @ back, height=np.array([z]), heading=np.array([yaw]))
    moved: Floats = rotate(xy, yaw) + np.array([x, y])
    assert np.array_equal(unconfirmable(other, same, moved, same), unconfirmable(image, same, xy, same))


def test_a_true_box_that_no_label_could_confirm_is_neutral_and_no_target() -> None:
    # two cars in five frames: one ahead, one that leaves the image from frame 2 on
    scene = make_scene([[Thing(1, 5, 0), Thing(2, 5, 0.1 if t < 2 else 9)] for t in range(5)])
    scene = replace(scene, image=field(frames=5))
    card = make_card(past=2, future=2)
    seen = evaluated(scene)
    assert seen.truth.neutral.tolist() == [False, False, False, False, *[False, True] * 3]
    assert seen.truth.eligible.tolist() == (~seen.truth.neutral).tolist()
    assert evaluated(seen).truth.neutral.tolist() == seen.truth.neutral.tolist()
    targets = find_targets(scene, card)
    assert list(zip(targets.object_id.tolist(), targets.frame.tolist(), strict=True)) == [(1, 1), (2, 1), (1, 2)]
    assert not scene.truth.neutral.any()  # the scene itself stays


def test_without_an_image_everything_counts() -> None:
    scene = make_scene([[Thing(1, -5, 0)]])
    assert evaluated(scene) is scene

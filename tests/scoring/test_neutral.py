"""What no label of an image could confirm: objects in the picture of one camera, drawn by hand."""

from dataclasses import replace

import numpy as np
import pytest

from mtp_bench.core import ImageField
from mtp_bench.scoring import evaluated, neutral_places
from tests.support.scoring_scenes import Thing, make_scene

CAR, WALKER = 0, 1
# A camera at the origin that looks along x: 200 x 100 pixels, its axis in the middle, 100 pixels to the metre at 1 m.
# A car ahead at x is 2 m long, 2 m wide, 1.65 m high: from x - 1 to x + 1 m, from the horizon (row 50) downwards.
# Seen from the front its near face decides: 200 / (x - 1) wide, 165 / (x - 1) high.
CAMERA = np.array([[100.0, -100.0, 0.0, 0.0], [50.0, 0.0, -100.0, 0.0], [1.0, 0.0, 0.0, 0.0]])
SIZES = np.array([[2.0, 2.0, 1.65], [0.2, 0.2, 1.65]])


def field(*regions: tuple[float, ...], frames: int = 1) -> ImageField:
    """The camera, and these regions in the last frame."""
    return ImageField(
        projection=np.tile(CAMERA, (frames, 1, 1)), height=np.zeros(frames), heading=np.zeros(frames), size=(200, 100),
        region=np.reshape(regions, (-1, 4)), region_start=np.array([0] * frames + [len(regions)]), box_size=SIZES,
    )  # fmt: skip


def one(image: ImageField, x: float, y: float = 0.0, class_id: int = CAR, frame: int = 0) -> bool:
    scene = replace(make_scene([]), image=image)
    (hidden,) = neutral_places(scene, np.array([frame]), np.array([[x, y]]), np.array([class_id]))
    return bool(hidden)


SEEN = {
    # x, y, class: whether no label could confirm it
    "ahead": (5.0, 0.0, CAR, False),
    "a walker is nearer to its middle": (6.69, 0.0, WALKER, False),  # 165 / 6.59 = 25.04 px
    "a walker too low": (6.71, 0.0, WALKER, True),
    "behind": (-5.0, 0.0, CAR, True),
    "left of the image": (5.0, 8.0, CAR, True),  # its right rear end at 6, 7 is 116.7 px left of the middle
    "partly in the image": (5.0, 6.9, CAR, False),  # 5.9 / 6: 1.7 px of it
    "around the camera": (0.0, 0.0, CAR, False),
    "beside the camera, its front ahead": (0.5, 1.4, CAR, False),  # 0.4 / 1.5: seen
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


def test_without_an_image_everything_counts() -> None:
    scene = make_scene([[Thing(1, -5, 0)]])
    assert evaluated(scene) is scene

"""Which true objects are to be forecast, and what is known about them."""

from dataclasses import replace

import numpy as np
import pytest

from mtp_bench.cards import load_card
from mtp_bench.cards.source import FilesSource
from mtp_bench.core.geometry import rotate
from mtp_bench.scoring import find_targets
from mtp_bench.scoring.targets import units
from mtp_bench.sources import open_source
from tests.support.scoring_scenes import Thing, make_card, make_scene
from tests.support.source_files import with_task

CARD = make_card(past=2, future=3)


def line(present: str) -> list[list[Thing]]:
    """One object at 1 m per frame along x, 2 m left of the ego; "." absent, "i" not eligible, "n" neutral."""
    things = [Thing(7, float(t), 2.0, eligible=c != "i", neutral=c == "n") for t, c in enumerate(present)]
    return [[] if c == "." else [thing] for c, thing in zip(present, things, strict=True)]


def test_distance_and_approach_are_those_to_the_ego_of_each_frame() -> None:
    scene = make_scene(line("xxxxx"))
    ego = np.zeros((5, 4))
    ego[:, 0] = [0, 1, 0, 3.2, 0]  # passes at x = 3.2 beside the object at (3, 2)
    targets = find_targets(replace(scene, ego=ego), CARD)
    assert (targets.distance.tolist(), targets.approach[0]) == ([2.0], pytest.approx(np.hypot(0.2, 2.0)))


PATHS = {
    # x in frames 0 to 4, the target is at frame 1: moving
    "there and back": ((0.0, 1.0, 2.0, 2.0, 1.0), False),
    "stopped before": ((0.0, 1.0, 1.0, 1.0, 1.0), False),
    "starts now": ((0.0, 0.0, 0.0, 0.0, 1.0), True),
    "below half a metre per second": ((0.0, 0.0, 0.0, 0.0, 0.147), False),
    "above": ((0.0, 0.0, 0.0, 0.0, 0.153), True),
}


@pytest.mark.parametrize(("x", "moving"), PATHS.values(), ids=PATHS.keys())
def test_moving_is_the_straight_displacement_over_the_future(x: tuple[float, ...], moving: bool) -> None:
    assert find_targets(make_scene([[Thing(1, place, 0.0)] for place in x]), CARD).moving.tolist() == [moving]


def test_moving_is_measured_in_the_world_where_every_frame_has_its_own_frame_of_reference() -> None:
    # the platform drives 1 m per frame along y and turns left by 0.1 rad; object 1 is parked, object 2 drives beside it
    parked, frames = np.array([8.0, 3.0]), range(5)
    pose = np.array([[0.0, t, 0.0, 0.1 * t] for t in frames])

    def seen(t: int, xy: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> tuple[float, float]:
        x, y = rotate(xy - pose[t, :2], -pose[t, 3])
        return float(x), float(y)

    scene = make_scene([[Thing(1, *seen(t, parked)), Thing(2, *seen(t, parked + np.array([0, t])))] for t in frames])
    assert find_targets(replace(scene, world=pose), CARD).moving.tolist() == [False, True]
    assert find_targets(scene, CARD).moving.tolist() == [True, True]
    assert find_targets(replace(scene, world=pose), CARD).future.tolist() == find_targets(scene, CARD).future.tolist()


TURNS = {
    # heading in frames 0 to 4, the target is at frame 1: turning
    "the past does not count": ((0.0, 1.0, 1.2, 1.4, 1.5), False),
    "just above": ((0.0, 1.0, 1.2, 1.4, 1.501), True),
    "to the right": ((0.0, 0.0, -0.3, -0.4, -0.6), True),
    "through pi": ((3.0, 3.1, 3.2 - 2 * np.pi, 3.3 - 2 * np.pi, 3.5 - 2 * np.pi), False),
    "there and back": ((0.0, 0.0, 1.0, 1.0, 0.0), False),
}


@pytest.mark.parametrize(("yaw", "turning"), TURNS.values(), ids=TURNS.keys())
def test_turning_is_the_change_of_heading_in_the_world_at_the_end(yaw: tuple[float, ...], turning: bool) -> None:
    scene = make_scene(line("xxxxx"))
    scene.truth.box[:, 3] = yaw
    assert find_targets(scene, CARD).turning.tolist() == [turning]
    world = np.array([[0.0, 0.0, 0.0, 0.5 * t] for t in range(5)])  # of the platform, which turns by itself
    scene.truth.box[:, 3] -= world[:, 3]
    assert find_targets(replace(scene, world=world), CARD).turning.tolist() == [turning]
    people = CARD.model_copy(update={"source": FilesSource(name="files", places_only=True)})
    assert find_targets(scene, people).turning.tolist() == [False]


# ---- blocks of recordings
@pytest.mark.parametrize(("frames", "blocks"), [(41, 1), (44, 2)])
def test_a_hole_counts_as_one_period(frames: int, blocks: int) -> None:
    time = np.cumsum(0.5 + 0.1 * np.sin(np.arange(frames))) + 30.0 * (np.arange(frames) > 20)  # it jitters too
    assert units(replace(make_scene([[]] * frames), time=time), with_task(CARD, rate=2.0)).max() + 1 == blocks


# scenes, units
RECORDED = {
    "MTP-nuScenes-mini-v0": (10, 10), "MTP-WILDTRACK-v0": (4, 4), "MTP-PETS-v0": (4, 4), "MTP-KITTI-v0": (11, 25),
    "MTP-KITTI-5Hz-v0": (11, 25),
}  # fmt: skip


@pytest.mark.data
@pytest.mark.parametrize(("env", "want"), RECORDED.items(), ids=RECORDED.keys())
def test_units_of_recorded_scenes(data_root: object, env: str, want: tuple[int, int]) -> None:
    source = open_source(card := load_card(env))
    blocks = [int(units(source.load(name), card).max()) + 1 for name in source.names]
    assert (len(blocks), sum(blocks)) == want

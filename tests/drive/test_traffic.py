"""Traffic with an ego that is driven from outside: the same bits again, detections frame by frame, contacts."""

import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import DriveSection, load_card, with_perturb
from mtp_bench.sources.cache import content_hash
from mtp_bench.traffic.drive_episode import DrivenScene, whole_scene
from mtp_bench.traffic.highway.driven import DrivenTraffic, hit_from_behind, is_at_fault
from mtp_bench.traffic.highway.source import pack
from mtp_bench.traffic.highway.world import RATE, Traffic

TRAFFIC = Traffic("intersection", "ego", 8.0, 8, 10, 20)
GAINS = (1.5 * np.sin(np.arange(50) / 5.0)).tolist()  # m/s2


def digest_of(gains: list[float]) -> str:
    traffic = DrivenTraffic(TRAFFIC, 5)
    for gain in gains:
        traffic.step(gain)
    return content_hash(pack(traffic.world()))


def elsewhere(function: Callable[..., Any], *arguments: object) -> Any:
    """Result of a call in a process that is started anew."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


def test_replayed_accelerations_give_the_same_bits() -> None:
    assert digest_of(GAINS) == digest_of(GAINS) == elsewhere(digest_of, GAINS) != digest_of([-1.0, *GAINS[1:]])


CARDS = {"MTP-Drive-Intersection-v0": TRAFFIC, "MTP-Roundabout-v0": Traffic("roundabout", "ego", 8.0, 8, 0, 20),
         "MTP-Merge-v0": Traffic("merge", "ego", 8.0, 12, 0)}  # fmt: skip


LEVELS: list[dict[str, float]] = [
    {}, {"noise": 2.5, "misses": 3.0, "delay": 1.5, "score": 0.2}, {"misses": 0.5, "noise": 0.5, "seed": 3}
]  # fmt: skip


@pytest.mark.parametrize("levels", LEVELS, ids=str)
@pytest.mark.parametrize("env_id", CARDS)
def test_detections_frame_by_frame_are_those_of_the_whole_scene(env_id: str, levels: dict[str, float]) -> None:
    card = load_card(env_id)
    if card.drive is None:
        card = card.model_copy(update={"drive": DriveSection()})
    card = with_perturb(card, levels)
    traffic, scenes, frames = DrivenTraffic(CARDS[env_id], 5), DrivenScene(card, "of-5"), []
    for step, gain in enumerate([0.0, *GAINS]):
        if step:
            traffic.step(gain)
        if step % round(RATE / card.task.rate) == 0:
            frames.append(scenes.current(traffic.world(last_only=True)))
    whole = whole_scene(traffic.world(), card, "of-5")
    assert len(frames) == whole.frames
    assert len(scenes.recording(traffic.world()).detections.score) == len(whole.detections.score) > 5
    for t, current in enumerate(frames):
        np.testing.assert_array_equal(current.ego[0], whole.ego[t])
        for mine, rows, last_only in (
            (current.detections, whole.detections, "score"),
            (current.truth, whole.truth, "object_id"),
        ):
            for name in ("box", "velocity", "class_id", last_only):
                np.testing.assert_array_equal(getattr(mine, name), getattr(rows, name)[rows.rows(t)], name)


# places and headings of others, and whether they hit from behind: ahead, coming, crossing, from beside, following
CONTACTS = ((3.9, 0.0, 0.0, False), (3.9, 0.5, 3.1, False), (2.0, 2.5, -1.6, False), (-2.5, 0.0, 1.6, False),
            (0.5, 1.9, -0.2, False), (-3.9, 0.0, 0.0, True), (-3.6, 0.8, -0.6, True))  # fmt: skip


@pytest.mark.parametrize(("x", "y", "heading", "from_behind"), CONTACTS)
def test_fault_of_a_contact(x: float, y: float, heading: float, from_behind: bool) -> None:
    """The ego is at (0, 0), 4 m long and 2 m wide, and drives along x."""
    ego, other = np.array([[0.0, 0.0, 0.75, 0.0, 4.0, 2.0, 1.5], [x, y, 0.75, heading, 4.0, 2.0, 1.5]])
    assert hit_from_behind(ego, other) == from_behind != is_at_fault(ego, 3.0, other)
    assert not is_at_fault(ego, 0.0, other)


def test_of_two_contacts_the_one_at_fault_counts() -> None:
    traffic = DrivenTraffic(TRAFFIC, 5)
    others = [vehicle for vehicle in traffic._attempt.vehicles if vehicle is not traffic.ego]
    along = np.array([np.cos(traffic.ego.heading), np.sin(traffic.ego.heading)])
    for vehicle, away in zip(others, (-3.0, 3.0), strict=False):
        vehicle.position, vehicle.heading = traffic.ego.position + away * along, traffic.ego.heading
    traffic.ego.speed = 5.0
    traffic._record()
    assert traffic.collision is not None
    assert (traffic.over, len(traffic.world().time), traffic.collision.at_fault) == (True, 2, True)

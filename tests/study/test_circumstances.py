"""Age of tracks, and time since events."""

from __future__ import annotations

from mtp_bench.scoring.targets import find_targets
from mtp_bench.study.circumstances import circumstances
from tests.support.scoring_scenes import Thing, make_card, make_rollout, make_scene

SMALL = make_card(past=2, future=3, samples=1)


def test_time_since_an_event_and_age_of_the_track() -> None:
    # a car whose track changes its name in frame 3, and is gone in frame 5
    cars = [[Thing(1, 0, 0)]] * 10
    ids = [7, 7, 7, 8, 8, None, 8, 8, 8, 8]
    tracks = [[] if i is None else [Thing(i, 0, 0)] for i in ids]
    scene, rollout = make_scene(cars), make_rollout(tracks, samples=1)
    near = circumstances(scene, rollout, SMALL)
    frames = find_targets(scene, SMALL).frame.tolist()
    assert frames == [1, 2, 3, 4, 5, 6]
    assert near.since["ids"].tolist() == [-1, -1, 0, 1, 2, 3]
    assert near.since["lost"].tolist() == [-1, -1, -1, -1, 0, 1]
    assert near.since["reacquired"].tolist() == [-1, -1, -1, -1, -1, 0]
    assert near.age.tolist() == [1, 2, 0, 1, -1, 3]
    assert near.own == {"ids": 1, "lost": 1, "reacquired": 1, "frag": 2}
    assert (near.objects, near.frames) == (1, 10)

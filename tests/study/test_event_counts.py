"""Counts of events."""

from mtp_bench.study.runs import EventCounts, count_events
from tests.support.scoring_scenes import Thing, make_card, make_rollout, make_scene


def test_events_of_one_hypothesis_are_shared_by_all() -> None:
    # a car whose track changes its name in frame 3, and is gone in frame 5
    ids = [7, 7, 7, 8, 8, None, 8, 8, 8, 8]
    tracks = [[] if i is None else [Thing(i, 0, 0)] for i in ids]
    found = count_events(make_scene([[Thing(1, 0, 0)]] * 10), make_rollout(tracks), make_card(samples=1))
    counts = {"ids": 1, "lost": 1, "reacquired": 1, "frag": 2}
    assert found == EventCounts(own=counts, shared=counts, objects=1, frames=10)

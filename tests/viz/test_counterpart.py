"""What a second run does where the first one has an event."""

from __future__ import annotations

import numpy as np
import pytest

from mtp_bench.viz.case import counterpart
from mtp_bench.viz.drawing.report import SIZE, report, stacked
from mtp_bench.viz.focus import Focus
from mtp_bench.viz.replay import NO_EVENT, Replay, replay
from tests.support.focus_scenes import CARD, EVENT, FRAMES, crowd
from tests.support.scoring_scenes import Thing, make_rollout

CAR = 5


def steady(first: Replay, track: int = 7, until: int = FRAMES) -> Replay:
    """A run of the same scene whose track follows the car without a switch, to frame ``until``."""
    tracks, said = [], []
    for t in range(FRAMES):
        x = 0.5 * t
        tracks.append([Thing(track, x, 0.0)] if t < until else [])
        ways = [[[x + 0.5 * s, 0.0] for s in (1, 2, 3)]] * 2
        said.append([Thing(0, x, 0.0, forecast=ways)] if t < until else [])
    return replay(first.scene, make_rollout(tracks, said, samples=2), CARD, "steady")


@pytest.fixture(scope="module")
def first() -> Replay:
    return crowd(ahead=12.0)


def test_an_event_of_the_same_object_and_frame(first: Replay) -> None:
    assert counterpart(first, first.incident("ids-0")) == first.incident("ids-0")
    lost = steady(first, until=EVENT)
    found = counterpart(lost, first.incident("ids-0"))
    assert (found.kind, found.frame, found.object_id) == ("lost", EVENT, CAR)
    assert found in lost.events


def test_no_event(first: Replay) -> None:
    run = steady(first)
    found = counterpart(run, first.incident("ids-0"))
    assert (found.kind, found.frame, found.object_id) == (NO_EVENT, EVENT, CAR)
    assert (found.old_id, found.new_id) == (7, 7)
    assert found.error == pytest.approx(0.0, abs=0.01)
    focus = Focus.of(run, found)
    assert focus.sentence.startswith("no event: at 0.4 s car 5 stays with track 7; the nearest of 2 samples goes the ")
    assert "which costs 0.0 m" in focus.sentence
    assert [key.text for key in focus.key if key.role == "event"] == ["the event of the other run"]


def false_forecasts(first: Replay, place: tuple[float, float], frames: range) -> Replay:
    """A run that says nothing but that a car stands where none is."""
    ghost = [Thing(80, *place, forecast=[[place] * 3] * 2)]
    tracks = [ghost if t in frames else [] for t in range(FRAMES)]
    return replay(first.scene, make_rollout(tracks, tracks, samples=2), CARD, "ghost")


def test_false_forecasts(first: Replay) -> None:
    one = false_forecasts(first, (90.0, 90.0), range(2, 8))
    at = one.incident("spurious-0")
    same = counterpart(false_forecasts(first, (90.5, 90.0), range(1, 5)), at)
    assert (same.kind, same.frame, same.until) == ("spurious", 2, 4)
    assert same.position[0] == pytest.approx(90.5)
    for other in (false_forecasts(first, (99.0, 90.0), range(1, 5)), false_forecasts(first, (90.0, 90.0), range(5, 9))):
        none = counterpart(other, at)
        assert (none.kind, none.new_id) == (NO_EVENT, -1)
        focus = Focus.of(other, none)
        assert focus.sentence == "no event: at 0.2 s there is no false forecast of a car"
        assert report(focus).size == SIZE


def test_pictures_stand_below_each_other(first: Replay) -> None:
    at, run = first.incident("ids-0"), steady(first)
    focuses = Focus.of_all([first, run], at)
    assert [focus.replay.agent for focus in focuses] == ["drawn", "steady"]
    assert focuses[0].turn == focuses[1].turn
    both = [report(focus) for focus in focuses]
    image = np.asarray(stacked(both))
    assert image.shape == (2 * SIZE[1], SIZE[0], 3)
    assert np.array_equal(image[SIZE[1] :], np.asarray(both[1]))

"""An event alone: what is bright, where the picture looks, and the same event in another run."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from mtp_bench.core.geometry import rotate
from mtp_bench.viz.causes import happened
from mtp_bench.viz.drawing.report import SIZE, report
from mtp_bench.viz.evidence import expected, taken_detection
from mtp_bench.viz.focus import Focus
from mtp_bench.viz.framing import LARGEST_M, counterpart, focuses_of, frame_of, turn_of, window_of
from mtp_bench.viz.incident import MOMENT
from mtp_bench.viz.run_replay import Replay, replay
from tests.support.focus_scenes import CARD, CROWD, EVENT, FRAMES, MOST_BRIGHT, bright, crowd
from tests.support.scoring_scenes import Thing, line, make_rollout, make_scene, moved, random_case, with_detections


def switch(**options: Any) -> Focus:
    run = crowd(**options)
    return Focus(run, run.incident("ids-0"))


# ---- what is bright
def test_only_what_belongs_to_the_event_is_bright() -> None:
    focus = switch()
    shown = frame_of(focus, EVENT)
    assert shown.object_box[:, :2].tolist() == shown.detection_box[:, :2].tolist() == [[2.0, 0.0]]
    assert [(track.track_id, track.role) for track in shown.tracks] == [(1, "before"), (2, "now")]
    np.testing.assert_allclose(shown.past[:, 0], [2.0, 1.5, 1.0, 0.5, 0.0])
    np.testing.assert_allclose(shown.future[:, 0], [2.0, 2.5, 3.0, 3.5])
    assert [len(track.trail) for track in shown.tracks] == [5, 1]
    assert len(shown.dim_truth) == len(shown.dim_track) == len(shown.dim_detection) == len(CROWD)
    assert [track.track_id for track in frame_of(focus, EVENT - 1).tracks] == [1]
    assert [focus.follower(t) for t in (EVENT - 1, EVENT, EVENT + 1)] == [1, 2, 2]
    forecasts = [[(role, forecast.frame) for role, forecast in focus.forecasts(t)] for t in (EVENT - 1, EVENT)]
    assert forecasts == [[("before", EVENT - 1)], [("before", EVENT - 1), ("now", EVENT)]]


def test_other_objects_of_tracks_and_detections_have_names() -> None:
    truth = [[Thing(5, t, 0.0), Thing(6, t, 1.5)] for t in range(9)]
    tracks = [[Thing(1, t, 0.0)] * (t < EVENT) + [Thing(2, t, 1.2)] for t in range(9)]
    run = replay(with_detections(make_scene(truth), [[car] for _, car in truth]), make_rollout(tracks), CARD)
    focus = Focus(run, run.incident("lost-0"))
    shown = frame_of(focus, EVENT)
    assert [(track.track_id, track.role) for track in shown.tracks] == [(2, "named")], "the nearest one is named"
    assert shown.other_names == ("car 6",)
    assert [text.partition(", ")[2] for text in shown.detection_text] == ["of car 6"]


def test_the_tracks_are_those_of_the_lineage_not_of_the_rank() -> None:
    # hypothesis 0 loses the car at frame 2; until then hypothesis 1, which never had track 1, weighed more
    truth = [[Thing(5, t, 0.0)] for t in range(4)]
    tracks = [[Thing(1, t, 0.2)] * (t < 2) + [Thing(9, t, 0.4, hypotheses=(1,))] for t in range(4)]
    rollout = make_rollout(tracks, log_weight=np.log([[0.4, 0.6]] * 2 + [[0.9, 0.1]] * 2), hypotheses=2)
    rollout.hypothesis_parent[1:] = [[0, 1]] * 3
    run = replay(make_scene(truth), rollout, CARD)
    focus = Focus(run, run.incident("lost-0"))
    assert (focus.hypothesis.tolist(), [track.track_id for track in frame_of(focus, 1).tracks]) == ([0, 0, 0, 0], [1])
    assert focus.follower(1) == 1


def test_what_follows_in_the_hypothesis_that_becomes_the_best() -> None:
    """Track 1 drifts off in it for two frames, while it stays in the one that was the best until then."""
    tracks = [
        [Thing(1, t, 0.0, hypotheses=(0,)), Thing(1, t, 5.0 if t in (2, 3) else 0.0, hypotheses=(1,))] for t in range(8)
    ]
    weight = [[0.0, -1.0] if t < 4 else [-1.0, 0.0] for t in range(8)]
    rollout = make_rollout(tracks, log_weight=weight, hypotheses=2)
    run = replay(make_scene(line([5] * 8)), replace(rollout, hypothesis_parent=np.tile([0, 1], (8, 1))), CARD)
    focus = Focus(run, run.incident("reacquired-0"))
    assert (focus.at.frame, [focus.follower(t) for t in range(5)]) == (4, [1, 1, -1, -1, 1])


def assert_in_the_middle(focus: Focus) -> None:
    window = window_of(focus, focus.at.frame)
    away = rotate(focus.place(focus.at.frame) - [window.x, window.y], -window.turn)
    assert (np.abs(away) <= np.array([window.wide, window.high]) / 6).all()


@settings(derandomize=True, deadline=None, max_examples=8)
@given(st.integers(0, 10_000))
def test_few_boxes_are_bright_and_the_object_is_in_the_middle(seed: int) -> None:
    run = replay(*random_case(seed), CARD)
    counted = 0
    for focus in [Focus(run, incident) for incident in run.incidents]:
        for t in range(max(0, focus.at.frame - 1), min(run.frames, focus.at.frame + 2)):
            assert bright(frame_of(focus, t)) <= MOST_BRIGHT
        assert_in_the_middle(focus)
        shown, window = frame_of(focus, focus.at.frame), window_of(focus, focus.at.frame)
        boxes = np.array([track.box for track in shown.tracks]).reshape(-1, 7)
        right = rotate(boxes[:, :2] - [window.x, window.y], -window.turn)
        assert (np.abs(right) < np.array([window.wide, window.high]) / 2).all()
        if focus.at.minADE is not None:
            forecast = focus.forecast(focus.at.frame)
            assert forecast is not None
            gap = forecast.nearest_path[1:] - focus.future(focus.at.frame)[1:]
            assert np.hypot(*gap.T).mean() == pytest.approx(focus.at.minADE), "the sample that the score counts"
            counted += 1
    assert counted or not any(event.minADE for event in run.events)


@pytest.mark.parametrize("detected", [3.0, 9.0])
def test_the_detection_that_a_track_took_lies_beyond_its_box(detected: float) -> None:
    tracks = [[Thing(1, t, 2.4 if t == 4 else 0.0)] for t in range(8)]
    seen = [[Thing(0, t, detected if t == 4 else 0.0)] for t in range(8)]
    run = replay(with_detections(make_scene(line([5] * 8)), seen), make_rollout(tracks), CARD)
    focus = Focus(run, run.incident("lost-0"))
    place = expected(focus, 1, 4)
    assert place is not None
    assert (place.tolist(), taken_detection(focus, 1, 4)) == ([4.0, 0.0], (4 if detected < 9.0 else -1))
    assert expected(focus, 1, 0) is None


# ---- where the picture looks
@pytest.mark.parametrize("ahead", [0.0, 5.0, 40.0, 200.0])
def test_the_window_holds_the_future_and_the_forecasts_as_far_as_it_may(ahead: float) -> None:
    focus = switch(ahead=ahead)
    window = window_of(focus, focus.at.frame)
    assert_in_the_middle(focus)
    assert max(window.wide, window.high) <= 2 * LARGEST_M
    ends = np.array([[3.5, 0.0], [2.0 + ahead, 0.0]])
    right = rotate(ends - [window.x, window.y], -window.turn)[:, 0]
    assert abs(right[0]) < window.wide / 2
    assert (abs(right[1]) < window.wide / 2) == (2.0 + ahead < LARGEST_M)


@pytest.mark.parametrize("yaw", [0.5 * np.pi, np.pi, -0.5 * np.pi])
def test_the_way_of_the_object_points_to_the_right_wherever_it_goes(yaw: float) -> None:
    run = crowd()
    turned = replay(*moved(run.scene, run.rollout, yaw, (100.0, -50.0, 0.0)), CARD)
    first, second = (Focus(one, one.incident("ids-0")) for one in (run, turned))
    assert turn_of(first) == pytest.approx(0.0)
    assert np.cos(turn_of(second) - yaw) == pytest.approx(1.0)
    windows = [window_of(focus, focus.at.frame) for focus in (first, second)]
    assert (windows[1].wide, windows[1].high) == pytest.approx((windows[0].wide, windows[0].high))
    assert happened(second) == happened(first)


# ---- another run
def steady(first: Replay, until: int = FRAMES) -> Replay:
    """A run of the same scene whose track 7 follows the car without a switch, to frame ``until``."""
    tracks, said = [], []
    for t in range(FRAMES):
        x = 0.5 * t
        ways = [[[x + 0.5 * s, 0.0] for s in (1, 2, 3)]] * 2
        tracks.append([Thing(7, x, 0.0)] * (t < until))
        said.append([Thing(0, x, 0.0, forecast=ways)] * (t < until))
    return replay(first.scene, make_rollout(tracks, said, samples=2), CARD, "steady")


@pytest.fixture(scope="module")
def first() -> Replay:
    return crowd(ahead=12.0)


def test_the_event_of_the_same_object_and_frame(first: Replay) -> None:
    assert counterpart(first, first.incident("ids-0")) == first.incident("ids-0")
    lost = counterpart(steady(first, until=EVENT), first.incident("ids-0"))
    assert (lost.kind, lost.frame, lost.object_id) == ("lost", EVENT, 5)
    pair = focuses_of([first, steady(first)], first.incident("ids-0"))
    windows = [window_of(focus, EVENT, pair) for focus in pair]
    assert windows[0] == windows[1] == window_of(pair[0], EVENT) != window_of(pair[1], EVENT), "one scale"
    none = pair[1].at
    assert (none.kind, none.frame, none.object_id, none.old_id, none.new_id) == (MOMENT, EVENT, 5, 7, 7)
    assert none.error == pytest.approx(0.0, abs=0.01)
    assert happened(pair[1]) == "no event: at 0.4 s car 5 is followed by track 7"


def false_forecasts(first: Replay, place: tuple[float, float], frames: range) -> Replay:
    """A run that says nothing but that a car stands where none is."""
    ghost = [Thing(80, *place, forecast=[[place] * 3] * 2)]
    tracks = [ghost if t in frames else [] for t in range(FRAMES)]
    return replay(first.scene, make_rollout(tracks, tracks, samples=2), CARD, "ghost")


def test_false_forecasts(first: Replay) -> None:
    at = false_forecasts(first, (90.0, 90.0), range(2, 8)).incident("spurious-0")
    same = counterpart(false_forecasts(first, (90.5, 90.0), range(1, 5)), at)
    assert (same.kind, same.frame, same.until) == ("spurious", 2, 4)
    assert same.position[0] == pytest.approx(90.5)
    for other in (false_forecasts(first, (99.0, 90.0), range(1, 5)), false_forecasts(first, (90.0, 90.0), range(5, 9))):
        focus = Focus(other, counterpart(other, at))
        assert (focus.at.kind, focus.at.new_id) == (MOMENT, -1)
        assert (happened(focus), report(focus).size) == ("no event: at 0.2 s no false forecast of a car", SIZE)

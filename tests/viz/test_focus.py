"""An event alone: what is bright, where the picture looks, and what the sentence says."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from mtp_bench.core.geometry import rotate
from mtp_bench.viz.drawing.close_up import draw_focus
from mtp_bench.viz.drawing.report import SIZE, report
from mtp_bench.viz.evidence import expected, taken
from mtp_bench.viz.focus import Focus
from mtp_bench.viz.framing import LARGEST, counterpart, focuses_of, frame_of, turn_of, window_of
from mtp_bench.viz.incident import MOMENT
from mtp_bench.viz.run_replay import Replay, replay
from mtp_bench.viz.sentences import sentence
from tests.support.focus_scenes import BY_IOU, CARD, CROWD, EVENT, FRAMES, MOST_BRIGHT, bright, crowd, told
from tests.support.scoring_scenes import Thing, line, make_rollout, make_scene, moved, random_case, with_detections


def switch(**options: Any) -> Focus:
    run = crowd(**options)
    return Focus(run, run.incident("ids-0"))


# ---- what is bright
def test_only_what_belongs_to_the_event_is_bright() -> None:
    shown = frame_of(switch(), EVENT)
    assert shown.object_box[:, :2].tolist() == [[2.0, 0.0]]
    assert [(track.track_id, track.role) for track in shown.tracks] == [(1, "before"), (2, "now")]
    assert shown.detection_box[:, :2].tolist() == [[2.0, 0.0]]
    np.testing.assert_allclose(shown.past[:, 0], [2.0, 1.5, 1.0, 0.5, 0.0])
    np.testing.assert_allclose(shown.future[:, 0], [2.0, 2.5, 3.0, 3.5])
    assert [len(track.trail) for track in shown.tracks] == [5, 1]
    assert len(shown.dim_truth) == len(shown.dim_track) == len(shown.dim_detection) == len(CROWD)


def test_before_the_event_its_old_track_is_there_and_the_new_one_is_not_yet() -> None:
    focus = switch()
    assert [track.track_id for track in frame_of(focus, EVENT - 1).tracks] == [1]
    assert [focus.follower(t) for t in (EVENT - 1, EVENT, EVENT + 1)] == [1, 2, 2]
    assert [role for role, _ in focus.forecasts(EVENT - 1)] == ["before"]
    both = [(role, forecast.frame) for role, forecast in focus.forecasts(EVENT)]
    assert both == [("before", EVENT - 1), ("now", EVENT)]


def test_a_swap_shows_the_other_object_by_its_name() -> None:
    truth = [[Thing(5, t, 0.0), Thing(6, t, 3.0)] for t in range(8)]
    tracks = [[Thing(1 if t < EVENT else 2, t, 0.0), Thing(2 if t < EVENT else 1, t, 3.0)] for t in range(8)]
    run = replay(make_scene(truth), make_rollout(tracks), CARD)
    shown = frame_of(Focus(run, run.incident("ids-0")), EVENT)
    assert (shown.other_names, shown.others[:, 1].tolist()) == (("car 6",), [3.0])
    assert "track 2 (of car 6 until then). Track 1 takes the detection of car 6 (ids-1), 3.0 m from where" in told(
        truth, tracks, "ids-0"
    )


def test_a_track_and_a_detection_at_the_object_are_said_to_be_of_another_one() -> None:
    truth = [[Thing(5, t, 0.0), Thing(6, t, 1.5)] for t in range(9)]
    tracks = [[Thing(1, t, 0.0)] * (t < EVENT) + [Thing(2, t, 1.2)] for t in range(9)]
    for t in range(EVENT + 1, 9):  # track 3 is output long before it takes car 5
        tracks[t].append(Thing(3, t, 0.0 if t == 8 else -3.0))
    run = replay(with_detections(make_scene(truth), [[car] for _, car in truth]), make_rollout(tracks), CARD)
    focus = Focus(run, run.incident("lost-0"))
    shown = frame_of(focus, EVENT)
    assert (focus.rival(EVENT), focus.rival(EVENT - 1)) == (2, -1)
    assert {track.track_id: track.frame for track in shown.named} == {1: EVENT - 1, 2: EVENT, 3: 8}
    assert ([text.partition(", ")[2] for text in shown.detection_text], shown.other_names) == (["of car 6"], ("car 6",))
    _, marks = draw_focus(focus, EVENT, (900, 450), window_of(focus, EVENT))
    assert "track 2, which follows car 6" in [mark.text for mark in marks]


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


@settings(derandomize=True, deadline=None, max_examples=8)
@given(st.integers(0, 10_000))
def test_few_boxes_are_bright_but_all_tracks_that_are_named_and_the_object_is_in_the_middle(seed: int) -> None:
    run = replay(*random_case(seed), CARD)
    for focus in [Focus(run, incident) for incident in run.incidents]:
        for t in range(max(0, focus.at.frame - 1), min(run.frames, focus.at.frame + 2)):
            assert bright(frame_of(focus, t)) <= MOST_BRIGHT
        assert_in_the_middle(focus)
        text, shown, window = sentence(focus), frame_of(focus, focus.at.frame), window_of(focus, focus.at.frame)
        assert text.startswith(f"{focus.at.name}: ")
        drawn = {track.track_id: track.box for track in shown.named}
        assert drawn.keys() == {*focus.named_tracks} >= {*map(int, re.findall(r"track (\d+)", text))}
        right = rotate(np.array([*drawn.values()]).reshape(-1, 7)[:, :2] - [window.x, window.y], -window.turn)
        assert (np.abs(right) < np.array([window.wide, window.high]) / 2).all()


def assert_in_the_middle(focus: Focus) -> None:
    window = window_of(focus, focus.at.frame)
    away = rotate(focus.place(focus.at.frame) - [window.x, window.y], -window.turn)
    assert (np.abs(away) <= np.array([window.wide, window.high]) / 6).all()


# ---- where the picture looks
@pytest.mark.parametrize("ahead", [0.0, 5.0, 40.0, 200.0])
def test_the_window_holds_the_future_and_the_forecasts_as_far_as_it_may(ahead: float) -> None:
    focus = switch(ahead=ahead)
    window = window_of(focus, focus.at.frame)
    assert_in_the_middle(focus)
    assert max(window.wide, window.high) <= 2 * LARGEST
    ends = np.array([[3.5, 0.0], [2.0 + ahead, 0.0]])
    right = rotate(ends - [window.x, window.y], -window.turn)[:, 0]
    assert abs(right[0]) < window.wide / 2
    assert (abs(right[1]) < window.wide / 2) == (2.0 + ahead < LARGEST)


@pytest.mark.parametrize("yaw", [0.5 * np.pi, np.pi, -0.5 * np.pi])
def test_the_way_of_the_object_points_to_the_right_wherever_it_goes(yaw: float) -> None:
    run = crowd()
    scene, rollout = moved(run.scene, run.rollout, yaw, (100.0, -50.0, 0.0))
    turned = replay(scene, rollout, CARD)
    first, second = (Focus(one, one.incident("ids-0")) for one in (run, turned))
    assert turn_of(first) == pytest.approx(0.0)
    assert np.cos(turn_of(second) - yaw) == pytest.approx(1.0)
    windows = [window_of(focus, focus.at.frame) for focus in (first, second)]
    assert (windows[1].wide, windows[1].high) == pytest.approx((windows[0].wide, windows[0].high))
    assert sentence(second) == sentence(first)


# ---- the sentence
def test_a_switch_in_one_sentence() -> None:
    assert sentence(switch(old_y=1.5, ahead=12.0)) == (
        "ids-0: at 0.4 s car 5 changes from track 1 to the new track 2. "
        "Track 1 takes no detection and is 1.5 m away, track 2 0.0 m. "
        "The nearest of 2 samples goes too far and ends 10.5 m off, which costs 7.0 m: rest 7.0 m"
    )
    assert "to the new track 2. Track 1 ends. " in sentence(switch(old_y=None))


SAYS: dict[str, tuple[list[list[Thing]], str, str]] = {  # tracks of car 5, event, what is said of it
    "an older track takes it": (
        [[Thing(1, t, 0.0 if t < 3 else 4.0), Thing(2, t, 4.0 if t < 3 else 0.0)] for t in range(8)], "ids-0",
        "(3 frames old, of no object before). Track 1 takes no detection and is 4.0 m away, track 2 0.0 m. "),
    "its track ends": (
        line([1, 1, None, None, None, None, None, None]), "lost-0",
        "loses track 1 for good. Track 1 ends; it is detected 0.0 m away, score 1.00; it is 2 m from the ego. It"),
    "its track drifts off": (
        [[Thing(1, t, 0.0 if t < 3 else 2.5)] for t in range(8)], "lost-0",
        "loses track 1 for good. Track 1 is 2.5 m away; it is detected 0.0 m away, "),
    "it is found again": (
        line([1, 1, None, None, 1, 1, 1, 1]), "reacquired-0",
        "at 0.4 s car 5 is found again after 0.2 s (lost-0) by its old track 1. "),
    "another track finds it": (
        line([1, 1, None, 2, 2, 2, 2, 2]), "reacquired-0", "is found again after 0.1 s (lost-0) by the new track 2. "),
    "too near the end to be a target": (
        line([1, 1, 1, 1, 1, 1, 1, 2]), "ids-0", "No error is counted, as it is not a target then"),
}  # fmt: skip


@pytest.mark.parametrize(("tracks", "name", "text"), SAYS.values(), ids=SAYS)
def test_what_is_said_of_an_event(tracks: list[list[Thing]], name: str, text: str) -> None:
    assert text in told(line([5] * 8), tracks, name)


def test_a_detection_of_another_class_is_said_of_the_object_and_of_its_ghost() -> None:
    seen = [[Thing(0, t, 0.0, class_id=int(t >= 3))] for t in range(8)]
    said = [[Thing(1, t, 0.2, class_id=int(t >= 3), forecast=[[[t, 0.0]] * 3])] for t in range(8)]
    run = replay(with_detections(make_scene(line([5] * 8)), seen), make_rollout(said, said), CARD)
    lost, ghost = (sentence(Focus(run, run.incident(name))) for name in ("lost-0", "spurious-0"))
    assert ". The detection there says pedestrian 1.00 (spurious-0); track 1 has class pedestrian now" in lost
    assert ". The true car 5 (lost-0) is 0.2 m away, forecast as pedestrian; the detection of track 1" in ghost


@pytest.mark.parametrize(("detected", "said"), [(3.0, "takes a detection of no object, 3.0 m"), (9.0, "takes no")])
def test_the_detection_that_a_track_took_lies_beyond_its_box(detected: float, said: str) -> None:
    tracks = [[Thing(1, t, 2.4 if t == 4 else 0.0)] for t in range(8)]
    seen = [[Thing(0, t, detected if t == 4 else 0.0)] for t in range(8)]
    run = replay(with_detections(make_scene(line([5] * 8)), seen), make_rollout(tracks), CARD)
    focus = Focus(run, run.incident("lost-0"))
    place = expected(focus, 1, 4)
    assert place is not None
    assert (place.tolist(), taken(focus, 1, 4)) == ([4.0, 0.0], (4 if detected < 9.0 else -1))
    assert f"for 0.1 s, until it has it again (reacquired-0). Track 1 {said}" in sentence(focus)
    rule = replay(run.scene, run.rollout, BY_IOU)
    assert re.search(r"has an IoU of 0\.\d\d with it, below 0\.5", sentence(Focus(rule, rule.incident("lost-0"))))


def test_what_follows_in_the_hypothesis_that_becomes_the_best() -> None:
    """Track 1 drifts off in it for two frames, while it stays in the one that was the best until then."""
    tracks = [
        [Thing(1, t, 0.0, hypotheses=(0,)), Thing(1, t, 5.0 if t in (2, 3) else 0.0, hypotheses=(1,))] for t in range(8)
    ]
    weight = [[0.0, -1.0] if t < 4 else [-1.0, 0.0] for t in range(8)]
    rollout = make_rollout(tracks, log_weight=weight, hypotheses=2)
    rollout = replace(rollout, hypothesis_parent=np.tile([0, 1], (8, 1)))
    run = replay(make_scene(line([5] * 8)), rollout, CARD)
    focus = Focus(run, run.incident("reacquired-0"))
    assert (focus.at.frame, [focus.follower(t) for t in range(5)]) == (4, [1, 1, -1, -1, 1])
    assert "car 5 is found again after 0.2 s by its old track 1. " in sentence(focus)


def test_the_nearest_sample_is_the_one_that_the_score_counts() -> None:
    runs = [replay(*random_case(seed), CARD) for seed in range(4)]
    counted = 0
    for focus in [Focus(run, event) for run in runs for event in run.events if event.minADE is not None]:
        forecast = focus.forecast(focus.at.frame)
        assert forecast is not None
        gap = forecast.nearest_path[1:] - focus.future(focus.at.frame)[1:]
        assert np.hypot(*gap.T).mean() == pytest.approx(focus.at.minADE)
        counted += 1
    assert counted > 5


# ---- another run
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
    assert (found.kind, found.frame, found.object_id) == ("lost", EVENT, 5)
    assert found in lost.events


def test_no_event(first: Replay) -> None:
    run = steady(first)
    pair = focuses_of([first, run], first.incident("ids-0"))
    found = pair[1].at
    windows = [window_of(focus, EVENT, pair) for focus in pair]
    assert windows[0] == windows[1] == window_of(pair[0], EVENT) != window_of(pair[1], EVENT), "one scale"
    assert (found.kind, found.frame, found.object_id) == (MOMENT, EVENT, 5)
    assert (found.old_id, found.new_id) == (7, 7)
    assert found.error == pytest.approx(0.0, abs=0.01)
    focus = Focus(run, found)
    assert sentence(focus).startswith(
        "no event: at 0.4 s car 5 is followed by track 7 from its first frame on. The nearest of 2 samples goes the "
    )
    assert "which costs 0.0 m" in sentence(focus)


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
        assert (none.kind, none.new_id) == (MOMENT, -1)
        focus = Focus(other, none)
        assert (sentence(focus), report(focus).size) == ("no event: at 0.2 s there is no false forecast of a car", SIZE)

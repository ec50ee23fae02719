"""The record that drawings read: incidents of scenes small enough to draw, and the judge's numbers on any scene."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from mtp_bench.core import Rollout, Scene
from mtp_bench.scoring import score_scene
from mtp_bench.scoring.lineage import match_hypotheses
from mtp_bench.viz.incident import Incident
from mtp_bench.viz.run_replay import Replay, replay
from tests.support.focus_scenes import CARD
from tests.support.scoring_scenes import WALKER, Thing, line, make_rollout, make_scene, random_case, with_detections


def told(incidents: tuple[Incident, ...]) -> list[tuple[str, int, int, int, int]]:
    """Name, frame, object, old and new track."""
    return [(i.name, i.frame, i.object_id, i.old_id, i.new_id) for i in incidents]


def together(*lines: list[list[Thing]]) -> list[list[Thing]]:
    return [[thing for one in frame for thing in one] for frame in zip(*lines, strict=True)]


CASES: dict[str, tuple[list[list[Thing]], list[list[Thing]], list[tuple[str, int, int, int, int]]]] = {
    # truth, tracks, incidents
    "nothing happens": (line([5] * 4), line([1] * 4), []),
    "a switch": (line([5] * 4), line([1, 1, 2, 2]), [("ids-0", 2, 5, 1, 2)]),
    "lost and found again": (
        line([5] * 5), line([1, 1, None, None, 1]), [("lost-0", 2, 5, 1, -1), ("reacquired-0", 4, 5, 1, 1)]),
    "a swap": (
        together(line([5] * 3), line([6] * 3, y=9.0)), together(line([1, 1, 2]), line([2, 2, 1], y=9.0)),
        [("ids-0", 2, 5, 1, 2), ("ids-1", 2, 6, 2, 1)]),
    "found late": (line([5] * 3), line([None, 1, 1]), []),
    "an object that leaves is not lost": (line([5, 5, None]), line([1, 1, None]), []),
    "neutral objects have no events": (line([5] * 3, neutral=True), line([1, 2, None]), []),
}  # fmt: skip


@pytest.mark.parametrize(("truth", "tracks", "expected"), CASES.values(), ids=CASES.keys())
def test_incidents(truth: list[list[Thing]], tracks: list[list[Thing]], expected: list[Any]) -> None:
    assert told(replay(make_scene(truth), make_rollout(tracks), CARD).incidents) == expected


def test_a_loss_says_whether_the_track_is_elsewhere() -> None:
    tracks = [[Thing(1, 0, 0)], [Thing(1, 1, 2.5)]]
    (lost,) = replay(make_scene(line([5] * 2)), make_rollout(tracks), CARD).incidents
    assert (lost.name, lost.wrong) == ("lost-0", True)
    (lost,) = replay(make_scene(line([5] * 2)), make_rollout(line([1, None])), CARD).incidents
    assert (lost.name, lost.wrong) == ("lost-0", False)


def test_incidents_are_those_of_the_best_hypothesis_along_its_lineage() -> None:
    # hypothesis 0 keeps track 1, hypothesis 1 switches to track 2; ranks change in the last frame
    tracks = together(line([1] * 4, hypotheses=(0,)), line([1, 1, 2, 2], hypotheses=(1,)))
    scene = make_scene(line([5] * 4))
    calm = make_rollout(tracks, log_weight=np.log([[0.6, 0.4]] * 4), hypotheses=2)
    assert replay(scene, calm, CARD).incidents == ()
    worse = make_rollout(tracks, log_weight=np.log([[0.4, 0.6]] * 4), hypotheses=2)
    assert told(replay(scene, worse, CARD).incidents) == [("ids-0", 2, 5, 1, 2)]
    late = make_rollout(tracks, log_weight=np.log([[0.6, 0.4]] * 3 + [[0.4, 0.6]]), hypotheses=2)
    played = replay(scene, late, CARD)
    assert played.incidents == (), "no track of either lineage changed then, and a change of rank is no switch"
    assert (played.answers.hypotheses.best.tolist(), played.truth_track.tolist()) == ([0, 0, 0, 1], [0, 2, 4, 7])


def spoken(things: list[list[Thing]], off: float = 0.0) -> list[list[Thing]]:
    """The same things with one forecast: 1 m per frame along x, ``off`` metres aside."""
    return [
        [replace(i, forecast=[[[i.x + s, i.y + off] for s in (1, 2, 3)]], log_weight=[0.0]) for i in frame]
        for frame in things
    ]


def worth(played: Replay) -> tuple[str, float | None, float | None, float | None]:
    """Name, minADE, error and confidence of the only incident."""
    (incident,) = played.incidents
    return incident.name, incident.minADE, incident.error, incident.confidence


def test_the_error_is_that_of_the_forecast_made_then() -> None:
    tracks = line([1] * 3 + [2] * 5)
    said = spoken(line([1] * 3 + [2] * 5, confidence=0.75), off=0.5)
    played = replay(make_scene(line([5] * 8)), make_rollout(tracks, said), CARD)
    assert worth(played) == ("ids-0", 0.5, 0.5, 0.75)
    silent = replay(make_scene(line([5] * 8)), make_rollout(tracks), CARD)
    assert worth(silent) == ("ids-0", None, 10.0, None), "a target without a forecast costs c"
    late = replay(make_scene(line([5] * 5)), make_rollout(tracks[:5], said[:5]), CARD)
    assert worth(late) == ("ids-0", None, None, None), "too near the end to be a target"
    far = replay(make_scene(line([5] * 8)), make_rollout(tracks, spoken(tracks, off=30.0)), CARD)
    assert worth(far) == ("ids-0", 30.0, 10.0, 1.0)


def test_false_forecasts_are_listed_as_runs_of_their_track() -> None:
    ghost = line([8, 8, 8, None, 8, 9, 9], y=50.0, confidence=0.25)
    walker = [[], [Thing(0, 70.0, 70.0, class_id=WALKER, confidence=0.5)], *[[] for _ in range(5)]]
    tracks, said = together(line([1] * 7), ghost), spoken(together(line([1] * 7), ghost, walker))
    said[2][1] = replace(said[2][1], confidence=0.5)
    scene = make_scene(line([5] * 9))  # live: frames 1 to 5
    said, tracks = [*said, [], []], [*tracks, [], []]
    played = replay(scene, make_rollout(tracks, said), CARD)
    found = [i for i in played.incidents if i.kind == "spurious"]
    assert [(i.name, i.frame, i.until, i.new_id, i.class_id == WALKER, i.confidence) for i in found] == [
        ("spurious-0", 1, 2, 8, False, 0.5),
        ("spurious-1", 1, 1, -1, True, 0.5),  # without a track
        ("spurious-2", 4, 4, 8, False, 0.25),
        ("spurious-3", 5, 5, 9, False, 0.25),
    ]
    assert (played.forecast_false.sum(), (played.answers.object_track >= 0).sum()) == (5, 13)
    assert played.rollout.tracks.frame_of_rows[played.track_false].tolist() == [0, 1, 2, 4, 5, 6]
    unknown = replay(replace(scene, truth_complete=False), make_rollout(tracks, said), CARD)
    assert {incident.kind for incident in unknown.incidents} == {"lost"}
    assert not unknown.forecast_false.any()
    assert not unknown.track_false.any()


def test_what_is_tracked_false_or_neither() -> None:
    # car 5 and a neutral car 6; detections and tracks of both, and one of nothing
    truth = together(line([5] * 2), line([6] * 2, y=9.0, neutral=True))
    things = together(line([1] * 2), line([2] * 2, y=9.5), line([3] * 2, y=30.0))
    played = replay(with_detections(make_scene(truth), things), make_rollout(things), CARD)
    assert (played.truth_track.tolist(), played.track_false.tolist()) == ([0, 1, 3, 4], [False, False, True] * 2)
    assert played.detection_false.tolist() == [False, False, True] * 2


def assert_same_as_the_score(scene: Scene, rollout: Rollout, card: Any) -> None:
    played, score = replay(scene, rollout, card), score_scene(scene, rollout, card)
    events = {kind: [i for i in played.incidents if i.kind == kind] for kind in ("ids", "lost", "reacquired")}
    frame = scene.truth.frame_of_rows
    for kind, incidents in events.items():
        assert len(incidents) == score.own_events[kind]
        assert all((frame[i.row], scene.truth.object_id[i.row]) == (i.frame, i.object_id) for i in incidents)
    assert sum(i.wrong for i in played.incidents) == score.own_events["wrong"]
    runs = [i for i in played.incidents if i.kind == "spurious"]
    assert sum(i.until - i.frame + 1 for i in runs) == (score.false_forecasts if scene.truth_complete else 0)
    if scene.truth_complete:
        assert played.track_false.sum() == score.counts.false_positives
    target = {(int(t), int(g)): i for i, (t, g) in enumerate(zip(score.frame, score.object_id, strict=True))}
    for incident in played.events:
        row = target.get((incident.frame, incident.object_id))
        assert (incident.error is None) == (row is None)
        if row is not None:
            assert incident.error == score.capped[row]
            assert incident.minADE == (score.min_ade[row] if score.covered[row] else None)
    found = played.answers.hypotheses
    matched = match_hypotheses(scene.truth, rollout, found.member, card)[np.arange(len(frame)), found.best[frame]]
    np.testing.assert_array_equal(matched, np.where(scene.truth.neutral, -1, played.truth_track))


@settings(derandomize=True, deadline=None, max_examples=10)
@given(st.integers(0, 10_000))
def test_the_record_says_what_the_score_counts(seed: int) -> None:
    scene, rollout = random_case(seed)
    assert_same_as_the_score(scene, rollout, CARD)

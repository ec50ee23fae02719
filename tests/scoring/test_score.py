"""A whole scene: what must not matter, and what must never make a number better."""

from __future__ import annotations

import pickle
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mtp_bench.errors import RolloutError
from mtp_bench.scoring import SceneScore, score_scene
from mtp_bench.scoring.error import error_sum
from mtp_bench.types import Rollout, Scene
from tests.support.scoring_scenes import (
    Thing,
    make_card,
    make_rollout,
    make_scene,
    moved,
    random_case,
    take_objects,
    take_tracks,
)

CARD = make_card()
steady = settings(derandomize=True, deadline=None, max_examples=40)
seeds = st.integers(0, 10_000)


def assert_equal(got: SceneScore, want: SceneScore, but: tuple[str, ...] = ()) -> None:
    for field in fields(SceneScore):
        if field.name in but:
            continue
        a, b = getattr(got, field.name), getattr(want, field.name)
        if isinstance(b, dict):
            assert a.keys() == b.keys()
            assert all(np.array_equal(a[k], b[k]) for k in b)
        elif field.name == "counts":
            for name in (f.name for f in fields(b)):
                np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-9, err_msg=name)
        elif isinstance(b, np.ndarray) and b.dtype.kind == "f":
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9, err_msg=field.name)
        else:
            assert np.array_equal(a, b), field.name


# ---- what must not matter


@steady
@given(seeds)
def test_order_of_rows_does_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene, rollout = random_case(seed)
    frame, track_frame = rollout.objects.frame_of_rows, rollout.tracks.frame_of_rows
    other = take_objects(rollout, np.lexsort((rng.random(len(frame)), frame)))
    other = take_tracks(other, np.lexsort((rng.random(len(track_frame)), track_frame)))
    assert_equal(score_scene(scene, other, CARD), score_scene(scene, rollout, CARD))


@steady
@given(seeds)
def test_order_of_samples_and_names_of_tracks_do_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene, rollout = random_case(seed)
    order = rng.permutation(4)
    name = rng.permutation(1000)
    other = replace(
        rollout,
        forecast=rollout.forecast[:, order],
        forecast_log_weight=rollout.forecast_log_weight[:, order],
        track_id=name[rollout.track_id],
    )
    assert_equal(score_scene(scene, other, CARD), score_scene(scene, rollout, CARD))


@steady
@given(seeds, st.sampled_from([np.pi / 2, np.pi, -np.pi / 2]))
def test_place_and_heading_of_the_world_do_not_matter(seed: int, yaw: float) -> None:
    scene, rollout = random_case(seed)
    assert_equal(score_scene(*moved(scene, rollout, yaw, (40.0, -7.0, 2.0)), CARD), score_scene(scene, rollout, CARD))


@pytest.mark.parametrize("yaw", [0.3, 2.0, -1.1])
def test_any_heading_up_to_the_rounding_of_forecasts(yaw: float) -> None:
    scene, rollout = random_case(11)
    got, want = score_scene(*moved(scene, rollout, yaw, (40.0, -7.0, 2.0)), CARD), score_scene(scene, rollout, CARD)
    np.testing.assert_allclose(got.capped, want.capped, atol=0.01)
    np.testing.assert_allclose(got.distance, want.distance)
    np.testing.assert_allclose(got.approach, want.approach)
    assert np.array_equal(got.own_ids, want.own_ids)
    assert np.array_equal(got.false_forecasts, want.false_forecasts)


@steady
@given(seeds)
def test_names_and_order_of_true_objects_matter_for_keys_only(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene, rollout = random_case(seed)
    truth = scene.truth
    frame = truth.frame_of_rows
    rows = np.lexsort((rng.random(len(frame)), frame))
    name = rng.permutation(100)
    columns = {f: getattr(truth, f)[rows] for f in ("box", "velocity", "class_id", "eligible", "neutral")}
    renamed = replace(truth, **columns, object_id=name[truth.object_id[rows]])
    got, want = score_scene(replace(scene, truth=renamed), rollout, CARD), score_scene(scene, rollout, CARD)
    a = np.lexsort((got.object_id, got.frame))
    b = np.lexsort((name[want.object_id], want.frame))
    for field in [
        "frame",
        "covered",
        "capped",
        "energy_score",
        "own_ids",
        "own_frag",
        "all_h_ids",
        "all_h_frag",
        "moving",
    ]:
        assert np.array_equal(getattr(got, field)[a], getattr(want, field)[b]), field
    assert error_sum(got) == pytest.approx(error_sum(want))


def test_scoring_again_gives_the_same() -> None:
    scene, rollout = random_case(5)
    assert_equal(score_scene(scene, rollout, CARD), score_scene(scene, rollout, CARD))
    sent = pickle.loads(pickle.dumps(score_scene(scene, rollout, CARD)))
    assert_equal(sent, score_scene(scene, rollout, CARD))


# ---- what must never help


@steady
@given(seeds)
def test_leaving_out_the_only_candidate_of_an_object_never_helps(seed: int) -> None:
    scene, rollout = random_case(seed)
    want = error_sum(score_scene(scene, rollout, CARD))
    frame = rollout.objects.frame_of_rows
    rows = np.arange(len(frame))
    gate = np.array([2.0, 1.0])
    lonely = 0
    for i in rows:
        kind, here = rollout.object_class[i], scene.truth.rows(frame[i])
        gap = np.hypot(*(scene.truth.box[here, :2] - rollout.object_box[i, :2]).T)
        near = np.flatnonzero((gap <= gate[kind]) & (scene.truth.class_id[here] == kind))
        rivals = (frame == frame[i]) & (rows != i)
        apart = np.hypot(*(rollout.object_box[rivals, :2] - rollout.object_box[i, :2]).T)
        if len(near) == 1 and (apart > 4.0).all():
            lonely += 1
            assert error_sum(score_scene(scene, take_objects(rollout, rows[rows != i]), CARD)) >= want - 1e-9
    assert lonely > 0


@steady
@given(seeds)
def test_saying_everything_twice_never_helps(seed: int) -> None:
    scene, rollout = random_case(seed)
    rows = np.repeat(np.arange(len(rollout.object_box)), 2)
    got = score_scene(scene, take_objects(rollout, rows), CARD)
    want = score_scene(scene, rollout, CARD)
    count = len(rollout.object_class)
    assert got.false_forecasts.sum() >= want.false_forecasts.sum()
    if count:
        assert got.false_error > want.false_error


def test_a_copy_of_one_object_costs_half_the_miss_error() -> None:
    scene = make_scene([[Thing(1, 0, 0)]] * 5)
    seen = Thing(1, 0.5, 0, forecast=np.zeros((4, 3, 2)))
    once = score_scene(scene, make_rollout([[]] * 5, [[], [seen]], samples=4), CARD)
    twice = score_scene(scene, make_rollout([[]] * 5, [[], [seen, seen]], samples=4), CARD)
    assert error_sum(twice) == error_sum(once) + 5.0


@steady
@given(seeds)
def test_fewer_samples_never_help(seed: int) -> None:
    scene, rollout = random_case(seed)
    want = score_scene(scene, rollout, CARD)
    fewer = rollout.forecast_log_weight.copy()
    fewer[:, 2:] = -np.inf
    got = score_scene(scene, replace(rollout, forecast_log_weight=fewer), CARD)
    assert (got.min_ade >= want.min_ade).all()
    assert (got.capped >= want.capped).all()
    assert error_sum(got) >= error_sum(want)
    assert (got.covered <= want.covered).all()


@steady
@given(seeds)
def test_saying_nothing_costs_the_miss_error_everywhere(seed: int) -> None:
    scene, rollout = random_case(seed)
    silent = take_objects(rollout, np.zeros(0, dtype=int))
    got, want = score_scene(scene, silent, CARD), score_scene(scene, rollout, CARD)
    assert not got.covered.any()
    assert np.isinf(got.min_ade).all()
    assert got.miss.all()
    assert np.array_equal(got.capped, got.miss_error)
    assert (got.capped >= want.capped).all()


@steady
@given(seeds)
def test_without_tracks_every_matched_object_is_missed(seed: int) -> None:
    scene, rollout = random_case(seed)
    got = score_scene(scene, take_tracks(rollout, np.zeros(0, dtype=int)), CARD)
    assert got.counts.fn.sum() == got.counts.truth.sum()
    assert got.counts.tp.sum() == got.counts.fp.sum() == got.counts.false_tracks == 0
    assert not any(len(keys) for keys in got.events.values())


@steady
@given(seeds)
def test_samples_worth_more_than_fewer_on_the_curve(seed: int) -> None:
    scene, rollout = random_case(seed)
    score = score_scene(scene, replace(rollout, forecast_log_weight=np.zeros((len(rollout.object_class), 4))), CARD)
    assert score.ks == (1,)
    here = score.covered
    assert (score.curve[here, 0] >= score.min_ade[here] - 1e-12).all()
    assert np.isinf(score.curve[~here]).all()


# ---- by hand


def scored(truth: list[Any], tracks: list[Any], log_weight: Any = None, hypotheses: int = 1) -> SceneScore:
    """The score of tracks, where one future frame makes a target."""
    rollout = make_rollout(tracks, log_weight=log_weight, hypotheses=hypotheses, future=1)
    return score_scene(make_scene(truth), rollout, make_card(future=1))


def test_counts_of_the_best_hypothesis() -> None:
    truth = [[Thing(1, 0, 0), Thing(2, 50, 0, neutral=True)]] * 4
    tracks = [
        [Thing(7, 0, 0, hypotheses=(0, 1)), Thing(8, 50, 0, hypotheses=(0,))],  # 8 sits on the neutral box
        [Thing(7, 0, 0, hypotheses=(0, 1)), Thing(9, 90, 0, hypotheses=(0,))],  # 9 on nothing
        [Thing(6, 0, 0, hypotheses=(0,)), Thing(7, 0, 0, hypotheses=(1,))],
        [Thing(5, 9, 0, hypotheses=(0, 1))],
    ]
    weight = [[-1, -2]] * 4
    score = scored(truth, tracks, weight, 2)
    counts = score.counts
    assert counts.truth.tolist() == [4, 0, 0]
    assert (counts.tp[0], counts.fp[0], counts.fn[0], counts.ids[0], counts.frag[0]) == (3, 2, 1, 1, 0)
    assert counts.false_positives == 2
    assert counts.false_tracks == 2  # 9 and 5; 8 belonged to something
    assert score.own_ids.tolist() == [False, True]  # targets are frames 1 and 2
    assert score.all_h_ids.tolist() == [False, False]
    assert len(score.events["lost"]) == 1
    assert len(score.events["ids"]) == 1


def test_sticky_counts_and_frame_events_differ_where_they_should() -> None:
    # track 2 comes nearer than track 1, which stays inside the gate
    truth = [[Thing(1, 0, 0)]] * 4
    tracks = [[Thing(1, 0.1, 0)]] * 2 + [[Thing(1, 1.5, 0), Thing(2, 0.1, 0)]] * 2
    score = scored(truth, tracks)
    assert score.counts.ids[0] == 0
    assert len(score.events["ids"]) == 1


def test_a_track_without_a_class_fits_every_class() -> None:
    truth = [[Thing(1, 0, 0, class_id=1)]] * 4
    tracks = [[Thing(3, 0.1, 0, class_id=-1), Thing(4, 30, 0, class_id=-1)]] * 4
    score = scored(truth, tracks)
    assert score.counts.tp.tolist() == [0, 4, 0]
    assert score.counts.fp.tolist() == [0, 0, 4]


def test_own_events_are_those_of_the_best_hypothesis_wherever_it_stands() -> None:
    tracks = [
        [Thing(1, 0, 0, hypotheses=(0, 1, 2))],
        [Thing(1, 0, 0, hypotheses=(0, 1, 2))],
        [Thing(1, 0, 0, hypotheses=(0,)), Thing(2, 0, 0, hypotheses=(1,)), Thing(1, 50, 0, hypotheses=(2,))],
        [Thing(1, 0, 0, hypotheses=(0,)), Thing(2, 0, 0, hypotheses=(1,)), Thing(1, 50, 0, hypotheses=(2,))],
    ]
    for best, switched, lost in ((0, False, False), (1, True, False), (2, False, True)):
        weight = np.where(np.arange(3) == best, -0.1, -3.0) * np.ones((4, 1))
        score = scored([[Thing(1, 0, 0)]] * 4, tracks, weight, 3)
        assert (score.own_ids.tolist(), score.own_frag.tolist()) == ([False, switched], [False, lost])
        assert len(score.events["wrong"]) == lost
        assert not score.all_h_ids.any()


def test_absent_hypotheses_have_no_say_in_what_every_hypothesis_has() -> None:
    tracks = [[Thing(1, 0, 0, hypotheses=(0, 1))]] * 2 + [[Thing(2, 0, 0, hypotheses=(0,))], []]
    weight = [[-1.0, -1.0], [-1.0, -1.0], [0.0, -np.inf], [0.0, -np.inf]]
    score = scored([[Thing(1, 0, 0)]] * 5, [*tracks, []], [*weight, weight[-1]], 2)
    assert score.all_h_ids.tolist() == [False, True, False]
    assert score.all_h_frag.tolist() == [False, False, True]


def test_a_neutral_box_is_left_to_the_track_that_fits_nothing_else() -> None:
    # track 3 lies nearest to the neutral box but belongs to the evaluated one, track 4 is left over for the neutral one
    truth = [[Thing(1, 0, 0), Thing(2, 1.5, 0, neutral=True)]] * 4
    tracks = [[Thing(3, 1.0, 0), Thing(4, 3.0, 0)]] * 4
    score = scored(truth, tracks)
    assert score.counts.fp.sum() == score.counts.false_positives == score.counts.false_tracks == 0
    assert len(score.truth_key) == score.counts.truth.sum() == 4


def test_events_in_every_hypothesis() -> None:
    truth = [[Thing(1, 0, 0)]] * 5
    switch = [[Thing(1, 0, 0, hypotheses=(0, 1))], [Thing(1, 0, 0, hypotheses=(0, 1))]]
    both = [*switch, [Thing(2, 0, 0, hypotheses=(0,)), Thing(3, 0, 0, hypotheses=(1,))], [], []]
    one = [*switch, [Thing(2, 0, 0, hypotheses=(0,)), Thing(1, 0, 0, hypotheses=(1,))], [], []]
    for tracks, everywhere in ((both, True), (one, False)):
        weight = [[-1.0, -2.0]] * 5
        score = scored(truth, tracks, weight, 2)
        assert score.own_ids.tolist() == [False, True, False]
        assert score.all_h_ids.tolist() == [False, everywhere, False]
        assert score.own_frag.tolist() == score.all_h_frag.tolist() == [False, False, True]


def test_iou_gate() -> None:
    truth = [[Thing(1, 0, 0)]] * 4
    tracks = [[Thing(1, 1.0, 0)]] * 2 + [[Thing(1, 1.4, 0)]] * 2  # IoU 3/5, then 2.6/5.4
    score = score_scene(make_scene(truth), make_rollout(tracks, future=1), make_card(future=1, measure="iou_3d"))
    assert score.counts.tp[0] == 2
    assert score.counts.cost[0] == pytest.approx(2 * 0.4)
    assert len(score.events["lost"]) == 1
    assert len(score.events["wrong"]) == 1


def wrong(**changes: Any) -> tuple[Scene, Rollout]:
    scene, rollout = random_case(1)
    return scene, replace(rollout, **changes)


WRONG: dict[str, tuple[Any, str]] = {
    "another scene": (wrong(scene="other"), "rollout is of scene 'other', expected 's'"),
    "fewer frames": ((make_scene([[]] * 3), make_rollout([[]] * 2, samples=4)), "has 2 frames, the scene 3"),
    "other horizon": ((make_scene([[]]), make_rollout([[]], future=5)), "forecasts 5 frames, expected 3"),
    "unknown class": (
        (make_scene([[]]), make_rollout([[]], [[Thing(1, 0, 0, class_id=2)]])),
        "object class 2 in the rollout of scene 's', expected less than 2",
    ),
}


@pytest.mark.parametrize(("case", "message"), WRONG.values(), ids=WRONG.keys())
def test_a_rollout_of_something_else_is_an_error(case: tuple[Scene, Rollout], message: str) -> None:
    with pytest.raises(RolloutError, match=message):
        score_scene(*case, CARD)

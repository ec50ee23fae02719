"""A whole scene: what must not matter, and what must never make a number better."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from mtp_bench.core import Rollout, Scene
from mtp_bench.core.errors import RolloutError
from mtp_bench.scoring import AgentScores, SceneScore, score_scene, summarise
from mtp_bench.scoring.bade import CardBudget, Cuts, errors_at
from mtp_bench.scoring.table import agent_table
from tests.support.scoring_scenes import (
    Array,
    Thing,
    make_card,
    make_rollout,
    make_scene,
    moved,
    random_case,
    take_objects,
    take_tracks,
    with_detections,
)

CARD = make_card()
STP = 4  # false forecasts of the reference
steady = settings(derandomize=True, deadline=None, max_examples=20)
at_every_cut = settings(steady, max_examples=8)  # each scores a scene some twenty times
seeds = st.integers(0, 10_000)


def at_budgets(*scores: SceneScore, stp: int = STP) -> Array:
    """The error over all targets of a run at each of the budgets of "all", and at that of the subsets."""
    targets = sum(map(len, scores))
    budgets = CardBudget(CARD.id, stp, max(targets, 1)).budgets(targets)
    found = errors_at([score.cuts for score in scores], [*budgets.all, budgets.subsets])
    return np.asarray(found.error.mean(axis=1))


def levels(cuts: Cuts) -> list[Any]:
    """What is left of the cuts where forecasts of equal confidence have no order."""
    cost = np.array([5.0, 2.0])
    return [(c, *(part.tolist() for part in cuts.at(c)), cuts.false_costs(c, cost)) for c in np.unique(cuts.confidence)]


def assert_equal(got: SceneScore, want: SceneScore) -> None:
    for field in fields(SceneScore):
        a: Any = getattr(got, field.name)
        b: Any = getattr(want, field.name)
        if field.name in ("outcome", "final_error"):  # by forecast, in the order of the cuts
            a, b = (np.sort(np.stack([s.cuts.confidence, value]), axis=1) for s, value in ((got, a), (want, b)))
        if isinstance(b, dict):
            assert a == b, field.name
        elif field.name in ("cuts", "score_cuts"):
            for one, other in zip(levels(a), levels(b), strict=True):
                for x, y in zip(one, other, strict=True):
                    np.testing.assert_allclose(x, y, atol=1e-9)
        elif field.name == "counts":
            of_a, of_b = ({**vars(each), **vars(each.identity)} for each in (a, b))
            for name in of_b.keys() - {"identity"}:
                np.testing.assert_allclose(of_a[name], of_b[name], rtol=1e-9, err_msg=name)
        elif isinstance(b, np.ndarray | float):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9, err_msg=field.name)
        else:
            assert np.array_equal(a, b), field.name


def sure(rollout: Rollout, confidence: Any) -> Rollout:
    whole = np.broadcast_to(confidence, len(rollout.object_box))
    return replace(rollout, object_confidence=whole.astype(np.float32))


def joined(*rollouts: Rollout) -> Rollout:
    """What all of them forecast, frame by frame; everything else is that of the first."""
    frame = np.concatenate([rollout.objects.frame_of_rows for rollout in rollouts])
    order = np.argsort(frame, kind="stable")
    names = ("object_box", "object_class", "object_confidence", "forecast", "forecast_log_weight")
    arrays: Any = {name: np.concatenate([getattr(rollout, name) for rollout in rollouts])[order] for name in names}
    start = np.searchsorted(frame[order], np.arange(rollouts[0].frames + 1))
    return replace(rollouts[0], object_start=start, **arrays)


# ---- what must not matter
@steady
@given(seeds)
def test_order_of_rows_and_samples_and_names_of_tracks_do_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene, rollout = random_case(seed)
    frame, track_frame = rollout.objects.frame_of_rows, rollout.tracks.frame_of_rows
    other = take_objects(rollout, np.lexsort((rng.random(len(frame)), frame)))
    other = take_tracks(other, np.lexsort((rng.random(len(track_frame)), track_frame)))
    order, name = rng.permutation(4), rng.permutation(1000)
    weight = other.forecast_log_weight[:, order]
    other = replace(other, forecast=other.forecast[:, order], forecast_log_weight=weight, track_id=name[other.track_id])
    assert_equal(score_scene(scene, other, CARD), score_scene(scene, rollout, CARD))


@steady
@given(seeds, st.floats(-3, 3))
def test_any_heading_up_to_the_rounding_of_forecasts(seed: int, yaw: float) -> None:
    scene, rollout = random_case(seed)
    got, want = score_scene(*moved(scene, rollout, yaw, (40.0, -7.0, 2.0)), CARD), score_scene(scene, rollout, CARD)
    np.testing.assert_allclose(got.distance, want.distance)
    np.testing.assert_allclose(got.approach, want.approach)
    assert np.array_equal(got.own_ids, want.own_ids)
    assert got.false_forecasts == want.false_forecasts


# ---- cuts
def test_the_score_of_the_nearest_detection() -> None:
    scene = make_scene([[Thing(1, 0, 0)]] * 5)
    scene = with_detections(scene, [[Thing(0, 0, 0), Thing(0, 50, 0), Thing(0, 0, 0, class_id=1)]] * 5)
    scene = replace(scene, detections=replace(scene.detections, score=np.tile([1.0, 3.0, 9.0], 5)))
    said = [Thing(0, 1, 0, confidence=0.9), Thing(1, 49, 0, confidence=0.1), Thing(2, 90, 0, class_id=1)]
    score = score_scene(scene, make_rollout([[]] * 5, [[], said]), CARD)
    assert score.score_cuts.confidence.tolist() == pytest.approx([0.9, 0.75, 0.5])  # s / (1 + |s|)
    assert score.score_cuts.false.tolist() == [True, True, False]
    blind = score_scene(make_scene([[Thing(1, 0, 0)]] * 5), make_rollout([[]] * 5, [[], said]), CARD)
    assert blind.score_cuts.confidence.tolist() == [-1.0] * 3


# ---- what must never help
@steady
@given(seeds)
def test_silence_costs_the_miss_error_at_every_budget(seed: int) -> None:
    scene, rollout = random_case(seed)
    got = score_scene(scene, take_objects(rollout, np.zeros(0, dtype=int)), CARD)
    honest = score_scene(scene, rollout, CARD)
    assert not got.covered.any()
    assert np.isinf(got.min_ade).all()
    assert got.miss.all()
    assert np.array_equal(got.capped, got.miss_error)
    for budget in errors_at([got.cuts], [0, 0.5, 3, 1e9]).error:
        assert np.array_equal(budget, got.miss_error)
    assert (at_budgets(honest) <= at_budgets(got)).all()


@at_every_cut
@given(seeds)
def test_the_error_falls_and_false_forecasts_rise_with_what_is_allowed(seed: int) -> None:
    """The error does so where objects are far apart: in a crowd a nearer forecast may take a target and be worse."""
    for apart in (0.0, 40.0):
        scene, rollout = random_case(seed, apart=apart)
        score = score_scene(scene, rollout, CARD)
        confidence = np.unique(score.cuts.confidence)
        kept = [take_objects(rollout, np.flatnonzero(rollout.object_confidence >= c)) for c in confidence]
        false = [score_scene(scene, some, CARD).false_forecasts for some in kept]
        assert false == sorted(false, reverse=True)  # of what a cut keeps, matched anew
        assert false == [score.cuts.false_costs(c, np.ones(2)) for c in confidence]
        covered = [score.cuts.at(c)[1].sum() for c in confidence]
        assert covered == sorted(covered)  # with a higher least confidence more is missed
        found = errors_at([score.cuts], np.linspace(0, 9, 19))
        assert (np.diff(found.missed.sum(axis=1)) <= 1e-9).all()
    assert (np.diff(found.error, axis=0) <= 1e-9).all()


@steady
@given(seeds, st.sampled_from(["the same samples", "the truth", "other confidence"]))
def test_a_late_copy_of_everything_never_helps(seed: int, copied: str) -> None:
    """Objects are far apart: in a crowd a copy may be right about a neighbour."""
    scene, rollout = random_case(seed, apart=40.0)
    rng, count = np.random.default_rng(seed), len(rollout.object_box)
    rollout = sure(rollout, np.maximum(rollout.object_confidence, 1 / 8))
    late = sure(rollout, 0.1 if copied != "other confidence" else rng.random(count) / 8)
    if copied == "the truth":
        late = replace(late, forecast=np.zeros_like(late.forecast))
    want, got = (at_budgets(score_scene(scene, said, CARD)) for said in (rollout, joined(rollout, late)))
    assert (got >= want - 1e-9).all()


def beyond_every_gate(rollout: Rollout, seed: int) -> Rollout:
    """One more forecast, 500 m away from all that is there, of a random frame, class and confidence."""
    rng = np.random.default_rng(seed)
    one = take_objects(rollout, rng.integers(len(rollout.object_box), size=1))
    confidence = np.float32(rng.choice([rng.integers(0, 9) / 8, rng.random()]))  # often equal to another
    kind = rng.integers(0, 2, 1)
    return joined(rollout, replace(sure(one, confidence), object_box=one.object_box + 500.0, object_class=kind))


@at_every_cut
@given(seeds)
def test_a_forecast_outside_every_gate_helps_only_where_more_forecasts_raise_the_error(seed: int) -> None:
    """It changes no error at any threshold, so bADE can fall only by stopping before a threshold that raises it."""
    scene, rollout = random_case(seed)
    want, got = (score_scene(scene, said, CARD) for said in (rollout, beyond_every_gate(rollout, seed)))
    kept = np.unique(np.concatenate([want.cuts.confidence, got.cuts.confidence]))[::-1]
    errors = np.stack([want.cuts.at(least)[0] for least in kept])
    assert np.array_equal(errors, [got.cuts.at(least)[0] for least in kept])
    more = [got.cuts.false_costs(least, np.ones(2)) - want.cuts.false_costs(least, np.ones(2)) for least in kept]
    in_live_frame = len(got.cuts.confidence) > len(want.cuts.confidence)
    assert more == sorted(more)  # never fewer
    assert ({*more} <= {0.0, 1.0}, more[-1]) == (True, in_live_frame)
    rises = (np.diff(np.vstack([want.miss_error, errors]).mean(axis=1)) > 1e-9).any()
    assert rises or (at_budgets(got) >= at_budgets(want) - 1e-9).all()


def test_a_false_forecast_lowers_bade_where_it_keeps_out_a_worse_matching() -> None:
    """Object 1 at 0 m, object 2 at 3 m. With the unsure forecast more objects are matched, and the error is larger."""
    scene = make_scene([[Thing(1, 0, 0), Thing(2, 3, 0)]] * 5)
    right = Thing(1, 1.4, 0, forecast=[[[0.0, 0.0]] * 3], confidence=0.875)  # for object 1; within both gates
    unsure = Thing(2, -1, 0, forecast=[[[50.0, 0.0]] * 3], confidence=0.5)  # takes object 1, the other gets object 2
    false = Thing(3, 90, 0, forecast=[[[90.0, 0.0]] * 3], confidence=0.75)
    want, got = (
        score_scene(scene, make_rollout([], [[], said, [], [], []]), CARD)
        for said in ([right, unsure], [right, unsure, false])
    )
    assert [want.cuts.at(least)[0].mean() for least in (0.875, 0.5)] == [5.0, 6.5]
    quarter = CardBudget(CARD.id, 1, 4)
    bade = [agent_table(AgentScores("a", 1, 1, "equal", ((score,),)), None, quarter).of_all for score in (want, got)]
    assert [each.error.mean() for each in bade] == [6.5, 5.0]


@steady
@given(seeds, st.integers(0, 60), st.integers(1, 60))
def test_budgets_do_not_change_with_the_input(seed: int, false: int, targets: int) -> None:
    """Whatever is detected and forecast: they follow from the card's constants and the number of targets."""
    constants = CardBudget(CARD.id, false, targets)
    scene, rollout = random_case(seed)
    cluttered = with_detections(scene, [[Thing(0, 40.0 * t, -30.0)] * 3 for t in range(scene.frames)])
    tables = []
    for seen, said in ((scene, rollout), (cluttered, beyond_every_gate(rollout, seed))):
        setting = AgentScores("agent", 1, 4, "equal", ((score_scene(seen, said, CARD),),))
        tables.append(agent_table(setting, None, constants))
    n, limit = len(tables[0].miss_error), false * len(tables[0].miss_error) / targets
    for table in tables:
        assert table.budgets.subsets == limit
        assert table.budgets.all.tolist() == pytest.approx([j / 10 * min(n, limit) for j in range(1, 11)])


@steady
@given(seeds)
def test_fewer_samples_never_help(seed: int) -> None:
    scene, rollout = random_case(seed)
    fewer = rollout.forecast_log_weight.copy()
    fewer[:, 2:] = -np.inf
    want, got = (score_scene(scene, said, CARD) for said in (rollout, replace(rollout, forecast_log_weight=fewer)))
    assert (got.min_ade >= want.min_ade).all()
    assert (at_budgets(got) >= at_budgets(want)).all()
    assert got.fixed_error >= want.fixed_error
    assert (got.covered <= want.covered).all()


# ---- by hand
def scored(truth: list[Any], tracks: list[Any], log_weight: Any = None, hypotheses: int = 1) -> SceneScore:
    rollout = make_rollout(tracks, log_weight=log_weight, hypotheses=hypotheses, future=1)
    return score_scene(make_scene(truth), rollout, make_card(future=1))


@pytest.mark.parametrize("right", [True, False])
def test_where_false_tracks_have_no_class_no_class_has_a_number_of_them(right: bool) -> None:
    truth = [[Thing(1, 0, 0, class_id=1)]] * 4
    tracks = [[Thing(3, 0.1 if right else 1.1, 0, class_id=-1), Thing(4, 30, 0, class_id=-1)]] * 4
    score, card = scored(truth, tracks), make_card(future=1)
    tracking = summarise([AgentScores("agent", 1, score.samples, "equal", ((score,),))], card).details[0].tracking
    fp, mota = tracking.all.FP, tracking.all.MOTA
    assert (fp, mota) == ((4, 0.0) if right else (8, -2.0))
    assert [(c.FP, c.MOTA, c.IDF1, c.HOTA) for c in tracking.classes.values()] == [(None,) * 4] * 2
    assert sum(c.TP or 0 for c in tracking.classes.values()) == (4 if right else 0)


def test_a_neutral_box_is_left_to_the_track_that_fits_nothing_else() -> None:
    # track 3 lies nearest to the neutral box but belongs to the evaluated one, track 4 is left over for the neutral one
    truth = [[Thing(1, 0, 0), Thing(2, 1.5, 0, neutral=True)]] * 4
    score = scored(truth, [[Thing(3, 1.0, 0), Thing(4, 3.0, 0)]] * 4)
    assert score.counts.fp.sum() == score.counts.false_positives == score.counts.false_tracks == 0
    assert score.counts.truth.sum() == score.counts.tp.sum() == 4


def test_events_in_every_hypothesis() -> None:
    truth = [[Thing(1, 0, 0)]] * 5
    switch = [[Thing(1, 0, 0, hypotheses=(0, 1))], [Thing(1, 0, 0, hypotheses=(0, 1))]]
    both = [*switch, [Thing(2, 0, 0, hypotheses=(0,)), Thing(3, 0, 0, hypotheses=(1,))], [], []]
    one = [*switch, [Thing(2, 0, 0, hypotheses=(0,)), Thing(1, 0, 0, hypotheses=(1,))], [], []]
    for tracks, everywhere in ((both, True), (one, False)):
        score = scored(truth, tracks, [[-1.0, -2.0]] * 5, 2)
        assert (score.own_ids.tolist(), score.all_h_ids.tolist()) == ([False, True, False], [False, everywhere, False])
        assert score.own_frag.tolist() == score.all_h_frag.tolist() == [False, False, True]


def wrong(**changes: Any) -> tuple[Scene, Rollout]:
    scene, rollout = random_case(1)
    return scene, replace(rollout, **changes)


WRONG: dict[str, tuple[Any, str]] = {
    "another scene": (wrong(scene="other"), "the name of the scene is 'other', expected 's'"),
    "fewer frames": ((make_scene([[]] * 3), make_rollout([[]] * 2, samples=4)), "frames is 2, expected 3"),
    "other horizon": ((make_scene([[]]), make_rollout([[]], future=5)), "future frames is 5, expected 3"),
    "unknown class": (
        (make_scene([[]]), make_rollout([[]], [[Thing(1, 0, 0, class_id=2)]])), "object_class contains 2"),
    # of tracks it means "not stated"
    "no class": ((make_scene([[]]), make_rollout([[]], [[Thing(1, 0, 0, class_id=-1)]])), "object_class contains -1"),
    "no place": ((make_scene([[]]), make_rollout([[]], [[Thing(1, np.nan, 0)]])), "object_box contains nan"),
    "no probability": (
        (make_scene([[]]), make_rollout([[]], [[Thing(1, 0, 0, confidence=np.nan)]])),
        r"rollout of scene 's': object_confidence contains nan \(frame 0\); expected values in \[0, 1\]"),
    "no parent": (wrong(hypothesis_parent=np.full((12, 3), 3)), r"parent contains 3 \(frame 0\); expected -1 to 2"),
    "fewer than no malformed rows": (
        wrong(malformed=np.repeat([[0], [-5]], [4, 8], axis=0) * np.ones((1, 3), int)),
        r"malformed contains -5 \(frame 4\); expected 0 or more"),
    "no time": (wrong(seconds=np.full(12, np.nan)), "seconds contains nan"),
}  # fmt: skip


@pytest.mark.parametrize(("case", "message"), WRONG.values(), ids=WRONG.keys())
def test_a_rollout_of_something_else_is_an_error(case: tuple[Scene, Rollout], message: str) -> None:
    with pytest.raises(RolloutError, match=message):
        score_scene(*case, CARD)

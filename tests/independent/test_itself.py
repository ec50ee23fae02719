"""The independent scorer against numbers computed by hand, and against enumeration."""

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.independent import shown
from tests.independent.budgets import budgets_of, cuts, error_at
from tests.independent.events import own_events
from tests.independent.forecasts import Run
from tests.independent.matching import best_pairs
from tests.independent.parts import ABSENT, COVERED, Known, covered_errors, parts_at
from tests.independent.scorer import score
from tests.independent.statistics import effective, guarded, inverted, sign_flip, studentised
from tests.independent.targets import find_targets, live_frames
from tests.support.scoring_scenes import Thing, at, make_card, make_rollout, make_scene, with_detections

CARD = make_card()  # P 2, T 3; car: gate 2 m, c 10 m


def said(id: int, x: float, off: float, confidence: float, **more: Any) -> Thing:
    """A forecast at (x, 0) whose only sample stays ``off`` metres beside it."""
    return at(id, (x, 0), forecast=np.tile([x, off], (1, 3, 1)), confidence=confidence, **more)


def two_cars(*forecasts: Thing) -> Run:
    """Cars at rest at x = 0 and 10 for 5 frames: the only live frame is 1, where ``forecasts`` are made."""
    scene = make_scene([[at(1, (0, 0)), at(2, (10, 0))]] * 5)
    rollout = make_rollout([], [[], forecasts, [], [], []])
    return Run(CARD, [scene], find_targets([scene], CARD), [rollout])


def three_forecasts() -> Run:
    return two_cars(said(1, 0, 1, 0.75), said(9, 50, 0, 0.625), said(2, 10, 3, 0.5))


def test_targets_and_live_frames() -> None:
    run = three_forecasts()
    assert ([(g.object, g.t) for g in run.targets], live_frames(run.scenes[0], CARD)) == ([(1, 1), (2, 1)], [1])
    listed = replace(run.scenes[0], listed_targets=True)
    assert [(g.object, g.t) for g in find_targets([listed], CARD)] == [(1, 0), (2, 0), (1, 1), (2, 1)]
    frames = [[at(1, (0, 0))] for t in range(9)]
    hole = replace(make_scene(frames), time=np.arange(9) / 10 + (np.arange(9) > 4))  # from frame 4 to 5
    assert live_frames(hole, CARD) == [g.t for g in find_targets([hole], CARD)] == [1]
    assert live_frames(replace(hole, listed_targets=True), CARD) == [0, 1, 5]
    frames = [[at(1, (0, 0)), at(2, (10, 0), neutral=t == 3)] for t in range(5)]
    assert [(g.object, g.t) for g in find_targets([make_scene(frames)], CARD)] == [(1, 1)]


def test_three_forecasts_at_every_cut_and_budget() -> None:
    run = three_forecasts()
    assert [(cut.false, cut.error.tolist()) for cut in cuts(run)] == [
        (0, [10, 10]), (0, [1, 10]), (1, [1, 10]), (1, [1, 3]),
    ]  # fmt: skip
    # Below one false forecast the line from cut 1 to cut 2 is flat at 5.5; at one everything is kept: 2.
    means = [error_at(list(cuts(run)), [b]).mean() for b in budgets_of(run, (1, 2), "all")]
    assert means == pytest.approx([5.5] * 9 + [2.0])
    # Of two false ones and a right one at once a budget of half of one takes a quarter.
    tied = two_cars(said(1, 0, 1, 0.5), said(8, 50, 0, 0.5), said(9, 60, 0, 0.5))
    assert error_at(list(cuts(tied)), [0.5]).mean() == pytest.approx(0.75 * 10 + 0.25 * 5.5)
    row = score(CARD, run.scenes, [run.rollouts], (1, 2), {"ids": np.array([0.25, 0.75])}).rows
    assert row["all"]["error"] == pytest.approx(5.15)
    assert row["all"]["missed"] == pytest.approx(4.5)  # 5 of the 5.5
    assert row["all"]["localisation"] == pytest.approx(0.65)
    assert row["ids"]["error"] == pytest.approx((1 + 3 * 3) / 4)
    assert row["ids"]["effective_targets"] == pytest.approx(1.6)


def test_parts_of_the_error() -> None:
    truth = [at(i, (100 * i, 0)) for i in range(1, 8)]
    seen = [at(0, (302, 0)), at(0, (401, 0), class_id=1), at(0, (403, 0)), at(0, (504, 0)), at(0, (604.1, 0))]
    scene = with_detections(make_scene([truth] * 5), [[at(0, (700, 0))], seen, [at(0, (600, 0))], [], []])
    forecasts = said(1, 101, 3, 0.75), said(9, 0, 0, 0.6), said(2, 200, 4, 0.5)
    run = Run(CARD, [scene], find_targets([scene], CARD), [make_rollout([], [[], forecasts, [], [], []])])
    own, moved = covered_errors([run])
    assert (own[:2].tolist(), moved[:2].tolist()) == ([math.sqrt(10), 4], [3, 4])
    assert np.isnan([own[2:], moved[2:]]).all()
    known = Known(np.array([3.0, *own[1:]]), np.array([2.5, *moved[1:]]), np.array([1.0] + 6 * [np.nan]))
    parts = parts_at(run, list(cuts(run)), [0.5, 1.0], known)  # the first budget ends before the forecast of object 2
    assert np.array([parts[name] for name in ABSENT[1:]]).tolist() == (10 * np.eye(7)[2:]).tolist()
    assert (parts["below_threshold"].tolist(), parts["rest"].tolist()) == ([0, 5, 0, 0, 0, 0, 0], [0, 2, 0, 0, 0, 0, 0])
    assert [parts[name][0] for name in COVERED[:4]] == pytest.approx([1, 0.5, 1.5, math.sqrt(10) - 3])


def test_incomplete_truth_counts_forecasts() -> None:
    junk = [said(100 + i, 100 + 10 * i, 0, 0.75) for i in range(41)]
    run = two_cars(said(1, 0, 1, 1.0), *junk, said(2, 10, 3, 0.5))
    scene = replace(run.scenes[0], truth_complete=False)
    run = Run(CARD, [scene], run.targets, run.rollouts)
    assert shown.fixed_error(run) == pytest.approx((1 + 3 + 3 * 5) / 2)
    assert budgets_of(run, (84, 2), "all") == [20, 40, 42]
    # Counts 0, 1, 42, 43 with errors 10, 5.5, 5.5, 2: 20 and 40 lie on the flat line, 42 is the third cut.
    assert score(CARD, [scene], [run.rollouts], (84, 2)).rows["all"]["error"] == pytest.approx(5.5)
    assert score(CARD, [scene], [run.rollouts], (43, 1)).rows["all"]["error"] == pytest.approx((5.5 + 5.5 + 2) / 3)


def test_a_late_duplicate_never_takes_a_match() -> None:
    run = two_cars(said(1, 1, 1, 0.75), said(5, 0.5, 0, 0.25), said(2, 10, 0, 0.5))
    # The duplicate is nearer and less sure: it is false. sqrt(2) m away, then exact.
    found = [(cut.false, cut.error.tolist()) for cut in cuts(run)]
    assert found == [(0, [10, 10]), (0, [math.sqrt(2), 10]), (0, [math.sqrt(2), 0]), (1, [math.sqrt(2), 0])]


def test_the_surest_are_matched_then_the_nearest_then_the_larger_error() -> None:
    for order in itertools.permutations([said(1, 1, 1, 0.5), said(2, 1, 4, 0.5), said(3, 0, 2, 0.25)]):
        assert shown.plain_errors(two_cars(*order)).tolist() == [math.hypot(1, 4), 10]
    assert shown.plain_errors(two_cars(said(1, 1, 1, 0.5), said(3, 0, 2, 0.5))).tolist() == [2, 10]


def test_events_of_one_object() -> None:
    # frame   0 1 2 3 4 5 6 7 8 9, object there but at 5 (absent); tracks by id, . for none
    ids = [7, 7, 8, 0, 8, 8, 0, 9, 0, 7]
    truth = [[] if t == 5 else [at(1, (0, 0))] for t in range(10)]
    tracks = [[at(i, (0, 0))] if i else [] for i in ids]
    found = own_events([make_scene(truth)], [make_rollout(tracks)], CARD)
    assert (found["ids"], found["lost"]) == ([(0, 1, 2, 7, 8)], [(0, 1, 3, 8, None), (0, 1, 8, 9, None)])
    assert found["reacquired"] == [(0, 1, 4, 8, 8), (0, 1, 9, 9, 7)]  # not at 7: before 6 the truth has a gap
    hole = replace(make_scene(truth), time=np.arange(10.0) / 10 + (np.arange(10) > 1) + (np.arange(10) > 3))
    assert own_events([hole], [make_rollout(tracks)], CARD) == {
        "ids": [], "lost": [(0, 1, 3, 8, None), (0, 1, 8, 9, None)], "reacquired": [(0, 1, 9, 9, 7)],
    }  # fmt: skip


def test_sign_flip_and_effective_number() -> None:
    assert sign_flip(np.full(6, -1.0), np.ones(6)) == pytest.approx(2 / 64)
    assert sign_flip(np.array([3.0, -1.0, 0.0]), np.ones(3)) == pytest.approx(1.0)  # +-4, +-2: all are at least 2
    assert sign_flip(np.full(20, 1.0), np.ones(20)) < 0.001
    assert effective([1, 1, 2]) == pytest.approx(16 / 6)


@pytest.mark.parametrize("units", [6, 8, 15])
def test_the_interval_holds_what_the_test_does_not_reject(units: int) -> None:
    rng = np.random.default_rng(units)
    w = rng.integers(1, 9, units).astype(float)
    d = np.round(w * rng.normal(0.5, 1, units), 2)
    found = inverted(d, w)
    assert found is not None
    for end, out in zip(found, (-1e-6, 1e-6), strict=True):
        assert sign_flip(d, w, null=end + out) < 0.05 <= sign_flip(d, w, null=end - out)
    assert inverted(np.arange(5.0), np.ones(5)) is None
    # 4 of 64 flips must not reject: that of none, of all, of the 1 alone and of all but it, whose means are 1 and 4
    assert inverted(np.arange(1.0, 7), np.ones(6)) == pytest.approx((1, 6))


def test_who_is_worse_than_stp() -> None:
    assert [guarded(worse, p) for worse, p in ((0.009, 0.01), (0.02, 0.06), (0.02, 0.04), (0.06, 0.9), (-0.1, 0))] == [
        False, False, True, True, False,
    ]  # fmt: skip


def test_an_interval_of_three_units() -> None:
    # the mean is 2, its standard error sqrt(2 / (3 * 2)); of 1 1 2 the mean is 4/3, and the error 1/3
    above, below, error = np.array([1.0, 2, 3]), np.ones(3), math.sqrt(1 / 3)
    t = ((4 / 3) - 2) / (1 / 3)
    drawn = np.array([[0, 0, 1]] * 50 + [[2, 2, 1]] * 50 + [[1, 1, 1]] * 50)  # t, -t, and one that says nothing
    assert studentised(above, below, lambda _: drawn) == pytest.approx((2 + t * error, 2 - t * error))
    assert studentised(np.append(above, 9), np.append(below, 0), lambda _: drawn) == pytest.approx(
        (2 + t * error, 2 - t * error)
    )
    assert studentised(above[:2], below[:2]) is None


def test_matching_is_the_best_of_all() -> None:
    rng = np.random.default_rng(0)
    for _ in range(100):
        some = [(a, b) for a in range(4) for b in range(4) if rng.random() < 0.5]
        pairs = {key: tuple(rng.integers(0, 3, 3) / 4) for key in some}
        every = [
            chosen
            for size in range(5)
            for chosen in itertools.combinations(some, size)
            if len({a for a, _ in chosen}) == len({b for _, b in chosen}) == size
        ]

        def value(chosen: Any, pairs: Any = pairs) -> tuple[float, ...]:
            surest = sorted((pairs[key][1] for key in chosen), reverse=True)
            return (len(chosen), *surest, -sum(pairs[key][0] for key in chosen), sum(pairs[key][2] for key in chosen))

        assert value(tuple(best_pairs(pairs).items())) == max(value(chosen) for chosen in every)

"""The independent scorer against numbers computed by hand, and against enumeration."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mtp_bench.types import ImageField
from tests.independent import shown
from tests.independent.budgets import at_budgets, budgets_of, cuts
from tests.independent.displacement import k_curve, numbers, stated
from tests.independent.events import own_events
from tests.independent.forecasts import Run
from tests.independent.matching import best_pairs
from tests.independent.scorer import score
from tests.independent.statistics import effective, of_shares, sign_flip, studentised
from tests.independent.targets import find_targets, live_frames, unconfirmed
from tests.support.scoring_scenes import Thing, at, make_card, make_rollout, make_scene

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
    assert [(g.object, g.t) for g in run.targets] == [(1, 1), (2, 1)]
    assert live_frames(run.scenes[0], CARD) == range(1, 2)
    listed = replace(run.scenes[0], listed_targets=True)
    assert [(g.object, g.t) for g in find_targets([listed], CARD)] == [(1, 0), (2, 0), (1, 1), (2, 1)]
    frames = [[at(1, (0, 0)), at(2, (10, 0), neutral=t == 3)] for t in range(5)]
    assert [(g.object, g.t) for g in find_targets([make_scene(frames)], CARD)] == [(1, 1)]


def test_three_forecasts_at_every_cut_and_budget() -> None:
    run = three_forecasts()
    assert [(cut.false, cut.error.tolist()) for cut in cuts(run)] == [
        (0, [10, 10]), (0, [1, 10]), (1, [1, 10]), (1, [1, 3]),
    ]  # fmt: skip
    # Below one false forecast the line from cut 1 to cut 2 is flat at 5.5; at one everything is kept: 2.
    means = [error.mean() for error, _ in at_budgets(cuts(run), budgets_of(run, 1, "all"))]
    assert means == pytest.approx([5.5] * 9 + [2.0])
    row = score(CARD, run.scenes, [run.rollouts], 1, {"ids": np.array([0.25, 0.75])}).rows
    assert row["all"]["error"] == pytest.approx(5.15)
    assert row["all"]["missed"] == pytest.approx(4.5)  # 5 of the 5.5
    assert row["all"]["localisation"] == pytest.approx(0.65)
    assert row["ids"]["error"] == pytest.approx((1 + 3 * 3) / 4)
    assert row["ids"]["effective_targets"] == pytest.approx(1.6)


def test_interpolation_between_cuts() -> None:
    run = two_cars(said(1, 0, 1, 0.5), said(8, 50, 0, 0.5), said(9, 60, 0, 0.5))  # one cut: 0 -> 2 false, 10 -> 5.5
    assert at_budgets(cuts(run), [0.5])[0][0].mean() == pytest.approx(0.75 * 10 + 0.25 * 5.5)


def test_numbers_shown_of_three_forecasts() -> None:
    run = three_forecasts()
    assert shown.plain_errors(run).tolist() == [1, 3]
    assert shown.fixed_error(run) == pytest.approx((1 + 3 + 5) / 2)
    assert shown.brier(run) == pytest.approx((0.25**2 + 0.625**2 + 0.5**2) / 3)
    assert shown.false_per_frame(run) == 1
    assert shown.epa(run) == pytest.approx((1 - 0.5) / 2)
    # precision 1 at the recalls .11 to .49, .5 at .5, then a line up to 2/3 at 1; .1 of each is cut off
    heights = 39 * 0.9 + 0.4 + sum(0.4 + i / 50 / 6 for i in range(1, 51))
    assert shown.ap_f(run) == pytest.approx(heights / 90 / 0.9)
    near, far = 1.0, math.exp(-100 / 18)
    aware = shown.planning_aware(run, shown.plain_errors(run), np.ones(2, dtype=bool))
    assert aware == pytest.approx((near * 1 + far * 3) / (near + far))


def test_malformed_rows_cost_half_of_c() -> None:
    run = three_forecasts()
    malformed = np.zeros((5, 3), dtype=int)
    malformed[1], malformed[3] = [0, 2, 1], [7, 7, 7]  # two pedestrians (2 m each) and one unreadable (5 m); not live
    spoiled = Run(CARD, run.scenes, run.targets, [replace(run.rollouts[0], malformed=malformed)])
    assert shown.fixed_error(spoiled) == pytest.approx((9 + 4 + 5) / 2)


def test_incomplete_truth_counts_forecasts() -> None:
    junk = [said(100 + i, 100 + 10 * i, 0, 0.75) for i in range(41)]
    run = two_cars(said(1, 0, 1, 1.0), *junk, said(2, 10, 3, 0.5))
    scene = replace(run.scenes[0], truth_complete=False)
    run = Run(CARD, [scene], run.targets, run.rollouts)
    assert shown.fixed_error(run) == pytest.approx((1 + 3 + 3 * 5) / 2)
    assert budgets_of(run, 42, "all") == [20, 40, 42]
    # Counts 0, 1, 42, 43 with errors 10, 5.5, 5.5, 2: 20 and 40 lie on the flat line, 42 is the third cut.
    assert score(CARD, [scene], [run.rollouts], 42).rows["all"]["error"] == pytest.approx(5.5)
    assert score(CARD, [scene], [run.rollouts], 43).rows["all"]["error"] == pytest.approx((5.5 + 5.5 + 2) / 3)


def test_a_late_duplicate_does_not_take_the_match_of_an_early_cut() -> None:
    run = two_cars(said(1, 1, 1, 0.75), said(5, 0.5, 0, 0.25), said(2, 10, 0, 0.5))
    # The duplicate is nearer: kept, it is matched and the first one is false. .5 m beside, 1 m beside and 1 m off.
    found = [(cut.false, cut.error.tolist()) for cut in cuts(run)]
    assert found == [(0, [10, 10]), (0, [math.sqrt(2), 10]), (0, [math.sqrt(2), 0]), (1, [0.5, 0])]


def test_ties_go_to_confidence_then_to_the_larger_error() -> None:
    for order in itertools.permutations([said(1, 0, 1, 0.5), said(2, 0, 4, 0.5), said(3, 0, 2, 0.25)]):
        assert shown.plain_errors(two_cars(*order)).tolist() == [4, 10]


def test_a_neutral_object_excuses_one_forecast() -> None:
    frames = [[at(1, (0, 0)), at(2, (10, 0)), at(3, (1, 0), neutral=True)]] * 5
    scene = make_scene(frames)
    for count, false in ((1, 0), (2, 0), (3, 1)):
        rollout = make_rollout([], [[], [said(i, 0.25 * i, 0, 1.0) for i in range(count)], [], [], []])
        assert shown.false_per_frame(Run(CARD, [scene], find_targets([scene], CARD), [rollout])) == false


def camera(region: list[float]) -> ImageField:
    """A camera in the origin, 2 m high, looking along x: 100 px focal length, 200 x 100 px; cars are cubes of 2 m."""
    projection = np.array([[100.0, -100, 0, 0], [50, 0, -100, 200], [1, 0, 0, 0]])
    box = np.full((2, 3), 2.0)
    return ImageField(
        projection[None], np.array([2.0]), np.zeros(1), (200, 100), np.array([region]), np.array([0, 1]), box
    )


def test_what_the_image_confirms() -> None:
    # At x = 5 the cube's front face is 4 m away: columns 75 to 125, rows 50 + 100 * -.35 / 4 = 41.25 (top) to 91.25.
    free = camera([0, 0, 1, 1])
    assert not unconfirmed(free, 0, np.array([5.0, 0]), 0)
    assert unconfirmed(free, 0, np.array([-5.0, 0]), 0)  # behind
    assert unconfirmed(free, 0, np.array([5.0, 9]), 0)  # beside: column 250 and more
    assert unconfirmed(free, 0, np.array([50.0, 0]), 0)  # 4 px high
    # The top edge is .35 m above the camera: rows 41.25 to 91.25 of the face, so half of the width is half of the area.
    assert not unconfirmed(camera([75, 0, 99.9, 100]), 0, np.array([5.0, 0]), 0)
    assert unconfirmed(camera([75, 0, 100.1, 100]), 0, np.array([5.0, 0]), 0)
    assert not unconfirmed(camera([0, 41.25, 200, 66.2]), 0, np.array([5.0, 0]), 0)
    assert unconfirmed(camera([0, 41.25, 200, 66.3]), 0, np.array([5.0, 0]), 0)


def test_numbers_of_one_target() -> None:
    path = np.array([[[3.0, 4], [3, 4], [0, 0]], [[0, 0], [0, 0], [0, 3]]])  # errors 5 5 0, and 0 0 3
    found = numbers(path, np.array([0.5, 0.5]), np.zeros((3, 2)))
    assert (found.min_ade, found.min_fde, found.miss) == (1, 0, False)
    assert found.curve == pytest.approx((13 / 6, 1))
    # Distances sqrt(50) and 3; the samples are sqrt(59) apart.
    assert found.energy == pytest.approx((math.sqrt(50) / 2 + 3 / 2 - math.sqrt(59) / 4) / math.sqrt(3))
    assert k_curve([1, 2, 6]) == pytest.approx((3, (1 + 1 + 2) / 3, 1))


def test_samples_below_the_floor_are_absent() -> None:
    weight = np.array([0.5, 0.0025, 0.4975 - 0.002, 0.002])
    forecast = np.arange(4)[:, None, None] * np.ones((1, 3, 2))
    thing = at(1, (0, 0), forecast=forecast, log_weight=np.log(weight))
    paths, kept = stated(make_rollout([], [[thing]], samples=4), 0)
    assert paths[:, 0, 0].tolist() == [0, 1, 2]  # .01 / 4 = .0025 is not below
    assert kept == pytest.approx(np.array([0.5, 0.0025, 0.4955]) / 0.998)


def test_events_of_one_object() -> None:
    # frame   0 1 2 3 4 5 6 7 8 9, object there but at 5 (absent); tracks by id, . for none
    ids = [7, 7, 8, 0, 8, 8, 0, 9, 0, 7]
    truth = [[] if t == 5 else [at(1, (0, 0))] for t in range(10)]
    tracks = [[at(i, (0, 0))] if i else [] for i in ids]
    found = own_events([make_scene(truth)], [make_rollout(tracks)], CARD)
    assert found["ids"] == [(0, 1, 2, 7, 8)]
    assert found["lost"] == [(0, 1, 3, 8, None), (0, 1, 8, 9, None)]
    assert found["reacquired"] == [(0, 1, 4, 8, 8), (0, 1, 9, 9, 7)]  # not at 7: before 6 the truth has a gap


def test_events_follow_the_stated_parent() -> None:
    scene = make_scene([[at(1, (0, 0))]] * 2)
    tracks = [[at(7, (0, 0), hypotheses=(0,)), at(8, (0, 0), hypotheses=(1,))]] * 2
    weight = np.log([[0.9, 0.1], [0.1, 0.9]])  # the best hypothesis is 0, then 1
    rollout = make_rollout(tracks, log_weight=weight, hypotheses=2)
    for parent, switches in ((1, 0), (0, 1)):
        stated_parent = np.array([[-1, -1], [-1, parent]])
        assert len(own_events([scene], [replace(rollout, hypothesis_parent=stated_parent)], CARD)["ids"]) == switches


def test_sign_flip_and_effective_number() -> None:
    assert sign_flip([-1.0] * 6) == pytest.approx(2 / 64)
    assert sign_flip([3.0, -1.0, 0.0]) == pytest.approx(1.0)  # 2 of +-4, +-2: all are at least 2
    assert sign_flip([1.0] * 20) < 0.001
    assert effective([1, 1, 2]) == pytest.approx(16 / 6)


def test_an_interval_of_three_units() -> None:
    # the mean is 2, its standard error sqrt(2 / (3 * 2)); of 1 1 2 the mean is 4/3, and the error 1/3
    above, below, error = np.array([1.0, 2, 3]), np.ones(3), math.sqrt(1 / 3)
    t = ((4 / 3) - 2) / (1 / 3)
    drawn = np.array([[0, 0, 1]] * 50 + [[2, 2, 1]] * 50 + [[1, 1, 1]] * 50)  # t, -t, and one that says nothing
    assert studentised(above, below, lambda _: drawn) == pytest.approx((2 + t * error, 2 - t * error))
    assert studentised(np.append(above, 9), np.append(below, 0), lambda _: drawn) == pytest.approx(
        (2 + t * error, 2 - t * error)
    )
    wide = drawn[:100]
    steep = studentised(np.array([1.0, 1 + 1e-6, 9]), below, lambda _: wide)
    assert steep is not None
    assert steep[1] - (11 + 1e-6) / 3 == pytest.approx(9.92484 * np.std([1, 1, 9], ddof=1) / math.sqrt(3), rel=1e-4)
    assert studentised(above[:2], below[:2]) is None


def test_an_interval_of_a_share() -> None:
    drawn = np.array([[0, 0], [0, 1], [1, 1]] * 40)
    assert of_shares(np.array([1.0, 2]), np.array([2.0, 3]), lambda _: drawn) == pytest.approx((1 / 2, 2 / 3))
    assert of_shares(np.array([1.0, 2]), np.array([-1.0, 3]), lambda _: drawn) is None


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
            cost, confidence, error = np.sum([pairs[key] for key in chosen], axis=0) if chosen else (0, 0, 0)
            return (len(chosen), -cost, confidence, error)

        assert value(tuple(best_pairs(pairs).items())) == max(value(chosen) for chosen in every)

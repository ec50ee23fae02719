"""More than one hypothesis: the tree of leaves that they share, and which of them survive."""

import itertools
from collections import defaultdict

import numpy as np
import pytest

from mtp_bench.core import Bools, Floats, Ints
from mtp_bench.core.tracks import Tracks
from mtp_bench.tracking import HypothesisTracker
from tests.support.tracking_scenes import CYCLIST, Frame, at_once, frame, random_frames, run

# Two cyclists meet at x = 3; the gate is 2 m. Did they cross, or turn back?
#
#   y   1.5   A
#       1.0        a
#       0.5             a              .
#       0.1                  a    .           detection 0 of each frame starts at the top (a), detection 1 is its
#      -0.1                  b                mirror image (b); at x = 3 each predicted place is as near to both
#      -0.5             b         .
#      -1.0        b                   .
#      -1.5   B
#
#   x         0    1    2    3    4    5
MEETING = [frame((x, y, CYCLIST), (x, -y, CYCLIST)) for x, y in enumerate([1.5, 1.0, 0.5, 0.1, -0.4, -0.9])]


def test_the_second_hypothesis_of_a_meeting_holds_the_swap() -> None:
    *_, meeting, after, _ = run(HypothesisTracker(20, at_once()), MEETING)
    assert meeting.member[:2].sum(axis=1).tolist() == [2, 2]
    first, second = (
        {int(i): int(d) for i, d in zip(meeting.track_id[m], meeting.detection[m], strict=True)}
        for m in meeting.member[:2]
    )
    assert (first, second) == ({0: 0, 1: 1}, {0: 1, 1: 0})
    assert meeting.log_weight[1] - meeting.log_weight[0] == pytest.approx(0, abs=0.01)
    # A frame later crossing is the likelier story, turning back is still there.
    stories = [dict(zip(after.track_id[m].tolist(), after.detection[m].tolist(), strict=True)) for m in after.member]
    assert stories[0] == {0: 0, 1: 1}
    assert {0: 1, 1: 0} in stories


@pytest.fixture(scope="module", params=[0, 1, 2, 4], ids=lambda seed: f"seed {seed}")
def crowd(request: pytest.FixtureRequest) -> list[Frame]:
    return random_frames(np.random.default_rng([7, request.param]), 30, objects=14, area=6.0)


@pytest.fixture(scope="module")
def history(crowd: list[Frame]) -> list[Tracks]:
    return list(run(HypothesisTracker(20, at_once()), crowd))


def test_hypotheses_are_distinct_sorted_and_no_more_than_asked_for(history: list[Tracks]) -> None:
    for tracks in history:
        assert 1 <= len(tracks.member) <= 20
        assert len(np.unique(tracks.member, axis=0)) == len(tracks.member)
        assert tracks.member.any(axis=0).all()
        assert (np.diff(tracks.log_weight) <= 0).all()
        assert np.exp(tracks.log_weight).sum() == pytest.approx(1.0)
    assert np.mean([len(tracks.member) for tracks in history[5:]]) > 15


def test_a_hypothesis_holds_every_id_and_every_detection_once(crowd: list[Frame], history: list[Tracks]) -> None:
    for (box, class_id), tracks in zip(crowd, history, strict=True):
        for held in tracks.member:
            ids, detection = tracks.track_id[held], tracks.detection[held]
            assert len(np.unique(ids)) == len(ids)
            # Every detection belongs to a track, to an old or to a new one.
            np.testing.assert_array_equal(np.sort(detection[detection >= 0]), np.arange(len(box)))
        took = tracks.detection >= 0
        np.testing.assert_array_equal(tracks.class_id[took], class_id[tracks.detection[took]])
        np.testing.assert_array_equal(tracks.past[took, -1], box[tracks.detection[took]])
        np.testing.assert_array_equal(tracks.past_valid[:, -1], took)


def test_leaves_are_distinct_and_shared(history: list[Tracks]) -> None:
    leaves = memberships = 0
    for tracks in history[5:]:
        # What differs only before the last P frames differs in the filtered box.
        state = np.column_stack([tracks.track_id, tracks.detection, tracks.past.reshape(-1, 70), tracks.box])
        assert len(np.unique(state, axis=0)) == len(state)
        leaves += tracks.member.shape[1]
        memberships += int(tracks.member.sum())
    assert memberships > 6 * leaves


def test_the_past_of_a_leaf_is_that_of_a_leaf_before(history: list[Tracks]) -> None:
    for before, now in itertools.pairwise(history):
        known: dict[int, list[Floats]] = defaultdict(list)
        for i, identity in enumerate(before.track_id.tolist()):
            known[identity].append(np.where(before.past_valid[i][:, None], before.past[i], 0.0))
        for i, identity in enumerate(now.track_id.tolist()):
            past = np.where(now.past_valid[i][:, None], now.past[i], 0.0)
            if identity in known:
                assert any(np.array_equal(past[:-1], parent[1:]) for parent in known[identity])
            else:
                assert now.past_valid[i].tolist() == [False] * 9 + [True]


@pytest.mark.parametrize("hypotheses", [1, 6])
def test_the_order_of_detections_does_not_matter(crowd: list[Frame], hypotheses: int) -> None:
    rng = np.random.default_rng(3)
    orders = [rng.permutation(len(box)) for box, _ in crowd]
    shuffled = [(box[order], class_id[order]) for (box, class_id), order in zip(crowd, orders, strict=True)]
    renamed: dict[int, int] = {}
    results = (run(HypothesisTracker(hypotheses, at_once()), frames) for frames in (crowd, shuffled))
    for order, tracks, other in zip(orders, *results, strict=True):
        np.testing.assert_allclose(other.log_weight, tracks.log_weight, atol=1e-9)
        place = np.append(order, -1)[other.detection]
        for held, other_held in zip(tracks.member, other.member, strict=True):
            mine = sorted_rows(tracks, tracks.detection, held)
            his = sorted_rows(other, place, other_held)
            np.testing.assert_array_equal(tracks.detection[mine], place[his])
            np.testing.assert_allclose(tracks.box[mine], other.box[his], atol=1e-9)
            for a, b in zip(tracks.track_id[mine].tolist(), other.track_id[his].tolist(), strict=True):
                assert renamed.setdefault(b, a) == a
    assert len(set(renamed.values())) == len(renamed) > 10


def sorted_rows(tracks: Tracks, detection: Ints, held: Bools) -> Ints:
    """Tracks of a hypothesis by detection, then by place."""
    rows = np.flatnonzero(held)
    return rows[np.lexsort((tracks.box[rows, 1].round(6), tracks.box[rows, 0].round(6), detection[rows]))]


def test_the_temperature_only_changes_the_weights(crowd: list[Frame]) -> None:
    hot, cold = (list(run(HypothesisTracker(8, temperature=t), crowd)) for t in (4.0, 0.5))
    for a, b in zip(hot, cold, strict=True):
        np.testing.assert_array_equal(a.member, b.member)
        gap_a, gap_b = a.log_weight - a.log_weight[0], b.log_weight - b.log_weight[0]
        np.testing.assert_allclose(8 * gap_a, gap_b, atol=1e-9)


def test_hypotheses_that_lost_all_their_tracks_are_merged() -> None:
    frames = [frame((0.0, 0.0, CYCLIST), (1.0, 0.0, CYCLIST))] * 3 + [frame()] * 4
    alive = [len(tracks.log_weight) for tracks in run(HypothesisTracker(20), frames)]
    assert alive[2] > 5
    assert alive[-1] == 1

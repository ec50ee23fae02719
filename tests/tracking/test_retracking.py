"""Re-tracking: switches and misses of hand-made scenes are mended, in one hypothesis and in several."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from mtp_bench import Forecasts, Frame, Pipeline
from mtp_bench.agent import Observation
from mtp_bench.errors import ShapeError
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, NoiseTable
from mtp_bench.tracking import HypothesisTracker, ReTracker
from mtp_bench.tracking.repair import bridged, smoothed
from mtp_bench.tracking.retracking import forecast_distances
from mtp_bench.tracks import Tracks
from mtp_bench.types import Floats, Task
from tests.support.tracking_scenes import PEDESTRIAN, SIZE, frame, kitti_task, observation, random_frames, run

DT = 0.5
TASK = kitti_task(dt=DT, past=6, future=8)

STEADY = NoiseTable(np.full(3, 0.3), np.full((3, 2), 0.1), np.full((3, 2), 2.0), np.full((3, 2), 0.1))

Row = tuple[int, float, float]  # identity that the tracker gives, x, y


class Script:
    """A tracker that says what it is told: the identities and places of each frame, by hypothesis."""

    def __init__(self, frames: Sequence[Sequence[Sequence[Row]]], parents: bool = True) -> None:
        self._frames, self._parents = frames, parents

    def reset(self, task: Task) -> None:
        self._task, self._seen = task, list[dict[int, Floats]]()

    def step(self, observation: Observation) -> Tracks:
        hypotheses = self._frames[len(self._seen)]
        rows = sorted({row for rows in hypotheses for row in rows})
        self._seen.append({i: np.array([x, y, 0, 0, *SIZE[PEDESTRIAN]]) for i, x, y in rows})
        past = np.zeros((len(rows), self._task.past, 7))
        valid = np.zeros(past.shape[:2], dtype=bool)
        for back, then in enumerate(reversed(self._seen[-self._task.past :])):
            for n, (i, _, _) in enumerate(rows):
                if i in then:
                    past[n, -1 - back], valid[n, -1 - back] = then[i], True
        places = sorted({row[1:] for row in rows})
        return Tracks(
            track_id=np.array([i for i, _, _ in rows], dtype=np.int64),
            box=past[:, -1].copy(),
            class_id=np.full(len(rows), PEDESTRIAN),
            score=np.ones(len(rows)),
            detection=np.array([places.index(row[1:]) for row in rows], dtype=np.int64),
            past=past,
            past_valid=valid,
            member=np.array([[row in mine for row in rows] for mine in hypotheses], dtype=bool),
            log_weight=np.full(len(hypotheses), -np.log(len(hypotheses))),
            parent=np.arange(len(hypotheses)) * (len(self._seen) > 1) if self._parents else None,
        )


def mended(frames: Sequence[Sequence[Sequence[Row]]], **settings: int | float | bool) -> list[Tracks]:
    """The tracks after re-tracking each frame of a script."""
    tracker = ReTracker(Script(frames), KinematicPredictor(STEADY), **settings)  # type: ignore[arg-type]
    return list(run(tracker, [frame(*[(0, 0, PEDESTRIAN)] * 9)] * len(frames), TASK))


def alone(rows: Iterable[Row | None]) -> list[list[list[Row]]]:
    """One hypothesis with one track, or none."""
    return [[[] if row is None else [row]] for row in rows]


WALK = [0.6 * t for t in range(12)]  # m along x: 1.2 m/s
ENDS: dict[str, Sequence[int | None]] = {  # identity that the tracker gives in each frame, None: not seen
    "another identity": [1] * 6 + [2] * 6,
    "a miss": [1] * 6 + [None] * 3 + [1] * 3,
    "a miss, then another identity": [1] * 6 + [None] * 3 + [2] * 3,
    "identities that come and go": [1, 1, 1, 2, 2, 1, None, 3, 3, None, 4, 4],
}


@pytest.mark.parametrize("hypotheses", [1, 3])
@pytest.mark.parametrize("case", ENDS)
def test_one_walk_is_one_track(case: str, hypotheses: int) -> None:
    rows = alone(None if i is None else (i, x, 0.0) for i, x in zip(ENDS[case], WALK, strict=True))
    tracks = mended([mine * hypotheses for mine in rows])
    assert {int(i) for after in tracks for i in after.track_id} == {0}
    last = tracks[-1]
    assert last.member.shape == (hypotheses, 1)
    np.testing.assert_allclose(last.past[0, :, 0], WALK[-6:], atol=0.02)  # gaps lie on the line
    assert last.past_valid.all()


def test_a_gap_is_output_for_as_long_as_asked() -> None:
    rows = alone((1, x, 0.0) if t < 6 or t > 8 else None for t, x in enumerate(WALK))
    for coasting, empty in [(0, [6, 7, 8]), (1, [7, 8]), (8, [])]:
        tracks = mended(rows, coasting=coasting)
        assert [t for t, after in enumerate(tracks) if not len(after.box)] == empty
    np.testing.assert_allclose([after.box[0, 0] for after in tracks], WALK, atol=0.1)
    assert [int(after.hits[0]) for after in tracks if after.hits is not None] == [1, 2, 3, 4, 5, 6, 6, 6, 6, 7, 8, 9]


def test_after_a_gap_a_track_is_output_from_several_hits_on() -> None:
    rows = alone((1, x, 0.0) if t != 6 else None for t, x in enumerate(WALK))
    tracks = mended(rows, coasting=0, min_hits=2)
    assert [t for t, after in enumerate(tracks) if not len(after.box)] == [6, 7]


@pytest.mark.parametrize(("misses", "ids"), [(1, {0, 1}), (2, {0})])
def test_a_track_dies(misses: int, ids: set[int]) -> None:
    rows = alone((1, x, 0.0) if t not in (6, 7) else None for t, x in enumerate(WALK))
    assert {int(i) for after in mended(rows, max_misses=misses) for i in after.track_id} == ids


def test_two_who_change_identities_for_a_moment_keep_their_own() -> None:
    # They walk 1 m apart; the tracker takes the one for the other in a single frame.
    def rows(t: int, x: float) -> list[Row]:
        return [(2, x, 0.0), (1, x, 1.0)] if t == 6 else [(1, x, 0.0), (2, x, 1.0)]

    tracks = mended([[rows(t, x)] for t, x in enumerate(WALK)])
    for after in tracks:
        by_place = dict(zip(after.box[:, 1], after.track_id, strict=True))
        assert by_place == {0.0: 0, 1.0: 1}


def test_hypotheses_keep_tracks_of_their_own() -> None:
    # Two hypotheses of who is who after a gap; the third has seen but one of them.
    def rows(t: int, x: float) -> list[list[Row]]:
        one: list[Row] = [(1, x, 0.0), (2, x, 6.0)]
        if t < 6:
            return [one] * 3
        return [one, [(3, x, 0.0), (2, x, 6.0)], one[:1]]

    tracks = mended([rows(t, x) for t, x in enumerate(WALK)])
    last = tracks[-1]
    assert_ids_are_unique(tracks)
    assert last.member.tolist() == [[True, True], [True, True], [True, False]]  # the repaired ones are shared
    assert last.track_id.tolist() == [0, 1]


@pytest.mark.parametrize("hypotheses", [1, 3])
def test_on_a_crowd(hypotheses: int) -> None:
    task = kitti_task(past=6, future=8)
    frames = random_frames(np.random.default_rng(3), 40)

    def tracks() -> list[Tracks]:
        return list(run(ReTracker(HypothesisTracker(hypotheses), KinematicPredictor()), frames, task))

    first, again = tracks(), tracks()
    assert_ids_are_unique(first)
    for one, other in zip(first, again, strict=True):
        for name in ("track_id", "box", "past", "member", "log_weight", "detection"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        taken = np.where(one.member, one.detection, -1)
        for row in taken:
            assert len(set(row[row >= 0])) == (row >= 0).sum()  # no detection twice in a hypothesis
    assert max(len(after.member) for after in first) == hypotheses


def assert_ids_are_unique(tracks: Iterable[Tracks]) -> None:
    for after in tracks:
        for row in after.member:
            assert len(set(after.track_id[row])) == row.sum()


def test_in_a_pipeline() -> None:
    predictor = KinematicPredictor()
    agent = Pipeline(ReTracker(HypothesisTracker(3), predictor), predictor, KMeansSampler())
    agent.reset(kitti_task())
    answers = [agent.act(observation(seen)) for seen in random_frames(np.random.default_rng(1), 12)]
    assert answers[-1]["object_valid"].any()


class Unlikely:
    """The kinematic predictor, with an unlikely sample before its own."""

    def __init__(self) -> None:
        self.inner = KinematicPredictor(STEADY)

    def reset(self, task: Task) -> None:
        self.inner.reset(task)

    def predict(self, frame: Frame) -> Forecasts:
        assert frame.seen
        likely = self.inner.predict(frame)
        samples = np.concatenate([likely.samples + 50.0, likely.samples], axis=1)
        return Forecasts(samples, np.tile([-9.0, 0.0], (len(samples), 1)), row=likely.row)


def test_the_likeliest_sample_counts() -> None:
    crowd = random_frames(np.random.default_rng(1), 20, objects=8, area=8.0)
    given = [ReTracker(HypothesisTracker(3), predictor) for predictor in (Unlikely(), KinematicPredictor(STEADY))]
    for one, other in zip(*(run(tracker, crowd, TASK) for tracker in given), strict=True):
        np.testing.assert_array_equal(one.track_id, other.track_id)
        np.testing.assert_array_equal(one.past, other.past)


def test_reset_forgets() -> None:
    tracker = ReTracker(Script(alone([(1, 0.0, 0.0)] * 2)), KinematicPredictor())
    for _ in range(2):
        assert [after.track_id.tolist() for after in run(tracker, [frame((0, 0, PEDESTRIAN))] * 2, TASK)] == [[0], [0]]


def test_several_hypotheses_need_parents() -> None:
    tracker = ReTracker(Script([[[(1, 0.0, 0.0)]] * 2], parents=False), KinematicPredictor())
    with pytest.raises(ShapeError, match="without stated parents"):
        list(run(tracker, [frame((0, 0, PEDESTRIAN))], TASK))
    one = ReTracker(Script(alone([(1, 0.0, 0.0)]), parents=False), KinematicPredictor())
    assert [after.track_id.tolist() for after in run(one, [frame((0, 0, PEDESTRIAN))], TASK)] == [[0]]


WRONG = [{"gate": 0.0}, {"gate": np.inf}, {"gate": np.nan}, {"min_hits": -1}, {"coasting": -1}, {"max_misses": -1}]


@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_settings_are_errors(wrong: dict[str, float]) -> None:
    with pytest.raises(ShapeError, match=next(iter(wrong))):
        ReTracker(HypothesisTracker(), KinematicPredictor(), **wrong)  # type: ignore[arg-type]


def test_distance_by_hand() -> None:
    # Kept: at 1, 2, 3, 4 from its last frame on. Seen two frames later at 2.5, going to 3.5, 4.5, ...
    kept = np.array([[[1.0, 0], [2, 0], [3, 0], [4, 0]]])
    seen = np.array([[[2.5 + step, 0] for step in range(5)]])
    # Steps of both: 2 + 0, 3 + 1, 4 + 2; always 0.5 m apart.
    assert forecast_distances(kept, np.array([2]), seen, 1.0) == pytest.approx(0.5 / np.sqrt(2))
    assert np.isinf(forecast_distances(kept, np.array([2]), seen, 0.3)).all()
    assert np.isinf(forecast_distances(kept, np.array([5]), seen, 9.0)).all()  # no frame in common


def test_bridged() -> None:
    past = np.zeros((1, 6, 7))
    past[0, :, 0] = [9, 0, 9, 9, 3, 9]
    whole, known = bridged(past, np.array([[False, True, False, False, True, False]]))
    np.testing.assert_allclose(whole[0, :, 0], [9, 0, 1, 2, 3, 9])
    assert known[0].tolist() == [False, True, True, True, True, False]


def test_smoothed_by_hand() -> None:
    past = np.zeros((1, 5, 7))
    past[0, :, 0] = [7, 0, 1, 3, 3]
    known = np.array([[False, True, True, True, True]])
    # Displacements 1 2 0. Levels 1; .5 * 2 + .5 * 1 = 1.5, trend .25; .5 * 0 + .5 * 1.75 = .875.
    expected = [7, 3 - 0.875 - 1.5 - 1, 3 - 0.875 - 1.5, 3 - 0.875, 3]
    np.testing.assert_allclose(smoothed(past, known)[0, :, 0], expected)


def test_smoothing_keeps_a_steady_walk_and_the_last_place() -> None:
    rng = np.random.default_rng(0)
    past = np.zeros((20, 8, 7))
    past[:, :, :2] = rng.normal(size=(20, 1, 2)) + np.arange(8)[:, None] * rng.normal(size=(20, 1, 2))
    known = np.ones((20, 8), dtype=bool)
    known[:10, :3] = False
    known[5:15, 6:] = False
    np.testing.assert_allclose(smoothed(past, known), past)
    rough = past + np.where(np.arange(7) < 2, rng.normal(size=past.shape), 0)
    last = known.shape[1] - 1 - known[:, ::-1].argmax(axis=1)
    after = smoothed(rough, known)
    np.testing.assert_array_equal(after[np.arange(20), last], rough[np.arange(20), last])
    np.testing.assert_array_equal(after[~known], rough[~known])


def test_other_classes_do_not_match() -> None:
    frames = [frame((0.6 * t, 0, PEDESTRIAN if t < 6 else 2)) for t in range(9)]
    rules = replace(TASK, detector="pointrcnn")
    tracks = list(run(ReTracker(HypothesisTracker(), KinematicPredictor(), coasting=0), frames, rules))
    assert tracks[-1].track_id.tolist() != tracks[0].track_id.tolist()

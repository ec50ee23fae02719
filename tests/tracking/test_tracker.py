"""The hypothesis tracker with one hypothesis: AB3DMOT's filter and life cycle with Hungarian or greedy assignment."""

from dataclasses import fields, replace

import numpy as np
import pytest

from mtp_bench.agent import Tracker
from mtp_bench.core import Observation
from mtp_bench.core.errors import ShapeError, UnknownNameError
from mtp_bench.core.tracks import Tracks
from mtp_bench.tracking import GivenTracker, HypothesisTracker, OnlineTracker, TruthTracker, score_thresholds
from mtp_bench.tracking.parameters import ClassParameters, read_detector
from tests.support.tracking_scenes import CAR, CYCLIST, PEDESTRIAN, frame, kitti_task, observation, random_frames, run

NOTHING = frame()


# Of one object, X a detection and . none; below, the track that is output: its id, lower case where it took no
# detection, and . for no output. Car: min_hits 3, max_age 2. Pedestrian: 1 and 4.
LIVES = {
    "first frame": (CAR, "X", "A"), "a recording does not wait for its first tracks": (CAR, "XXXX", "AAAA"),
    "later births wait for three detections": (CAR, "...XXXX", ".....AA"),
    "one frame without a detection is bridged": (CAR, "XXXX.XX", "AAAAaAA"),
    "two end a track": (CAR, "XXXX..XXXX", "AAAAa...BB"),
    "they do not count as detections": (CAR, "....XX.XX", ".......AA"),
    "unconfirmed and unseen twice: never output": (CAR, "....XX..XX", ".........."),
    "no detection ever": (CAR, ".....", "....."), "pedestrians are output at once": (PEDESTRIAN, "..X", "..A"),
    "pedestrians survive three": (PEDESTRIAN, "X...X", "AaaaA"), "but not four": (PEDESTRIAN, "X....X", "Aaaa.B"),
    "cyclists": (CYCLIST, "...XXX...X....", ".....AaaaAaaa."),
}  # fmt: skip


@pytest.mark.parametrize("case", LIVES)
def test_life_of_a_track(case: str) -> None:
    class_id, seen, expected = LIVES[case]
    frames = [frame((5.0, 5.0, class_id)) if mark == "X" else NOTHING for mark in seen]
    story = ""
    for tracks in run(HypothesisTracker(), frames):
        assert len(tracks.track_id) <= 1
        letter = "".join("ABCDE"[i] for i in tracks.track_id)
        story += (letter if (tracks.detection >= 0).all() else letter.lower()) or "."
    assert story == expected


@pytest.mark.parametrize("hypotheses", [1, 20])
def test_without_any_detection_there_is_one_empty_hypothesis(hypotheses: int) -> None:
    for tracks in run(HypothesisTracker(hypotheses), [NOTHING] * 4):
        assert (tracks.member.shape, tracks.past.shape) == ((1, 0), (0, 10, 7))
        np.testing.assert_array_equal(tracks.log_weight, [0.0])


@pytest.mark.parametrize(("assignment", "ids"), [("hungarian", [0, 1]), ("as_parameters", [0, 1]), ("greedy", [1, 2])])
def test_greedy_takes_the_best_pair_first_whatever_the_class(assignment: str, ids: list[int]) -> None:
    # Cars 2 m apart step by 1.2 m: the second detection of the first frame is nearest to the first one of the second.
    frames = [frame((0.0, 0.0, CAR), (2.0, 0.0, CAR)), frame((1.2, 0.0, CAR), (3.2, 0.0, CAR))]
    rule = ClassParameters("hungarian", "center_distance", 2.0, 1, 2)
    *_, tracks = run(HypothesisTracker(1, (rule,), assignment=assignment), frames, kitti_task(classes=("car",)))
    assert tracks.track_id[tracks.detection >= 0].tolist() == ids


# the object and x of one car's detections; then the tracks that are output, lower case without a detection
GIVEN: dict[str, tuple[list[tuple[int, float] | None], str]] = {
    "continues at any distance": ([(7, 0), (7, 90), (7, -900)], "AAA"),
    "takes no other detection": ([(7, 0), (7, 0), (7, 0), (-1, 0)], "AAAa"),
    "is not resumed after its end": ([(7, 0), (7, 0), (7, 0), None, None, (7, 0), (7, 0), (7, 0)], "AAAa...B"),
    "detections of no object are associated by place": ([(-1, 0), (-1, 0.1), (-1, 90)], "AAaB"),
    "a track of no object takes no object": ([(-1, 0), (-1, 0), (7, 0)], "AAaB"),
}


@pytest.mark.parametrize("case", GIVEN)
def test_a_track_with_a_given_identity(case: str) -> None:
    seen, expected = GIVEN[case]
    tracker, story = HypothesisTracker(), ""
    tracker.reset(kitti_task(observe="associated"))
    for each in seen:
        now = observation(NOTHING if each is None else frame((each[1], 0.0, CAR)))
        tracks = tracker.step({**now, "detection_id": np.array([] if each is None else [each[0]], dtype=np.int64)})
        letters = zip(tracks.track_id.tolist(), tracks.detection.tolist(), strict=True)
        story += "".join("ABC"[i] if took >= 0 else "abc"[i] for i, took in letters) or "."
    assert story == expected
    with pytest.raises(ShapeError, match='observe="associated" works with 1 hypothesis, got 2'):
        HypothesisTracker(2).reset(kitti_task(observe="associated"))


def test_the_truth_tracker_follows_true_ids() -> None:
    tracker = TruthTracker()
    tracker.reset(kitti_task(observe="truth", past=3))
    for x, ids in ((0.0, [4]), (1.0, [9, 4]), (2.0, [9]), (3.0, [9, 4])):
        seen = observation(frame(*((x + i, float(i), CAR) for i in ids)))
        tracks = tracker.step({**seen, "detection_id": np.array(ids)})
    assert (tracks.track_id.tolist(), tracks.past_valid.tolist()) == ([9, 4], [[True, True, True], [True, False, True]])
    assert tracks.past[:, :, 0].tolist() == [[10.0, 11.0, 12.0], [5.0, 0.0, 7.0]]


TRACKERS: dict[str, tuple[Tracker, str]] = {
    "one hypothesis": (HypothesisTracker(), "detections"),
    "several hypotheses": (HypothesisTracker(5), "detections"),
    "given identities": (HypothesisTracker(), "associated"),
    "ground-truth tracks": (TruthTracker(), "truth"),
    "stored tracks": (GivenTracker(), "tracks"),
    "another library": (OnlineTracker(lambda task: lambda seen: [(i, box, 1) for i, box in enumerate(seen.box)]), ""),
}


@pytest.mark.parametrize(("tracker", "observe"), TRACKERS.values(), ids=TRACKERS)
def test_after_a_hole_a_tracker_begins_as_in_a_new_scene(tracker: Tracker, observe: str) -> None:
    task, frames = kitti_task(observe=observe or "detections"), random_frames(np.random.default_rng(1), 30)

    def played(first: int) -> list[Tracks]:
        tracker.reset(task)
        tracks = []
        for t in range(first, 30):
            step = {"time": np.array(0.1 * t), "dt": np.array(2.0 if t == 15 > first else 0.1)}
            step["detection_id"] = np.arange(len(frames[t][1]))
            tracks.append(tracker.step(observation(frames[t]) | step))
        return tracks

    before, after, fresh = (played(0)[:15], played(0)[15:], played(15))
    for one, other in zip(after, fresh, strict=True):
        for name in {column.name for column in fields(Tracks)} - {"track_id", "affinity"}:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    first, second = ({i for tracks in part for i in tracks.track_id.tolist()} for part in (before, after))
    assert observe in ("truth", "tracks") or (first and second and not first & second)


def test_weak_detections_are_ignored() -> None:
    # Car, cyclist, cyclist with scores 1, 2, 3; the track says which row of the observation it took.
    seen = observation(frame((0.0, 0.0, 0), (20.0, 0.0, CYCLIST), (40.0, 0.0, CYCLIST)))

    def rows(least: float | dict[str, float] | None) -> list[int]:
        tracker = HypothesisTracker(min_detection_score=least)
        tracker.reset(kitti_task())
        return [int(row) for row in tracker.step(seen).detection]

    assert rows(None) == rows(-np.inf) == [0, 1, 2]
    assert (rows(2.0), rows({"cyclist": 2.5}), rows({"car": 9.0, "cyclist": 9.0})) == ([1, 2], [0, 2], [])
    assert rows(np.float32(2.0)) == [1, 2]  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match="unknown class in min_detection_score 'cars'"):
        rows({"cars": 1.0})


def test_score_thresholds_of_a_task() -> None:
    task, stored = kitti_task(), (read_detector("pointrcnn") or {})["min_detection_score"]
    assert score_thresholds(task) == stored
    assert score_thresholds(replace(task, detector="pointrcnn-mine", classes=("car",))) == {"car": stored["car"]}
    assert score_thresholds(replace(task, detector="wildtrack_mvdet")) == {}
    HypothesisTracker(min_detection_score=score_thresholds(task)).reset(task)


DT = 0.5
URBAN = kitti_task(classes=("car",), dt=DT, detector="nuscenes_megvii", velocity=True)


def at(x: float, velocity: float) -> Observation:
    return {**observation(frame((x, 0.0, CAR))), "detection_velocity": np.array([[velocity, 0.0]], dtype=np.float32)}


def test_a_fast_car_at_2_hz_keeps_its_identity_only_by_its_velocity() -> None:
    speed = 25.0  # m/s: 12.5 m between frames, far beyond the gate
    ids: dict[bool, set[int]] = {}
    for known in (True, False):
        tracker = HypothesisTracker()
        tracker.reset(replace(URBAN, velocity=known))
        tracks = [tracker.step(at(speed * DT * t, speed)) for t in range(4)]
        ids[known] = {int(track_id) for frame_tracks in tracks for track_id in frame_tracks.track_id}
    assert (len(ids[True]), len(ids[False])) == (1, 4)

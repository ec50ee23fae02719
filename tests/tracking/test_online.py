"""Ordinary online trackers behind the adapter: what they answer, and the tracks that it makes of it."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from mtp_bench.core import Task
from mtp_bench.core.errors import ShapeError
from mtp_bench.core.tracks import UNBORN, Tracks
from mtp_bench.tracking import BirdsEye, HypothesisTracker, OnlineDetections, OnlineTracker
from tests.support.tracking_scenes import CAR, PEDESTRIAN, Frame, at_once, frame, kitti_task, observation, random_frames

Answer = Callable[[OnlineDetections], Sequence[Any]]


def played(answer: Answer, frames: Iterable[Frame], task: Task | None = None, **options: Any) -> list[Tracks]:
    tracker = OnlineTracker(lambda task: answer, **options)
    tracker.reset(task or kitti_task())
    return [
        tracker.step({**observation(seen), "time": np.array(0.1 * t), "dt": np.array(0.1)})
        for t, seen in enumerate(frames)
    ]


def scripted(*answers: Sequence[Any]) -> Answer:
    """A tracker that says this, frame by frame, whatever it is given."""
    left = iter(answers)
    return lambda detections: next(left)


def box(x: float, y: float = 0.0) -> list[float]:
    return [x, y, 0.75, 0.0, 4.0, 1.8, 1.5]


def test_what_is_remembered_of_a_track() -> None:
    # A car moves along x, is undetected in frame 2 and coasts there.
    frames = [frame((0, 0, CAR)), frame((1, 0, CAR)), frame(), frame((3, 0, CAR))]
    *_, missed, last = played(scripted(*([("a", box(x + 0.2), 0.9)] for x in (0, 1, 2, 3))), frames)
    assert (missed.detection.tolist(), last.detection.tolist(), last.track_id.tolist()) == ([-1], [0], [0])
    assert last.hits is not None
    assert last.age is not None
    assert last.past_detection is not None
    assert (last.hits.tolist(), last.age.tolist(), missed.age.tolist()) == ([3], [4], [3])  # type: ignore[union-attr]
    assert last.box[0, 0] == pytest.approx(3.2)  # where the tracker says it is
    assert last.past[0, -4:, 0].tolist() == [0.0, 1.0, 2.2, 3.0]  # the detections, and its own box where it had none
    assert last.past_valid[0].tolist() == [False] * 6 + [True, True, False, True]
    assert last.past_detection[0].tolist() == [UNBORN] * 6 + [0, 0, -1, 0]
    assert last.last_score is not None
    assert (last.score.tolist(), last.last_score.tolist()) == ([1.0], [1.0])  # of its detections, not the tracker's 0.9
    assert (last.member.shape, last.log_weight.tolist()) == ((1, 1), [0.0])


@pytest.mark.parametrize(
    ("away", "x", "taken"), [(2, [0, 1, 2, 3], [0, -1, -1, 0]), (30, [0, 0, 0, 3], [UNBORN] * 3 + [0])]
)
def test_what_was_not_said_moved_steadily_or_is_not_known(away: int, x: list[float], taken: list[int]) -> None:
    """The detections are where the tracker says; after a long absence the window holds the return alone."""
    frames = [frame((0, 0, CAR)), *[frame()] * away, frame((3, 0, CAR))]
    last = played(scripted([(7, box(0), 1)], *[[]] * away, [(7, box(3), 1)]), frames)[-1]
    assert last.past_detection is not None
    assert (last.past[0, -4:, 0].tolist(), last.past_detection[0, -4:].tolist()) == (pytest.approx(x), taken)


def test_an_id_in_another_class_is_another_identity() -> None:
    tracks = played(scripted([(1, box(0), 1, 0)], [(1, box(0), 1, 0)]), [frame((0, 0, CAR)), frame((0, 0, PEDESTRIAN))])
    assert [t.track_id.tolist() for t in tracks] == [[0], [1]]
    assert [t.class_id.tolist() for t in tracks] == [[CAR], [PEDESTRIAN]]


@pytest.mark.parametrize("ids", [("a", "b"), (2**70, -1), (np.int64(4), 4.5), ((1, 2), frozenset())], ids=str)
def test_any_hashable_is_an_id(ids: tuple[Any, Any]) -> None:
    frames = [frame((0, 0, CAR), (20, 0, CAR))] * 2
    first, second = played(
        scripted([(ids[0], box(0), 1), (ids[1], box(20), 1)], [(ids[1], box(20), 1), (ids[0], box(0), 1)]), frames
    )
    assert (first.track_id.tolist(), second.track_id.tolist()) == ([0, 1], [1, 0])


FAR, STAYS = [frame((0, 0, CAR)), frame((3, 0, CAR))], [[("a", box(0), 1)]] * 2
TAKEN: dict[str, tuple[list[Frame], list[list[Any]], float, list[int]]] = {
    # frames, what the tracker says, gate, the detections that its tracks take in the last frame
    "the nearest, one to one": (
        [frame((0, 0, CAR), (1.8, 0, CAR))], [[("a", box(0.9), 1), ("b", box(0.1), 1)]], 2, [1, 0]),
    "of its class": (
        [FAR[0], frame((0.1, 0, PEDESTRIAN), (1.0, 0, CAR))], [[("a", box(0), 1)], [("a", box(0.2), 1)]], 2, [1]),
    "none beyond the gate": (FAR, STAYS, 2, [-1]),
    "one inside of it": (FAR, STAYS, 4, [0]),
}  # fmt: skip


@pytest.mark.parametrize("case", TAKEN)
def test_detections_that_tracks_take(case: str) -> None:
    frames, said, gate, taken = TAKEN[case]
    *_, tracks = played(scripted(*said), frames, gate=gate)
    assert (tracks.detection.tolist(), tracks.class_id.tolist()) == (taken, [CAR] * len(taken))


def test_what_never_took_a_detection_has_no_class_and_is_left_out() -> None:
    first, second = played(scripted([("a", box(50), 1)], [("a", box(0), 1)]), [frame((0, 0, CAR)), frame((0, 0, CAR))])
    assert (len(first.track_id), second.track_id.tolist()) == (0, [0])


def test_rectangles_become_the_whole_box_of_their_detection() -> None:
    view = BirdsEye(scale=20.0, padding=0.5)

    def answer(detections: OnlineDetections) -> list[Any]:
        if len(detections):
            return [("a", detections.rectangle[0] + 4.0, 1.0)]
        return [("a", [100, -20, 140, 20], 1.0)]  # coasts to (6, 0)

    seen, coasted = played(answer, [frame((2, 1, CAR)), frame()], view=view)
    np.testing.assert_allclose(seen.box, frame((2, 1, CAR))[0])
    np.testing.assert_allclose(coasted.box[0], [6, 0, *frame((2, 1, CAR))[0][0, 2:]])


def test_a_tracker_for_each_class() -> None:
    # Both count their tracks from 1.
    made: list[int] = []

    def make(task: Task) -> Answer:
        made.append(len(made))
        return lambda detections: [(1 + at, detections.box[at], 1.0, at) for at in range(len(detections))]

    tracker = OnlineTracker(make, per_class=True)
    tracker.reset(kitti_task())
    seen = frame((0, 0, PEDESTRIAN), (9, 0, CAR), (30, 0, PEDESTRIAN))
    tracks = tracker.step({**observation(seen), "time": np.array(0.0), "dt": np.array(0.1)})
    assert (made, tracks.class_id.tolist()) == ([0, 1, 2], [CAR, PEDESTRIAN, PEDESTRIAN])
    assert (tracks.detection.tolist(), len(set(tracks.track_id.tolist()))) == ([1, 0, 2], 3)


class OurOwn:
    """Our tracker in the form of an ordinary one."""

    def __init__(self, task: Task) -> None:
        self._tracker = HypothesisTracker(parameters=at_once())
        self._tracker.reset(task)

    def update(self, detections: OnlineDetections) -> list[Any]:
        """Rows that name their detections."""
        seen = observation((detections.box, detections.class_id))
        tracks = self._tracker.step({**seen, "detection_score": detections.score})
        return list(zip(tracks.track_id.tolist(), tracks.box, tracks.score, tracks.detection.tolist(), strict=True))


@pytest.mark.parametrize("seed", range(3))
def test_our_own_tracker_behind_the_adapter_says_the_same(seed: int) -> None:
    frames = random_frames(np.random.default_rng(seed), 40)
    direct, adapted = HypothesisTracker(parameters=at_once()), OnlineTracker(OurOwn)
    number: dict[int, int] = {}
    for tracker in (direct, adapted):
        tracker.reset(kitti_task())
    for t, detections in enumerate(frames):
        seen = {**observation(detections), "time": np.array(0.1 * t), "dt": np.array(0.1)}
        ours, theirs = direct.step(seen), adapted.step(seen)
        for mine, its in zip(ours.track_id.tolist(), theirs.track_id.tolist(), strict=True):
            assert number.setdefault(its, mine) == mine
        # the ids are others; what only our filter knows is not there; before birth nobody looks at the boxes
        other = ("track_id", "covariance", "affinity", "past", "parent", "log_weight")
        for name in (field.name for field in fields(Tracks) if field.name not in other):
            np.testing.assert_allclose(getattr(theirs, name), getattr(ours, name), err_msg=name)
        born = ours.past_detection != UNBORN
        np.testing.assert_allclose(theirs.past[born], ours.past[born])


WRONG: dict[str, tuple[Any, str]] = {
    "nothing": (None, r"frame 0: the tracker gave None, expected a list of \(id, box, score\)"),
    "rows of an array": (np.zeros((1, 5)), r"as row 0: expected \(id, box, score\) or \(id, box, score, detection\)"),
    "five numbers": ([(1, [0, 0, 1, 1, 0], 1)], "the box is .*, expected x y z yaw l w h"),
    "flat": ([(1, [0, 0, 0, 0, 4, 0, 1], 1)], "the box is .* with sizes above 0"),
    "nan as score": ([(1, box(0), np.nan)], "the score is nan, expected a finite number"),
    "a list as id": ([([1], box(0), 1)], "expected .* a number or a text"),
    "no id": ([(None, box(0), 1)], "the id is None, .* leave out what has no id yet"),
    "one id twice": ([(1, box(0), 1), (1, box(9), 1)], "frame 0: the tracker gave id 1 twice"),
    "one detection twice": ([(1, box(0), 1, 0), (2, box(9), 1, 0)], "gave detection 0 to two tracks"),
    "no such detection": ([(1, box(0), 1, 2)], "the detection is 2, expected -1 or one of the 2 rows"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_answer_is_one_error(case: str) -> None:
    said, message = WRONG[case]
    with pytest.raises(ShapeError, match=message):
        played(lambda detections: said, [frame((0, 0, CAR), (9, 0, CAR))])


def test_birds_eye_rectangles() -> None:
    turned = [[10.0, 5.0, 0.0, np.pi / 2, 4.0, 2.0, 1.5]]  # 4 m along y
    view = BirdsEye(scale=10.0, padding=0.5)
    rectangle = view.rectangles(np.array(turned))
    np.testing.assert_allclose(rectangle, [[85.0, 25.0, 115.0, 75.0]])
    np.testing.assert_allclose(view.centres(rectangle), [[10.0, 5.0]])
    slanted = BirdsEye(1.0).rectangles(np.array([[0, 0, 0, np.pi / 4, 2.0, 2.0, 1.0]]))
    np.testing.assert_allclose(slanted, np.sqrt(2) * np.array([[-1, -1, 1, 1]]))

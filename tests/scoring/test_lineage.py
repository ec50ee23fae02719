"""Lineages: parents of hypotheses, and events along them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mtp_bench.scoring.lineage import Hypotheses, hypotheses, lineage_events, match_hypotheses
from tests.support.scoring_scenes import CAR, WALKER, Thing, make_card, make_rollout, make_scene

CARD = make_card()
NEVER = -np.inf


def held(id: int, x: float, *by: int, class_id: int = CAR) -> Thing:
    return Thing(id, x, 0.0, class_id=class_id, hypotheses=by)


def three(by: int, *x: float) -> list[Thing]:
    """Tracks 1, 2 and 3 of a hypothesis at these places."""
    return [held(1 + i, place, by) for i, place in enumerate(x)]


SHARED = [held(id, 0, 0, 1) for id in (1, 2, 3)]
PARENTS: dict[str, tuple[list[list[Thing]], Any, list[int]]] = {
    # tracks of two frames, log-weights of the first frame, parents of hypotheses 0 and 1 in the second
    "tie: the heavier": ([[held(1, 0, 0, 1)], [held(1, 0, 0, 1)]], [-2, -1], [1, 1]),
    "tie of weights: the lower index": ([[held(1, 0, 0, 1)], [held(1, 0, 0, 1)]], [-1, -1], [0, 0]),
    "an absent hypothesis is nobody's parent": (
        [[held(1, 0, 0), held(2, 0, 1)], [held(2, 0, 0, 1)]], [0, NEVER], [0, 0]),
    "an id of another class is another track": (
        [[held(1, 0, 0), held(1, 0.5, 1, class_id=WALKER)], [held(1, 0.5, 0), held(1, 0.0, 1, class_id=WALKER)]],
        [-2, -1], [0, 1]),
    "tie up to rounding": ([three(0, 0.1, 0.2, 0.3) + three(1, 0.3, 0.2, 0.1), SHARED], [-2, -1], [1, 1]),
    "tie up to rounding, the other way": (
        [three(0, 0.3, 0.2, 0.1) + three(1, 0.1, 0.2, 0.3), SHARED], [-2, -1], [1, 1]),
    "no track at all": ([[], []], [-2, -1], [1, 1]),
}  # fmt: skip


@pytest.mark.parametrize(("tracks", "weight", "want"), PARENTS.values(), ids=PARENTS.keys())
def test_parents(tracks: list[list[Thing]], weight: Any, want: list[int]) -> None:
    rollout = make_rollout(tracks, log_weight=[weight, [-1, -1]], hypotheses=2)
    assert hypotheses(rollout, CARD).parent[1].tolist() == want


def test_best_is_the_heaviest_then_the_first() -> None:
    weight = [[-2, -1, -3], [-1, -1, -3], [NEVER, NEVER, -1], [NEVER, NEVER, NEVER]]
    found = hypotheses(make_rollout([[held(1, 0, 0, 1, 2)]] * 4, log_weight=weight, hypotheses=3), CARD)
    assert (found.best.tolist(), found.alive.sum(axis=1).tolist()) == ([1, 0, 2, 0], [3, 3, 1, 1])
    assert not found.member[3].any()  # a frame without hypotheses is one without tracks


def events(tracks: list[list[Thing]], weight: Any, h: int, truth: list[list[Thing]] | None = None) -> Any:
    """Events of one true object at the origin, along the lineage of the best hypothesis and of all."""
    scene = make_scene(truth or [[Thing(5, 0, 0)]] * len(tracks))
    rollout = make_rollout(tracks, log_weight=weight, hypotheses=h)
    found = hypotheses(rollout, CARD)
    matched = match_hypotheses(scene.truth, rollout, found.member, CARD)
    return lineage_events(scene.truth, rollout, found, matched, scene.annotated_frames), found


def test_a_change_of_rank_is_no_switch() -> None:
    # two hypotheses with different ids exchange their ranks and their weights every frame
    tracks = [[held(1, 0, t % 2), held(2, 0, 1 - t % 2)] for t in range(5)]
    got, found = events(tracks, [[-1, -2] if t % 2 else [-2, -1] for t in range(5)], 2)
    assert found.parent[1:].tolist() == [[1, 0]] * 4
    assert not got.ids.any()
    assert not got.lost.any()


def test_a_fragment_is_remembered_along_the_lineage() -> None:
    tracks = [
        [held(1, 0, 0, 1), held(8, 50, 0), held(9, 50, 1)],
        [held(1, 0, 0), held(8, 50, 0), held(9, 50, 1)],  # hypothesis 1 loses the object
        [held(1, 0, 1), held(8, 50, 1), held(7, 0, 0), held(9, 50, 0)],  # ranks change, 0 has found it again
    ]
    got, found = events(tracks, [[-1, -1]] * 3, 2)
    assert (found.parent[2].tolist(), got.lost.tolist()) == ([1, 0], [[False, False], [False, True], [False, False]])
    assert got.reacquired.tolist() == [[False, False], [False, False], [True, False]]
    assert not got.ids.any()


def test_who_says_nothing_goes_on_from_the_best_hypothesis() -> None:
    # hypothesis 0 is the best and holds the object, hypothesis 1 holds nothing; in frames 2 and 3 nothing is said
    tracks = [[held(1, 0, 0)], [held(1, 0, 0)], [], [], [held(1, 0, 0)]]
    got, found = events(tracks, [[-0.1, -3], [-0.1, -3], [NEVER, NEVER], [NEVER, NEVER], [-0.1, -3]], 2)
    assert (found.parent[2:].tolist(), np.flatnonzero(got.lost[:, 0]).tolist()) == ([[0, 0]] * 3, [2])
    assert np.flatnonzero(got.reacquired[:, 0]).tolist() == [4]


ABSENT = {
    # truth: "x" evaluated, "n" neutral, "." not there; tracks: an id, "-" none; frames of ids, lost, reacquired
    "neutral in between": ("xnx", "1-1", ([], [], [])),
    "neutral at once after a loss": ("xxnx", "1--1", ([], [1], [])),
    "found again after a neutral frame": ("xnxxx", "1-1-1", ([], [3], [4])),
    "a track on a neutral box": ("xnx", "121", ([], [], [])),
    "there all the time": ("xxxx", "1-12", ([3], [1], [2])),
}


@pytest.mark.parametrize(("seen", "stream", "want"), ABSENT.values(), ids=ABSENT.keys())
def test_a_frame_with_no_or_a_neutral_object_has_no_event(seen: str, stream: str, want: tuple[list[int], ...]) -> None:
    truth = [[] if c == "." else [Thing(5, 0, 0, neutral=c == "n")] for c in seen]
    got, _ = events([[] if c == "-" else [held(int(c), 0, 0)] for c in stream], [[0]] * len(seen), 1, truth)
    frame = make_scene(truth).truth.frame_of_rows
    assert tuple(frame[getattr(got, kind)[:, 0]].tolist() for kind in ("ids", "lost", "reacquired")) == want


def test_a_wrong_loss_is_that_of_its_own_object() -> None:
    truth = [[Thing(5, 0, 0), Thing(6, 20, 0)]] * 2
    tracks = [[held(1, 0, 0), held(2, 20, 0)], [held(1, 9, 0)]]  # 1 is still output, 2 is not
    got, _ = events(tracks, [[0]] * 2, 1, truth)
    assert (got.lost[:, 0].tolist(), got.wrong[:, 0].tolist()) == (
        [False, False, True, True],
        [False] * 2 + [True, False],
    )


def test_frames_in_which_the_lineage_is_guessed_are_counted() -> None:
    tracks = [[held(1, 0, 0), held(2, 5, 1)]] * 4
    rollout = make_rollout(tracks, log_weight=[[-1, -2], [-1, -2], [-1, NEVER], [-1, -2]], hypotheses=2)
    assert hypotheses(rollout, CARD).guessed == 2, "frame 3 has one hypothesis before it, so there is no choice"
    stated = replace(rollout, hypothesis_parent=np.array([[-1, -1], [1, 0], [0, -1], [0, 0]]))
    assert hypotheses(stated, CARD).guessed == 0


def test_what_the_best_hypothesis_of_a_frame_descends_from() -> None:
    """Best in turn are 0, 1, 0 and 1; that of frame 2 descends from 1 and 0."""
    everywhere = np.ones((4, 2), dtype=bool)
    found = Hypotheses(
        alive=everywhere, member=np.zeros((0, 2), dtype=bool), best=np.array([0, 1, 0, 1]),
        parent=np.array([[0, 0], [1, 0], [0, 1], [0, 1]]), stated=everywhere,
    )  # fmt: skip
    assert (found.seen_from(2).tolist(), found.seen_from(0).tolist()) == ([1, 0, 0, 1], [0, 1, 0, 1])
    assert found.best.tolist() == [0, 1, 0, 1]

"""Events and CLEAR counts on streams that can be read off a line; input that is wrong."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from mtp_bench.core.errors import ShapeError
from mtp_bench.scoring import find_events, history, tracking_counts

# One object, one character per frame: a letter is the id of the track on it, "-" no track on it, "." no object,
# "!" the track before is output, but 9 m away.
EVENTS = {
    # stream: ids, lost, of these "wrong", reacquired (frames)
    "aaaa": ([], [], [], []),
    "aabb": ([2], [], [], []),
    "aa-a": ([], [2], [], [3]),
    "aa-b": ([], [2], [], [3]),
    "aa!a": ([], [2], [2], [3]),
    "--aa": ([], [], [], []),
    "aa--": ([], [2], [], []),
    "a-a-": ([], [1, 3], [], [2]),
    "aba": ([1, 2], [], [], []),
    "aa.a": ([], [], [], []),
    "aa.b": ([], [], [], []),
    "a-.a": ([], [1], [], []),
    "a.-a": ([], [], [], []),
    "a.-.a": ([], [], [], []),
    "a-.a-a": ([], [1, 4], [], [5]),
    "a.-a-a": ([], [4], [], [5]),
    "----": ([], [], [], []),
    "-a-a": ([], [2], [], [3]),
    ".a": ([], [], [], []),
}


def frames_of(stream: str) -> list[Any]:
    frames, last = [], "a"
    for t, c in enumerate(stream):
        last = c if c.isalpha() else last
        tracks = [(last, [t + 9.0, 0.0])] if c == "!" else [(c, [t + 0.1, 0.0])] if c.isalpha() else []
        truth = [] if c == "." else [("g", [float(t), 0.0])]
        frames.append(
            ("s", t, [i for i, _ in truth], [x for _, x in truth], [i for i, _ in tracks], [x for _, x in tracks])
        )
    return frames


def events_of(stream: str) -> Any:
    code = {c: i for i, c in enumerate(sorted(set(stream)))}
    frame = np.array([t for t, c in enumerate(stream) if c != "."], dtype=int)
    matched, track_frame, track_id, last = [], [], [], "a"
    for t, c in enumerate(stream):
        last = c if c.isalpha() else last
        if c.isalpha() or c == "!":
            track_frame.append(t)
            track_id.append(code[last])
        if c != ".":
            matched.append(len(track_id) - 1 if c.isalpha() else -1)
    ids = np.array(track_id, dtype=int)
    objects = history(frame, np.full(len(frame), 7))
    tracks = history(np.array(track_frame, dtype=int), ids)
    return find_events(objects, np.array(matched, dtype=int), tracks, ids)


@pytest.mark.parametrize(("stream", "want"), EVENTS.items(), ids=EVENTS.keys())
def test_events_of_one_object(stream: str, want: tuple[list[int], ...]) -> None:
    found = events_of(stream)
    frame = np.array([t for t, c in enumerate(stream) if c != "."], dtype=int)
    got = found.ids, found.lost, found.wrong, found.reacquired
    assert tuple(frame[rows].tolist() for rows in got) == want
    counts = tracking_counts(frames_of(stream))
    assert (counts["ids"], counts["lost"], counts["reacquired"]) == tuple(len(want[i]) for i in (0, 1, 3))


@pytest.mark.parametrize("later", [(1, 2), (2, 1)])
def test_a_wrong_loss_is_that_of_its_object_in_any_order_of_rows(later: tuple[int, int]) -> None:
    # objects 1 and 2 are matched to tracks 11 and 12, then both are lost: 11 is still output, 12 is not
    objects = history(np.array([0, 0, 1, 1]), np.array([1, 2, *later]))
    ids = np.array([11, 12, 11])
    found = find_events(objects, np.array([0, 1, -1, -1]), history(np.array([0, 0, 1]), ids), ids)
    assert (found.lost.tolist(), found.wrong.tolist()) == ([2, 3], [2 + later.index(1)])


def test_an_identity_twice_in_a_frame_is_an_error() -> None:
    with pytest.raises(ShapeError, match="identity 4 occurs twice in frame 1"):
        history(np.array([0, 1, 1]), np.array([4, 4, 4]))


CLEAR = {  # stream: IDS, FRAG
    "aa-b": (1, 1), "aa.b": (1, 0), "aa.a": (0, 0), "a-b-a": (2, 2), "--a": (0, 0), "a--": (0, 0), "abab": (3, 0),
}  # fmt: skip


@pytest.mark.parametrize(("stream", "want"), CLEAR.items(), ids=CLEAR.keys())
def test_clear_counts_of_one_object(stream: str, want: tuple[int, int]) -> None:
    for mode in ("frame", "sticky"):
        counts = tracking_counts(frames_of(stream), mode=mode)
        assert (counts["IDS"], counts["FRAG"]) == want


# ---- frames as they come
def random_frames(rng: np.random.Generator) -> list[Any]:
    def places(count: int) -> Any:
        return rng.uniform(0, 6, (count, 2))

    frames = []
    for scene in ("s", "t"):
        for t in range(6):
            n, m = rng.integers(0, 5, 2)
            true, mine = (rng.permutation(9)[:n], places(n)), (rng.permutation(9)[:m], places(m))
            frames.append((scene, t, *true, *mine))
    return frames


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.integers(0, 10_000), st.sampled_from(["frame", "sticky"]))
def test_names_types_order_and_place_do_not_matter(seed: int, mode: Any) -> None:
    rng = np.random.default_rng(seed)
    frames = random_frames(rng)
    want = tracking_counts(frames, mode=mode)
    as_lists = [(s, t, a.tolist(), b.tolist(), c.tolist(), d.tolist()) for s, t, a, b, c, d in frames]
    assert tracking_counts(iter(as_lists), mode=mode) == want
    as_text = [(s, t, [f"car {i}" for i in a], b, [str(i) for i in c], d) for s, t, a, b, c, d in frames]
    assert tracking_counts(as_text, mode=mode) == want
    name = rng.permutation(9) * 10**12 - 5
    renamed = [(s, t, name[a], b, name[c], d) for s, t, a, b, c, d in frames]
    assert tracking_counts(renamed, mode=mode) == want
    shuffled = []
    for s, t, a, b, c, d in frames:
        p, q = rng.permutation(len(a)), rng.permutation(len(c))
        shuffled.append((s, t, a[p], b[p], c[q], d[q]))
    moved = [(s, t, a, b @ [[0, 1], [-1, 0]] + 100, c, d @ [[0, 1], [-1, 0]] + 100) for s, t, a, b, c, d in shuffled]
    for other in (shuffled, moved):
        assert tracking_counts(other, mode=mode) == pytest.approx(want)


def test_one_and_its_name_are_two_ids() -> None:
    frames: Any = [("s", 0, [1], [[0, 0]], [1], [[0, 0]]), ("s", 1, [1], [[0, 0]], ["1"], [[0, 0]])]
    assert tracking_counts(frames)["ids"] == 1
    xy = [[0, 0], [9, 9]]
    mixed: Any = [("s", 0, [1, 2], xy, [1, 2], xy), ("s", 1, [1, 2], xy, [1, "a"], xy)]
    assert tracking_counts(mixed)["ids"] == 1, "1 beside a text is the number still"
    both: Any = np.array([1, "1"], dtype=object)
    assert tracking_counts([("s", 0, both, [[0, 0], [9, 9]], both, [[0, 0], [9, 9]])])["TP"] == 2


def test_nothing_at_all() -> None:
    numbers = ("TP", "FP", "FN", "IDS", "FRAG", "MOTA", "MOTP", "ids", "lost", "reacquired")
    empty = {name: None if name in ("MOTA", "MOTP") else 0 for name in numbers}
    nothing: Any
    for nothing in ([], [("s", 0, [], [], [], [])], [("s", 0, np.zeros(0, int), np.zeros((0, 2)), (), ())]):
        assert tracking_counts(nothing) == empty


GOOD: Any = ("s", 3, [1, 2], [[0, 0], [1, 1]], [5], [[0, 0]])
IDS, XY = "expected a list of integers or strings", "expected finite metres of shape"
BAD: dict[str, tuple[Any, str]] = {
    "NaN": ([(*GOOD[:3], [[0, 0], [1, float("nan")]], *GOOD[4:])], rf"true xy of \(scene 's', t 3\) is .*nan.*{XY}"),
    "infinite": ([(*GOOD[:5], [[np.inf, 0]])], r"track xy of \(scene 's', t 3\)"),
    "true id twice": ([(*GOOD[:2], [1, 1], *GOOD[3:])], r"true ids of \(scene 's', t 3\) are \[1, 1\], expected each"),
    "track id twice": ([(*GOOD[:4], ["a", "a"], [[0, 0], [1, 1]])], "track ids of .*'a', 'a'"),
    "lengths differ": ([(*GOOD[:3], [[0, 0]], *GOOD[4:])], rf"true xy .*{XY} \(2, 2\)"),
    "three coordinates": ([(*GOOD[:5], [[0, 0, 0]])], rf"track xy .*{XY} \(1, 2\)"),
    "ragged": ([(*GOOD[:3], [[0, 0], [1]], *GOOD[4:])], f"true xy .*{XY}"),
    "text": ([(*GOOD[:5], [["a", "b"]])], f"track xy .*{XY}"),
    "frame twice": ([GOOD, GOOD], r"frame \(scene 's', t 3\) is given twice"),
    "ids are floats": ([(*GOOD[:4], [0.5], [[0, 0]])], rf"track ids of \(scene 's', t 3\) hold 0.5, {IDS}"),
    "a float beside a text": ([(*GOOD[:2], [0.5, "a"], *GOOD[3:])], f"hold 0.5, {IDS}"),
    "ids are flags": ([(*GOOD[:2], [True, False], *GOOD[3:])], f"hold True, {IDS}"),
    "no ids": ([(*GOOD[:2], None, [], *GOOD[4:])], f"hold None, {IDS}"),
    "ids as a column": ([(*GOOD[:2], np.array([[1], [2]]), *GOOD[3:])], rf"hold \[1\], {IDS}"),
    "no time": ([("s", float("nan"), *GOOD[2:])], r"t of frame \(scene 's', t nan\) is nan, expected a finite number"),
    "a time in words": ([("s", "noon", *GOOD[2:])], r"t of frame .* is 'noon', expected a finite number"),
}  # fmt: skip


@pytest.mark.parametrize(("frames", "message"), BAD.values(), ids=BAD.keys())
def test_wrong_frames_are_an_error(frames: Any, message: str) -> None:
    with pytest.raises(ShapeError, match=message):
        tracking_counts(frames)

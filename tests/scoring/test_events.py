"""Events and CLEAR counts on streams that can be read off a line."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from mtp_bench.core.errors import ShapeError
from mtp_bench.scoring import history
from mtp_bench.scoring.lineage import hypotheses, lineage_events, match_hypotheses
from tests.support.scoring_scenes import Thing, make_card, make_rollout, make_scene
from tests.support.tracking_counts import tracking_counts

# One object, one character per frame: a letter is the id of the track on it, "-" no track on it, "." no object,
# "!" the track before is output, but 9 m away.
EVENTS = {
    # stream: frames of ids, lost, of these "wrong", reacquired
    "aaaa": ([], [], [], []),
    "aabb": ([2], [], [], []),
    "aa-a": ([], [2], [], [3]),
    "aa-b": ([], [2], [], [3]),
    "aa!a": ([], [2], [2], [3]),
    "aa-!": ([], [2], [], []),
    "--aa": ([], [], [], []),
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


def tracks_of(stream: str) -> list[list[tuple[str, float]]]:
    """Id and distance from the object, of the track of each frame."""
    ids = list[str]()
    for c in stream:
        ids.append(c if c.isalpha() or not ids else ids[-1])
    away = {"!": 9.0, "-": None, ".": None}
    found = [(id, away.get(c, 0.1)) for id, c in zip(ids, stream, strict=True)]
    return [[] if x is None else [(id, x)] for id, x in found]


def frames_of(stream: str) -> list[Any]:
    rows = [([], []) if c == "." else (["g"], [[0.0, 0.0]]) for c in stream]
    sides = [([id for id, _ in track], [[x, 0.0] for _, x in track]) for track in tracks_of(stream)]
    return [("s", t, *rows[t], *sides[t]) for t in range(len(stream))]


@pytest.mark.parametrize("stream", EVENTS)
def test_events_of_one_object(stream: str) -> None:
    """The same frame by frame, and along the lineage of one hypothesis."""
    want = EVENTS[stream]
    counts = tracking_counts(frames_of(stream))
    assert (counts["ids"], counts["lost"], counts["reacquired"]) == tuple(len(want[i]) for i in (0, 1, 3))
    tracks = [[Thing(ord(id), x, 0) for id, x in track] for track in tracks_of(stream)]
    scene = make_scene([[] if c == "." else [Thing(7, 0, 0)] for c in stream])
    rollout, card = make_rollout(tracks), make_card()
    lineage = hypotheses(rollout, card)
    matched = match_hypotheses(scene.truth, rollout, lineage.member, card)
    found = lineage_events(scene.truth, rollout, lineage, matched, scene.annotated_frames)
    kinds = (found.ids, found.lost, found.wrong, found.reacquired)
    assert tuple(scene.truth.frame_of_rows[kind[:, 0]].tolist() for kind in kinds) == want


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

"""CLEAR counts and identity events of tracks that are given frame by frame, made of the scorer's own pieces.

The golden results of other programs and `benchmarks/scorer.py` count frames in this form.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from itertools import count
from typing import Any, Literal, NamedTuple

import numpy as np

from mtp_bench.core import Floats, Ints
from mtp_bench.scoring import Pairs, history, match, match_sticky
from mtp_bench.scoring.events import History, clear_identity
from mtp_bench.scoring.pairs import near_pairs

Frame = tuple[Any, ...]  # scene, t, true ids, true xy, track ids, track xy


class Events(NamedTuple):
    """Rows of the truth where an object's identity has an event, ascending."""

    ids: Ints
    lost: Ints
    reacquired: Ints


def find_events(objects: History, matched: Ints, track_id: Ints) -> Events:
    """Events of one stream of tracks, object by object.

    ``objects``: history of the true boxes [R]; ``matched`` [R]: row of the track of each true box, -1 if none;
    ``track_id``: id of each track row. Where frames without the object lie between two of its boxes, no event is
    counted.
    """
    rows: dict[str, list[int]] = {"ids": [], "lost": [], "reacquired": []}
    had_match = False
    last = -1  # track row of the row before
    for row, consecutive in zip(objects.order.tolist(), objects.consecutive.tolist(), strict=True):
        track = int(matched[row])
        if not consecutive:
            had_match, last = False, -1
        if track < 0 and last >= 0:
            rows["lost"].append(row)
        if track >= 0 and last >= 0 and track_id[track] != track_id[last]:
            rows["ids"].append(row)
        if track >= 0 and last < 0 and had_match:
            rows["reacquired"].append(row)
        had_match |= track >= 0
        last = track
    return Events(**{kind: np.sort(np.array(found, dtype=np.int64)) for kind, found in rows.items()})


class _Positions(NamedTuple):
    """Rows of all frames of all scenes, sorted by scene and time."""

    frame: Ints  # [R]
    identity: Ints  # [R] unique over the scenes
    xy: Floats  # [R, 2] m
    history: History


def tracking_counts(
    frames: Iterable[Frame], gate: float = 2.0, mode: Literal["frame", "sticky"] = "frame"
) -> dict[str, float | None]:
    """Counts of tracks against truth by BEV centre distance: CLEAR's, and the events of this benchmark.

    ``gate``, m, is inclusive. "frame" matches without memory, "sticky" keeps the pairs of the previous frame.
    """
    scenes: dict[Any, int] = {}
    ordered = sorted(frames, key=lambda frame: (scenes.setdefault(frame[0], len(scenes)), frame[1]))
    truth, tracks = _positions(ordered, 2), _positions(ordered, 4)
    pairs = Pairs(*near_pairs(truth.frame, truth.xy, tracks.frame, tracks.xy, gate))
    if mode == "frame":
        matched = match(pairs, len(truth.xy))
    else:
        matched = match_sticky(pairs, len(truth.xy), truth.history.previous(), tracks.history.previous())
    events = find_events(truth.history, matched, tracks.identity)
    switches, fragments = clear_identity(truth.history, matched, tracks.identity)
    row = np.flatnonzero(matched >= 0)
    misses, false = len(truth.xy) - len(row), len(tracks.xy) - len(row)
    distance = np.hypot(*(truth.xy[row] - tracks.xy[matched[row]]).T)
    return {
        "TP": len(row),
        "FP": false,
        "FN": misses,
        "IDS": len(switches),
        "FRAG": len(fragments),
        "MOTA": 1.0 - (misses + false + len(switches)) / len(truth.xy) if len(truth.xy) else None,
        "MOTP": float(distance.mean()) if len(row) else None,
        "ids": len(events.ids),
        "lost": len(events.lost),
        "reacquired": len(events.reacquired),
    }


def _positions(frames: Sequence[Frame], column: int) -> _Positions:
    """Rows of the ids at ``column`` of each frame and of the positions behind them; ids count per scene."""
    unused = count()
    codes: dict[Any, Any] = defaultdict(lambda: defaultdict(unused.__next__))
    identity = [codes[frame[0]][number] for frame in frames for number in np.asarray(frame[column], object).tolist()]
    sizes = [len(frame[column]) for frame in frames]
    frame = np.repeat(np.arange(len(frames)), sizes)
    xy = np.concatenate([np.zeros((0, 2)), *(np.reshape(frame[column + 1], (-1, 2)) for frame in frames)])
    identities = np.array(identity, dtype=np.int64)
    return _Positions(frame, identities, xy, history(frame, identities))

"""CLEAR MOT metrics and identity events (docs/definitions, "Events") of tracks that are given frame by frame."""

import reprlib
from collections import defaultdict
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from itertools import count, pairwise
from numbers import Real
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..core import Floats, Ints, ShapeError
from .events import History, clear_identity, find_events, history
from .matching import match, match_sticky
from .pairs import Pairs, near_pairs

Frame = tuple[
    Hashable, float, ArrayLike, ArrayLike, ArrayLike, ArrayLike
]  # scene, t, true ids, xy, track ids, xy
Mode = Literal["frame", "sticky"]


def tracking_counts(
    frames: Iterable[Frame], gate: float = 2.0, mode: Mode = "frame"
) -> dict[str, int | float | None]:
    """``TP FP FN IDS FRAG MOTA MOTP ids lost reacquired`` of tracks against truth, by BEV centre distance.

    ``frames`` iterates (scene, t, true ids [M], true xy [M, 2], track ids [N], track xy [N, 2]) in metres; ids are
    integers or strings; lists or arrays, which may be empty; scenes may be interleaved. ``gate`` is inclusive. All
    numbers come from the matching of ``mode``: "frame" has no memory, "sticky" keeps the pairs of the previous frame.
    ``IDS`` and ``FRAG`` are CLEAR's, ``ids``, ``lost`` and ``reacquired`` the events of this benchmark; MOTP is the
    mean distance of matched pairs, metres. None stands for an undefined number. Raises ShapeError for a negative gate,
    an unknown mode, ids or positions of another shape or type, a time or a position that is not finite,
    and an id or a frame that occurs twice.
    """
    if not (np.isfinite(gate) and gate >= 0):
        raise ShapeError(f"gate is {gate}, expected a distance of 0 m or more")
    truth, tracks = _read_frames(frames)
    pairs = Pairs(*near_pairs(truth.frame, truth.xy, tracks.frame, tracks.xy, gate))
    if mode == "frame":
        matched = match(pairs, len(truth))
    elif mode == "sticky":
        matched = match_sticky(
            pairs, len(truth), truth.history.previous(), tracks.history.previous()
        )
    else:
        raise ShapeError(f"mode is {mode!r}, expected 'frame' or 'sticky'")
    events = find_events(truth.history, matched, tracks.history, tracks.identity)
    switches, fragments = clear_identity(truth.history, matched, tracks.identity)
    row = np.flatnonzero(matched >= 0)
    tp = len(row)
    fn, fp = len(truth) - tp, len(tracks) - tp
    gap = truth.xy[row] - tracks.xy[matched[row]]
    return {
        "TP": tp,
        "FP": fp,
        "FN": fn,
        "IDS": len(switches),
        "FRAG": len(fragments),
        "MOTA": 1.0 - (fn + fp + len(switches)) / len(truth) if len(truth) else None,
        "MOTP": float(np.hypot(gap[:, 0], gap[:, 1]).mean()) if tp else None,
        "ids": len(events.ids),
        "lost": len(events.lost),
        "reacquired": len(events.reacquired),
    }


@dataclass(frozen=True, eq=False)
class _Positions:
    """Rows of all frames of all scenes, sorted by scene and time."""

    frame: Ints  # [R]
    identity: Ints  # [R] unique over the scenes
    xy: Floats  # [R, 2] m
    history: History

    def __len__(self) -> int:
        return len(self.frame)


def _read_frames(frames: Iterable[Frame]) -> tuple[_Positions, _Positions]:
    """Truth and tracks of ``frames``; raises ShapeError, with the scene and t, for what `tracking_counts` names."""
    given = list(frames)
    scenes: dict[Hashable, int] = {}
    keys = [(scenes.setdefault(frame[0], len(scenes)), _time(frame)) for frame in given]
    order = sorted(range(len(given)), key=keys.__getitem__)
    for before, after in pairwise(order):
        if keys[before] == keys[after]:
            raise ShapeError(
                f"frame {_where(given[after])} is given twice, expected once"
            )
    ordered = [given[i] for i in order]
    return _positions(ordered, 2, "true"), _positions(ordered, 4, "track")


def _positions(frames: Sequence[Frame], place: int, name: str) -> _Positions:
    """The ids at ``place`` of each frame, and the positions behind them."""
    unused = count()
    codes: dict[Hashable, dict[Hashable, int]] = defaultdict(
        lambda: defaultdict(unused.__next__)
    )
    identity, points = list[int](), list[Floats]()
    for frame in frames:
        ids = _ids(frame, place, name)
        if len(set(ids)) < len(ids):
            raise ShapeError(
                f"{name} ids of {_where(frame)} are {ids}, expected each id once"
            )
        identity += map(codes[frame[0]].__getitem__, ids)
        points.append(_points(frame, place + 1, len(ids), name))
    rows = np.repeat(np.arange(len(frames)), [len(each) for each in points])
    numbers, xy = (
        np.array(identity, dtype=np.int64),
        np.concatenate([np.zeros((0, 2)), *points]),
    )
    if not np.isfinite(xy).all():
        for frame, each in zip(frames, points, strict=True):
            _points(frame, place + 1, len(each), name, finite=True)
    return _Positions(rows, numbers, xy, history(rows, numbers))


def _where(frame: Frame) -> str:
    return f"(scene {frame[0]!r}, t {frame[1]})"


def _time(frame: Frame) -> float:
    if not isinstance(frame[1], Real) or not np.isfinite(frame[1]):
        raise ShapeError(
            f"t of frame {_where(frame)} is {frame[1]!r}, expected a finite number"
        )
    return float(frame[1])


def _ids(frame: Frame, place: int, name: str) -> list[int | str]:
    """Ids [M] of a frame."""
    given: Any = frame[place]
    try:
        ids: list[Any] = list(
            given.tolist() if isinstance(given, np.ndarray) else given
        )
    except TypeError:
        ids = [given]
    plain = {int, str}.issuperset(map(type, ids))
    odd = (
        []
        if plain
        else [
            i
            for i in ids
            if isinstance(i, bool) or not isinstance(i, int | str | np.integer)
        ]
    )
    if odd:
        raise ShapeError(
            f"{name} ids of {_where(frame)} hold {odd[0]!r}, expected a list of integers or strings"
        )
    return ids


def _points(
    frame: Frame, place: int, count: int, name: str, finite: bool = False
) -> Floats:
    """Positions [M, 2] of a frame with ``count`` ids, m; ``finite``: they must be."""
    try:
        xy = np.asarray(frame[place], dtype=np.float64)
    except (TypeError, ValueError):
        xy = np.zeros(0)
    if xy.size == count == 0:
        return np.zeros((0, 2))
    if xy.shape != (count, 2) or (finite and not np.isfinite(xy).all()):
        got = f"{name} xy of {_where(frame)} is {reprlib.repr(frame[place])}"
        raise ShapeError(f"{got}, expected finite metres of shape {(count, 2)}")
    return xy

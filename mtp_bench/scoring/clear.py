"""CLEAR MOT and the protocol's events of tracks that are given frame by frame (protocol, "Events")."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ShapeError
from .events import History, clear_identity, find_events, history
from .matching import match, match_sticky
from .pairs import Pairs, near_pairs

Frame = tuple[Hashable, float, ArrayLike, ArrayLike, ArrayLike, ArrayLike]  # scene, t, true ids, xy, track ids, xy
Mode = Literal["frame", "sticky"]


def tracking_counts(frames: Iterable[Frame], gate: float = 2.0, mode: Mode = "frame") -> dict[str, int | float | None]:
    """``TP FP FN IDS FRAG MOTA MOTP ids lost reacquired`` of tracks against truth, by BEV centre distance.

    ``frames`` iterates (scene, t, true ids [M], true xy [M, 2], track ids [N], track xy [N, 2]) in metres; ids are
    integers or strings; lists or arrays, which may be empty; scenes may be interleaved. ``gate`` is inclusive. All
    numbers come from the matching of ``mode``: "frame" has no memory, "sticky" keeps the pairs of the previous frame.
    ``IDS`` and ``FRAG`` are CLEAR's, ``ids``, ``lost`` and ``reacquired`` the protocol's events; MOTP is the mean
    distance of matched pairs, metres. None stands for an undefined number. Raises ShapeError for a
    negative gate, an unknown mode, ids or positions of another shape or type, a time or a position that is not finite,
    and an id or a frame that occurs twice.
    """
    if not (np.isfinite(gate) and gate >= 0):
        raise ShapeError(f"gate is {gate}, expected a distance of 0 m or more")
    truth, tracks = read_frames(frames)
    pairs = Pairs(*near_pairs(truth.frame, truth.xy, tracks.frame, tracks.xy, gate))
    if mode == "frame":
        matched = match(pairs, len(truth))
    elif mode == "sticky":
        matched = match_sticky(pairs, len(truth), truth.history.previous(), tracks.history.previous())
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
class PositionTable:
    """Rows of all frames of all scenes, numbered through; sorted by frame."""

    frame: NDArray[np.intp]  # [R]
    identity: NDArray[np.int64]  # [R] unique over the scenes
    xy: NDArray[np.float64]  # [R, 2] m
    history: History

    def __len__(self) -> int:
        return len(self.frame)


def read_frames(frames: Iterable[Frame]) -> tuple[PositionTable, PositionTable]:
    """Truth and tracks of ``frames``, each (scene, t, true ids, true xy, track ids, track xy).

    Scenes may be interleaved; within a scene frames follow one another in the order of t. Ids are integers or strings.
    Raises ShapeError, with the scene and t, for ids or positions of another shape or type, an id twice in a frame, a
    frame given twice, or a time or a position that is not finite.
    """
    ordered = list(frames)
    scenes: dict[Hashable, int] = {}
    scene = np.array([scenes.setdefault(f[0], len(scenes)) for f in ordered], dtype=np.intp)
    time = np.array([_time(f) for f in ordered], dtype=np.float64)
    order = np.lexsort((time, scene))
    scene, time = scene[order], time[order]
    again = np.flatnonzero((scene[1:] == scene[:-1]) & (time[1:] == time[:-1]))
    if len(again):
        raise ShapeError(f"frame {_where(ordered[order[again[0]]])} is given twice, expected once")
    ordered = [ordered[i] for i in order]
    return _table(ordered, 2, "true", scene), _table(ordered, 4, "track", scene)


def _where(frame: Frame) -> str:
    return f"(scene {frame[0]!r}, t {frame[1]})"


def _time(frame: Frame) -> float:
    """The t of a frame."""
    try:
        time = float(frame[1])
    except (TypeError, ValueError):
        time = np.nan
    if not np.isfinite(time):
        raise ShapeError(f"t of frame {_where(frame)} is {frame[1]!r}, expected a finite number")
    return time


def _ids(frame: Frame, given: Any, name: str) -> NDArray[Any]:
    """Ids [M] of a frame: integers, text, or objects that are one of both."""
    try:
        ids = np.asarray(given)
    except ValueError:
        raise _no_ids(frame, name, "are lists of several lengths") from None
    if ids.ndim != 1:
        raise _no_ids(frame, name, f"have shape {ids.shape}")
    if not len(ids) or ids.dtype.kind in "iu" or (ids.dtype.kind == "U" and isinstance(given, np.ndarray)):
        return ids
    each = list(ids if isinstance(given, np.ndarray) else given)
    odd = [type(i).__name__ for i in each if isinstance(i, bool) or not isinstance(i, int | str | np.integer)]
    if odd:
        raise _no_ids(frame, name, f"have type {odd[0] if ids.dtype.kind in 'UO' else ids.dtype}")
    return np.array(each, dtype=object)  # numpy itself would make text of 1 beside "a"


def _no_ids(frame: Frame, name: str, got: str) -> ShapeError:
    return ShapeError(f"{name} ids {got}, expected integers or strings, one per object {_where(frame)}")


def _points(frame: Frame, given: Any, count: int, name: str) -> NDArray[np.float64]:
    """Positions [M, 2] of a frame with ``count`` ids, m."""
    try:
        xy = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise ShapeError(
            f"{name} xy of {_where(frame)} is not an array of numbers, expected {(count, 2)} metres"
        ) from None
    if xy.shape != (count, 2) and not (count == 0 and xy.size == 0):
        raise ShapeError(f"{name} xy of {_where(frame)} has shape {xy.shape}, expected {(count, 2)}: one per id")
    return xy


def _table(frames: Sequence[Frame], place: int, name: str, scene: NDArray[np.intp]) -> PositionTable:
    ids = [_ids(f, f[place], name) for f in frames]
    points = [_points(f, f[place + 1], len(i), name) for f, i in zip(frames, ids, strict=True)]
    count = np.array([len(i) for i in ids], dtype=np.intp)
    filled = [i for i in range(len(frames)) if count[i] > 0]
    xy = np.concatenate([points[i] for i in filled]) if filled else np.zeros((0, 2))
    frame, of_scene = np.repeat(np.arange(len(frames), dtype=np.intp), count), np.repeat(scene, count)
    bad = np.flatnonzero(~np.isfinite(xy).all(axis=1))
    if len(bad):
        at = _where(frames[int(frame[bad[0]])])
        raise ShapeError(f"{name} xy of {at} holds {xy[bad[0]].tolist()}, expected finite metres")
    code = _codes([ids[i] for i in filled])
    identity = of_scene * (int(code.max(initial=0)) + 1) + code
    try:
        past = history(frame, identity)
    except ShapeError:
        raise ShapeError(_twice(frames, ids, name)) from None
    return PositionTable(frame, identity, xy, past)


def _codes(ids: list[NDArray[Any]]) -> NDArray[np.int64]:
    """Numbers from 0 on, equal for equal ids."""
    if ids and all(part.dtype.kind in "iu" for part in ids):
        whole = np.concatenate(ids)
        least, most = int(whole.min()), int(whole.max())
        if whole.dtype.kind in "iu" and most - least < 1 << 31 and most < 1 << 62 and least > -(1 << 62):
            return np.asarray(whole.astype(np.int64) - least)
    # of several kinds: 1 and "1" are two ids
    codes: dict[Hashable, int] = {}
    return np.array([codes.setdefault(i, len(codes)) for part in ids for i in part.tolist()], dtype=np.int64)


def _twice(frames: Sequence[Frame], ids: list[NDArray[Any]], name: str) -> str:
    """The text of the error about an id that occurs twice in a frame."""
    for frame, part in zip(frames, ids, strict=True):
        known: set[Hashable] = set()
        for i in part.tolist():
            if i in known:
                return f"{name} id {i!r} occurs twice in frame {_where(frame)}, expected once"
            known.add(i)
    return f"a {name} id occurs twice in a frame, expected once"

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
    distance of matched pairs, metres. MOTA is None without truth, MOTP without a match. Raises ShapeError for a
    negative gate, an unknown mode, a position that is not finite or an id twice in a frame.
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
class Table:
    """Rows of all frames of all scenes, numbered through; sorted by frame."""

    frame: NDArray[np.intp]  # [R]
    identity: NDArray[np.int64]  # [R] unique over the scenes
    xy: NDArray[np.float64]  # [R, 2] m
    history: History

    def __len__(self) -> int:
        return len(self.frame)


def read_frames(frames: Iterable[Frame]) -> tuple[Table, Table]:
    """Truth and tracks of ``frames``, each (scene, t, true ids, true xy, track ids, track xy).

    Scenes may be interleaved; within a scene frames follow one another in the order of t. Ids are integers or strings.
    Raises ShapeError, with the scene and t, for lengths that do not fit, an id twice in a frame, a frame given twice,
    or a position not finite.
    """
    ordered = list(frames)
    scenes: dict[Hashable, int] = {}
    scene = np.array([scenes.setdefault(f[0], len(scenes)) for f in ordered], dtype=np.intp)
    time = np.array([f[1] for f in ordered], dtype=np.float64)
    order = np.lexsort((time, scene))
    scene, time = scene[order], time[order]
    again = np.flatnonzero((scene[1:] == scene[:-1]) & (time[1:] == time[:-1]))
    if len(again):
        raise ShapeError(f"frame {_where(ordered[order[again[0]]])} is given twice, expected once")
    ordered = [ordered[i] for i in order]
    return _table(ordered, 2, "true", scene), _table(ordered, 4, "track", scene)


def _where(frame: Frame) -> str:
    return f"(scene {frame[0]!r}, t {frame[1]})"


def _table(frames: Sequence[Frame], place: int, name: str, scene: NDArray[np.intp]) -> Table:
    ids = [np.asarray(f[place]) for f in frames]
    points = [np.asarray(f[place + 1], dtype=np.float64) for f in frames]
    count = np.array([len(i) if i.ndim else -1 for i in ids], dtype=np.intp)
    for i, (want, xy) in enumerate(zip(count, points, strict=True)):
        if xy.shape != (want, 2) and not (want == 0 and xy.size == 0):
            raise ShapeError(
                f"{name} xy of {_where(frames[i])} has shape {xy.shape}, expected {(max(int(want), 0), 2)}: one per id"
            )
    filled = [i for i in range(len(frames)) if count[i] > 0]
    xy = np.concatenate([points[i] for i in filled]) if filled else np.zeros((0, 2))
    frame, of_scene = np.repeat(np.arange(len(frames), dtype=np.intp), count), np.repeat(scene, count)
    bad = np.flatnonzero(~np.isfinite(xy).all(axis=1))
    if len(bad):
        at = _where(frames[int(frame[bad[0]])])
        raise ShapeError(f"{name} xy of {at} holds {xy[bad[0]].tolist()}, expected finite metres")
    code = _codes([ids[i] for i in filled], f"{name} ids")
    identity = of_scene * (int(code.max(initial=0)) + 1) + code
    try:
        past = history(frame, identity)
    except ShapeError:
        raise ShapeError(_twice(frames, ids, name)) from None
    return Table(frame, identity, xy, past)


def _codes(ids: list[NDArray[Any]], name: str) -> NDArray[np.int64]:
    """Numbers from 0 on that are equal where the ids are."""
    other = [part.dtype for part in ids if part.dtype.kind not in "iuUO"]
    if other:
        raise ShapeError(f"{name} have type {other[0]}, expected integers or strings")
    if ids and all(part.dtype.kind in "iu" for part in ids):
        whole = np.concatenate(ids)
        least, most = int(whole.min()), int(whole.max())
        if most - least < 1 << 31 and most < 1 << 62 and least > -(1 << 62):
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

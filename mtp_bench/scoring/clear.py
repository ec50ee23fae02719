"""CLEAR MOT metrics and identity events of tracks that are given frame by frame.

Definitions: docs/definitions, "Events".
"""

import reprlib
from collections import defaultdict
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from itertools import count
from numbers import Real
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..core import Floats, Ints, ShapeError
from .events import History, clear_identity, find_events, history
from .matching import match, match_sticky
from .pairs import Pairs, near_pairs

# scene, t, true ids, true xy, track ids, track xy
Frame = tuple[Hashable, float, ArrayLike, ArrayLike, ArrayLike, ArrayLike]
Mode = Literal["frame", "sticky"]
_ID_TYPES = (int, str, np.integer)


def tracking_counts(
    frames: Iterable[Frame], gate: float = 2.0, mode: Mode = "frame"
) -> dict[str, int | float | None]:
    """Return tracking counts of tracks against truth, by BEV centre distance.

    They are ``TP FP FN IDS FRAG MOTA MOTP ids lost reacquired``. ``frames`` iterates
    (scene, t, true ids [M], true xy [M, 2], track ids [N], track xy [N, 2]) in metres;
    ids are integers or strings; lists or arrays, which may be empty; scenes may be
    interleaved. ``gate`` is inclusive. All numbers come from the matching of ``mode``:
    "frame" has no memory, "sticky" keeps the pairs of the previous frame.

    ``IDS`` and ``FRAG`` are CLEAR's, ``ids``, ``lost`` and ``reacquired`` the events of
    this benchmark; MOTP is the mean distance of matched pairs, metres. None stands for
    an undefined number. Raises ShapeError for a negative gate, an unknown mode, ids or
    positions of another shape or type, a time or a position that is not finite, and an
    id or a frame that occurs twice.
    """
    if not (np.isfinite(gate) and gate >= 0):
        raise ShapeError(f"gate is {gate}, expected a distance of 0 m or more")
    ordered = _ordered(frames)
    truth = _positions(ordered, column=2, name="true")
    tracks = _positions(ordered, column=4, name="track")
    pairs = Pairs(*near_pairs(truth.frame, truth.xy, tracks.frame, tracks.xy, gate))
    if mode == "frame":
        matched = match(pairs, len(truth.xy))
    elif mode == "sticky":
        matched = match_sticky(
            pairs, len(truth.xy), truth.history.previous(), tracks.history.previous()
        )
    else:
        raise ShapeError(f"mode is {mode!r}, expected 'frame' or 'sticky'")
    events = find_events(truth.history, matched, tracks.identity)
    switches, fragments = clear_identity(truth.history, matched, tracks.identity)
    row = np.flatnonzero(matched >= 0)
    tp = len(row)
    fn = len(truth.xy) - tp
    fp = len(tracks.xy) - tp
    errors = fn + fp + len(switches)
    offset = truth.xy[row] - tracks.xy[matched[row]]
    return {
        "TP": tp,
        "FP": fp,
        "FN": fn,
        "IDS": len(switches),
        "FRAG": len(fragments),
        "MOTA": 1.0 - errors / len(truth.xy) if len(truth.xy) else None,
        "MOTP": float(np.hypot(offset[:, 0], offset[:, 1]).mean()) if tp else None,
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


def _ordered(frames: Iterable[Frame]) -> list[Frame]:
    """Return the frames by scene and time.

    Raises ShapeError if one occurs twice.
    """
    scenes: dict[Hashable, int] = {}
    frame_at: dict[tuple[int, float], Frame] = {}
    for frame in frames:
        scene, time = frame[:2]
        if not isinstance(time, Real) or not np.isfinite(time):
            raise ShapeError(
                f"t of frame {_where(frame)} is {time!r}, expected a finite number"
            )
        key = scenes.setdefault(scene, len(scenes)), float(time)
        if key in frame_at:
            raise ShapeError(f"frame {_where(frame)} is given twice, expected once")
        frame_at[key] = frame
    return [frame_at[key] for key in sorted(frame_at)]


def _positions(frames: Sequence[Frame], column: int, name: str) -> _Positions:
    """Read the ids at ``column`` of each frame, and the positions behind them."""
    # by scene, each new id gets the next unused number
    unused = count()
    codes: dict[Hashable, dict[Hashable, int]] = defaultdict(
        lambda: defaultdict(unused.__next__)
    )
    identities: list[int] = []
    positions: list[Floats] = [np.zeros((0, 2))]
    for frame in frames:
        try:
            ids = _ids(frame[column])
            positions.append(_xy(frame[column + 1], len(ids)))
        except (TypeError, ValueError):
            raise _content_error(frame, column, name) from None
        scene_codes = codes[frame[0]]
        identities += [scene_codes[track_id] for track_id in ids]
    frame_index = np.repeat(np.arange(len(frames)), [len(xy) for xy in positions[1:]])
    identity = np.array(identities, dtype=np.int64)
    xy = np.concatenate(positions)
    infinite = ~np.isfinite(xy).all(axis=1)
    if infinite.any():
        raise _content_error(frames[frame_index[infinite][0]], column, name)
    return _Positions(frame_index, identity, xy, history(frame_index, identity))


def _where(frame: Frame) -> str:
    return f"(scene {frame[0]!r}, t {frame[1]})"


def _ids(content: Any) -> list[int | str]:
    """Return distinct ids.

    Raises TypeError or ValueError for other content.
    """
    ids = list(content.tolist() if isinstance(content, np.ndarray) else content)
    kinds = set(map(type, ids))
    if any(kind is bool or not issubclass(kind, _ID_TYPES) for kind in kinds):
        raise ValueError
    if len(set(ids)) < len(ids):
        raise ValueError
    return ids


def _xy(content: Any, ids: int) -> Floats:
    """Return positions [ids, 2].

    Raises TypeError or ValueError for other content.
    """
    xy = np.asarray(content, dtype=np.float64)
    if ids == 0 and xy.size == 0:  # of any shape
        return np.zeros((0, 2))
    if xy.shape != (ids, 2):
        raise ValueError
    return xy


def _content_error(frame: Frame, column: int, name: str) -> ShapeError:
    ids, xy = map(reprlib.repr, frame[column : column + 2])
    return ShapeError(
        f"{name} ids and xy of {_where(frame)} are {ids} and {xy}, expected distinct "
        "integers or strings, and a finite position (x, y) in metres for each"
    )
